"""The circles between which a heavy top nutates: the cubic of `nutation.py`, solved without a lost
digit.

The unknown is d = y3 - |beta|, measured from the vertical at which the weight is highest, whose
constants are e = alpha - |beta| and g = gamma - N:

    d^3 + a2 d^2 + a1 d = (|beta| g)^2,     a2 = 2 |beta| - e - N^2,   a1 = 2 |beta| (N g - e)
    q = |beta| (2 - u1 - u2) = d + a2 = (|beta|^2 X - a1)/d
    X = (1 - u1)(1 - u2) = g^2/d = (a1 + q d)/|beta|^2

d, q and X are not negative, and of each pair of forms one is a sum of non-negative terms: the sign
of a1 selects it. So no digit is lost where d and 1 - u1 vanish together, the separatrix, where the
period is infinite; e and g, which decide there, are formed from the state, not from alpha and
gamma.

For a nearly steady precession alpha and gamma do not determine the width u1 - u2, because f has
nearly a double root. A state does, through f and its slope there:

    P = (u1 - u)(u - u2) = u'^2/(y3 - beta u)
    u1 + u2 - 2 u = [f'(u) + beta P]/(y3 - beta u)
    (u1 - u2)^2 = (u1 + u2 - 2 u)^2 + 4 P          f'(u) = 2 N (gamma - N u) - beta (1 - u^2)
                                                           - 2 u (alpha - beta u)

Without one, u = gamma/N is taken where it is on the way: the middle of a fast top's narrow path.

Source: Thomson 5.13-18..21 (cubic); symbols as in `nutation.py`.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from ..core import Flag, Scalar
from ..core.barrier import computed_once
from ..core.safe import safe_divide, safe_sqrt
from ..core.squares import quotient

# Newton's steps: the two bounds from which they start are within a factor of 1.5 of the root, and
# five steps reach rounding from there.
STEPS = 7


class Place(NamedTuple):
    """A point of a nutation: sin^2 (`up`) and cos^2 (`down`) of half the
    nutation angle, u'^2, 1/s^2, and f'(u), 1/s^2."""

    up: Scalar
    down: Scalar
    rate_squared: Scalar
    slope: Scalar


class TurningCircles(NamedTuple):
    """d, 1/s^2, and sums and products of sin^2 (`up`) and cos^2 (`down`) of half the two turning
    angles, which are measured from the vertical at which the weight is highest; the square of the
    difference of both sin^2, or of both cos^2."""

    d: Scalar
    sum_up: Scalar
    product_up: Scalar
    sum_down: Scalar
    product_down: Scalar
    apart_squared: Scalar

    @property
    def half_angles(self) -> tuple[tuple[Scalar, Scalar], tuple[Scalar, Scalar]]:
        """sin^2 and cos^2 of half the turning angle, of the nearer and of the farther circle."""
        apart = safe_sqrt(self.apart_squared)
        sine, cosine = 0.5 * (self.sum_up + apart), 0.5 * (self.sum_down + apart)
        # Where both circles are the vertical, each takes half of the sum's derivative.
        near = jnp.where(
            sine == 0.0, 0.5 * (self.sum_up - apart), safe_divide(self.product_up, sine)
        )
        return (
            (near, cosine),
            (sine, safe_divide(self.product_down, cosine)),
        )


def turning_circles(
    N: Scalar,
    b: Scalar,
    e: Scalar,
    g: Scalar,
    e_down: Scalar,
    g_down: Scalar,
    start: Place | None,
) -> TurningCircles:
    """The solution of the cubic for an axis whose weight is highest at u = 1.

    **Arguments**

    - `N`, 1/s, and `b`, 1/s^2: N and |beta|.
    - `e`, 1/s^2, and `g`, 1/s: alpha - b and gamma - N.
    - `e_down` and `g_down`: alpha + b and gamma + N.
    - `start`: a place on the way, seen from the same vertical, or None.
    """
    half_slope = N * g - e
    a2 = 2.0 * b - e - N * N
    a1 = 2.0 * b * half_slope
    d = _largest_root(a2, a1, (b * g) ** 2)
    # Of each pair of forms, the one that adds non-negative numbers. Those divided by d have d > 0,
    # because a1 < 0 or a2 < 0; those divided by |beta| have |beta| > 0, because a2 > 0. Where d
    # vanishes with a2, at the critical spin, the sum still has a derivative.
    wide, falls = (a2 > 0.0) | ((a2 == 0.0) & (b > 0.0)), (a1 < 0.0) | (a2 <= 0.0)
    below = jnp.where(falls & (d > 0.0), d, 1.0)
    width = jnp.where(wide, b, 1.0)
    rest = quotient(a2 + d, width)
    product = quotient(
        jnp.where(falls, g * g, 2.0 * half_slope + rest * d), jnp.where(falls, below, width)
    )
    total = jnp.where(wide, rest, quotient(b * product - 2.0 * half_slope, below))
    # From the other vertical y3 + |beta| is far: no second form is needed there.
    far = jnp.where(d + b == 0.0, 1.0, d + 2.0 * b)
    product_down = quotient(g_down * g_down, far)
    total_down = quotient(2.0 * (e_down + N * g_down) - b * product_down, far)
    # No `maximum`, which halves the derivative at zero.
    sum_up = 0.5 * jnp.where(total < 0.0, 0.0, total)
    product_up = 0.25 * jnp.maximum(product, 0.0)
    sum_down = 0.5 * jnp.where(total_down < 0.0, 0.0, total_down)
    product_down = 0.25 * product_down
    # The two forms are equal: that with the smaller terms is taken.
    nearer = sum_up < sum_down
    total = jnp.where(nearer, sum_up, sum_down)
    apart_squared = total * total - 4.0 * jnp.where(nearer, product_up, product_down)
    on_the_way = jnp.array(True)
    if start is None:
        start, on_the_way = _middle(N, b, e, g, g_down)
    # Where the difference loses digits.
    steady = on_the_way & (apart_squared < 0.25 * total * total)
    apart_squared = jnp.where(steady, _width_squared(start, b, d, steady), apart_squared)
    apart_squared = jnp.maximum(apart_squared, 0.0)
    return TurningCircles(d, sum_up, product_up, sum_down, product_down, apart_squared)


def _middle(N: Scalar, b: Scalar, e: Scalar, g: Scalar, g_down: Scalar) -> tuple[Place, Flag]:
    """The place u = gamma/N, where psi' vanishes, and whether the axis passes it."""
    # Both shares from 0 to 1; elsewhere one in place of a spin that may be far smaller than g.
    between = (N != 0.0) & (g * jnp.sign(N) <= 0.0) & (g_down * jnp.sign(N) >= 0.0)
    spin = 2.0 * jnp.where(between, N, 1.0)
    up, down = quotient(-g, spin), quotient(g_down, spin)
    energy = e + 2.0 * b * up
    passes = between & (energy >= 0.0)
    sin_squared = 4.0 * up * down
    slope = -b * sin_squared - 2.0 * (down - up) * energy
    return Place(up, down, energy * sin_squared, slope), passes


def _width_squared(start: Place, b: Scalar, d: Scalar, applies: Flag) -> Scalar:
    """(u1 - u2)^2 / 4 by the start, as a sum of squares, for runs for which it `applies`."""
    steep = d + 2.0 * b * start.up
    steep = jnp.where(applies & (steep > 0.0), steep, 1.0)
    product = quotient(start.rate_squared, steep)
    offset = quotient(start.slope + b * product, steep)
    return 0.25 * offset * offset + product


@computed_once
def _largest_root(a2: Scalar, a1: Scalar, c: Scalar) -> Scalar:
    """The largest root of d^3 + a2 d^2 + a1 d = c, where one is not negative and two are not
    positive."""

    def excess(d: Scalar) -> Scalar:
        return ((d + a2) * d + a1) * d - c

    def newton(d: Scalar) -> Scalar:
        return d - safe_divide(excess(d), (3.0 * d + 2.0 * a2) * d + a1)

    # Two upper bounds: Samuelson's, exact where the other two roots are equal, and, for a2 > 0, the
    # root without the cubic term, exact for a small root.
    samuelson = (2.0 * safe_sqrt(jnp.maximum(a2 * a2 - 3.0 * a1, 0.0)) - a2) / 3.0
    width = jnp.where(a2 > 0.0, a2, 1.0)
    root = safe_sqrt(a1 * a1 + 4.0 * width * c)
    quadratic = jnp.where(
        a1 < 0.0, quotient(0.5 * (root - a1), width), safe_divide(2.0 * c, a1 + root)
    )
    start = jnp.where(a2 > 0.0, jnp.minimum(samuelson, quadratic), samuelson)
    start = jax.lax.stop_gradient(jnp.maximum(start, 0.0))
    d = jax.lax.fori_loop(0, STEPS, lambda _, d: newton(d), start)
    # Two steps more carry the derivatives of first and second order.
    return newton(newton(jax.lax.stop_gradient(d)))
