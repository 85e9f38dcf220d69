"""A cache of answers that depend on the structure of trees and the shapes of their arrays only.

Tracing a vector field takes longer than a short run, and a run needs several such answers.
"""

import functools
import weakref
from collections.abc import Callable
from typing import Literal, NamedTuple, TypeVar

import equinox as eqx
import jax
import numpy as np
from jax.extend.core import Literal as Constant
from jax.typing import DTypeLike
from jaxtyping import PyTree

from .suggestions import suggests

T = TypeVar("T")
Leaf = TypeVar("Leaf")

# Number of structures for which a function caches its results.
KEPT = 512


def shape_of(x: Leaf) -> Leaf | jax.ShapeDtypeStruct:
    """The shape and precision of an array; anything else as it is."""
    if not isinstance(x, jax.Array | np.ndarray):
        return x
    # A weak type promotes in its own way, and leads to another trace.
    return jax.ShapeDtypeStruct(x.shape, x.dtype, weak_type=getattr(x, "weak_type", False))


class _Array(NamedTuple):
    """Key of an array for comparisons: made and hashed in a tenth of the time of a
    `jax.ShapeDtypeStruct`."""

    shape: tuple[int, ...]
    dtype: DTypeLike
    weak_type: bool


def _compared(x: object) -> object:
    if isinstance(x, jax.Array | jax.ShapeDtypeStruct):
        # The keys of random numbers have no weak type.
        return _Array(x.shape, x.dtype, getattr(x, "weak_type", False))
    return _Array(x.shape, x.dtype, False) if isinstance(x, np.ndarray) else x


class _Make:
    """Structure and shapes of a tree, hashed once, because large trees are looked up often."""

    __slots__ = ("hash", "leaves", "structure")

    def __init__(self, tree: PyTree):
        leaves, self.structure = jax.tree.flatten(tree)
        self.leaves = tuple(map(_compared, leaves))
        self.hash = hash((self.structure, self.leaves))

    def __hash__(self) -> int:
        return self.hash

    def __eq__(self, other: object) -> bool:
        if self is other:
            return True
        if not isinstance(other, _Make) or self.hash != other.hash:
            return False
        return self.structure == other.structure and self.leaves == other.leaves

    def shapes(self) -> PyTree:
        """The tree with shapes in place of its arrays."""
        leaves = [
            jax.ShapeDtypeStruct(x.shape, x.dtype, weak_type=x.weak_type)
            if isinstance(x, _Array)
            else x
            for x in self.leaves
        ]
        return jax.tree.unflatten(self.structure, leaves)


# By the identity of a module, which is immutable. An entry is deleted with its module.
_MAKES: dict[int, tuple[weakref.ref, _Make]] = {}


def _make_of(tree: PyTree) -> _Make:
    if not isinstance(tree, eqx.Module):
        return _Make(tree)
    known = _MAKES.get(id(tree))
    if known is not None and known[0]() is tree:
        return known[1]
    make = _Make(tree)
    key = id(tree)
    _MAKES[key] = weakref.ref(tree, lambda _: _MAKES.pop(key, None)), make
    return make


@suggests
class HashedModule(eqx.Module):
    """A module with a hash, although arrays have none: that of its structure and their shapes.

    `jax.jit` hashes the function that it is given, and with a method of a module the module:
    `jax.jit(task.step)`."""

    def __hash__(self) -> int:
        return hash(_make_of(self))


def same_structure(first: PyTree, second: PyTree) -> bool:
    """Whether two trees differ only in the numbers of their arrays.

    Trees with an unhashable leaf or static field are excluded."""
    try:
        return _make_of(first) == _make_of(second)
    except TypeError:
        return False


def once_per_structure(function: Callable[..., T]) -> Callable[..., T]:
    """A function of trees that meets the shapes of their arrays in place of the arrays, and runs
    once for each structure and shapes.

    Its answer is cached, so that it must not be changed later. An error is not cached. Where a
    leaf or a static field cannot be hashed, the function runs every time."""

    def of_makes(args: tuple[_Make, ...], kwargs: tuple[tuple[str, _Make], ...]) -> T:
        named = {name: make.shapes() for name, make in kwargs}
        return function(*(make.shapes() for make in args), **named)

    cached = functools.lru_cache(maxsize=KEPT)(of_makes)

    @functools.wraps(function)
    def of_trees(*args: PyTree, **kwargs: PyTree) -> T:
        try:
            makes = tuple(map(_make_of, args))
            named = tuple((name, _make_of(tree)) for name, tree in kwargs.items())
        except TypeError:
            shapes = jax.tree.map(shape_of, (args, kwargs))
            return function(*shapes[0], **shapes[1])
        return cached(makes, named)

    return of_trees


def reads_a_leaf(function: Callable[[PyTree], T]) -> Callable[[PyTree], T]:
    """A function of a tree that returns one of its leaves, or `None`: run once for each structure
    and shapes, to see which leaf it is. One that computes its result runs every time.

    Reading a leaf takes a hundredth of the time in which a scene creates its regularised
    variables."""

    @once_per_structure
    def place(tree: PyTree) -> int | Literal["none", "computed"]:
        shapes, static = eqx.partition(tree, lambda x: isinstance(x, jax.ShapeDtypeStruct))
        try:
            jaxpr = jax.make_jaxpr(lambda shapes: function(eqx.combine(shapes, static)))(shapes)
        # Whatever a tree raises that asks a traced number for its value.
        except Exception:  # noqa: BLE001
            return "computed"
        if not jaxpr.jaxpr.outvars:
            return "none"
        leaves = jax.tree.leaves(tree)
        arrays = [k for k, x in enumerate(leaves) if isinstance(x, jax.ShapeDtypeStruct)]
        places = dict(zip(jaxpr.jaxpr.invars, arrays, strict=True))
        (result,) = jaxpr.jaxpr.outvars
        # A number outside of arrays is a literal, which cannot be looked up.
        return "computed" if isinstance(result, Constant) else places.get(result, "computed")

    @functools.wraps(function)
    def of_tree(tree: PyTree) -> PyTree:
        where = place(tree)
        if isinstance(where, int):
            return jax.tree.leaves(tree)[where]
        return function(tree) if where == "computed" else None

    return of_tree


def without_numbers(function: Callable[..., T]) -> Callable[..., T]:
    """A function of trees whose result contains no arrays and does not depend on numbers: traced
    once for each structure and set of shapes. A function that reads a number after all runs every
    time."""

    @once_per_structure
    def traced(*args: PyTree) -> tuple[T] | None:
        try:
            return (eqx.filter_eval_shape(function, *args),)
        # jax raises one of these where a function reads the value of a traced number.
        except Exception:  # noqa: BLE001
            return None

    @functools.wraps(function)
    def of_trees(*args: PyTree) -> T:
        answer = traced(*args)
        return function(*args) if answer is None else answer[0]

    return of_trees
