"""Special functions of the closed forms, right in value and derivative on both sides of every removable singularity.

    c_n(z) = sum_k (-z)^k / (2k + n)!           Stumpff; c0 = cos(s), c1 = sin(s)/s with s = sqrt(z); hyperbolic for z < 0
    c0 = 1 - z c2,  c1 = 1 - z c3
    c1(4z) = c0 c1,  c2(4z) = c1^2 / 2,  c3(4z) = (c2 + c0 c3) / 4

Source: Danby, Fundamentals of Celestial Mechanics, 6.9.
"""

import math

import jax.numpy as jnp

from ._types import Scalar

_TERMS = 9
_SMALL = math.pi**2


def stumpff(z: Scalar) -> tuple[Scalar, Scalar, Scalar, Scalar]:
    """The Stumpff functions c0, c1, c2, c3 of z, for every z whose hyperbolic functions the precision can hold.

    Series and argument quadrupling serve |z| <= pi^2, whole turns are taken off above, exponentials serve the rest; so that
    no digit is lost by cancellation, and the derivatives of every order are those of the functions."""
    high, low = z > _SMALL, z < -_SMALL
    s = jnp.sqrt(jnp.where(high, z, 1.0))
    turned = s - 2.0 * math.pi * jnp.round(s / (2.0 * math.pi))
    c0, c1, c2, c3 = _near(jnp.where(high, turned * turned, jnp.where(low, 0.0, z)))
    part = jnp.where(high, turned / s, 1.0)
    c1, c2 = part * c1, part * part * c2
    c3 = jnp.where(high, (1.0 - c1) / jnp.where(high, z, 1.0), c3)
    far = _far_hyperbolic(jnp.where(low, z, -_SMALL))
    c0, c1, c2, c3 = (jnp.where(low, f, c) for f, c in zip(far, (c0, c1, c2, c3), strict=True))
    return c0, c1, c2, c3


def _near(z: Scalar) -> tuple[Scalar, Scalar, Scalar, Scalar]:
    """c0..c3 for |z| <= pi^2: series at z/16, then two quadruplings of the argument, every one free of cancellation."""
    w = z * 0.0625
    c2 = c3 = 1.0
    for n in range(_TERMS, 0, -1):
        c2 = 1.0 - w / ((2 * n + 1) * (2 * n + 2)) * c2
        c3 = 1.0 - w / ((2 * n + 2) * (2 * n + 3)) * c3
    c2, c3 = c2 / 2.0, c3 / 6.0
    c0, c1 = 1.0 - w * c2, 1.0 - w * c3
    for _ in range(2):
        c3, c2, c1, w = 0.25 * (c2 + c0 * c3), 0.5 * c1 * c1, c0 * c1, 4.0 * w
        c0 = 1.0 - w * c2
    return c0, c1, c2, c3


def _far_hyperbolic(z: Scalar) -> tuple[Scalar, Scalar, Scalar, Scalar]:
    """c0..c3 for z <= -pi^2, by one exponential."""
    s = jnp.sqrt(-z)
    grown = jnp.exp(s)
    c0, c1 = 0.5 * (grown + 1.0 / grown), 0.5 * (grown - 1.0 / grown) / s
    return c0, c1, (1.0 - c0) / z, (1.0 - c1) / z
