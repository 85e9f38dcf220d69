"""Lists of numbers in place of arrays, for the functions that formulas are made of.

A `formula` converts lists as part of its checks. The functions of this package are called many
times while a program is traced, and read no number: lists are converted, and everything else
passes.
"""

import functools
import inspect
from collections.abc import Callable
from typing import Any, TypeVar, cast

import jax

from .checks import InputError
from .types import as_float

Function = TypeVar("Function", bound=Callable[..., Any])


def takes_lists(function: Function) -> Function:
    """Decorator: lists and tuples of numbers are accepted as arrays.

    Raises `InputError`, by the name of the argument, for a list of anything but numbers."""
    names = list(inspect.signature(function).parameters)
    # Those of a variable number of arguments have no name each.
    names += names[-1:] * 8

    @functools.wraps(function)
    def checked(*given: object, **named: object) -> object:
        arrays = [_as_array(name, x) for name, x in zip(names, given, strict=False)]
        return function(*arrays, **{name: _as_array(name, x) for name, x in named.items()})

    if isinstance(function, jax.custom_jvp):
        # The rule of the derivative is declared below the function.
        checked.defjvp = function.defjvp  # type: ignore[attr-defined]
    return cast(Function, checked)


def _as_array(name: str, x: object) -> object:
    if not isinstance(x, list | tuple):
        return x
    array = as_float(x)
    if isinstance(array, list | tuple):
        raise InputError(f"{name} is {x!r}: it must be a number, or an array or list of numbers.")
    return array
