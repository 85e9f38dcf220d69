"""The map of Kustaanheimo and Stiefel from four parameters to a position: r = L(u) u.

Source: Stiefel, Scheifele, Linear and Regular Celestial Mechanics, sections 8, 9.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import Scalar, Vector
from ..core.square_roots import sqrt
from ..core.vectors import dot


def ks_parameters(r: Vector) -> Float[Array, "4 *#runs"]:
    """Some u, m^(1/2), of the position `r`, m: L(u) u = r."""
    x, y, z = r[0], r[1], r[2]
    # A circle of u belongs to one position. The u with u4 = 0 is taken where x >= 0, and the one
    # with u3 = 0 elsewhere, because the divisor below is then never close to zero.
    ahead = x >= 0.0
    first = sqrt(0.5 * (jnp.sqrt(dot(r, r)) + jnp.where(ahead, x, -x)))
    b = 0.5 * y / first
    c = 0.5 * z / first
    zero = jnp.zeros_like(x)
    return jnp.where(ahead, jnp.stack([first, b, c, zero]), jnp.stack([b, first, zero, c]))


def ks_map(u: Array, w: Array) -> Vector:
    """The first three rows of L(u) w; the position for w = u."""
    (a, b, c, d), (e, f, g, h) = u, w
    return jnp.stack(
        [
            a * e - b * f - c * g + d * h,
            b * e + a * f - d * g - c * h,
            c * e + d * f + a * g + b * h,
        ]
    )


def ks_transposed(u: Array, p: Vector) -> Float[Array, "4 *#runs"]:
    """L(u)^T p, for a vector p without a fourth component."""
    (a, b, c, d), (x, y, z) = u, p
    return jnp.stack(
        [a * x + b * y + c * z, a * y - b * x + d * z, a * z - c * x - d * y, d * x - c * y + b * z]
    )


def dot4(u: Array, w: Array) -> Scalar:
    """u . w of four components."""
    (a, b, c, d), (e, f, g, h) = u, w
    # Written out, because a reduction over four components hinders the compiler's fusion.
    return (a * e + b * f) + (c * g + d * h)
