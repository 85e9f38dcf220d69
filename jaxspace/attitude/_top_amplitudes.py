"""The parameters a and b of a heavy top after a given time, and the angles by which they turn, in
the letters of `top_motion.py`.

Source: that of `top_motion.py`.
"""

import math

import jax.numpy as jnp
from jaxtyping import Array

from ..core import Scalar
from ..core.elliptic import complete_third
from ..core.jacobi import Jacobi, third
from ..core.safe import safe_atan2
from ._cayley_klein import times_i
from ._top_start import TopStart


def amplitudes(start: TopStart, s: Scalar, c: Scalar, d: Scalar) -> tuple[Array, Array]:
    """a and b within a quarter period, before they are turned.

    Over d^2, because near the separatrix c and d are as small as the tilt."""
    c, s_d = c / d, s / d
    cubic = s * s_d * s_d
    D = 1.0 + start.above * s_d * s_d
    p = 1.0 + start.down.slope * s * s
    a = (start.a * (c + start.bend * cubic) + start.a_rate * (s * D)) / (D * jnp.sqrt(p))
    p = c * c + start.up.slope * s_d * s_d
    q = start.b_rate - start.rho * times_i(start.b)
    there = start.b * p + s * (c * q - (start.rho * s_d / d) * times_i(q))
    # Where b passes this form is not taken.
    weight = jnp.where(start.passes, 0.0, start.up.weight)
    here = start.b * c - (weight * cubic) * times_i(start.b) + start.b_rate * (s * p)
    return a, jnp.where(start.passes, there, here) / (D * d * jnp.sqrt(p))


def third_angles(start: TopStart, phase: Jacobi, duration: Scalar) -> tuple[Scalar, Scalar]:
    """The angles by which a and b are turned, without alpha t, rad, including the half turns
    completed."""
    s, c, d = phase.s, phase.c, phase.d
    down, up = start.down, start.up
    returns = phase.half_periods != 0.0
    x = jnp.where(returns, start.x, 1.0)
    least = jnp.sqrt(jnp.where(returns, start.difference, 1.0) / x)
    p = jnp.stack([1.0 + down.slope * s * s, c * c + up.slope * s * s])
    quarter = jnp.where(returns, jnp.stack([down.quarter, up.quarter]), 1.0)
    weight = jnp.stack([down.weight, up.weight])
    s, c, d, x, least = (jnp.broadcast_to(v, p.shape) for v in (s, c, d, x, least))
    within = third(s, c, d, p, weight)
    whole = weight / (3.0 * x * jnp.sqrt(x)) * complete_third(1.0 + least, least, quarter)
    # S and c change their signs in a half period, and with them a and, where it does not pass, b.
    sense = jnp.stack([_sign(down.momentum), jnp.where(start.passes, 0.0, _sign(up.momentum))])
    period = jnp.where(returns, 2.0 * whole + math.pi * sense, 0.0)
    angles = within + phase.half_periods * period
    return angles[0], angles[1] + start.rho * duration


def third_rates(start: TopStart, phase: Jacobi) -> tuple[Scalar, Scalar]:
    """The rates of the `third_angles`, rad/s."""
    s = phase.s
    c = phase.c / phase.d
    s_d = phase.s / phase.d
    down = start.down.weight * s * s / (1.0 + start.down.slope * s * s)
    up = start.up.weight * s_d * s_d / (c * c + start.up.slope * s_d * s_d)
    return down, start.rho + up


def arguments(start: TopStart, phase: Jacobi) -> tuple[Scalar, Scalar]:
    """The angles by which a and b turn in `amplitudes` since the start, rad, on the half of the
    circle that the momentum decides."""
    s = phase.s
    c = phase.c / phase.d
    s_d = phase.s / phase.d
    cubic = s * s_d * s_d
    D = 1.0 + start.above * s_d * s_d
    a, b = jnp.sum(start.a * start.a, axis=0), jnp.sum(start.b * start.b, axis=0)
    sine = 0.25 * s * D
    down = safe_atan2(start.down.momentum * sine, a * (c + start.bend * cubic) + start.rise * sine)
    # The pole near which b turns, also where its third integral is taken at the other one.
    p = c * c + start.near * s_d * s_d
    up = safe_atan2(start.up.momentum * sine, b * c - 0.25 * start.rise * s * p)
    return down, up - safe_atan2(start.rho * s_d / phase.d, c)


def _sign(x: Scalar) -> Scalar:
    return jnp.where(x < 0.0, -1.0, 1.0)
