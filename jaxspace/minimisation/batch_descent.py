"""Descent by gradients of fresh batches of runs, for networks and many unknowns.

    x <- x - step of the optimiser for grad L(x; batch k),   k = 1, 2, ...

    L = f - nu+ . d,   nu+ = max(0, nu - rho d)        (`_lagrangian.py`; f and d of the batch)
    nu <- max(0, nu - rho mean(d))                      after each round, with its mean of d
    m <- a m + (1 - a) x                                mean of the iterates, the result

The weight rho stays: a growing one would freeze an optimiser that divides by the size of past
gradients. A batch whose numbers are not finite is left out. The search ends where the mean
objective of the last steps is not below that of the steps before by more than its error.
Sources: Polyak and Juditsky, SIAM J. Control Optim. 30 (1992), 838 (averaging); Nocedal and
Wright, 17.4 (multipliers).
"""

from collections.abc import Callable
from typing import Any, NamedTuple, final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PyTree

from ..core import InputError, Scalar
from ..core.jit import compiled
from ..core.printing import printed
from ._bounds import as_bounds
from ._criterion import Criterion, Point, StopReason, listed
from ._drive import Progress
from ._entry import as_point, check_scale, check_steps
from ._lagrangian import FIRST_WEIGHT, Multipliers
from ._scaling import ScaledProblem, scaled_problem, weights
from .optimiser import SQP, Optimiser, Stepper, as_stepper, check_optimiser
from .search_store import SearchStore

# Steps after which the multipliers follow the mean of the constraints.
ROUND = 20
# As many unknowns for each number of a batch as forward mode is taken for.
FORWARD_RATIO = 8.0
# Batches in sequence without finite numbers, after which a search ends.
MOST_LEFT_OUT = 10

SENTENCES = {
    StopReason.CONVERGED: "Converged after {steps} steps: the objective no longer decreases{more}.",
    StopReason.STEP_LIMIT: "Stopped at the maximum number of steps, {steps}{more}.",
    StopReason.NOT_FINITE: "No finite values in {bad} consecutive batches{more}.",
    StopReason.INTERRUPTED: "Interrupted after {steps} steps{more}.",
}


@final
@printed(reason=StopReason)
class BatchMinimum(eqx.Module):
    """The result of a descent by batches.

    - `x`: the mean of the last iterates.
    - `reason`: why the search ended, a `StopReason`: `CONVERGED` if the objective fell no further.
    - `steps`: batches, of which `left_out` were left out as not finite.
    - `influence`: the largest scaled derivative by each unknown in any batch.
    - `multipliers`: of the constraints, scaled.
    - `history`: objective, violation and scaled gradient of each batch, (steps, 3)."""

    x: Point
    reason: Int[Array, ""]
    steps: Int[Array, ""]
    left_out: Int[Array, ""]
    influence: Point
    multipliers: Float[Array, " inequal"]
    history: Float[Array, "steps 3"]

    @property
    def converged(self) -> bool:
        """Whether the search ended because the objective fell no further."""
        return int(self.reason) == StopReason.CONVERGED

    def plot(self, title: str = "") -> Any:
        """A figure of the history, with matplotlib. Raises `ImportError` without it."""
        from ..plots import convergence_figure

        return convergence_figure(self.history, title)

    def sentence(self, unmet: list[str] | None = None) -> str:
        """Why the search ended, in words.

        - `unmet`: a clause for each constraint that is not met at the result."""
        left = f"{int(self.left_out)} batches skipped because not finite"
        clauses = ([left] if int(self.left_out) else []) + list(unmet or ())
        more = f", {listed(clauses)}" if clauses else ""
        sentence = SENTENCES[StopReason(int(self.reason))]
        return sentence.format(steps=int(self.steps), bad=MOST_LEFT_OUT, more=more)


class BatchState(NamedTuple):
    """State of the search between two batches.

    - `z`, `mean`: scaled unknowns, and their average.
    - `optimiser`: the state of optax; `multipliers`; `weight`: scales of (f, c, d).
    - `round_sum`: sums of c and d in this round.
    - `step`: number of the next batch; `left_out`, `bad`: batches without finite numbers, in all
      and in sequence.
    - `influence`: the largest derivatives so far; `row`: of the last batch."""

    z: Float[Array, " n"]
    mean: Float[Array, " n"]
    optimiser: Any
    multipliers: Multipliers
    weight: Float[Array, " all"]
    round_sum: Float[Array, " constraints"]
    step: Int[Array, ""]
    left_out: Int[Array, ""]
    bad: Int[Array, ""]
    influence: Float[Array, " n"]
    row: Float[Array, " 3"]


class StoredSearch(NamedTuple):
    """The stored data of a search: its `state`, and the `rows` of its history, NaN for future
    batches."""

    state: BatchState
    rows: Float[np.ndarray, "max_steps 3"]


def descend_by_batches(
    problem: Callable[[Point, Array], Criterion],
    start: PyTree,
    *,
    optimiser: Optimiser,
    bounds: tuple[PyTree, PyTree] | None,
    scale: PyTree | None,
    max_steps: int,
    patience: int,
    average: float,
    seed: int,
    progress: Progress | None,
    store: SearchStore | None,
) -> BatchMinimum:
    """A minimum of the mean of `problem(x, key)` over random keys.

    **Arguments**

    - `problem`: a function from a point and the random key of a batch to its `Criterion`.
    - `start`, `bounds`, `scale`, `progress`: as in `minimise`; steps end at the bounds.
    - `optimiser`: of optax, without a line search.
    - `max_steps`: the largest number of batches; `patience`: of how many the mean is compared.
    - `average`: the factor a, from 0 for the last iterate to below 1.
    - `seed`: of the keys.
    - `store`: saves the state after each batch.

    **Returns** the `BatchMinimum`; Ctrl-C ends the search with that of the last step.

    **Raises** `InputError` as `minimise` does, and for an optimiser that compares values of one
    function.
    """
    check_steps(max_steps)
    _check_settings(optimiser, patience, average)
    x = as_point(start)
    if scale is not None:
        check_scale(scale, x)
    key = jax.random.key(seed)
    own = eqx.Partial(_of_batch, problem, key)
    scaled = scaled_problem(own, x, as_bounds(bounds, x), scale, None, bounds is not None)
    stepper = as_stepper(optimiser, scaled.start, scaled.unravel)
    if stepper.restarts:
        raise InputError(
            "optimiser uses line searches or curvature estimates, which are invalid when the batch "
            "changes: use one such as optax.adam(1e-3)."
        )

    # A tree of arrays and of functions of this module: searches of the same problem share the
    # program.
    number = jnp.asarray(average, scaled.start.dtype)
    step = compiled(eqx.Partial(_after_batch, problem, key, scaled, stepper, number))
    begun = StoredSearch(_begin(scaled, stepper), np.full((max_steps, 3), np.nan))
    if store is not None:
        setting = (scaled.low, scaled.high, scaled.size, seed, patience, average)
        begun = store.begin(begun, (setting, begun))
    state, rows, reason = _driven(step, begun, patience, progress, store)
    z = state.mean if not stepper.averages else stepper.averaged(state.optimiser, state.z)
    return BatchMinimum(
        x=scaled.unravel(scaled.size * z),
        reason=jnp.asarray(int(reason)),
        steps=state.step,
        left_out=state.left_out,
        influence=scaled.unravel(state.influence),
        multipliers=state.multipliers.nu,
        history=jnp.asarray(rows),
    )


def _of_batch(problem: Callable[[Point, Array], Criterion], key: Array, x: Point) -> Criterion:
    """The criterion of the batch with this `key`."""
    return problem(x, key)


def _after_batch(
    problem: Callable[[Point, Array], Criterion],
    key: Array,
    scaled: ScaledProblem,
    stepper: Stepper,
    average: Scalar,
    state: BatchState,
) -> BatchState:
    """The state after the next batch of a search whose batches have keys from this one."""
    of_batch = eqx.Partial(_of_batch, problem, jax.random.fold_in(key, state.step))
    return _advance(state, scaled._replace(problem=of_batch), stepper, average)


def _check_settings(optimiser: object, patience: int, average: float) -> None:
    if optimiser == SQP:
        raise InputError(
            "optimiser is 'sqp': batches require an optax optimiser, such as optax.adam(1e-3)."
        )
    check_optimiser(optimiser, False)
    if patience < 2:
        raise InputError(f"patience is {patience}: it must be 2 steps or more.")
    if not 0.0 <= average < 1.0:
        raise InputError(f"average is {average}: it must be from 0 to below 1.")


def _begin(scaled: ScaledProblem, stepper: Stepper) -> BatchState:
    z = scaled.start
    constraints = jnp.zeros(scaled.me + scaled.mi, z.dtype)
    rho = jnp.asarray(FIRST_WEIGHT, z.dtype)
    none = jnp.asarray(0)
    return BatchState(
        z=z,
        mean=z,
        optimiser=stepper.begin(z),
        multipliers=Multipliers(constraints[: scaled.me], constraints[scaled.me :], rho),
        weight=jnp.ones(1 + scaled.me + scaled.mi, z.dtype),
        round_sum=constraints,
        step=none,
        left_out=none,
        bad=none,
        influence=jnp.zeros_like(z),
        row=jnp.full(3, jnp.nan, z.dtype),
    )


def _advance(s: BatchState, scaled: ScaledProblem, stepper: Stepper, average: Scalar) -> BatchState:
    """The state after one batch."""

    def numbers(z: Array) -> tuple[Array, Array]:
        stacked, _ = scaled.numbers(z)
        return stacked, stacked

    # Forward mode costs a run for each unknown, reverse mode several for each number.
    mode = jax.jacfwd if s.z.size <= FORWARD_RATIO * s.weight.size else jax.jacrev
    jacobian, values = mode(numbers, has_aux=True)(s.z)
    sound = jnp.all(jnp.isfinite(jacobian)) & jnp.all(jnp.isfinite(values))
    first = weights(values, jacobian)
    weight = jnp.where((s.step == s.left_out) & sound, first, s.weight)
    scaled_values, rows = weight * values, weight[:, None] * jacobian
    me = scaled.me
    own = s.multipliers.of(scaled_values[1 : 1 + me], scaled_values[1 + me :])
    g = rows[0] + own.y @ rows[1 : 1 + me] - own.nu @ rows[1 + me :]
    # Values that are not finite must not reach the state of the optimiser.
    safe_g = jnp.where(sound, g, 0.0)
    update, optimiser = stepper.step(s.z, safe_g, scaled_values[0], lambda q: q[0], s.optimiser)
    z = jnp.clip(s.z + update, scaled.low, scaled.high)
    # The first iterates are averaged evenly, so that the start does not stay in the mean.
    count = (s.step - s.left_out + 1).astype(z.dtype)
    share = jnp.maximum(1.0 - average, 1.0 / count)
    moved = s._replace(
        z=z,
        mean=s.mean + share * (z - s.mean),
        optimiser=optimiser,
        weight=weight,
        round_sum=s.round_sum + scaled_values[1:],
        influence=jnp.maximum(s.influence, jnp.max(jnp.abs(rows), axis=0)),
        bad=jnp.zeros_like(s.bad),
        row=jnp.stack([values[0], _violation(values, me), jnp.max(jnp.abs(g))]),
    )
    lost = s._replace(left_out=s.left_out + 1, bad=s.bad + 1, row=jnp.full_like(s.row, jnp.nan))
    after = jax.tree.map(lambda a, b: jnp.where(sound, a, b), moved, lost)
    return _end_of_round(after._replace(step=s.step + 1), me)


def _end_of_round(s: BatchState, me: int) -> BatchState:
    """The state with new multipliers, where a round ends."""
    mean = s.round_sum / ROUND
    after = s.multipliers.of(mean[:me], mean[me:])
    ends = s.step % ROUND == 0
    chosen = jax.tree.map(lambda a, b: jnp.where(ends, a, b), after, s.multipliers)
    return s._replace(multipliers=chosen, round_sum=jnp.where(ends, 0.0, s.round_sum))


def _violation(values: Float[Array, " all"], me: int) -> Float[Array, ""]:
    """The largest violation, in the units of the constraint."""
    largest = jnp.max(jnp.abs(values[1 : 1 + me]), initial=0.0)
    return jnp.maximum(largest, jnp.max(-values[1 + me :], initial=0.0))


def _driven(
    step: Callable[[BatchState], BatchState],
    begun: StoredSearch,
    patience: int,
    progress: Progress | None,
    store: SearchStore | None,
) -> tuple[BatchState, np.ndarray, StopReason]:
    """The last state, a row for each batch, and why the search ended."""
    state, rows = begun.state, np.array(begun.rows)
    taken = int(state.step)
    reason = _reason(state, rows, patience)
    try:
        while reason is None:
            state = step(state)
            taken = int(state.step)
            rows[taken - 1] = np.asarray(state.row)
            reason = _reason(state, rows, patience)
            if store is not None:
                store.save(StoredSearch(state, rows), last=reason is not None)
            if progress is not None:
                progress(taken, *(float(x) for x in rows[taken - 1]))
    except KeyboardInterrupt:
        # The state of the last whole step.
        reason = StopReason.INTERRUPTED
        if store is not None:
            store.save(StoredSearch(state, rows), last=True)
    return state, rows[:taken], StopReason(reason)


def _reason(state: BatchState, rows: np.ndarray, patience: int) -> StopReason | None:
    """Why a search ends here; `None` if it continues."""
    taken = int(state.step)
    if int(state.bad) >= MOST_LEFT_OUT:
        return StopReason.NOT_FINITE
    if taken and taken % patience == 0 and _settled(rows[:taken], patience):
        return StopReason.CONVERGED
    return StopReason.STEP_LIMIT if taken >= len(rows) else None


def _settled(rows: np.ndarray, patience: int) -> bool:
    """Whether objective and violation of the last steps are not below those of the steps before by
    more than the error of their means."""
    before, last = rows[-2 * patience : -patience, :2], rows[-patience:, :2]
    if len(before) < patience:
        return False
    fall = np.nanmean(before, axis=0) - np.nanmean(last, axis=0)
    error = np.sqrt((np.nanvar(before, axis=0) + np.nanvar(last, axis=0)) / patience)
    return bool(np.all(fall <= error))
