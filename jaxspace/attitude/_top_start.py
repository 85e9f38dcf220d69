"""The start of a heavy top for its motion in closed form, in the letters of `top_motion.py`:
parameters of the elliptic functions, and both verticals as poles of the third integral.

    x = beta (u3 - u2)/4,   y = beta (u1 - u2)/4,   x - y = beta (u3 - u1)/4
    a' = (i N a - b conj(omega_12))/2,   b' = (a omega_12 - i N b)/2,   alpha = (n - N)/2

Source: that of `top_motion.py`.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array

from ..core import Flag, Scalar, Vector
from ..core.barrier import barrier, computed_once
from ..core.safe import safe_divide, safe_sqrt
from ..rotations import Quaternion
from ._cayley_klein import conjugate, pairs_of, product, times_i
from ._state import vertical
from ._turning_circles import turning_circles
from .nutation import nutation_through


class Pole(NamedTuple):
    """One of the two verticals as a pole of the third integral.

    `slope`, 1/s^2: (p - 1)/S^2 for a, (p - c^2)/S^2 for b; `quarter`: p at the quarter period;
    `weight`, 1/s^3: rho M, less for the pole that b passes to; `momentum`, 1/s: gamma + N for a,
    gamma - N for b."""

    slope: Scalar
    quarter: Scalar
    weight: Scalar
    momentum: Scalar


class TopStart(NamedTuple):
    """A top that is highest upright, at its start: the pairs a, b and a', b'; x, y, x - y; beta
    (u1 - u)/4, 1/s^2; u', 1/s; beta u'/8, 1/s^3; both poles; whether b passes to the other one,
    with the rate rho then, else zero; N and n."""

    a: Array
    b: Array
    a_rate: Array
    b_rate: Array
    x: Scalar
    y: Scalar
    difference: Scalar
    above: Scalar
    rise: Scalar
    bend: Scalar
    down: Pole
    up: Pole
    passes: Flag
    rho: Scalar
    alpha: Scalar
    near: Scalar


@computed_once
def start_of(q: Array, omega: Vector, N: Scalar, beta: Scalar) -> TopStart:
    """The start from a unit quaternion, omega, rad/s, N, 1/s, and beta, 1/s^2, not negative."""
    Z = vertical(Quaternion(q))
    # Barriers between the stages: fused into one, the program compiles for much longer.
    nutation = barrier(nutation_through(Quaternion(q), omega, Z, N, beta))
    circles = turning_circles(
        N,
        beta,
        nutation.alpha_up,
        nutation.gamma_up,
        nutation.alpha_down,
        nutation.gamma_down,
        nutation.start,
    )
    (upper, _), (lower, rest) = barrier(circles.half_angles)
    x = 0.25 * (circles.d + 2.0 * beta * lower)
    y = 0.5 * beta * safe_sqrt(circles.apart_squared)
    pole = -0.5 * beta * lower
    # The third integral is well conditioned at the smaller of the pole and its image xy/pole.
    passes = pole * pole > x * y
    # The inner switch keeps the quotient finite where it is not used, also for derivatives.
    rho = jnp.where(passes, nutation.gamma_up / jnp.where(passes, 4.0 * lower, 1.0), 0.0)
    share = safe_divide(upper, lower)
    top = jnp.where(x == 0.0, 1.0, x)
    near = 0.25 * circles.d
    down = 0.5 * beta * rest
    a, b = pairs_of(q)
    rise = omega[1] * Z[0] - omega[0] * Z[1]
    return TopStart(
        a,
        b,
        a_rate=0.5 * (N * times_i(a) - product(b, conjugate(omega[:2]))),
        b_rate=0.5 * (product(a, omega[:2]) - N * times_i(b)),
        x=x,
        y=y,
        difference=0.25 * (circles.d + 2.0 * beta * upper),
        above=0.5 * beta * (b[0] * b[0] + b[1] * b[1] - upper),
        rise=rise,
        bend=0.125 * beta * rise,
        down=Pole(down, 1.0 + down / top, 0.125 * beta * nutation.gamma_down, nutation.gamma_down),
        up=Pole(
            jnp.where(passes, x * share, near),
            jnp.where(passes, share, near / top),
            jnp.where(
                passes,
                -rho * x * y / jnp.where(passes, pole, 1.0),
                -0.125 * beta * nutation.gamma_up,
            ),
            nutation.gamma_up,
        ),
        passes=passes,
        rho=rho,
        alpha=0.5 * (omega[2] - N),
        near=near,
    )
