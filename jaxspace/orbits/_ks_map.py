"""The map of Kustaanheimo and Stiefel from four parameters to a position: r = L(u) u.

Source: Stiefel, Scheifele, Linear and Regular Celestial Mechanics, sections 8, 9.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..core import Scalar, Vector, dot


def ks_parameters(r: Vector) -> Float[Array, "4 *#runs"]:
    """Some u, m^(1/2), of the position `r`, m: L(u) u = r."""
    x, y, z = r[0], r[1], r[2]
    # A circle of u belongs to one position. The u with u4 = 0 is taken where x >= 0, and the one
    # with u3 = 0 elsewhere, because the divisor below is then never close to zero.
    ahead = x >= 0.0
    first = jnp.sqrt(0.5 * (jnp.sqrt(dot(r, r)) + jnp.where(ahead, x, -x)))
    b = 0.5 * y / first
    c = 0.5 * z / first
    zero = jnp.zeros_like(x)
    return jnp.where(ahead, jnp.stack([first, b, c, zero]), jnp.stack([b, first, zero, c]))


# The three vectors of the rows of L(u) are u with its components exchanged in pairs, with signs.
# Written so, they need no reordering component by component, which compiles to slow code.
_SIGNS = np.array([[1.0, -1.0, -1.0, 1.0], [1.0, 1.0, -1.0, -1.0], [1.0, 1.0, 1.0, 1.0]])


def _row(u: Array, k: int) -> Array:
    """The row number `k` of L(u): component i is that number (i xor k) of u, with a sign."""
    axes = [axis for axis, bit in ((1, 1), (0, 2)) if k & bit]
    pairs = u.reshape(2, 2, *u.shape[1:])
    signs = jnp.asarray(_SIGNS[k].reshape(4, *(1,) * (u.ndim - 1)), u.dtype)
    return signs * jnp.flip(pairs, axes).reshape(u.shape)


def ks_map(u: Array, w: Array) -> Vector:
    """The first three rows of L(u) w; the position for w = u."""
    return jnp.stack([dot4(_row(u, k), w) for k in range(3)])


def ks_transposed(u: Array, p: Vector) -> Float[Array, "4 *#runs"]:
    """L(u)^T p, for a vector p without a fourth component."""
    return _row(u, 0) * p[0] + (_row(u, 1) * p[1] + _row(u, 2) * p[2])


def dot4(u: Array, w: Array) -> Scalar:
    """u . w of four components."""
    (a, b, c, d), (e, f, g, h) = u, w
    # Written out, because a reduction over four components hinders the compiler's fusion.
    return (a * e + b * f) + (c * g + d * h)
