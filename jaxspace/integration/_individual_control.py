"""Step-size control with individual steps for every run.

From the error of a step follows its ideal length, at which the error is just the allowed one. Along
an orbit this length is proportional to a power of a scale of the motion, such as the distance from
the centre, which the unperturbed motion predicts for the next step:

    h_next = S h_ideal (b/b_0)^p        b, b_0: scale in the middle of the next step and of this one
    p = sum x y / sum x^2               x, y: change of log b and of log h_ideal, step by step

Steps thus shorten before a periapsis is reached, and lengthen after it. The power p is close to one
where a perturbation acts at the periapsis only, and zero where all steps are equal. Logarithm and
power are rational approximations, whose error the control corrects at the next step.

    symbol  meaning
    S       safety factor
    p       power, learned by each run, within 0 and 1
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..core import AbstractRegularised, AbstractSecondOrderForm, Scalar
from ..core.barrier import barrier
from ..solvers.regularised_step import Regular, order_of
from ..solvers.step_control import GROW, SHRINK

SAFETY = 0.85
# Safety factor for variables without a scale of the motion.
CLOSER = 0.9
# Decay of the sums for the power at each step: their memory is about the steps of one orbit.
MEMORY = 0.9
# Initial power, and its weight.
FIRST_POWER, FIRST_WEIGHT = 0.5, 0.02
# Iterations of the length, because the scale depends on the length that it determines.
REPEATS = 3


class Trend(NamedTuple):
    """Statistics of the steps of each run, which predict the length of the next one.

    - `ideal`: ideal length of the last step, zero before the first one.
    - `step_scale`: the scale in the middle of the last step.
    - `xy`, `xx`: the sums of x y and x^2."""

    ideal: Float[Array, "*runs"]
    step_scale: Float[Array, "*runs"]
    xy: Float[Array, "*runs"]
    xx: Float[Array, "*runs"]

    @classmethod
    def before(cls, like: Float[Array, "*runs"]) -> "Trend":
        """The trend before the first step."""
        weight = jnp.full_like(like, FIRST_WEIGHT)
        return cls(jnp.zeros_like(like), jnp.ones_like(like), FIRST_POWER * weight, weight)


def ideal_length(form: AbstractRegularised, h: Array, local: Array) -> Array:
    """The ideal length of a step `h`, from its error `local` in units of the allowed error."""
    # Single precision is enough here, and a power in double precision costs as much as some stages.
    size = jnp.clip(local, 1e-14, 1e14).astype(jnp.float32)
    return jnp.abs(h) * jnp.exp(jnp.log(size) * (-1.0 / order_of(form))).astype(h.dtype)


def following(
    form: AbstractRegularised,
    trend: Trend,
    ideal: Array,
    h: Array,
    z0: Regular,
    z: Regular,
    used: Bool[Array, "*runs"],
) -> tuple[Trend, Array]:
    """The trend after a step and the length of the next one.

    **Arguments**

    - `ideal`, `h`: ideal length of the step, and its length with its direction.
    - `z0`, `z`: the variables at its start, and where the next one starts.
    - `used`: whether the step is accepted and serves the prediction."""
    known = used & (trend.ideal > 0.0)
    if not isinstance(form, AbstractSecondOrderForm):
        # Drag in a thin shell follows no power of the distance: where the ideal length has shrunk,
        # the prediction lets it shrink by the same factor again.
        last = jnp.where(known, trend.ideal, 1.0)
        again = jnp.where(known, jnp.minimum(ideal / last, 1.0), 1.0)
        return trend._replace(ideal=jnp.where(used, ideal, trend.ideal)), CLOSER * ideal * again
    step_scale = form.step_scale(0.5 * h, z0)
    x = jnp.where(known, _logarithm(step_scale, trend.step_scale), 0.0)
    y = jnp.where(known, _logarithm(ideal, trend.ideal), 0.0)
    memory = jnp.where(known, MEMORY, 1.0)
    trend = Trend(
        jnp.where(used, ideal, trend.ideal),
        jnp.where(used, step_scale, trend.step_scale),
        memory * trend.xy + x * y,
        memory * trend.xx + x * x,
    )
    p = jnp.clip(trend.xy / trend.xx, 0.0, 1.0)
    length, step_scale = barrier((SAFETY * ideal, step_scale))
    half = 0.5 * jnp.sign(h)
    proposal = length
    for _ in range(REPEATS):
        ahead = form.step_scale(half * proposal, z)
        proposal = barrier(length * _power(ahead, step_scale, p))
    return trend, proposal


def _logarithm(a: Scalar, b: Scalar) -> Scalar:
    """Approximation of log(a/b)/2, for positive a and b."""
    return (a - b) / (a + b)


def _power(a: Scalar, b: Scalar, p: Scalar) -> Scalar:
    """Approximation of (a/b)^p, for positive a and b; exact for p = 0 and p = 1."""
    more, less = 1.0 + p, 1.0 - p
    return (more * a + less * b) / (less * a + more * b)


def bounded(proposal: Array, h: Array, good: Bool[Array, "*runs"]) -> Array:
    """The length `proposal` within the limits of growth and reduction after a step `h`."""
    h = jnp.abs(h)
    return jnp.clip(proposal, SHRINK * h, jnp.where(good, GROW, SAFETY) * h)
