"""Kinds of tables: one with known keys, one of an object that can be given in several ways."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from ...core.quantities import REQUIRED
from .errors import missing, unknown, wrong
from .kind import Entry, Kind, Maker, Reading, Schema, Value
from .named_files import NamedFiles
from .values import ListOf, Number

MOST_UNKNOWN = 20
"""Maximum number of unknown keys of a table that are named."""


@dataclass(frozen=True, eq=False)
class Table(Kind):
    """A table of `entries`; a key that is not among them is an error.

    - `refused`: reasons why other keys cannot be in a file."""

    entries: Mapping[str, Entry]
    refused: Mapping[str, str] = field(default_factory=dict)

    def read(self, value: object, path: str, reading: Reading) -> Value:
        if not isinstance(value, Mapping):
            reading.errors.append(wrong(path, value, self.expected()))
            return None
        strange = [key for key in value if key not in self.entries]
        for key in strange[:MOST_UNKNOWN]:
            full = _joined(path, key)
            known = key in self.refused
            reading.errors.append(
                f"{full} {self.refused[key]}" if known else unknown(full, key, self.entries)
            )
        # Only a few errors, because each searches for the nearest name.
        if len(strange) > MOST_UNKNOWN:
            where = f"{path} has" if path else "there are"
            more = len(strange) - MOST_UNKNOWN
            reading.errors.append(f"{where} {more} more unknown keys.")
        # In the order of the file, which is that of the effects of a scene, and of the units.
        keys = dict.fromkeys([*(key for key in value if key in self.entries), *self.entries])
        return {
            key: self._entry(
                self.entries[key], value.get(key, REQUIRED), _joined(path, key), reading
            )
            for key in keys
        }

    def _entry(self, entry: Entry, value: object, path: str, reading: Reading) -> Value:
        if value is not REQUIRED:
            return entry.kind.read(value, path, reading)
        # The value comes from another table, which is checked by `shared_errors`.
        if entry.shared:
            return None
        if entry.default is REQUIRED:
            reading.errors.append(missing(path, entry.kind.expected()))
            return None
        # A default is read like a value of the file, so that it can be dispersed.
        default = list(entry.default) if isinstance(entry.default, tuple) else entry.default
        return None if default is None else entry.kind.read(default, path, reading)

    def expected(self) -> str:
        if not self.entries:
            return "an empty table"
        return f"a table with the keys {', '.join(self.entries)}"

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
        required = _required(self.entries)
        return {**made, "required": required} if required else made


@dataclass(frozen=True, eq=False)
class Object(Kind):
    """An object that can be given in several ways, of which the given keys select one."""

    ways: tuple[Maker, ...]

    def read(self, value: object, path: str, reading: Reading) -> Value:
        result = [self._attempt(way, value, path, reading.files) for way in self.ways]
        # The first way without an error; otherwise the one with the fewest wrong keys, so that the
        # errors concern the intended way.
        best = min(range(len(result)), key=lambda k: result[k][2])
        values, trial, _ = result[best]
        if trial.errors:
            trial.errors = [self._with_other_ways(line, best) for line in trial.errors]
        else:
            trial.makers[path] = self.ways[best]
        reading.take(trial)
        return values

    def _attempt(
        self, way: Maker, value: object, path: str, files: NamedFiles
    ) -> tuple[Value, Reading, int]:
        # A separate reading for each way, because those of the other ways are dropped.
        trial = Reading(files)
        if way.bare and not isinstance(value, Mapping):
            values = way.first.kind.read(value, path, trial)
        else:
            values = Table(way.entries).read(value, path, trial)
            if way.bare and values is not None:
                (values,) = values.values()
        # Unknown keys count twice, because a key of another way is stronger evidence than a missing
        # one.
        strange = [k for k in value if k not in way.entries] if isinstance(value, Mapping) else []
        return values, trial, len(trial.errors) + len(strange)

    def _with_other_ways(self, line: str, best: int) -> str:
        # Only a missing key may be due to another way.
        if " is missing: " not in line or len(self.ways) == 1:
            return line
        required = set(_required(self.ways[best].entries))
        others = [_required(w.entries) for k, w in enumerate(self.ways) if k != best]
        # A form with fewer keys than this one is not an alternative.
        others = [" with ".join(keys) for keys in others if keys and not set(keys) <= required]
        text = f"; alternatively give {', or '.join(dict.fromkeys(others))}" if others else ""
        return line.removesuffix(".") + text + "."

    def expected(self) -> str:
        return " or ".join(
            dict.fromkeys(
                way.first.kind.expected() if way.bare else Table(way.entries).expected()
                for way in self.ways
            )
        )

    def schema(self) -> Schema:
        made = []
        for way in self.ways:
            if way.bare:
                made.append(way.first.kind.schema())
            made.append(Table(way.entries).schema())
        # An `anyOf` with one entry would obscure the messages of editors.
        return made[0] if len(made) == 1 else {"anyOf": made}


@dataclass(frozen=True, eq=False)
class OneOrMore(Kind):
    """An object, or a list of objects of the same kind: [fins], or [[fins]] for each of several."""

    kind: Object

    @property
    def items(self) -> ListOf:
        """The kind of the list."""
        return ListOf(self.kind, least=1)

    def read(self, value: object, path: str, reading: Reading) -> Value:
        kind = self.items if isinstance(value, list) else self.kind
        return kind.read(value, path, reading)

    def expected(self) -> str:
        return f"{self.kind.expected()}, or a list of such tables"

    def schema(self) -> Schema:
        return {"anyOf": [self.kind.schema(), self.items.schema()]}


@dataclass(frozen=True, eq=False)
class NamedTables(Kind):
    """Tables of one kind, each under a name that the file gives it."""

    kind: Table

    def read(self, value: object, path: str, reading: Reading) -> Value:
        if not isinstance(value, Mapping):
            reading.errors.append(wrong(path, value, self.expected(path)))
            return None
        result = {}
        for name, table in value.items():
            # The name is a step of the paths of its numbers.
            if not name or "." in name:
                reading.errors.append(
                    wrong(path, name, "a name of at least one letter, without a dot")
                )
            else:
                result[name] = self.kind.read(table, _joined(path, name), reading)
        return result

    def expected(self, path: str = "table") -> str:
        return f"tables with names of your choice, each [{path}.NAME]"

    def schema(self) -> Schema:
        return {"type": "object", "additionalProperties": self.kind.schema()}


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


def _required(entries: Mapping[str, Entry]) -> list[str]:
    """The keys that have to be there."""
    return [key for key, e in entries.items() if e.default is REQUIRED and not e.shared]


def _joined(path: str, key: object) -> str:
    """The path of an entry of the table at `path`."""
    return f"{path}.{key}" if path else str(key)
