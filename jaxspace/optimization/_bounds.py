"""Bounds by smooth maps from free numbers q, whose slope vanishes at a bound, so that an optimum
there is an ordinary point of a descent.

    a <= x <= b    x = a + (b - a)(1 + sin q)/2
    a <= x         x = a - 1 + sqrt(1 + q^2)            x <= b    x = b + 1 - sqrt(1 + q^2)

Source: James and Roos, MINUIT (Comput. Phys. Commun. 10, 1975).
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..core import InputError
from ..core.checks import is_concrete
from ._criterion import Point

# How near a bound a descent may begin, in units of its range: on it the slope of the map is zero.
NEAREST = 1e-3


class Bounds(NamedTuple):
    """Lower and upper bounds, trees like x; infinite where there is none."""

    lower: Point
    upper: Point

    def inside(self, q: Point) -> Point:
        """The x of free numbers."""
        return jax.tree.map(_inside, q, self.lower, self.upper)

    def free(self, x: Point) -> Point:
        """The free numbers of an x, moved inside where it lies on a bound or beyond."""
        return jax.tree.map(_free, x, self.lower, self.upper)


def as_bounds(bounds: Any, start: Point) -> Bounds:
    """The bounds as trees like `start`: from a pair of trees or numbers, or `None`.

    Raises `InputError` for another structure, or a lower bound above the upper one."""
    lower, upper = (None, None) if bounds is None else bounds
    made = []
    for tree, default in ((lower, -jnp.inf), (upper, jnp.inf)):
        tree = default if tree is None else tree
        if isinstance(tree, int | float) or getattr(tree, "ndim", None) == 0:
            tree = jax.tree.map(lambda x, tree=tree: tree, start)
        if jax.tree.structure(tree) != jax.tree.structure(start):
            raise InputError("bounds must have the structure of the start, or be two numbers.")
        made.append(jax.tree.map(lambda b, x: jnp.broadcast_to(
            jnp.asarray(b, x.dtype), x.shape), tree, start))  # fmt: skip
    for low, high in zip(*(jax.tree.leaves(m) for m in made), strict=True):
        if not (is_concrete(low) and is_concrete(high)):
            continue
        if not np.all(np.asarray(low) < np.asarray(high)):
            raise InputError(f"bounds are {low} and {high}: the lower one must be below.")
    return Bounds(*made)


def _inside(q: Array, low: Array, high: Array) -> Array:
    below, above = jnp.isfinite(low), jnp.isfinite(high)
    # Finite in place of bounds that are none: the branch not taken would be NaN in its derivative.
    a, b = jnp.where(below, low, 0.0), jnp.where(above, high, 1.0)
    root = jnp.sqrt(1.0 + q * q) - 1.0
    both = a + 0.5 * (b - a) * (1.0 + jnp.sin(q))
    one = jnp.where(below, a + root, jnp.where(above, b - root, q))
    return jnp.where(below & above, both, one)


def _free(x: Array, low: Array, high: Array) -> Array:
    below, above = jnp.isfinite(low), jnp.isfinite(high)
    a, b = jnp.where(below, low, 0.0), jnp.where(above, high, 1.0)
    share = jnp.clip((x - a) / (b - a), NEAREST, 1.0 - NEAREST)
    off = 1.0 + jnp.maximum(jnp.where(below, x - a, b - x), NEAREST)
    one = jnp.where(below | above, jnp.sqrt(off * off - 1.0), x)
    return jnp.where(below & above, jnp.arcsin(2.0 * share - 1.0), one)
