"""A problem as `_sqp.py` takes it: numbers of order one with their Jacobian."""

import jax
import jax.numpy as jnp
from jaxtyping import Array

from . import _sqp as sqp
from . import _sqp_state as sqp_state
from ._criterion import Criterion, Minimum, farthest
from ._drive import drive
from ._scaling import ScaledProblem
from ._search import Common, taken_up
from ._sqp_measures import at_least_violation


def by_sqp(
    common: Common,
    scaled: ScaledProblem,
    max_steps: int,
    exact_hessian: bool,
    before: Minimum | None,
) -> Minimum:
    """Quadratic programmes in scaled unknowns, with scaled objective and constraints."""
    z0 = scaled.start
    me = scaled.me
    mi = scaled.mi

    def numbers(z: Array) -> tuple[Array, tuple[Array, Criterion]]:
        stacked, criterion = scaled.numbers(z)
        return stacked, (stacked, criterion)

    # Forward mode costs a run for each unknown, reverse mode several for each number, and more to
    # compile.
    mode = jax.jacfwd if z0.size <= 16 * (1 + me + mi) else jax.jacrev
    derivatives = mode(numbers, has_aux=True)

    def evaluate(s: sqp_state.SqpState) -> sqp_state.Found:
        jacobian, (values, criterion) = derivatives(s.trial)
        return sqp_state.Found(values, jacobian, criterion)

    curvature = jax.hessian(lambda z, w: w @ numbers(z)[0]) if exact_hessian else None
    tolerance = jnp.asarray(common.tolerance, z0.dtype)
    limits = sqp_state.Limits(scaled.low, scaled.high, tolerance, farthest(z0))
    state = sqp_state.begin(z0, scaled.size, me, mi, scaled.blank, max_steps, common.check, limits)
    if before is not None:
        state = taken_up(before, state)
    last, interrupted = drive(
        evaluate,
        lambda s, found: sqp.advance(s, found, limits, curvature),
        lambda s: sqp_state.unfinished(s, limits),
        state,
        common.progress,
    )
    slope = last.at.g + last.at.J.T @ last.y - last.at.K.T @ last.nu
    limited = last.taken >= last.rows.shape[0]
    least, astray = at_least_violation(last, limits), sqp_state.astray(last, limits)
    ends = (last.at.sound(), limited, least, astray, interrupted)
    return scaled.minimum(last, last.at.report, last.x, slope, ends, common.tolerance, before)
