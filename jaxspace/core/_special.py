"""Special functions of the closed forms, right in value and derivative on both sides of every
removable singularity.

    c_n(z) = sum_k (-z)^k / (2k + n)!           Stumpff; c0 = cos(s), c1 = sin(s)/s with s = sqrt(z); hyperbolic for z < 0
    c_n = 1/n! - z c_(n+2)
    c2(4z) = c1^2 / 2,  c3(4z) = (c2 + c0 c3) / 4,  c4(4z) = (1 + c1) c3 / 8,  c5(4z) = (c4 + c5 + c2 c3) / 16

Source: Danby, Fundamentals of Celestial Mechanics, 6.9.
"""

import math

import jax
import jax.numpy as jnp

from ._barrier import barrier
from ._types import Scalar

_TERMS = 8
_SMALL = math.pi**2


@jax.jit
def stumpff(z: Scalar) -> tuple[Scalar, Scalar, Scalar, Scalar]:
    """The Stumpff functions c2 to c5 of z, from minus infinity, as far as the precision holds the
    hyperbolic functions, to pi^2; c0 = 1 - z c2 and c1 = 1 - z c3.

    Series and argument quadrupling serve |z| <= pi^2, one exponential the rest: no digit is lost by
    cancellation, and the derivatives of every order are those of the functions. A larger z is for
    the caller to take whole turns off."""
    far = z < -_SMALL
    distant = jnp.where(far, z, -_SMALL)
    near = stumpff_near(jnp.where(far, 0.0, z))
    c2, c3, c4, c5 = (
        jnp.where(far, f, c) for f, c in zip(_far_hyperbolic(distant), near, strict=True)
    )
    return c2, c3, c4, c5


def stumpff_near(z: Scalar) -> tuple[Scalar, Scalar, Scalar, Scalar]:
    """c2 to c5 for |z| <= pi^2: series at z/16, then two quadruplings of the argument, every one
    free of cancellation."""
    w = z * 0.0625
    c4 = c5 = 1.0
    for n in range(_TERMS, 0, -1):
        c4 = 1.0 - w / ((2 * n + 3) * (2 * n + 4)) * c4
        c5 = 1.0 - w / ((2 * n + 4) * (2 * n + 5)) * c5
    c4, c5 = barrier((c4 / 24.0, c5 / 120.0))
    c2, c3 = 0.5 - w * c4, 1.0 / 6.0 - w * c5
    for _ in range(2):
        c0, c1 = 1.0 - w * c2, 1.0 - w * c3
        c5, c4 = 0.0625 * (c4 + c5 + c2 * c3), 0.125 * (1.0 + c1) * c3
        c3, c2, w = 0.25 * (c2 + c0 * c3), 0.5 * c1 * c1, 4.0 * w
    return c2, c3, c4, c5


def _far_hyperbolic(z: Scalar) -> tuple[Scalar, Scalar, Scalar, Scalar]:
    """c2 to c5 for z <= -pi^2, by one exponential."""
    s = jnp.sqrt(-z)
    grown, s = barrier((jnp.exp(s), s))
    c2, c3 = (0.5 * (grown + 1.0 / grown) - 1.0) / -z, (0.5 * (grown - 1.0 / grown) - s) / (-z * s)
    return c2, c3, (0.5 - c2) / z, (1.0 / 6.0 - c3) / z
