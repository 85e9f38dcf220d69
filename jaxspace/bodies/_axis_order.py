"""The principal axes of a body, in the order in which its free rotation is written: the axis of the
intermediate moment second, and third the outer axis from which the angular momentum stays farther.

Source: `_free_rotation.py`.
"""

import jax.numpy as jnp

from ..core import Flag, Vector
from ..core.safe import safe_divide


def axis_order(moments: Vector, omega: Vector) -> tuple[tuple[Flag, Flag], Flag]:
    """Whether the first or the last axis is the intermediate one, and whether the other two change
    places."""
    i0, i1, i2 = moments
    # For two equal moments a product is zero, so that the first case takes them.
    middle = (
        (i0 - i1) * (i0 - i2) <= 0.0,
        ((i2 - i0) * (i2 - i1) <= 0.0) & ((i0 - i1) * (i0 - i2) > 0.0),
    )
    (a, b, c), (u, v, w) = arranged(moments, middle, False), arranged(omega, middle, False)
    # For a sphere all three moments are equal, and any order of axes is right.
    share = safe_divide(b - c, a - c) * b * b * v * v
    rest = safe_divide(a - b, a - c) * b * b * v * v
    # The squares of L_1 and L_3 where the polhode crosses the plane of these two axes.
    return middle, a * a * u * u + a / b * share < c * c * w * w + c / b * rest


def arranged(v: Vector, middle: tuple[Flag, Flag], mirrored: Flag) -> Vector:
    """Components along the arranged axes: a cyclic change, and the exchange of the outer axes."""
    first, last = middle
    a = jnp.where(first, v[2], jnp.where(last, v[1], v[0]))
    b = jnp.where(first, v[0], jnp.where(last, v[2], v[1]))
    c = jnp.where(first, v[1], jnp.where(last, v[0], v[2]))
    return jnp.stack([jnp.where(mirrored, c, a), b, jnp.where(mirrored, a, c)])


def restored(v: Vector, middle: tuple[Flag, Flag], mirrored: Flag) -> Vector:
    """Components along the axes as they were given."""
    first, last = middle
    a = jnp.where(mirrored, v[2], v[0])
    b = v[1]
    c = jnp.where(mirrored, v[0], v[2])
    x = jnp.where(first, b, jnp.where(last, c, a))
    y = jnp.where(first, c, jnp.where(last, a, b))
    return jnp.stack([x, y, jnp.where(first, a, jnp.where(last, b, c))])
