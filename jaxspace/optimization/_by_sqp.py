"""A problem as `_sqp.py` takes it: numbers of order one with their Jacobian, and the result in the
units of the problem."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array

from ..core import Scalar
from . import _sqp as sqp
from . import _sqp_state as sqp_state
from ._criterion import Criterion, Minimum, Point
from ._drive import drive
from ._search import Common, joined_rows, reason_of, taken_up


def by_sqp(
    common: Common,
    max_steps: int,
    exact_hessian: bool,
    scale: Point | None,
    before: Minimum | None,
) -> Minimum:
    """Quadratic programmes in scaled unknowns, with scaled objective and constraints."""
    problem = common.problem
    x0, unravel = ravel_pytree(common.start)
    low, high = (ravel_pytree(b)[0] for b in common.limits)
    size = _sizes(x0, low, high) if scale is None else ravel_pytree(scale)[0]

    if before is not None and isinstance(before.search, sqp_state.SqpState):
        # The search goes on in its own scaled unknowns.
        size = before.search.size

    def numbers(z: Array) -> tuple[Array, tuple[Array, Criterion]]:
        criterion = problem(unravel(size * z))
        parts = (criterion.objective, criterion.equal_zero, criterion.non_negative)
        stacked = jnp.concatenate([jnp.ravel(x) for x in parts if x is not None])
        return stacked, (stacked, criterion)

    shapes = jax.eval_shape(problem, common.start)
    me = 0 if shapes.equal_zero is None else shapes.equal_zero.size
    mi = 0 if shapes.non_negative is None else shapes.non_negative.size
    # Forward mode costs a run for each unknown, reverse mode several for each number, and more to
    # compile.
    mode = jax.jacfwd if x0.size <= 16 * (1 + me + mi) else jax.jacrev
    derivatives = mode(numbers, has_aux=True)

    def evaluate(s: sqp_state.SqpState) -> sqp_state.Found:
        jacobian, (values, criterion) = derivatives(s.trial)
        return sqp_state.Found(values, jacobian, criterion)

    curvature = jax.hessian(lambda z, w: w @ numbers(z)[0]) if exact_hessian else None
    limits = sqp_state.Limits(low / size, high / size, jnp.asarray(common.tolerance, x0.dtype))
    blank = jax.tree.map(lambda like: jnp.zeros(like.shape, like.dtype), shapes)
    # A start far outside of the bounds would leave the first programme without a solution.
    z0 = jnp.clip(x0, low, high) / size
    state = sqp_state.begin(z0, size, me, mi, blank, max_steps, common.check)
    if before is not None:
        state = taken_up(before, state)
    last, interrupted = drive(
        evaluate,
        lambda s, found: sqp.advance(s, found, limits, curvature),
        lambda s: sqp_state.unfinished(s, limits),
        state,
        common.progress,
    )
    return _sqp_minimum(last, unravel, size, common.tolerance, interrupted, before)


def _sqp_minimum(
    last: sqp_state.SqpState,
    unravel: Callable[[Array], Point],
    size: Array,
    tolerance: Scalar,
    interrupted: bool,
    before: Minimum | None,
) -> Minimum:
    """The result in the units of the problem."""
    me, weight = last.y.size, last.weight
    c, d = last.at.report.equal_zero, last.at.report.non_negative
    # The search has scaled objective and constraints: a multiplier is the quotient of both scales.
    y = last.y * weight[1 : 1 + me] / weight[0]
    nu = last.nu * weight[1 + me :] / weight[0]
    slope = (last.at.g + last.at.J.T @ last.y - last.at.K.T @ last.nu) / (weight[0] * size)
    violation = jnp.zeros_like(last.gradient)
    if c is not None:
        violation = jnp.maximum(violation, jnp.max(jnp.abs(c)))
    if d is not None:
        violation = jnp.maximum(violation, jnp.max(-d))
    missed = last.violation > tolerance
    converged = (last.gradient <= tolerance) & ~missed
    finite = jnp.isfinite(last.at.f) & jnp.all(jnp.isfinite(last.at.g))
    limited = last.taken >= last.rows.shape[0]
    rows = joined_rows(before, last.rows)
    return Minimum(
        x=unravel(size * last.x),
        criterion=last.at.report,
        multipliers=Criterion(
            jnp.ones_like(last.at.f),
            None if c is None else y.reshape(c.shape),
            None if d is None else nu.reshape(d.shape),
        ),
        gradient=last.gradient,
        violation=violation,
        steps=last.taken if before is None else last.taken + before.steps,
        converged=converged,
        gradient_error=last.wrong,
        reason=reason_of(last.wrong, interrupted, finite, converged, limited, missed),
        bound_multipliers=unravel(slope),
        history=rows,
        search=last,
    )


def _sizes(x: Array, low: Array, high: Array) -> Array:
    """The range of the bounds, or the larger of the start and 1."""
    both = jnp.isfinite(low) & jnp.isfinite(high)
    return jnp.where(both, jnp.where(both, high - low, 1.0), jnp.maximum(jnp.abs(x), 1.0))
