"""Answers that depend on the structure of trees and on the shapes of their arrays, and on no
number: found once for each make, and kept.

To trace a vector field takes longer than a short run, and a run asks several such questions.
"""

import functools
from collections.abc import Callable, Hashable
from typing import Any, TypeVar

import jax
import numpy as np

T = TypeVar("T")
Leaf = TypeVar("Leaf")

# Makes of systems and states for which a question keeps its answers.
KEPT = 512


def shape_of(x: Leaf) -> Leaf | jax.ShapeDtypeStruct:
    """The shape and precision of an array; anything else as it is."""
    if not isinstance(x, jax.Array | np.ndarray):
        return x
    # A weak type promotes in its own way, and leads to another trace.
    return jax.ShapeDtypeStruct(x.shape, x.dtype, weak_type=getattr(x, "weak_type", False))


def once_per_structure(function: Callable[..., T]) -> Callable[..., T]:
    """A function of trees that meets the shapes of their arrays in place of the arrays, and runs
    once for each structure and shapes.

    Its answer is kept, so that it must be one that nobody changes. An error is not kept. Where a
    leaf or a static field cannot be hashed, the function runs every time."""

    @functools.lru_cache(maxsize=KEPT)
    def kept(structure: jax.tree_util.PyTreeDef, leaves: tuple[Hashable, ...]) -> T:
        args, kwargs = jax.tree.unflatten(structure, leaves)
        return function(*args, **kwargs)

    @functools.wraps(function)
    def of_trees(*args: Any, **kwargs: Any) -> T:
        leaves, structure = jax.tree.flatten((args, kwargs))
        shapes = tuple(map(shape_of, leaves))
        try:
            hash((structure, shapes))
        except TypeError:
            return kept.__wrapped__(structure, shapes)
        return kept(structure, shapes)

    return of_trees
