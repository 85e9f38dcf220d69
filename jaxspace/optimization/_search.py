"""Search for the minimum of a scaled problem by quadratic programmes (`_sqp.py`), from its start or
from the end of an earlier search, to a `Minimum` in the units of the problem."""

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import InputError, Scalar
from ..core.tracing import is_traced
from ..integration.compiling import QUICK
from . import _sqp as sqp
from . import _sqp_state as sqp_state
from ._criterion import Criterion, Minimum, StopReason, farthest, stop_reason
from ._drive import Progress, drive
from ._gradient_check import GRADIENT_TOLERANCE
from ._scaling import ScaledProblem
from ._sqp_measures import at_least_violation, slope

P = ParamSpec("P")
R = TypeVar("R")


def search(
    scaled: ScaledProblem,
    tolerance: Scalar,
    max_steps: int,
    exact_hessian: bool,
    check: bool,
    progress: Progress | None,
    before: Minimum | None,
) -> Minimum:
    """The minimum of a scaled problem; the arguments are those of `minimise`, `check` says whether
    the gradient at the start is compared with differences, and `before` is the search to
    continue."""
    z0 = scaled.start
    me = scaled.me
    mi = scaled.mi

    def numbers(z: Array) -> tuple[Array, tuple[Array, Criterion]]:
        stacked, criterion = scaled.numbers(z)
        return stacked, (stacked, criterion)

    # Forward mode costs a run for each unknown; reverse mode costs several runs for each number,
    # and compiles for longer.
    mode = jax.jacfwd if z0.size <= 16 * (1 + me + mi) else jax.jacrev
    derivatives = mode(numbers, has_aux=True)

    def evaluate(s: sqp_state.SqpState) -> sqp_state.Evaluation:
        jacobian, (values, criterion) = derivatives(s.trial)
        return sqp_state.Evaluation(values, jacobian, criterion)

    curvature = jax.hessian(lambda z, w: w @ numbers(z)[0]) if exact_hessian else None
    least = jnp.asarray(tolerance, z0.dtype)
    limits = sqp_state.Limits(scaled.low, scaled.high, least, farthest(z0))
    state = _at_once(
        sqp_state.begin, z0, scaled.size, me, mi, scaled.blank, max_steps, check, limits
    )
    if before is not None:
        state = _resumed(before, state)
    last, interrupted = drive(
        evaluate,
        lambda s, evaluation: sqp.advance(s, evaluation, limits, curvature),
        lambda s: sqp_state.unfinished(s, limits),
        state,
        progress,
    )
    minimum = _at_once(_minimum, last, limits, scaled.size, interrupted)
    history = minimum.history
    if before is not None:
        # Rows of steps not taken are NaN, and would separate the two searches.
        old = before.history
        history = jnp.concatenate([old[~jnp.isnan(old[:, 0])], history])
    x = scaled.unravel(minimum.x)
    held = scaled.unravel(minimum.bound_multipliers)
    places = lambda m: (m.x, m.bound_multipliers, m.history)  # noqa: E731
    return eqx.tree_at(places, minimum, (x, held, history))


def _at_once(f: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
    """f(*args) as one compiled program where its numbers are known: otherwise each of its many
    operations would be compiled separately."""
    return f(*args, **kwargs) if is_traced(args) else eqx.filter_jit(f, **QUICK)(*args, **kwargs)


def _minimum(
    last: sqp_state.SqpState,
    limits: sqp_state.Limits,
    size: Float[Array, " n"],
    interrupted: bool,
) -> Minimum:
    """The result of a search from its `last` state, in the units of the problem, with x as one
    array."""
    at = last.at
    c, d = at.report.equal_zero, at.report.non_negative
    weight = last.weight
    y = last.y * weight[1 : 1 + last.y.size] / weight[0]
    nu = last.nu * weight[1 + last.y.size :] / weight[0]
    violation = jnp.zeros_like(last.gradient)
    if c is not None:
        violation = jnp.maximum(violation, jnp.max(jnp.abs(c)))
    if d is not None:
        violation = jnp.maximum(violation, jnp.max(-d))
    missed = last.violation > limits.tolerance
    finite = at.sound()
    # `finite` is needed as well: NaN does not exceed a tolerance, and an infinite objective can
    # have a gradient of zero.
    converged = (last.gradient <= limits.tolerance) & ~missed & finite
    reason = stop_reason(
        finite,
        converged,
        last.taken >= last.rows.shape[0],
        missed & at_least_violation(last, limits),
        sqp_state.diverged(last, limits),
    )
    # A wrong gradient and an interruption come first.
    if interrupted:
        reason = jnp.full_like(reason, StopReason.INTERRUPTED)
    reason = jnp.where(last.wrong > GRADIENT_TOLERANCE, StopReason.WRONG_GRADIENT, reason)
    return Minimum(
        x=size * last.x,
        criterion=at.report,
        multipliers=Criterion(
            jnp.ones_like(last.gradient),
            None if c is None else y.reshape(c.shape),
            None if d is None else nu.reshape(d.shape),
        ),
        gradient=last.gradient,
        violation=violation,
        steps=last.steps,
        converged=converged,
        gradient_error=last.wrong,
        reason=reason.astype(int),
        bound_multipliers=slope(at, last.y, last.nu) / (weight[0] * size),
        history=last.rows,
        search=last,
        tolerance=limits.tolerance,
    )


def _resumed(before: Minimum, blank: sqp_state.SqpState) -> sqp_state.SqpState:
    """The state in which a search ended, with space for as many further steps."""
    last = before.search
    # Another number of constraints means another problem; the rows are for the new limit of steps.
    if _shapes(last) != _shapes(blank):
        raise InputError("start is a Minimum of another problem: start from its x.")
    # What was pending when it ended is evaluated first.
    return last._replace(rows=blank.rows, taken=jnp.asarray(0))


def _shapes(state: Any) -> list[tuple[int, ...]]:
    return [x.shape for x in jax.tree.leaves(state._replace(rows=None))]
