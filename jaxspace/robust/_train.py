"""The best design under dispersion by fresh runs in every step, for networks and many unknowns."""

import os
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, PyTree

from ..core import InputError, Scalar
from ..core.jit import compiled
from ..integration.accuracy import Accuracy
from ..minimisation import Criterion, Progress
from ..minimisation.batch_descent import BatchMinimum, descend_by_batches
from ._optimum import DesignOptimum
from ._runs import CampaignOf, Design, Problem, enough_runs, failures, problem_of
from ._search import RUNS, progress_of, store_of
from .statistics import AbstractStatistic, Constraint


def train_design(
    campaign: CampaignOf,
    start: Design,
    *,
    minimise: AbstractStatistic | None = None,
    maximise: AbstractStatistic | None = None,
    optimiser: Any,
    subject_to: Sequence[Constraint] = (),
    bounds: tuple[PyTree, PyTree] | None = None,
    scale: PyTree | None = None,
    batch: int = 256,
    seed: int = 0,
    accuracy: Accuracy | Scalar | None = None,
    may_fail: float = 0.0,
    max_steps: int = 1000,
    patience: int = 100,
    average: float = 0.9,
    progress: Progress | None = None,
    store: str | os.PathLike[str] | None = None,
    resume: bool = False,
) -> DesignOptimum:
    """The optimal design under dispersion, with new runs in every step.

    Unlike `optimise_design` it does not adapt to one sample, and reaches the optimum within the
    noise of its steps.

    **Arguments**

    - `campaign`, `start`, `minimise`, `maximise`, `subject_to`, `accuracy`, `may_fail`: as in
      `optimise_design`. A batch in which more runs fail is skipped.
    - `optimiser`: of optax, such as `optax.adam(1e-3)`; a schedule, clipping or other parts of a
      chain are allowed, except for line searches. Its rates are in sizes of the unknowns.
    - `bounds`, `scale`: as in `optimise_design`; steps end at the bounds.
    - `batch`: number of runs of a step. A quantile is that of each batch.
    - `seed`: of the runs.
    - `max_steps`: the largest number of steps.
    - `patience`: the search ends where the mean of so many steps is not below that of as many
      before, by more than its error.
    - `average`: factor of the average of the iterates, which is the result: 0 for the last one,
      0.9 for about ten.
    - `progress`: called after each step with its number and the objective, violation and gradient
      of its batch. Ctrl-C ends the search with the result so far.
    - `store`, `resume`: as in `optimise_design`.

    **Returns** a `DesignOptimum`, whose objective and limits are those of a separate sample.

    **Raises** `InputError` as `optimise_design` does, for a batch too small for a quantile, and for
    an optimiser with a line search.
    """
    problem = problem_of(
        campaign, start, minimise, subject_to, batch, seed, accuracy, may_fail, maximise
    )
    found = descend_by_batches(
        eqx.Partial(_of_batch, problem),
        start,
        optimiser=optimiser,
        bounds=bounds,
        scale=scale,
        max_steps=max_steps,
        patience=patience,
        average=average,
        seed=seed,
        progress=progress_of(problem, progress),
        store=store_of(store, resume, problem, seed),
    )
    # A separate sample, larger than a batch, because one batch has little information on the
    # design.
    whole = problem_of(
        *(campaign, start, minimise, subject_to, enough_runs(problem.statistics, RUNS)),
        *(seed, accuracy, may_fail, maximise),
    )
    criterion = compiled(whole)(found.x)
    _check_used(found, criterion, may_fail)
    return DesignOptimum(found.x, start, criterion, found, whole, seed)


def _of_batch(problem: Problem, x: Design, key: Array) -> Criterion:
    """The criterion of a batch of new runs."""
    assert problem.normals is not None
    # Independent, and not on Sobol points: over the steps independent errors average out.
    normals = jax.random.normal(key, problem.normals.shape, jnp.result_type(float))
    # Without the runs, which no step needs.
    found = problem._replace(normals=normals)(x)
    return Criterion(found.objective, None, found.non_negative)


def _check_used(found: BatchMinimum, criterion: Criterion, may_fail: float) -> None:
    """Raise `InputError` where every batch was left out because too many of its runs fail."""
    # Then the result is the start: only the author can choose another.
    if int(found.steps) != int(found.left_out):
        return
    failed = failures(criterion.report)
    if failed:
        raise InputError(
            f"In every batch too many runs fail. {failed} At most a fraction of {may_fail:g} may "
            "fail: start from a design whose runs succeed, or increase may_fail."
        )
