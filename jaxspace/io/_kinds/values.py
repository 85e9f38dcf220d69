"""Kinds of single values and of lists: numbers with units, whole numbers, names, text,
files."""

import math
from dataclasses import dataclass

from ...core.file_names import SEPARATORS, file_name_fault
from ...core.quantities import Quantity
from ...core.text import is_printable
from ..units import dimension, expected, read_number
from .errors import hint, wrong
from .kind import Kind, Reading, Schema, Value

LONGEST_TEXT = 200
"""Maximum number of characters of a title or a name, so that it fits into tables and figures."""
LONGEST_PART = 100
"""Bytes of a name in the names of files, which have 255 with all of their parts."""


# A float, so that checks compare it like any number; only dispersions need the rest.
class Measure(float):
    """A number in SI units that may be dispersed, with its quantity and the unit in which it is
    written."""

    quantity: Quantity
    unit: str

    @classmethod
    def of(cls, number: float, quantity: Quantity, unit: str) -> "Measure":
        """The `number` as a measure of this quantity."""
        measure = cls(number)
        measure.quantity, measure.unit = quantity, unit
        return measure


class Known(float):
    """A number in SI units that cannot be dispersed, but is an argument of programs."""


@dataclass(frozen=True, eq=False)
class Number(Kind):
    """A number of a `quantity`, with or without unit.

    `shapes`: whether a fixed quantity is part of the structure of programs, and no argument."""

    quantity: Quantity
    shapes: bool = True

    def read(self, value: object, path: str, reading: Reading) -> Value:
        try:
            number, unit = read_number(value, self.quantity)
        except ValueError as error:
            # Collected and not raised, so that all errors of the file are reported at once.
            reading.errors.append(wrong(path, value, str(error)))
            return None
        if unit:
            reading.units.add(path, self.quantity.unit, unit)
        # A number that fixes the shape of a program cannot be dispersed, and stays a plain number.
        if self.quantity.fixed:
            return number if self.shapes else Known(number)
        return Measure.of(number, self.quantity, unit)

    def expected(self) -> str:
        return expected(self.quantity)

    def schema(self) -> Schema:
        low, high, strict = self.quantity.low, self.quantity.high, self.quantity.strict
        number: Schema = {"type": "number"}
        if low > -math.inf:
            number["exclusiveMinimum" if strict else "minimum"] = low
        if high < math.inf:
            number["exclusiveMaximum" if strict else "maximum"] = high
        if self.quantity.unit == "":
            # A percentage is the only unit of a pure number that is accepted.
            return {"anyOf": [number, {"type": "string", "pattern": "%\\s*$"}]}
        name, example = dimension(self.quantity.unit)
        text = {"type": "string", "description": f"with a unit of {name}", "examples": [example]}
        return {"anyOf": [number, text], "description": f"{name}, in {self.quantity.unit}"}


@dataclass(frozen=True, eq=False)
class ListOf(Kind):
    """A list of entries of one kind: `count` of them, or at least `least`."""

    kind: Kind
    count: int | None = None
    least: int = 0

    def read(self, value: object, path: str, reading: Reading) -> Value:
        # A number in place of a list is rejected, because its component is unclear.
        short = isinstance(value, list) and len(value) < self.least
        if (
            not isinstance(value, list)
            or short
            or (self.count is not None and len(value) != self.count)
        ):
            reading.errors.append(wrong(path, value, self.expected()))
            return None
        entries = [self.kind.read(v, f"{path}.{k}", reading) for k, v in enumerate(value)]
        rows = {len(entry) for entry in entries if isinstance(entry, list)}
        if isinstance(self.kind, ListOf) and len(rows) > 1:
            reading.errors.append(wrong(path, value, "lists of equal length"))
            return None
        return entries

    def expected(self) -> str:
        least = {0: "", 1: "one or more "}.get(self.least, f"at least {self.least} ")
        count = f"{self.count} " if self.count else least
        return f"a list of {count}entries, each {self.kind.expected()}"

    def schema(self) -> Schema:
        least = self.least if self.count is None else self.count
        made = {"type": "array", "items": self.kind.schema(), "minItems": least}
        return made if self.count is None else {**made, "maxItems": self.count}


@dataclass(frozen=True, eq=False)
class OneName(Kind):
    """One name out of several."""

    names: tuple[str, ...]

    def read(self, value: object, path: str, reading: Reading) -> Value:
        if value not in self.names:
            line = wrong(path, value, self.expected())
            reading.errors.append(line + hint(value, self.names))
            return None
        return value

    def expected(self) -> str:
        return f"one of {', '.join(self.names)}"

    def schema(self) -> Schema:
        return {"enum": list(self.names)}


@dataclass(frozen=True, eq=False)
class Text(Kind):
    """A text of one line, which is printed and drawn as it is."""

    def read(self, value: object, path: str, reading: Reading) -> Value:
        if isinstance(value, str) and len(value) <= LONGEST_TEXT and is_printable(value):
            return value
        reading.errors.append(wrong(path, value, self.expected()))
        return None

    def expected(self) -> str:
        return f"a single line of at most {LONGEST_TEXT} printable characters"

    def schema(self) -> Schema:
        return {"type": "string", "maxLength": LONGEST_TEXT}


@dataclass(frozen=True, eq=False)
class PartOfFileName(Kind):
    """A name that becomes a part of the names of files and of arrays in a store."""

    def read(self, value: object, path: str, reading: Reading) -> Value:
        if isinstance(value, str) and not file_name_fault(value, LONGEST_PART):
            return value
        reading.errors.append(wrong(path, value, self.expected()))
        return None

    def expected(self) -> str:
        return (
            f"text that can be part of a file name: at most {LONGEST_PART} printable bytes without "
            f"{' '.join(SEPARATORS)}, not starting with a dot, not ending with a dot or a space, "
            "and not a Windows device name"
        )

    def schema(self) -> Schema:
        return {"type": "string", "minLength": 1, "maxLength": LONGEST_PART}


@dataclass(frozen=True, eq=False)
class FilePath(Kind):
    """The name of a file that can be read, relative to the scene file."""

    def read(self, value: object, path: str, reading: Reading) -> Value:
        if not isinstance(value, str):
            reading.errors.append(wrong(path, value, self.expected()))
            return None
        try:
            return reading.files.file(value, path)
        except ValueError as error:
            reading.errors.append(f"{path}: {error}")
            return None

    def expected(self) -> str:
        return "the name of a file, relative to this one"

    def schema(self) -> Schema:
        return {"type": "string", "description": self.expected()}


@dataclass(frozen=True, eq=False)
class Whole(Kind):
    """A whole number from `least` to `most`."""

    least: int = 1
    # Fits 32 bits: without double precision jax has no wider integers.
    most: int = 2**31 - 1

    def read(self, value: object, path: str, reading: Reading) -> Value:
        # In Python a truth value is an int: `runs = true` must not mean one run.
        if (
            isinstance(value, int)
            and not isinstance(value, bool)
            and self.least <= value <= self.most
        ):
            return value
        reading.errors.append(wrong(path, value, self.expected()))
        return None

    def expected(self) -> str:
        more = "above zero" if self.least == 1 else f"from {self.least} on"
        return f"a whole number {more}, at most {self.most}"

    def schema(self) -> Schema:
        return {"type": "integer", "minimum": self.least, "maximum": self.most}
