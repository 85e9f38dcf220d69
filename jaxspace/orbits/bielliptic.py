"""Break-even of the bi-elliptic transfer: where three impulses are cheaper than two.

    Q(u, x) = (dv of three impulses - dv of two) b / (b - x),  b = x / u:  zero at break-even

    symbol  meaning                                                       unit
    x       ratio of the radii of the two circles, the larger to the smaller  1
    b       radius of the impulse between, in that of the smaller circle      1

Source: the three impulses from Thomson 4.11; Curtis, Orbital Mechanics, 6.4, has the limits.

The factor b - x is divided out of every difference in Q, so that its root is not lost next to b =
x, where both transfers coincide. Below x = 11.938765 two impulses are always cheaper, above
15.581718 three are cheaper for every b > x.
"""

__all__ = ["bielliptic_break_even"]

import math

import jax
import jax.numpy as jnp

from ..core import Scalar
from ..core.formula import POSITIVE, formula
from ..core.square_roots import inverse_sqrt, sqrt
from ..core.types import as_float


@formula(ratio=POSITIVE)
def bielliptic_break_even(ratio: Scalar) -> Scalar:
    """Distance of the middle impulse beyond which a bi-elliptic transfer costs less than Hohmann's.

    **Arguments**

    - `ratio`: of the radii of the circles, (*runs,), in either order.

    **Returns** the radius of the impulse between over that of the smaller circle, (*runs,): beyond
    it three impulses are cheaper. Infinite, with the derivative zero, where they never are (ratios
    below 11.94); the radius of the larger circle where they always are (above 15.58).
    """
    x = as_float(ratio)
    # The way back takes the same impulses in the opposite order.
    x = jnp.where(x < 1.0, 1.0 / x, x)
    one = jnp.ones_like(x)
    never, always = _excess(0.0 * one, x) >= 0.0, _excess(one, x) <= 0.0
    # Thirteen is between both limits: it replaces a ratio without a root, so that nothing is NaN.
    u = _root(jnp.where(never | always, 13.0, x))
    return jnp.where(never, math.inf, jnp.where(always, x, jnp.where(never | always, 13.0, x) / u))


@jax.custom_jvp
def _root(x: Scalar) -> Scalar:
    """The u of the break-even."""

    def halve(_, bounds):
        low, high = bounds
        middle = 0.5 * (low + high)
        cheaper = _excess(middle, x) < 0.0
        return jnp.where(cheaper, middle, low), jnp.where(cheaper, high, middle)

    # As many halvings as u has binary digits: it is small only near a ratio of 11.94.
    steps = 2 - int(math.log2(jnp.finfo(x.dtype).eps))
    return jax.lax.fori_loop(0, steps, halve, (jnp.zeros_like(x), jnp.ones_like(x)))[1]


@_root.defjvp
def _root_rule(primals: tuple[Scalar], tangents: tuple[Scalar]) -> tuple[Scalar, Scalar]:
    # The implicit function theorem: Q stays zero.
    (x,), (dx,) = primals, tangents
    u = _root(x)
    one = jnp.ones_like(x)
    along_u = jax.jvp(lambda u: _excess(u, x), (u,), (one,))[1]
    along_x = jax.jvp(lambda x: _excess(u, x), (x,), (one,))[1]
    return u, -along_x / along_u * dx


def _excess(u: Scalar, x: Scalar) -> Scalar:
    """Q of the module: negative where three impulses are cheaper."""
    circular = inverse_sqrt(x)
    # At the smaller circle, at the impulse between (twice), at the larger circle: differences of
    # squares of speeds over their sums.
    out = sqrt(2.0 * x / (u + x))
    leave = 2.0 * x / ((u + x) * (1.0 + x)) / (out + jnp.sqrt(2.0 * x / (1.0 + x)))
    slow = u * jnp.sqrt(2.0 / (x * (1.0 + u)))
    raise_ = (1.0 + 2.0 * u) / (x * (1.0 + u)) / (slow + circular)
    speeds = jnp.sqrt(2.0 / (x * (x + 1.0))) + u * jnp.sqrt(2.0 / (x * (x + u)))
    fall = 2.0 * (x + u * (x + 1.0)) / (x * (x + 1.0) * (x + u)) / speeds
    back = 1.0 / (x * (1.0 + u)) / (jnp.sqrt(2.0 / (x * (1.0 + u))) + circular)
    return leave - raise_ + fall + back
