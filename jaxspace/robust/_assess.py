"""Designs assessed with an independent campaign, whose runs no search has used.

    value of modelling dispersion    W = S(f(x_0, w)) - S(f(x*, w))
    its variance                     sum_i (I_i(x_0) - I_i(x*))^2

    symbol  meaning                                                        unit
    S       statistic that was minimised                                   that of the output
    x*, x_0 optimum under dispersion, and another design                   those of the unknowns
    w       inputs of the independent runs, the same for each design
    I_i     influence of run i on S (`statistics.py`)                     that of the output

A search overestimates its optimum, because it adapts the design to its runs. The bias is the
difference between the statistic of its runs and that of independent ones. Source: Birge and
Louveaux, Introduction to Stochastic Programming, 4.2 (value of the stochastic solution).
"""

import dataclasses
from collections.abc import Callable, Mapping
from typing import final

import equinox as eqx
import numpy as np
from jaxtyping import Array

from ..core import InputError, State
from ..dispersion import Campaign, disperse
from ..simulation import Mission
from ..simulation.mission_result import MissionTrajectory
from ..statistics import Dispersion
from ..statistics.limits import clopper_pearson
from ..statistics.requirements import Verdict, verdict_of
from ._optimum import DesignOptimum
from ._runs import CampaignOf, Design, Problem, enough_runs
from .assessment import AssessedDesign, AssessedLimit, DesignAssessment, Estimate
from .statistics import AbstractStatistic, Constraint, Measured

# Four times as many as a search has, so that their error is half of that of the search.
RUNS = 4096
"""Default minimum number of independent runs."""


@final
class _BuildOf(eqx.Module):
    """The `build` of the campaign of a design, as a function that contains the design: campaigns of
    several designs then share their compiled programs."""

    campaign: CampaignOf
    x: Design

    def __call__(self, samples: dict[str, Array]) -> tuple[Mission, State]:
        return self.campaign(self.x).build(samples)


@final
class _OutputsOf(eqx.Module):
    """The `outputs` of the campaign of a design, in the same way."""

    campaign: CampaignOf
    x: Design

    def __call__(self, result: MissionTrajectory, samples: dict[str, Array]) -> dict[str, Array]:
        return self.campaign(self.x).outputs(result, samples)


def campaign_at(campaign: CampaignOf, x: Design) -> Campaign:
    """The campaign of a design, with random runs."""
    # Drawn independently, as the intervals assume.
    return dataclasses.replace(
        campaign(x), build=_BuildOf(campaign, x), outputs=_OutputsOf(campaign, x), design=None
    )


def assess_designs(
    optimum: DesignOptimum,
    others: Mapping[str, Design] | None = None,
    *,
    runs: int | None = None,
    seed: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> DesignAssessment:
    """An optimum under dispersion, and other designs for comparison, assessed with independent
    runs.

    **Arguments**

    - `optimum`: the result of `optimise_design`.
    - `others`: designs by name, such as `{"nominal": optimise_design(..., nominal=True).x}`.
    - `runs`: number of fresh runs, the same for every design; by default a power of two from 4,096
      on that leaves twenty beyond each quantile.
    - `seed`: of the fresh runs; by default the one after that of the search.
    - `progress`: called as `progress(done, total)` after every chunk of every design.

    **Returns** the `DesignAssessment`, which prints as a table.

    **Raises** `InputError` for the seed of the search, fewer runs than a quantile needs, an optimum
    of the nominal run, and a name that is taken; `SimulationError` if a nominal run fails.
    """
    problem = optimum.problem
    if problem.normals is None:
        raise InputError("optimum belongs to the nominal run: pass the result of optimise_design.")
    # The next one, and not one at random, so that an assessment can be repeated.
    seed = optimum.seed + 1 if seed is None else seed
    if seed == optimum.seed:
        raise InputError(
            f"seed is {seed}, the seed of the search: independent runs must have another one."
        )
    if others and "robust" in others:
        raise InputError(
            '"robust" is reserved for the optimum: give the other design another name.'
        )
    runs = enough_runs(problem.statistics, RUNS) if runs is None else runs
    problem.check_runs(runs)
    designs = {**(others or {}), "robust": optimum.x}
    assessed = {}
    for name, x in designs.items():
        # With the same inputs for every design: in their differences the common variance cancels.
        fresh = disperse(
            campaign_at(problem.campaign, x),
            runs,
            seed=seed,
            accuracy=problem.accuracy,
            progress=progress,
        )
        assessed[name] = _assess_design(problem, x, fresh)
    return DesignAssessment(assessed, optimum, _on_search(optimum), seed)


def _assess_design(problem: Problem, x: Design, fresh: Dispersion) -> AssessedDesign:
    """A design by its fresh runs."""
    measured = _measured(problem.objective, fresh)
    # Exact for any number of failures: for few, a normal interval would reach below zero.
    failed = clopper_pearson(int(np.count_nonzero(~fresh.good)), fresh.runs)
    limits = tuple(_assess_limit(c, fresh) for c in problem.constraints)
    return AssessedDesign(x, fresh, measured, limits, failed)


def _measured(statistic: AbstractStatistic, fresh: Dispersion) -> Measured:
    x = fresh.values(statistic.output).astype(float)
    # A failed run has no value; the share of failed runs is assessed by itself.
    return statistic.measured(x, fresh.good & np.isfinite(x))


def _assess_limit(constraint: Constraint, fresh: Dispersion) -> AssessedLimit:
    """A constraint on independent runs: its statistic, and the runs that violate its
    requirement."""
    measured = _measured(constraint.statistic, fresh)
    estimate = Estimate(measured.value, measured.error)
    required = constraint.requirement
    verdict: Verdict | None = None
    # A limit of a mean requires nothing of a single run.
    if required is not None and required.allowed is not None:
        violation = fresh.violation(
            constraint.statistic.output,
            at_least=-np.inf if required.low is None else required.low,
            at_most=np.inf if required.high is None else required.high,
        )
        verdict = verdict_of(violation, required.allowed)
    return AssessedLimit(constraint, estimate, verdict)


def _on_search(optimum: DesignOptimum) -> Measured:
    """The statistic that was minimised, on the runs of the search."""
    # The report of the search holds these runs: none is computed again.
    objective, runs = optimum.problem.objective, optimum.runs
    good = np.asarray(runs.good(objective.output))
    return objective.measured(np.asarray(runs.outputs[objective.output]), good)
