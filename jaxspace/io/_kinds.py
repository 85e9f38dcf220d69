"""Kinds of entries of a scene file: each reads a value, says what it expects, and gives its JSON
schema.

A kind reads into plain numbers, text, lists and dicts. What else is learnt on the way - errors,
units, which way was chosen to give an object - goes into the `Reading`."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple, TypeAlias

from ..core import REQUIRED, Quantity
from ._errors import hint, missing, unknown, wrong
from ._units import dimension, expected, read_number

# What stands in a file: a table, a list, a number, text or `None`; where objects are built, arrays
# stand for the numbers. A recursive type would need a cast at every step of a path.
Value: TypeAlias = Any
Values: TypeAlias = dict[str, Value]
Schema: TypeAlias = dict[str, object]


# A float, so that checks compare it like any number; only what scatters asks for more.
class Measure(float):
    """A number in SI that may be dispersed, with what it is and the unit in which it is written."""

    quantity: Quantity
    unit: str

    @classmethod
    def of(cls, number: float, quantity: Quantity, unit: str) -> "Measure":
        """The `number` as a measure of this quantity."""
        measure = cls(number)
        measure.quantity, measure.unit = quantity, unit
        return measure


@dataclass
class Reading:
    """What reading a file finds besides the values: `errors`, the `makers` of objects by path, and
    the `units` as written, by their unit in SI."""

    errors: list[str] = field(default_factory=list)
    makers: dict[str, "Maker"] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)

    def take(self, other: "Reading") -> None:
        """Add what another reading has found."""
        self.errors += other.errors
        self.makers |= other.makers
        # The unit that was met first stays: reports use the one that the author reached for.
        self.units = {**other.units, **self.units}


class Kind(ABC):
    """What an entry of a file may be."""

    @abstractmethod
    def read(self, value: object, path: str, reading: Reading) -> Value:
        """The value as it is used; `None`, with an error in the `reading`, if it is wrong."""

    @abstractmethod
    def expected(self) -> str:
        """What a value must be, for a sentence."""

    @abstractmethod
    def schema(self) -> Schema:
        """The JSON schema."""


@dataclass(frozen=True, eq=False)
class Number(Kind):
    """A number of a `quantity`, with or without unit."""

    quantity: Quantity

    def read(self, value: object, path: str, reading: Reading) -> Value:
        try:
            number, unit = read_number(value, self.quantity)
        except ValueError as error:
            # Collected and not raised: the author sees every fault of the file in one go.
            reading.errors.append(wrong(path, value, str(error)))
            return None
        if unit:
            reading.units.setdefault(self.quantity.unit, unit)
        # What sets the shape of a program cannot scatter, so that it stays a plain number.
        return number if self.quantity.fixed else Measure.of(number, self.quantity, unit)

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
            # A percentage is the one unit of a pure number that people write.
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
        # A number in place of a list of one entry is refused: which component is meant is unclear.
        short = isinstance(value, list) and len(value) < self.least
        if (
            not isinstance(value, list)
            or short
            or (self.count is not None and len(value) != self.count)
        ):
            reading.errors.append(wrong(path, value, self.expected()))
            return None
        return [self.kind.read(v, f"{path}.{k}", reading) for k, v in enumerate(value)]

    def expected(self) -> str:
        count = f"{self.count} " if self.count else f"at least {self.least} " if self.least else ""
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
    """Any text."""

    def read(self, value: object, path: str, reading: Reading) -> Value:
        if isinstance(value, str):
            return value
        reading.errors.append(wrong(path, value, self.expected()))
        return None

    def expected(self) -> str:
        return "text"

    def schema(self) -> Schema:
        return {"type": "string"}


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


class Entry(NamedTuple):
    """An entry of a table.

    - `default`: the value where the file gives none; `REQUIRED` makes that an error.
    - `shared`: the path of the entry of the file that is taken instead.
    - `doc`: what it is."""

    kind: Kind
    default: object = REQUIRED
    shared: str = ""
    doc: str = ""


@dataclass(frozen=True, eq=False)
class Table(Kind):
    """A table of `entries`; a key that is not among them is an error."""

    entries: Mapping[str, Entry]

    def read(self, value: object, path: str, reading: Reading) -> Value:
        if not isinstance(value, Mapping):
            reading.errors.append(wrong(path, value, self.expected()))
            return None
        for key in value:
            if key not in self.entries:
                reading.errors.append(unknown(joined(path, key), key, self.entries))
        # In the order of the file: it is that of the effects of a scene, and of the units.
        keys = dict.fromkeys([*(key for key in value if key in self.entries), *self.entries])
        return {
            key: self._entry(
                self.entries[key], value.get(key, REQUIRED), joined(path, key), reading
            )
            for key in keys
        }

    def _entry(self, entry: Entry, value: object, path: str, reading: Reading) -> Value:
        if value is not REQUIRED:
            return entry.kind.read(value, path, reading)
        # The value comes from another table, which is not read yet; `shared_errors` asks for it.
        if entry.shared:
            return None
        if entry.default is REQUIRED:
            reading.errors.append(missing(path, entry.kind.expected()))
            return None
        # A default is read like a value of the file, so that it becomes a `Measure` and can
        # scatter.
        default = list(entry.default) if isinstance(entry.default, tuple) else entry.default
        return None if default is None else entry.kind.read(default, path, reading)

    def expected(self) -> str:
        if not self.entries:
            return "an empty table"
        return f"a table with the keys {', '.join(self.entries)}"

    def required(self) -> list[str]:
        """The keys that have to be there."""
        return [k for k, e in self.entries.items() if e.default is REQUIRED and not e.shared]

    def schema(self) -> Schema:
        properties = {}
        for key, entry in self.entries.items():
            properties[key] = entry.kind.schema()
            if entry.doc:
                unit = entry.kind.quantity.unit if isinstance(entry.kind, Number) else ""
                meaning = f"{entry.doc} (in {unit})" if unit else entry.doc
                properties[key] = {**properties[key], "description": meaning}
            if isinstance(entry.default, int | float | str) and entry.default != "":
                properties[key] = {**properties[key], "default": entry.default}
        made = {"type": "object", "properties": properties, "additionalProperties": False}
        return {**made, "required": self.required()} if self.required() else made


class Maker(NamedTuple):
    """A way to give an object in a file: `make`, called with the entries of a table.

    - `name`: of the class or function, for sentences.
    - `arguments`: for each key the name of the argument.
    - `fields`: the entries of the table.
    - `references`: arguments that are attributes of another effect.
    - `bare`: whether the file gives the only entry itself, and no table of it."""

    name: str
    make: Callable[..., Any]  # of whatever class or function it is
    arguments: Mapping[str, str]
    fields: Table
    references: Mapping[str, str]
    bare: bool = False


@dataclass(frozen=True, eq=False)
class Object(Kind):
    """An object that can be given in several ways; the keys that are there decide which is
    meant."""

    ways: tuple[Maker, ...]

    def read(self, value: object, path: str, reading: Reading) -> Value:
        found = [self._attempt(way, value, path) for way in self.ways]
        # The first way without an error; else the one in which the fewest keys are wrong, so that
        # the sentences are about the way that is meant.
        best = min(range(len(found)), key=lambda k: found[k][2])
        values, trial, _ = found[best]
        if trial.errors:
            trial.errors = [self._with_other_ways(line, best) for line in trial.errors]
        else:
            trial.makers[path] = self.ways[best]
        reading.take(trial)
        return values

    def _attempt(self, way: Maker, value: object, path: str) -> tuple[Value, Reading, int]:
        # Each way reads into its own findings: those of the ways that are not meant are dropped.
        trial = Reading()
        table = way.fields
        if way.bare and not isinstance(value, Mapping):
            (entry,) = table.entries.values()
            values = entry.kind.read(value, path, trial)
        else:
            values = table.read(value, path, trial)
            if way.bare and values is not None:
                (values,) = values.values()
        # Unknown keys count twice: a key of another way says more than one that is missing.
        strange = [k for k in value if k not in table.entries] if isinstance(value, Mapping) else []
        return values, trial, len(trial.errors) + len(strange)

    def _with_other_ways(self, line: str, best: int) -> str:
        # Only a missing key can mean that the author had another way in mind.
        if " is missing: " not in line or len(self.ways) == 1:
            return line
        own = set(self.ways[best].fields.required())
        others = [w.fields.required() for k, w in enumerate(self.ways) if k != best]
        # A way that asks for less than this one is no alternative to what is missing.
        others = [" with ".join(keys) for keys in others if keys and not set(keys) <= own]
        text = f"; another way is to give {', or '.join(dict.fromkeys(others))}" if others else ""
        return line.removesuffix(".") + text + "."

    def expected(self) -> str:
        return " or ".join(
            dict.fromkeys(
                next(iter(w.fields.entries.values())).kind.expected()
                if w.bare
                else w.fields.expected()
                for w in self.ways
            )
        )

    def schema(self) -> Schema:
        made = []
        for way in self.ways:
            if way.bare:
                made.append(next(iter(way.fields.entries.values())).kind.schema())
            made.append(way.fields.schema())
        # An `anyOf` with one entry makes the messages of editors worse.
        return made[0] if len(made) == 1 else {"anyOf": made}


@dataclass(frozen=True, eq=False)
class AnyTable(Kind):
    """A table whose keys are read later."""

    def read(self, value: object, path: str, reading: Reading) -> Value:
        if isinstance(value, Mapping):
            return value
        reading.errors.append(wrong(path, value, self.expected()))
        return None

    def expected(self) -> str:
        return "a table whose keys are paths of numbers of this file"

    def schema(self) -> Schema:
        return {"type": "object"}


def joined(path: str, key: object) -> str:
    """The path of an entry of the table at `path`."""
    return f"{path}.{key}" if path else str(key)
