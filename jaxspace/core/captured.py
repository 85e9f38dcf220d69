"""Functions with the arrays that they capture as leaves.

A function of a user, such as `lambda t, y, body: Load(acceleration_N=-k * y.velocity)`, holds the
number `k` out of reach of tree transformations: derivative rules, vectorisation and tests for
concrete values all operate on leaves. As a `Captured` it is equivalent to an `equinox.Module` with
the field `k`.
"""

import functools
import types
from collections.abc import Callable, Iterator
from typing import Any, TypeVar, final

import equinox as eqx
import jax
from jax.core import Tracer
from jaxtyping import PyTree

T = TypeVar("T")


@final
class _Code:
    """The remainder of a function without its variables."""

    def __init__(self, function: types.FunctionType):
        self.code, self.names = function.__code__, function.__globals__
        self.name = function.__name__

    def filled(self, cells: list, defaults: tuple | None, by_name: dict | None) -> Callable:
        """The function with these variables."""
        closure = tuple(types.CellType(*cell) for cell in cells)
        function = types.FunctionType(self.code, self.names, self.name, defaults, closure)
        function.__kwdefaults__ = by_name
        return function


class _Function(eqx.Module):
    """A module in place of a function: equal to itself only, as a function is. Transformations of
    JAX hash the function that they are given, and arrays have no hash."""

    def __hash__(self) -> int:
        return id(self)

    def __eq__(self, other: object) -> bool:
        return self is other


@final
class Captured(_Function):
    """A function, and the variables that it captures: of the functions around it, and the defaults
    of its arguments.

    A variable without a value is an empty tuple."""

    code: _Code = eqx.field(static=True)
    cells: list[tuple]
    defaults: tuple | None
    by_name: dict[str, Any] | None

    def __call__(self, *args: object, **kwargs: object) -> PyTree:
        return self.code.filled(self.cells, self.defaults, self.by_name)(*args, **kwargs)


@final
class _Applied(_Function):
    """A partial function, whose function may contain arrays, too."""

    function: Callable
    args: tuple
    keywords: dict[str, Any]

    def __call__(self, *args: object, **kwargs: object) -> PyTree:
        return self.function(*self.args, *args, **self.keywords | kwargs)


def captured_as_leaves(tree: T) -> T:
    """The tree in which each function that captures a traced array is replaced by a `Captured`, or
    by an object that applies one to arguments. Other functions are unchanged, such as the methods
    of a class that is not a pytree; of a function that captures itself, the inner one is
    unchanged."""
    if not any(isinstance(x, Tracer) for x in _variables(tree, ())):
        return tree
    return jax.tree.map(lambda x: _converted(x, ()), tree)


def _inside(function: object) -> PyTree | None:
    """The variables that a function captures; `None` for anything but a Python function."""
    if isinstance(function, functools.partial):
        return (function.func, function.args, function.keywords)
    if isinstance(function, types.MethodType):
        return function.__self__
    if isinstance(function, types.FunctionType):
        cells = [_content(cell) for cell in function.__closure__ or ()]
        return (cells, function.__defaults__, function.__kwdefaults__)
    return None


def _content(cell: types.CellType) -> tuple:
    """The content of a variable, as a tuple that is empty where there is none."""
    try:
        return (cell.cell_contents,)
    except ValueError:
        return ()


def _variables(tree: PyTree, outer: tuple) -> Iterator[object]:
    """The arrays and other leaves that functions in a tree capture, directly or by each other."""
    for leaf in jax.tree.leaves(tree):
        inside = _inside(leaf)
        # A function may capture itself.
        if inside is not None and not any(leaf is each for each in outer):
            yield from (x for x in jax.tree.leaves(inside) if _inside(x) is None)
            yield from _variables(inside, (*outer, leaf))


def _converted(leaf: PyTree, outer: tuple) -> PyTree:
    """A leaf, or a function without the arrays that it captures."""
    inside = _inside(leaf)
    if inside is None or any(leaf is each for each in outer):
        return leaf
    if not any(isinstance(x, Tracer) for x in _variables(leaf, ())):
        return leaf
    inside = jax.tree.map(lambda x: _converted(x, (*outer, leaf)), inside)
    if isinstance(leaf, functools.partial):
        return _Applied(*inside)
    if isinstance(leaf, types.MethodType):
        return _Applied(leaf.__func__, (inside,), {})
    return Captured(_Code(leaf), *inside)
