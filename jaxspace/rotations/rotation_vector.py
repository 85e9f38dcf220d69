"""Rates of the rotation vector, whose direction is the axis of a turn and whose length its angle.

    theta' = omega + theta x omega / 2
             + (1 - (theta/2) cot(theta/2)) theta x (theta x omega) / theta^2
    omega  = theta' - (1 - cos(theta)) theta x theta' / theta^2
             + (theta - sin(theta)) theta x (theta x theta') / theta^3

    symbol   meaning                                         unit
    theta    turn of the body from a fixed orientation       rad
    omega    angular velocity in body axes                   rad/s

Source: Thomson 1.5 (where two finite turns differ from their sum); Bortz (1971), IEEE Trans. AES 7,
61. The first form is singular at a whole turn, where the rate is undefined; the second nowhere.
"""

__all__ = ["omega_from_rotation_vector_rate", "rotation_vector_rate"]

import math

import jax.numpy as jnp

from ..core import Scalar, Vector
from ..core.formula import formula
from ..core.safe import sinc_squared
from ..core.shapes import check_components, with_rank
from ..core.special import stumpff_near
from ..core.vectors import cross, dot


@formula
def rotation_vector_rate(turn: Vector, omega: Vector) -> Vector:
    """Rate of the rotation vector of a rotating body.

    **Arguments**

    - `turn`: rotation vector from a fixed orientation to the body's, rad, (3, *runs), shorter than
      a whole turn.
    - `omega`: angular velocity in body axes, rad/s, (3, *runs).

    **Returns** the rate, rad/s, (3, *runs), smooth at zero rotation; not finite at a whole turn.
    """
    turn, omega = _same_rank("rotation_vector_rate", turn, "omega", omega)
    across = cross(turn, omega)
    return omega + 0.5 * across + _bend(dot(turn, turn)) * cross(turn, across)


@formula
def omega_from_rotation_vector_rate(turn: Vector, rate: Vector) -> Vector:
    """Angular velocity from the rate of the rotation vector.

    **Arguments**

    - `turn`: rotation vector from a fixed orientation to the body's, rad, (3, *runs), of any
      length.
    - `rate`: its rate, rad/s, (3, *runs).

    **Returns** omega, rad/s, in body axes, (3, *runs), smooth everywhere.
    """
    turn, rate = _same_rank("omega_from_rotation_vector_rate", turn, "rate", rate)
    z = dot(turn, turn)
    across = cross(turn, rate)
    # (1 - cos s) / s^2 without a difference, and (s - sin s) / s^3 by its series within half a
    # turn.
    near = z < math.pi**2
    far = jnp.where(near, 1.0, z)
    second = jnp.where(
        near, stumpff_near(jnp.where(near, z, 0.0))[1], (1.0 - sinc_squared(far)) / far
    )
    return rate - 0.5 * sinc_squared(z / 4.0) ** 2 * across + second * cross(turn, across)


def _same_rank(function: str, turn: Vector, name: str, other: Vector) -> tuple[Vector, Vector]:
    check_components(f"{function}: turn", turn, 3)
    check_components(f"{function}: {name}", other, 3)
    rank = max(turn.ndim, other.ndim) - 1
    return with_rank(turn, rank), with_rank(other, rank)


def _bend(z: Scalar) -> Scalar:
    """(1 - s cot(s)) / (4 s^2) of z = 4 s^2, with its series about z = 0; singular at a whole
    turn."""
    # The closed form loses digits near zero, where the series is exact to rounding.
    small = z < 0.1
    y = jnp.where(small, z, 0.0)
    x = jnp.where(small, 1.0, z)
    s = 0.5 * jnp.sqrt(x)
    # The coefficients |B_2n| / (2n)! of the series of the cotangent, with Bernoulli's numbers.
    series = 691.0 / 1307674368000.0
    for inverse in (47900160.0, 1209600.0, 30240.0, 720.0, 12.0):
        series = 1.0 / inverse + y * series
    return jnp.where(small, series, (1.0 - s / jnp.tan(s)) / x)
