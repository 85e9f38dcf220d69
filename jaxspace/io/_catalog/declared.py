"""Entries of a file from the declarations of a class or a function.

declaration                                         in a file
a field or an argument that is a quantity           a key with a number, or a list of numbers
an argument that is a `FileName`                    a key with the name of a file
a field that is another object with quantities      a table, or the number itself if it has one
a field that is one such object or a tuple of them  a table, or a list of tables
a named constructor (`constructor`)                 another way to fill the table of its class
a field that refers to another effect (`reference`) nothing: the effect is found
"""

import dataclasses
import inspect
import re
import typing
from collections.abc import Callable, Iterable, Mapping
from typing import TypeAlias

from ...bodies import AbstractBody, AbstractEffect
from ...control import AbstractController
from ...core import AbstractParameters, AbstractSystem, Choice, FileName
from ...core.declarations import references
from ...core.quantities import REQUIRED, Quantity, quantities
from .._kinds.kind import Entry, Kind, Maker
from .._kinds.tables import Object, OneOrMore
from .._kinds.values import FilePath, ListOf, Number, OneName

Declared: TypeAlias = Mapping[str, Quantity | Choice | FileName]

# Objects with tables at the top level of a file.
TOP_LEVEL = (AbstractSystem, AbstractEffect, AbstractBody, AbstractController)


def snake_case(name: str) -> str:
    """The key of a class: `two_body` for `TwoBody`."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", name).lower()


def kind_of_quantity(quantity: Quantity) -> Kind:
    """A number, or a list of numbers of the quantity's shape."""
    kind: Kind = Number(quantity._replace(shape=()))
    for count in reversed(quantity.shape):
        kind = ListOf(kind, count, 0 if count is not None else quantity.least)
    return kind


def entry_of(declared: Quantity | Choice | FileName) -> Entry:
    """The entry of a table for a declaration."""
    if isinstance(declared, Choice):
        return Entry(OneName(declared.names), declared.default, doc=declared.doc)
    if isinstance(declared, FileName):
        return Entry(FilePath(), declared.default, doc=declared.doc)
    kind = kind_of_quantity(declared)
    return Entry(kind, declared.default, declared.shared, declared.doc)


def entries_of(declared: Declared) -> dict[str, Entry]:
    """The entries of a table for declared arguments."""
    return {(getattr(d, "key", "") or name): entry_of(d) for name, d in declared.items()}


def object_kind(cls: type) -> Object | None:
    """The ways in which a file may give an object of the class; `None` if there is none.

    For an abstract class they are those of its final subclasses."""
    if not getattr(cls, "__final__", False):
        # A field annotated with an abstract class takes any final class of it.
        kinds = [object_kind(sub) for sub in cls.__subclasses__()]
        ways = tuple(way for kind in kinds if kind is not None for way in kind.ways)
        return Object(ways) if ways else None
    ways = [way for way in (_plain_way(cls), *_named_ways(cls)) if way is not None]
    return Object(tuple(ways)) if ways else None


def function_way(function: Callable[..., object], declared: Declared) -> Maker:
    """The way to call a function whose arguments are declared."""
    arguments = {(getattr(d, "key", "") or name): name for name, d in declared.items()}
    return Maker(function.__name__, function, arguments, entries_of(declared), {})


def _plain_way(cls: type) -> Maker | None:
    """The class itself, with its fields."""
    # A class with its own `__init__` may name its arguments unlike its fields.
    taken = inspect.signature(cls).parameters
    fields = {}
    arguments = {}
    referred = references(cls)
    for name, entry in _field_entries(cls).items():
        # With a field that no file can give, and without a default, only named constructors remain.
        if entry is None:
            return None
        key = (quantities(cls)[name].key if name in quantities(cls) else "") or name
        argument = name if name in taken else key
        if argument in taken:
            fields[key], arguments[key] = entry, argument
    # `inertia = [1, 2, 3]` in place of a table with the single key `moments`.
    bare = len(fields) == 1 and isinstance(next(iter(fields.values())).kind, ListOf)
    return Maker(cls.__name__, cls, arguments, fields, referred, bare and not referred)


def foreign_fields(cls: type) -> list[str]:
    """The fields of a class that cannot be given in a file and have no default."""
    return [name for name, entry in _field_entries(cls).items() if entry is None]


def _named_ways(cls: type) -> Iterable[Maker]:
    """The named constructors of the class."""
    for name, function in members(cls).items():
        if not isinstance(function, classmethod):
            continue
        declared = getattr(function.__func__, "constructor", None)
        if declared is None:
            continue
        fields = entries_of(declared.arguments)
        arguments = {(getattr(d, "key", "") or n): n for n, d in declared.arguments.items()}
        for field, entry in _field_entries(cls).items():
            # Fields that the constructor computes must not be given as well.
            if entry is not None and field not in (*declared.sets, *arguments.values()):
                fields[field], arguments[field] = entry, field
        yield Maker(
            f"{cls.__name__}.{name}",
            getattr(cls, name),
            arguments,
            fields,
            references(cls),
        )


def members(cls: type) -> dict[str, object]:
    """The attributes of a class and of its bases by name, in the order of the alphabet; static,
    because binding a descriptor would run code of the class."""
    every = {name: x for base in reversed(cls.__mro__) for name, x in vars(base).items()}
    return dict(sorted(every.items()))


def _field_entries(cls: type) -> dict[str, Entry | None]:
    """The entry of each field that a file can give; `None` for one that it cannot give and must."""
    result: dict[str, Entry | None] = {}
    declared = quantities(cls)
    referred = references(cls)
    for field in dataclasses.fields(cls):
        if field.name in referred or not field.init and field.name not in declared:
            continue
        nested = _nested(field.type)
        default = REQUIRED if field.default is REQUIRED else field.default
        if nested is not None:
            shared = field.metadata.get("shared", "")
            shared = declared[field.name].shared if field.name in declared else shared
            doc = field.metadata.get("doc", "")
            doc = declared[field.name].doc if field.name in declared else doc
            result[field.name] = Entry(nested, None if default is None else REQUIRED, shared, doc)
        elif field.name in declared:
            result[field.name] = entry_of(declared[field.name])
        elif default is REQUIRED and field.default_factory is REQUIRED:
            result[field.name] = None
    return result


def _nested(annotation: object) -> Object | OneOrMore | None:
    """The ways to give a field that is itself an object with quantities, or a tuple of them."""
    kind = _nested_object(annotation)
    several = any(typing.get_origin(one) is tuple for one in typing.get_args(annotation))
    return OneOrMore(kind) if kind is not None and several else kind


def _nested_object(annotation: object) -> Object | None:
    for one in (annotation, *typing.get_args(annotation)):
        # By their ancestors, because `issubclass` of an abstract class asks all of its subclasses.
        if not isinstance(one, type) or AbstractParameters not in one.__mro__:
            continue
        # These have separate top-level tables in a file, and are not nested, except for a named
        # system that is part of another one.
        part = AbstractSystem in one.__mro__ and getattr(one, "__final__", False)
        if part or not set(TOP_LEVEL) & set(one.__mro__):
            return object_kind(one)
    return None
