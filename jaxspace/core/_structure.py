"""Answers that depend on the structure of trees and on the shapes of their arrays, and on no
number: found once for each make, and kept.

To trace a vector field takes longer than a short run, and a run asks several such questions.
"""

import functools
from collections.abc import Callable, Hashable
from typing import Any, NamedTuple, TypeVar

import equinox as eqx
import jax
import numpy as np
from jax.typing import DTypeLike

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


class _Array(NamedTuple):
    """What is compared of an array: made and hashed in a tenth of the time of a
    `jax.ShapeDtypeStruct`."""

    shape: tuple[int, ...]
    dtype: DTypeLike
    weak_type: bool


def _compared(x: object) -> object:
    if isinstance(x, jax.Array):
        return _Array(x.shape, x.dtype, x.weak_type)
    return _Array(x.shape, x.dtype, False) if isinstance(x, np.ndarray) else x


def once_per_structure(function: Callable[..., T]) -> Callable[..., T]:
    """A function of trees that meets the shapes of their arrays in place of the arrays, and runs
    once for each structure and shapes.

    Its answer is kept, so that it must be one that nobody changes. An error is not kept. Where a
    leaf or a static field cannot be hashed, the function runs every time."""

    @functools.lru_cache(maxsize=KEPT)
    def kept(structure: jax.tree_util.PyTreeDef, leaves: tuple[Hashable, ...]) -> T:
        shapes = [
            jax.ShapeDtypeStruct(x.shape, x.dtype, weak_type=x.weak_type)
            if isinstance(x, _Array)
            else x
            for x in leaves
        ]
        args, kwargs = jax.tree.unflatten(structure, shapes)
        return function(*args, **kwargs)

    @functools.wraps(function)
    def of_trees(*args: Any, **kwargs: Any) -> T:
        leaves, structure = jax.tree.flatten((args, kwargs))
        compared = tuple(map(_compared, leaves))
        try:
            hash((structure, compared))
        except TypeError:
            return kept.__wrapped__(structure, compared)
        return kept(structure, compared)

    return of_trees


def without_numbers(function: Callable[..., T]) -> Callable[..., T]:
    """A function of trees whose answer holds no array and hangs on no number of theirs: traced once
    for each structure and shapes. One that decides by a number after all runs every time."""

    @once_per_structure
    def traced(*args: Any) -> tuple[T] | None:
        try:
            return (eqx.filter_eval_shape(function, *args),)
        # Whatever a function raises that asks a traced number for its value.
        except Exception:  # noqa: BLE001
            return None

    @functools.wraps(function)
    def of_trees(*args: Any) -> T:
        answer = traced(*args)
        return function(*args) if answer is None else answer[0]

    return of_trees
