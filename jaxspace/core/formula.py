"""Formulas: functions of numbers whose arguments are checked by their annotations and ranges.

Without a check a text in the place of a number is found where it is first computed with, by an
error of JAX that names no argument, and a complex number is computed with in silence; a radius of
the wrong sign gives NaN.
"""

import functools
import inspect
import typing
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, TypeVar, cast

import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from .checks import InputError, check, is_concrete
from .field_types import SHOWN, is_real
from .types import as_float

Function = TypeVar("Function", bound=Callable[..., Any])


class Range(NamedTuple):
    """The accepted types of a number: `allowed` in words, and `contains`, which is false for
    NaN."""

    allowed: str
    contains: Callable[[Any], Any]


POSITIVE = Range("positive and finite", lambda x: (x > 0.0) & np.isfinite(x))
NOT_NEGATIVE = Range("zero or positive, and finite", lambda x: (x >= 0.0) & np.isfinite(x))
FINITE = Range("finite", lambda x: np.isfinite(x))
NOT_ZERO = Range("finite and not zero", lambda x: (x != 0.0) & np.isfinite(x))
# Where the limit at infinity has a meaning, as the other apsis of a parabola.
ABOVE_ZERO = Range("above zero", lambda x: x > 0.0)
BELOW_ONE = Range("at least zero and below one", lambda x: (x >= 0.0) & (x < 1.0))
UP_TO_ONE = Range("from zero to one", lambda x: (x >= 0.0) & (x <= 1.0))
ANY = Range("a number", lambda x: x == x)
# Of a vector: its components are not all zero.
AWAY = Range("away from the centre", lambda x: np.any(x != 0.0, axis=0))


class _Number(NamedTuple):
    """An argument for numbers: its position, its name, the lengths of its first axes (`None`
    for any), whether it may be absent, and its range."""

    place: int
    name: str
    shape: tuple[int | None, ...]
    optional: bool
    range: Range


@typing.overload
def formula(function: Function, /) -> Function:
    """Decorator without ranges."""
    ...


@typing.overload
def formula(
    **ranges: Range,
) -> Callable[[Function], Function]:  # pyright: ignore[reportInvalidTypeVarUse]
    """Decorator with the ranges of some arguments."""
    ...


def formula(function: Callable[..., object] | None = None, /, **ranges: Range) -> Any:
    """Check the arguments of a function that its annotations declare as real numbers:
    `@formula`, or with ranges `@formula(radius=POSITIVE, eccentricity=NOT_NEGATIVE)`.

    Raises `InputError`, by the name of the argument, for text, complex numbers or other objects
    instead of numbers, for an array with a wrong number of components, and for a concrete number
    that is NaN or out of its range. Of the concrete numbers of several runs one out of its range
    becomes NaN, which marks its run and harms no other. Traced values are checked by type and shape
    only, at no cost in the compiled program."""
    if function is None:
        return lambda function: _checked(function, ranges)
    return _checked(function, {})


def _checked(function: Function, ranges: Mapping[str, Range]) -> Function:
    numbers = tuple(_numbers_of(function, ranges))
    by_name = {number.name: number for number in numbers}
    if not set(ranges) <= set(by_name):
        raise TypeError(f"{function.__name__}: no numbers {sorted(set(ranges) - set(by_name))}")

    @functools.wraps(function)
    def checked(*given: object, **named: object) -> object:
        places = list(given)
        for number in numbers:
            if number.place < len(places):
                places[number.place] = _checked_value(number, places[number.place])
        for name, value in named.items():
            if name in by_name:
                named[name] = _checked_value(by_name[name], value)
        return function(*places, **named)

    checked.numbers = numbers  # type: ignore[attr-defined]
    return cast(Function, checked)


def _numbers_of(function: Callable[..., object], ranges: Mapping[str, Range]) -> list[_Number]:
    """The arguments of a function that take real numbers, with their ranges."""
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
        result.append(_Number(place, name, shape, optional, ranges.get(name, ANY)))
    return result


def _checked_value(number: _Number, x: object) -> object:
    """`x`, with NaN for the runs that are out of the range. Raises `InputError` unless it can be
    used as the number."""
    # The kinds of most calls first.
    if isinstance(x, float | int):
        _check_range(number, x)
        return x
    if x is None and number.optional:
        return x
    dtype = getattr(x, "dtype", None)
    if isinstance(x, list | tuple):
        x = as_float(x)
        dtype = getattr(x, "dtype", None)
    # Objects that define their conversion to an array are converted where they are used, as are
    # lists of other objects than numbers.
    if dtype is None and (isinstance(x, list | tuple) or hasattr(x, "__jax_array__")):
        return x
    if dtype is None or not is_real(x):
        raise InputError(f"{number.name} is {_shown(x)}: it must be {_allowed(number)}.")
    for length, wanted in zip(np.shape(x), number.shape, strict=False):
        if wanted is not None and length != wanted:
            raise InputError(
                f"{number.name} has the shape {np.shape(x)}: it must be {_allowed(number)}."
            )
    one_run = np.ndim(x) <= len(number.shape)
    # The components of a vector without a range, and of runs without one, are not read, because
    # that would wait for the device.
    if number.range is ANY and (number.shape or not one_run):
        return x
    if one_run:
        _check_range(number, x)
        return x
    if number.range is AWAY:
        _check_layout(number, x)
        return x
    return _marked(number, x)


def _check_layout(number: _Number, x: PyTree) -> None:
    """Raise `InputError` for as many known runs as components, of which one is at the centre: most
    likely the runs lead. For other shapes the result of such a run is NaN, and marks this run
    only."""
    if np.shape(x) == (3, 3) and is_concrete(x) and not np.all(AWAY.contains(np.asarray(x))):
        raise InputError(
            f"{number.name} has the shape (3, 3) and a column of zeros, the position of a run at "
            "the centre: the components are on the first axis, (3, *runs)."
        )


def _marked(number: _Number, x: PyTree) -> PyTree:
    """The numbers of several runs, NaN where they are known to be out of the range."""
    if not is_concrete(x):
        return x
    good = number.range.contains(np.asarray(x))
    return x if np.all(good) else jnp.where(good, x, jnp.nan)


def _check_range(number: _Number, x: object) -> None:
    """Raise `InputError` for concrete numbers that are NaN or out of their range."""
    if is_concrete(x):
        check(number.range.contains(np.asarray(x)), number.name, x, number.range.allowed)


def _allowed(number: _Number) -> str:
    if not number.shape:
        return "a number, or an array of numbers of the runs"
    axes = ", ".join("n" if n is None else str(n) for n in number.shape)
    return f"an array of numbers, ({axes}, *runs)"


def _shown(x: PyTree) -> str:
    if isinstance(x, str | bytes | complex) or x is None:
        text = repr(x)
        return text if len(text) <= SHOWN else f"{text[:SHOWN]}..."
    return f"of type {type(x).__name__}" + (f", {x.dtype}" if hasattr(x, "dtype") else "")
