"""Special functions of the closed forms, right in value and derivative at every removable
singularity.

    c_n(z) = sum_k (-z)^k / (2k + n)!           Stumpff; for z > 0, with s = sqrt(z): c0 = cos(s),
                                                c1 = sin(s)/s; for z < 0 hyperbolic
    c_n = 1/n! - z c_(n+2)
    c2(4z) = c1^2 / 2,                          c3(4z) = (c2 + c0 c3) / 4
    c4(4z) = (1 + c1) c3 / 8,                   c5(4z) = (c4 + c5 + c2 c3) / 16

Source: Danby, Fundamentals of Celestial Mechanics, 6.9.
"""

__all__ = ["stumpff", "stumpff_near"]

import math

import jax
import jax.numpy as jnp

from ._lists import takes_lists
from .barrier import barrier
from .square_roots import sqrt
from .types import Scalar

# At |z| <= pi^2 / 16 the ninth term is below rounding.
_TERMS = 8
_SMALL = math.pi**2


# Jitted, so that many calls in a program share one traced function.
@takes_lists
@jax.jit
def stumpff(z: Scalar) -> tuple[Scalar, Scalar, Scalar, Scalar]:
    """The Stumpff functions c2 to c5; c0 = 1 - z c2 and c1 = 1 - z c3.

    **Arguments**

    - `z`: up to pi^2, and down to where the hyperbolic functions leave the range of the precision.
      The caller subtracts whole turns from a larger z.

    **Returns** c2, c3, c4 and c5, each of the shape of `z`. No digit is lost by cancellation, and
    the derivatives of every order are those of the functions.
    """
    far = z < -_SMALL
    # Each branch gets numbers of its own range, so that no derivative of the other overflows.
    distant = jnp.where(far, z, -_SMALL)
    near = stumpff_near(jnp.where(far, 0.0, z))
    c2, c3, c4, c5 = (
        jnp.where(far, f, c) for f, c in zip(_far_hyperbolic(distant), near, strict=True)
    )
    return c2, c3, c4, c5


@takes_lists
def stumpff_near(z: Scalar) -> tuple[Scalar, Scalar, Scalar, Scalar]:
    """c2 to c5 for |z| <= pi^2: the series at z/16, then the argument quadrupled twice."""
    w = z * 0.0625
    c4 = c5 = 1.0
    for n in range(_TERMS, 0, -1):
        c4 = 1.0 - w / ((2 * n + 3) * (2 * n + 4)) * c4
        c5 = 1.0 - w / ((2 * n + 4) * (2 * n + 5)) * c5
    # Two series instead of four: c2 and c3 follow, and both must be there once for all results.
    c4, c5 = barrier((c4 / 24.0, c5 / 120.0))
    c2 = 0.5 - w * c4
    c3 = 1.0 / 6.0 - w * c5
    for _ in range(2):
        c0 = 1.0 - w * c2
        c1 = 1.0 - w * c3
        # Sums and products of positive terms: nothing cancels. c5 first, because the functions on
        # the right are still those of the smaller argument.
        c5 = 0.0625 * (c4 + c5 + c2 * c3)
        c4 = 0.125 * (1.0 + c1) * c3
        c3 = 0.25 * (c2 + c0 * c3)
        c2 = 0.5 * c1 * c1
        w = 4.0 * w
    return c2, c3, c4, c5


def _far_hyperbolic(z: Scalar) -> tuple[Scalar, Scalar, Scalar, Scalar]:
    """c2 to c5 for z <= -pi^2, by one exponential: nothing cancels that far out."""
    s = sqrt(-z)
    grown, s = barrier((jnp.exp(s), s))
    c2 = (0.5 * (grown + 1.0 / grown) - 1.0) / -z
    c3 = (0.5 * (grown - 1.0 / grown) - s) / (-z * s)
    return c2, c3, (0.5 - c2) / z, (1.0 / 6.0 - c3) / z
