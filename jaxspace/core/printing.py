"""Printing of results, states and declared parameters: the names, numbers and units of their
fields.

Printed on one line where it fits, else as a table with a row for each field; nested objects have a
row for each of their fields. Large arrays are printed as their shape with the least and the
greatest number, traced ones as their shape only.
"""

import dataclasses
import enum
from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple, TypeAlias, TypeVar

import jax
import numpy as np
from jax.core import Tracer
from jaxtyping import PyTree

from .field_types import QUANTITY
from .suggestions import suggests
from .text import aligned

Class = TypeVar("Class", bound=type)
# A unit, empty for a pure number, or the meaning of a code.
Unit: TypeAlias = str | type[enum.IntEnum]

# The attribute of a class with the units of its fields.
UNITS = "_printed_units"
# Columns of one line, and of one within a table.
WIDTH, SHORT_LINE = 100, 64
# Numbers of an array that are printed in full, rows of a table.
MOST_NUMBERS, MOST_ROWS = 6, 36


class Row(NamedTuple):
    """The line of one number, array or text: its name, unit and value, in words."""

    name: str
    unit: str
    value: str


def printed(**units: Unit) -> Callable[[Class], Class]:
    """Let the instances of a class print their fields with numbers and units, and suggest the
    nearest name for an unknown attribute.

    **Arguments**

    - `units`: of the fields that are no `quantity`, by name: empty for a pure number, or the
      `IntEnum` of a code.

    **Returns** the decorator, for modules and named tuples."""

    def decorate(cls: Class) -> Class:
        setattr(cls, UNITS, units)
        cls.__repr__ = lambda self: printed_form(self)  # type: ignore[assignment]
        return suggests(cls)

    return decorate


def printed_form(thing: object) -> str:
    """The fields of `thing`, as its `__repr__`."""
    rows = list(_rows(thing, ""))
    title = type(thing).__name__
    line = ", ".join(f"{row.name}={' '.join(filter(None, (row.value, row.unit)))}" for row in rows)
    if len(title) + len(line) + 2 <= WIDTH:
        return f"{title}({line})"
    shown = [(row.name, row.unit, row.value) for row in rows[:MOST_ROWS]]
    more = [f"and {len(rows) - len(shown)} more"] if len(rows) > len(shown) else []
    lines = [*aligned(shown, left=3).splitlines(), *more]
    return "\n".join([title, *(f"  {line[:WIDTH]}" for line in lines)])


def units_of(cls: type) -> Mapping[str, Unit]:
    """The units by which the fields of a class print, without those that declare none."""
    fields = dataclasses.fields(cls) if dataclasses.is_dataclass(cls) else ()
    declared = {x.name: x.metadata[QUANTITY].unit for x in fields if QUANTITY in x.metadata}
    return {**declared, **getattr(cls, UNITS, {})}


def _rows(thing: object, prefix: str) -> Iterator[Row]:
    """A row for each field that is present."""
    names = getattr(thing, "_fields", None) or [
        field.name
        for field in dataclasses.fields(thing)  # type: ignore[arg-type]
    ]
    units = units_of(type(thing))
    for name in names:
        # While a constructor fails, some fields are not there yet.
        yield from _row(getattr(thing, name, None), prefix + name, units.get(name, ""))


def _row(x: PyTree, name: str, unit: Unit) -> Iterator[Row]:
    """The rows of a value: one, or those of its fields and entries."""
    if x is None:
        return
    if hasattr(type(x), UNITS):
        yield from _inner_rows(x, name)
    # A named tuple that is not decorated is part of a computation.
    elif (isinstance(x, Mapping) or type(x) in (tuple, list)) and not _is_numbers(x):
        entries = x.items() if isinstance(x, Mapping) else enumerate(x)
        for key, entry in entries:
            yield from _row(entry, f"{name}.{key}", unit)
    else:
        known = "" if isinstance(unit, type) else unit
        yield Row(name, known if _is_numbers(x) else "", _value(x, unit))


def _inner_rows(x: object, name: str) -> Iterator[Row]:
    """The rows of a field that is a result, a state or an object of parameters itself."""
    rows = list(_rows(x, f"{name}."))
    if UNITS in vars(type(x)):
        # Objects with a single field, such as a quaternion, have the name of the field that
        # contains them.
        yield from [rows[0]._replace(name=name)] if len(rows) == 1 else rows
        return
    # Parameters are identified by their class.
    line = printed_form(x)
    if len(line) <= SHORT_LINE and "\n" not in line:
        yield Row(name, "", line)
    else:
        yield Row(name, "", type(x).__name__)
        yield from rows


def _is_numbers(x: object) -> bool:
    """Whether `x` is a number, an array or a list of plain numbers."""
    if isinstance(x, list | tuple):
        return bool(x) and all(isinstance(entry, int | float) for entry in x)
    return isinstance(x, int | float | complex | np.ndarray | np.generic | jax.Array)


def _value(x: object, unit: Unit) -> str:
    """A number, an array or any other value in words."""
    if isinstance(x, Tracer | jax.ShapeDtypeStruct):
        return f"{x.dtype}{list(x.shape)}"
    if isinstance(x, str | bool):
        return f"{x}"
    if not _is_numbers(x):
        return getattr(x, "__name__", type(x).__name__)
    if isinstance(x, jax.Array) and not x.is_fully_addressable:
        return f"{x.dtype}{list(x.shape)}"
    return _numbers(np.asarray(x), unit)


def _numbers(x: np.ndarray, unit: Unit) -> str:
    if isinstance(unit, type) and x.ndim == 0:
        return unit(int(x)).name
    if x.ndim == 0:
        return _number(x[()])
    if x.size <= MOST_NUMBERS:
        return f"[{', '.join(_number(number) for number in x.ravel())}]"
    shape = f"{x.dtype}{list(x.shape)}"
    if x.dtype.kind not in "iuf":
        return shape
    # NaN of failed runs hides the others from `min`, and not from `fmin`.
    low, high = (_number(function.reduce(x.ravel())) for function in (np.fmin, np.fmax))
    return f"{shape} from {low} to {high}"


def _number(x: object) -> str:
    """Counts in full, measured numbers to six digits; negative zero is printed without sign."""
    return f"{x + 0.0:.6g}" if isinstance(x, float | np.floating) else f"{x}"
