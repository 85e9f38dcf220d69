"""Formulas: functions of numbers whose arguments are checked by their annotations.

Without a check a text in the place of a number is found where it is first computed with, by an
error of JAX that names no argument, and a complex number is computed with in silence.
"""

import functools
import inspect
import typing
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np

from .checks import InputError
from .field_types import SHOWN, is_real

Function = TypeVar("Function", bound=Callable[..., Any])


class _Number(NamedTuple):
    """An argument that takes numbers: its place, its name, the lengths of its first axes (`None`
    for any), and whether it may be absent."""

    place: int
    name: str
    shape: tuple[int | None, ...]
    optional: bool


def formula(function: Function) -> Function:
    """Check the arguments of a function that its annotations declare as real numbers.

    Raises `InputError`, by the name of the argument, for a text, a complex number or another object
    in the place of numbers, and for an array with another number of components. What is traced is
    checked by its type and shape alone, at no cost in the compiled program; NaN passes."""
    numbers = tuple(_numbers_of(function))
    by_name = {number.name: number for number in numbers}

    @functools.wraps(function)
    def checked(*given: Any, **named: Any) -> Any:
        for number in numbers:
            if number.place < len(given):
                _check(number, given[number.place])
        for name, value in named.items():
            if name in by_name:
                _check(by_name[name], value)
        return function(*given, **named)

    return cast(Function, checked)


def _numbers_of(function: Callable[..., Any]) -> list[_Number]:
    """The arguments of a function that take real numbers."""
    result = []
    for place, (name, argument) in enumerate(inspect.signature(function).parameters.items()):
        kinds = [argument.annotation, *typing.get_args(argument.annotation)]
        arrays = [kind for kind in kinds if getattr(kind, "dim_str", None) is not None]
        # One of several kinds of objects is checked where it is used.
        if len(arrays) != 1 or not set(kinds[1:]) <= {arrays[0], float, int, type(None)}:
            continue
        if any(dtype.startswith(("complex", "bool")) for dtype in arrays[0].dtypes or ()):
            continue
        axes = [x for x in arrays[0].dim_str.split() if not x.startswith(("*", "#", "."))]
        shape = tuple(int(x) if x.isdigit() else None for x in axes)
        optional = argument.default is None or type(None) in kinds
        result.append(_Number(place, name, shape, optional))
    return result


def _check(number: _Number, x: Any) -> None:
    """Raise `InputError` unless `x` can stand for the number."""
    # The kinds of most calls first.
    if isinstance(x, float | int) or (x is None and number.optional):
        return
    dtype = getattr(x, "dtype", None)
    # Lists are converted where they are used, and objects that say what array they are.
    if dtype is None and (isinstance(x, list | tuple) or hasattr(x, "__jax_array__")):
        return
    if dtype is None or not is_real(x):
        raise InputError(f"{number.name} is {_shown(x)}: it must be {_allowed(number)}.")
    for length, wanted in zip(np.shape(x), number.shape, strict=False):
        if wanted is not None and length != wanted:
            raise InputError(
                f"{number.name} has the shape {np.shape(x)}: it must be {_allowed(number)}."
            )


def _allowed(number: _Number) -> str:
    if not number.shape:
        return "a number, or an array of numbers of the runs"
    axes = ", ".join("n" if n is None else str(n) for n in number.shape)
    return f"an array of numbers, ({axes}, *runs)"


def _shown(x: Any) -> str:
    if isinstance(x, str | bytes | complex) or x is None:
        text = repr(x)
        return text if len(text) <= SHOWN else f"{text[:SHOWN]}..."
    return f"of type {type(x).__name__}" + (f", {x.dtype}" if hasattr(x, "dtype") else "")
