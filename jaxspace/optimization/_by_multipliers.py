"""A problem as `_multipliers.py` takes it: numbers of order one, and their Lagrangian in free
numbers."""

import jax
import jax.numpy as jnp
from jaxtyping import Array

from ..core import Scalar
from . import _multipliers as multipliers
from ._bounds import Bounds
from ._criterion import Minimum, farthest
from ._drive import drive
from ._infeasibility import least_violation
from ._multipliers_state import Descent, Evaluation, Options, begin, scaled_numbers
from ._scaling import ScaledProblem
from ._search import Common, taken_up


def by_multipliers(
    common: Common,
    scaled: ScaledProblem,
    bounded: bool,
    rounds: tuple[int, int, int, Scalar],
    before: Minimum | None,
) -> Minimum:
    """Descents in free numbers, from which the bounds make the scaled unknowns."""
    max_steps, max_rounds, adam_steps, adam_rate = rounds
    limits = Bounds(scaled.low, scaled.high)
    q0 = limits.free(scaled.start) if bounded else scaled.start

    def inside(q: Array) -> Array:
        return limits.inside(q) if bounded else q

    state = begin(
        q0, scaled.size, scaled.me, scaled.mi, scaled.blank, max_rounds, adam_steps, common.check
    )
    if before is not None:
        state = taken_up(before, state)._replace(judged=jnp.asarray(False))
    options = Options(common.tolerance, max_steps, adam_rate, farthest(state.x))

    def evaluate(s: Descent) -> Evaluation:
        z, to_free = jax.vjp(inside, s.trial)
        values, pull, criterion = jax.vjp(scaled.numbers, z, has_aux=True)
        total, along = multipliers.wanted(s, values, options)
        # In z, where the slope is what a bound takes; in the free numbers it is zero there.
        (held,) = pull(along)
        (slopes,) = to_free(held)
        return Evaluation(total, slopes, held, values, criterion)

    last, interrupted = drive(
        evaluate,
        lambda s, found: multipliers.advance(s, found, options),
        lambda s: multipliers.unfinished(s, options),
        state,
        common.progress,
    )
    slope = last.held if bounded else jnp.zeros_like(last.held)
    z = inside(last.x)
    y, nu = multipliers.violations(last.values, last)
    _, c, d = scaled_numbers(last.values, last)
    largest = jnp.maximum(jnp.max(jnp.abs(c), initial=0.0), jnp.max(-d, initial=0.0))
    least = least_violation(z, last.outward, c @ y - d @ nu, largest, (scaled.low, scaled.high))
    astray = multipliers.astray(last, options)
    limited = last.taken >= max_rounds
    ends = (multipliers.is_finite(last), limited, last.judged & least, astray, interrupted)
    return scaled.minimum(last, last.criterion, z, slope, ends, common.tolerance, before)
