"""Bounds of the unknowns of a search, as trees like them."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from ..core import InputError
from ..core.checks import is_concrete
from ._criterion import Point


class Bounds(NamedTuple):
    """Lower and upper bounds, trees like x; infinite where there is none."""

    lower: Point
    upper: Point


def as_bounds(bounds: PyTree, start: Point) -> Bounds:
    """The bounds as trees like `start`: from a pair of trees or numbers, or `None`.

    Raises `InputError` for another structure, or a lower bound above the upper one."""
    lower, upper = (None, None) if bounds is None else bounds
    made = []
    for tree, default in ((lower, -jnp.inf), (upper, jnp.inf)):
        tree = default if tree is None else tree
        if isinstance(tree, int | float) or getattr(tree, "ndim", None) == 0:
            tree = jax.tree.map(lambda x, tree=tree: tree, start)
        if jax.tree.structure(tree) != jax.tree.structure(start):
            raise InputError("bounds must have the structure of the start or be two numbers.")
        made.append(jax.tree.map(lambda b, x: jnp.broadcast_to(
            jnp.asarray(b, x.dtype), x.shape), tree, start))  # fmt: skip
    for low, high in zip(*(jax.tree.leaves(m) for m in made), strict=True):
        if not (is_concrete(low) and is_concrete(high)):
            continue
        if not np.all(np.asarray(low) < np.asarray(high)):
            raise InputError(f"bounds are {low} and {high}: the lower one must be below.")
    return Bounds(*made)
