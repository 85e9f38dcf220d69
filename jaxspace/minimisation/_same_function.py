"""Equality of functions by their code and their closures.

The functions of an optimiser of optax are new objects each time the optimiser is made, and JAX
compiles another program for each new object. Two functions with the same code and equal closures
can share a program.
"""

import functools
import types
from collections.abc import Hashable

import numpy as np


def content(value: object, above: tuple[int, ...] = ()) -> Hashable:
    """A key that is equal for values with the same content.

    Functions are compared by code, defaults and closures; tuples, lists, dictionaries and partial
    functions part by part; numbers and texts by type and value. Everything else, such as an array,
    is equal to itself alone: the key refers to it, so that its identity is not reused. A list or a
    dictionary may change later, and then has another key.

    - `above`: the functions, lists and dictionaries that contain this value."""
    if isinstance(value, types.FunctionType | list | dict):
        if id(value) in above:
            # A function that calls itself.
            return ("above", len(above) - above.index(id(value)))
    inside = (*above, id(value))
    if isinstance(value, types.FunctionType):
        cells = tuple(_cell(cell, inside) for cell in value.__closure__ or ())
        named = tuple((value.__kwdefaults__ or {}).items())
        defaults = content((value.__defaults__, named), inside)
        return (types.FunctionType, value.__code__, _Same(value.__globals__), defaults, cells)
    if isinstance(value, functools.partial):
        return (
            type(value),
            content((value.func, value.args, tuple(value.keywords.items())), above),
        )
    if isinstance(value, types.MethodType):
        return (type(value), content((value.__func__, value.__self__), above))
    if isinstance(value, list):
        return (type(value), tuple(content(x, inside) for x in value))
    if isinstance(value, dict):
        # In their order, in which the parts of a tree are visited.
        return (type(value), content(tuple(value.items()), inside))
    if isinstance(value, tuple):
        return (type(value), tuple(content(x, above) for x in value))
    if isinstance(value, float | np.floating):
        # The sign of zero counts, and NaN is the same as NaN.
        return (type(value), float(value).hex())
    if value is None or isinstance(value, bool | int | str | bytes | np.dtype | type):
        return (type(value), value)
    return _Same(value)


def same_values(a: Hashable, b: Hashable) -> bool:
    """Whether two keys of `content` differ in the types of numbers at most.

    Functions may replace a number in their closures by an equal one of another type when they are
    first called, as the schedules of optax do with their number of steps."""
    return _with_floats(a) == _with_floats(b)


def _with_floats(key: Hashable) -> Hashable:
    match key:
        case (kind, str(number)) if kind is float:
            return (float, float.fromhex(number))
        case (kind, int(number)) if kind is int:
            return (float, float(number))
        case tuple():
            return tuple(map(_with_floats, key))
    return key


def _cell(cell: types.CellType, above: tuple[int, ...]) -> Hashable:
    try:
        return content(cell.cell_contents, above)
    except ValueError:
        # Not assigned yet.
        return ("empty",)


class _Same:
    """An object, compared by identity."""

    def __init__(self, value: object):
        self.value = value

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and other.value is self.value

    def __hash__(self) -> int:
        return id(self.value)
