"""Kinds of the entries of a scene file, entries of tables, and makers of objects.

A kind reads a value, describes the expected values, and provides its JSON schema. Values are plain
numbers, text, lists and dicts. Errors, units and the chosen maker of an object go into the
`Reading`."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple, TypeAlias

from ...core.quantities import REQUIRED
from ..units import WrittenUnits
from .named_files import NamedFiles

# A value of a file: a table, a list, a number, text or `None`; when objects are built, arrays
# replace the numbers. A recursive type would need a cast at every step of a path.
Value: TypeAlias = Any
Values: TypeAlias = dict[str, Value]
Schema: TypeAlias = dict[str, object]


@dataclass
class Reading:
    """Results of reading a file besides the values: `errors`, the `makers` of objects by path, the
    `units` as written, and the named `files`."""

    files: NamedFiles = field(default_factory=NamedFiles)
    errors: list[str] = field(default_factory=list)
    makers: dict[str, "Maker"] = field(default_factory=dict)
    units: WrittenUnits = field(default_factory=WrittenUnits)

    def take(self, other: "Reading") -> None:
        """Add the results of another reading."""
        self.errors += other.errors
        self.makers |= other.makers
        self.units.take(other.units)


class Kind(ABC):
    """The kind of an entry of a file."""

    @abstractmethod
    def read(self, value: object, path: str, reading: Reading) -> Value:
        """The value as it is used; `None`, with an error in the `reading`, if it is wrong."""

    @abstractmethod
    def expected(self) -> str:
        """Description of the allowed values, for a message."""

    @abstractmethod
    def schema(self) -> Schema:
        """The JSON schema."""


class Entry(NamedTuple):
    """An entry of a table.

    - `default`: the value where the file gives none; `REQUIRED` makes that an error.
    - `shared`: the path of the entry of the file that is used instead.
    - `doc`: what it is."""

    kind: Kind
    default: object = REQUIRED
    shared: str = ""
    doc: str = ""


class Maker(NamedTuple):
    """A way to give an object in a file: `make`, called with the entries of a table.

    - `name`: of the class or function, for sentences.
    - `arguments`: for each key the name of the argument.
    - `entries`: of the table.
    - `references`: arguments that are attributes of another effect.
    - `bare`: whether the file gives the only entry itself, and no table of it."""

    name: str
    make: Callable[..., Any]  # of whatever class or function it is
    arguments: Mapping[str, str]
    entries: Mapping[str, Entry]
    references: Mapping[str, str]
    bare: bool = False

    @property
    def identity(self) -> tuple[object, ...]:
        """All that determines an object besides the values of the file."""
        arguments, references = tuple(self.arguments.items()), tuple(self.references.items())
        shared = tuple((key, entry.shared) for key, entry in self.entries.items())
        return self.make, arguments, references, shared, self.bare

    @property
    def first(self) -> Entry:
        """The first entry, which is the only one of a bare way."""
        return next(iter(self.entries.values()))
