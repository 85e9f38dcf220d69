"""A problem as `_multipliers.py` takes it: its Lagrangian in free numbers, and the result from the
state in which the descents end."""

import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array

from ..core import Scalar
from . import _multipliers as multipliers
from ._criterion import Criterion, Minimum, Point
from ._drive import drive
from ._gradient_check import sizes_of
from ._search import Common, joined_rows, reason_of, taken_up


def by_multipliers(
    common: Common, bounded: bool, rounds: tuple[int, int, int, Scalar], before: Minimum | None
) -> Minimum:
    """Descents in free numbers, from which the bounds make x."""
    max_steps, max_rounds, adam_steps, adam_rate = rounds
    limits, problem = common.limits, common.problem
    first = limits.free(common.start) if bounded else common.start
    q0, unravel = ravel_pytree(first)

    def inside(q: Array) -> Point:
        return limits.inside(unravel(q)) if bounded else unravel(q)

    shapes = jax.eval_shape(problem, common.start)
    blank = jax.tree.map(lambda like: jnp.zeros(like.shape, like.dtype), shapes)
    state = multipliers.begin(q0, sizes_of(first), blank, max_rounds, adam_steps, common.check)
    if before is not None:
        state = taken_up(before, state)

    def evaluate(s: multipliers.Descent) -> multipliers.Evaluation:
        x, to_free = jax.vjp(inside, s.trial)
        flat, back = ravel_pytree(x)

        def value(flat: Array) -> tuple[Array, tuple[Array, Criterion]]:
            criterion = problem(back(flat))
            total = multipliers.lagrangian(criterion, s.dual, s.rho)
            return total, (total, criterion)

        # In x, where the slope is what a bound takes; in the free numbers it is zero there.
        held, (total, criterion) = jax.grad(value, has_aux=True)(flat)
        slopes, _ = ravel_pytree(to_free(back(held))[0])
        return multipliers.Evaluation(total, slopes, held, criterion)

    options = multipliers.Options(common.tolerance, max_steps, adam_rate)
    last, interrupted = drive(
        evaluate,
        lambda s, found: multipliers.advance(s, found, options),
        lambda s: multipliers.unfinished(s, options),
        state,
        common.progress,
    )
    x = inside(last.x)
    held = ravel_pytree(x)[1](last.held if bounded else jnp.zeros_like(last.held))
    missed = last.violation > common.tolerance
    converged = (last.gradient <= common.tolerance) & ~missed
    finite = jnp.isfinite(last.value)
    limited = (last.taken >= max_rounds) & ~missed
    return Minimum(
        x=x,
        criterion=last.criterion,
        multipliers=last.dual,
        gradient=last.gradient,
        violation=last.violation,
        steps=last.steps,
        converged=converged,
        gradient_error=last.wrong,
        reason=reason_of(last.wrong, interrupted, finite, converged, limited, missed),
        bound_multipliers=held,
        history=joined_rows(before, last.rows),
        search=last,
    )
