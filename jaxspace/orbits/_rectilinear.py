"""Motion about a centre without attraction: a straight line, and its first-order change with mu.

    r = r0 + t v0 - mu (G2/|r0| r0 + G3 v0)
    v = v0 - (mu/R) (G1/|r0| r0 + G2 v0)         R = |r0 + t v0|
    G1 = 2 T/(1 - z),  G2 = 2 T^2/(1 - z),  G3 = 2 T^3 k(z)
    T = t/(|r0| + R),  z = v0^2 T^2,  k = (1/(1 - z) - artanh(sqrt z)/sqrt z)/z

    symbol  meaning                                                        unit
    r0, v0  position, velocity at the start                                m, m/s
    t, R    duration, distance from the centre after it                    s, m
    mu      gravitational parameter: to first order                        m^3/s^2
    G_n     Stumpff functions of the line, s^n c_n(-v0^2 s^2), s = int dt/R  (s/m)^n

Source: Danby, Fundamentals of Celestial Mechanics, 6.9, in the limit mu = 0, where the universal
anomaly s is the potential of a rod: tanh(|v0| s/2) = |v0| T.

On a line through the centre any attraction causes a collision: beyond it the derivatives with
respect to mu do not exist and are set to zero.
"""

import jax.numpy as jnp

from ..core import Scalar, Vector
from ..core.safe import safe_divide, safe_sqrt
from ..core.square_roots import sqrt
from ..core.vectors import dot


def rectilinear_motion(
    position: Vector, velocity: Vector, duration: Scalar, mu: Scalar
) -> tuple[Vector, Vector]:
    """The state after a duration for `mu` = 0, with the first derivatives with respect to `mu`.

    **Arguments**

    - `position`, m, and `velocity`, m/s: at the start, (3, *runs).
    - `duration`: s, (*runs,).
    - `mu`: m^3/s^2, (*runs,).

    **Returns** the position, m, and the velocity, m/s, (3, *runs)."""
    start = safe_sqrt(dot(position, position))
    end = position + duration * velocity
    R = safe_sqrt(dot(end, end))
    total = start + R
    T = safe_divide(duration, total)
    z = dot(velocity, velocity) * T * T
    # 1 - z as a sum, which is accurate far out.
    rest = 2.0 * safe_divide(start * total + duration * dot(position, velocity), total * total)
    # The line begins at the centre, ends there or passes it.
    hit = (start * R == 0.0) | (rest <= 0.0)
    z, rest = jnp.where(hit, 0.0, z), jnp.where(hit, 1.0, rest)
    mu = jnp.where(hit, 0.0, mu)
    start, R = jnp.where(hit, 1.0, start), jnp.where(hit, 1.0, R)
    G1 = 2.0 * T / rest
    G2 = T * G1
    G3 = 2.0 * T * T * T * _k(z, rest)
    return (
        end - mu * (G2 / start * position + G3 * velocity),
        velocity - mu / R * (G1 / start * position + G2 * velocity),
    )


def _k(z: Scalar, rest: Scalar) -> Scalar:
    """k of 0 <= z < 1 and 1 - z, by its series for small z."""
    small = z < 0.1
    s = jnp.where(small, z, 0.0)
    series = 0.0
    # 0.1^17 is below rounding.
    for n in range(17, 0, -1):
        series = 2.0 * n / (2.0 * n + 1.0) + s * series
    root = sqrt(jnp.where(small, 0.25, z))
    rest = jnp.where(small, 0.75, rest)
    # artanh x = log((1 + x)^2 / (1 - x^2)) / 2
    artanh = 0.5 * jnp.log((1.0 + root) * (1.0 + root) / rest)
    return jnp.where(small, series, (1.0 / rest - artanh / root) / (root * root))
