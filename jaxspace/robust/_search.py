"""Design optimisation under dispersion, on a sample that is drawn once.

    minimise S_0(f(x, w_1), ..., f(x, w_n))   subject to   S_k(...) <= a_k,   a <= x <= b

    symbol  meaning
    x       unknowns of the design
    w_i     random inputs of run i: the same numbers for every design
    f       outputs of a run
    S_0     statistic that is minimised; S_k with its limit a_k: those that are constrained

With common random numbers, the sum over the runs is a smooth function of x, whose gradient is that
of the runs, through their events and phases. Its minimum converges to that of the distribution
like 1/sqrt(n), and faster on Sobol points.
Source: Shapiro, Dentcheva and Ruszczynski, Lectures on Stochastic Programming, chapter 5.
"""

import math
import os
from collections.abc import Sequence
from typing import Any

from jaxtyping import PyTree

from ..core import InputError, Scalar
from ..integration.accuracy import Accuracy
from ..minimisation import Progress
from ..minimisation import minimise as search_minimum
from ..minimisation.batch_descent import FORWARD_RATIO
from ..minimisation.search_store import SearchStore, as_store
from ._optimum import DesignOptimum
from ._runs import CampaignOf, Design, Problem, enough_runs, failures, problem_of
from .statistics import AbstractStatistic, Constraint

# A power of two, in which Sobol points fill the unit cube evenly.
RUNS = 1024
"""Default minimum number of runs."""


def optimise_design(
    campaign: CampaignOf,
    start: Design,
    *,
    minimise: AbstractStatistic | None = None,
    maximise: AbstractStatistic | None = None,
    subject_to: Sequence[Constraint] = (),
    bounds: tuple[PyTree, PyTree] | None = None,
    scale: PyTree | None = None,
    optimiser: Any = "sqp",
    runs: int | None = None,
    seed: int = 0,
    nominal: bool = False,
    accuracy: Accuracy | Scalar | None = None,
    may_fail: float = 0.0,
    tolerance: Scalar = 1e-4,
    max_steps: int = 200,
    progress: Progress | None = None,
    store: str | os.PathLike[str] | None = None,
    resume: bool = False,
) -> DesignOptimum:
    """The optimal design under dispersion.

    **Arguments**

    - `campaign`: a function from a design to its `Campaign`. Mission, outputs and distributions may
      depend on the design. Runs follow the campaign's sampling `design`, or Sobol points.
    - `start`: the design at the start of the search, a pytree of floats.
    - `minimise`: a statistic of an output, such as `Quantile("propellant", 0.99)`; or `maximise` to
      maximise it.
    - `subject_to`: limits of statistics, such as `Quantile("impact_speed", 0.99).at_most(6.0)`.
    - `bounds`, `scale`, `optimiser`, `tolerance`, `max_steps`, `progress`: as in
      `jaxspace.optimization.minimise`. The default of `tolerance` is far below the sampling error.
    - `runs`: number of runs; by default a power of two from 1024 on with at least twenty runs
      beyond each quantile.
    - `seed`: of the runs. All designs have the same runs, drawn once.
    - `nominal`: whether only the nominal run is optimised, for comparison; `runs`, `seed` and
      `may_fail` then have no effect. Every statistic is the output of that run, and a share of
      violations is the excess of the output over its limit.
    - `accuracy`: the relative tolerance of each step, or an `Accuracy`; by default that of the
      campaign.
    - `may_fail`: the share of the runs that may fail, from 0 on. They are left out of the
      statistics; the search rejects a design at which more fail.
    - `store`: the path of a file in which the search saves its state.
    - `resume`: whether to continue from that file, if it exists, after an interrupted process: with
      bit-identical steps.

    **Returns** a `DesignOptimum`. Ctrl-C ends the search with the best design so far.

    **Raises** `InputError` for a campaign without dispersion, too few runs for a quantile, an
    unknown output, more failed runs at the start than allowed, a store that exists or belongs to
    another search, and as `minimise` does.
    """
    every = [minimise, maximise, *(getattr(c, "statistic", None) for c in subject_to)]
    # Anything else is rejected by `problem_of`, with its name.
    known = [statistic for statistic in every if isinstance(statistic, AbstractStatistic)]
    if nominal:
        runs = None
    elif runs is None:
        runs = enough_runs(known, RUNS)
    problem = problem_of(
        campaign, start, minimise, subject_to, runs, seed, accuracy, may_fail, maximise
    )
    minimum = search_minimum(
        problem,
        start,
        bounds=bounds,
        scale=scale,
        optimiser=optimiser,
        tolerance=tolerance,
        max_steps=max_steps,
        progress=progress_of(problem, progress),
        store=store_of(store, resume, problem, seed),
        forward_ratio=FORWARD_RATIO,
    )
    optimum = DesignOptimum(minimum.x, start, minimum.criterion, minimum, problem, seed)
    # A start at which too many runs fail shows no way on: only the author can choose another.
    if not math.isfinite(optimum.objective) and int(minimum.steps) == 0:
        failed = failures(optimum.runs)
        if failed:
            raise InputError(
                f"At the start {failed} At most a fraction of {problem.may_fail:g} may fail: start "
                "from a design whose runs succeed, or increase may_fail."
            )
    return optimum


def store_of(
    store: str | os.PathLike[str] | None, resume: bool, problem: Problem, seed: int
) -> SearchStore | None:
    """The store of a search with these arguments, which knows its statistics and its runs."""
    if store is None:
        return as_store(store, resume)
    limits = [c.text() for c in problem.constraints]
    # With other statistics or runs it would be another search, whose store is rejected.
    goal = (
        problem.objective.text() if problem.sign > 0.0 else f"greatest {problem.objective.text()}"
    )
    runs = "nominal run" if problem.normals is None else f"{problem.count} runs of seed {seed}"
    return SearchStore(store, resume, "; ".join((goal, *limits, runs)))


def progress_of(problem: Problem, progress: Progress | None) -> Progress | None:
    """The `progress` with the original sign of the objective."""
    if progress is None:
        return None
    return lambda step, objective, *rest: progress(step, problem.sign * objective, *rest)
