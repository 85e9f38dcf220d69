"""The names that scene files may use, for people (a text) and for editors (a JSON schema)."""

import itertools
import os
import re
from collections.abc import Iterable, Mapping
from typing import TypeAlias

from ..bodies import BodyState
from ..core import InputError
from ..core.quantities import REQUIRED
from ..vehicles import LaunchSite
from ._catalog.catalog import Catalog, catalog, output_methods
from ._form import form_of
from ._kinds.kind import Entry, Kind, Schema
from ._kinds.tables import Object, OneOrMore, Table
from ._kinds.values import FilePath, ListOf, Number, OneName
from ._mission.flight import CLASSES, SITE, flight_kinds
from ._mission.tables import branch_table, initial_kind, initial_ways
from ._requests.accuracy import method_kind

Group: TypeAlias = tuple[str, list[str]]
DIALECT = "https://json-schema.org/draft/2020-12/schema"


def schema(also: Iterable[object] = (), modules: Iterable[str | os.PathLike[str]] = ()) -> Schema:
    """The JSON schema of all scene files. An editor completes and checks files with it.

    **Arguments**

    - `also`, `modules`: as in `load`.

    **Returns** the schema as a dict."""
    known = catalog(also, modules)
    # One form for each system, because its name determines all other keys.
    systems = [form_of("system", known, name).schema() for name in known.systems]
    body = [form_of(kind, known).schema() for kind in ("scene", "mission", "flight")]
    forms = [*systems, *body]
    return {"$schema": DIALECT, "title": "jaxspace scene file", "anyOf": forms}


def listing(
    also: Iterable[object] = (),
    modules: Iterable[str | os.PathLike[str]] = (),
    word: str = "",
    fields: bool = True,
) -> str:
    """The names that scene files may use: systems, effects, events and so on, with fields and
    units. The fields of a table shared by several entries are listed once.

    **Arguments**

    - `also`, `modules`: as in `load`.
    - `word`: only the group with this name is listed; otherwise, the entries that contain it in
      their name or first sentence, or else in their fields.
    - `fields`: whether the fields of each entry follow its name and its first sentence.

    **Raises** `InputError` for a word that no entry has."""
    known = catalog(also, modules)
    groups = [
        ("flights", _classes({**known.kinds, **flight_kinds()}, CLASSES)),
        ("systems", _classes(known.kinds, known.systems, known)),
        ("bodies", _classes(known.kinds, known.bodies)),
        ("effects", _classes(known.kinds, known.effects)),
        ("initial states of a body", _initials(known)),
        ("jumps", _classes(known.kinds, known.jumps)),
        ("branches of a mission", _branch(known)),
        ("events", _events(known) + _times(known)),
        ("outputs", _functions(known.outputs, "output") + _methods(known)),
        ("controllers", _classes(known.kinds, known.controllers)),
        ("distributions", _classes(known.kinds, known.distributions)),
        ("methods", [f"  {name}" for name in method_names(known)]),
    ]
    groups = _with_word(groups, word) if word else groups
    written: dict[tuple[str, ...], str] = {}
    shown = [
        (name, _once(lines, written) if fields else [entry[0] for entry in _entries(lines)])
        for name, lines in groups
    ]
    return "\n\n".join("\n".join([name, *lines]) for name, lines in shown)


def _with_word(groups: list[Group], word: str) -> list[Group]:
    """The group of this name; or else the entries with this word, in the groups that have some."""
    named = [group for group in groups if group[0] == word]
    if named:
        return named
    entries = [(group, entry) for group, lines in groups for entry in _entries(lines)]
    # By all of its lines only then: fields of thrust are named in half of the entries.
    for part in (slice(1), slice(None)):
        result: dict[str, list[str]] = {}
        for group, entry in entries:
            if word.lower() in "\n".join(entry[part]).lower():
                result.setdefault(group, []).extend(entry)
        if result:
            return list(result.items())
    names = [*(name for name, _ in groups), *(_name(entry[0]) for _, entry in entries)]
    raise InputError(
        f"{word} matches no entry: it must be part of a name or of a description."
        f"{InputError.hint(word, names)}"
    )


def _once(lines: list[str], written: dict[tuple[str, ...], str]) -> list[str]:
    """The lines; of a table whose fields are `written` above, the place where they are."""
    result: list[str] = []
    path: list[str] = []
    until = 0
    for k, line in enumerate(lines):
        depth = _depth(line)
        if k < until:
            continue
        inner = list(itertools.takewhile(lambda x, d=depth: _depth(x) > d, lines[k + 1 :]))
        fields = tuple(x[depth:] for x in inner)
        path = [*path[: depth // 2 - 1], _name(line)]
        result.append(line)
        # A short table is read faster than its place.
        if depth < 4 or len(fields) < 4:
            continue
        if fields in written:
            result.append(f"{' ' * (depth + 2)}as in {written[fields]}")
            until = k + 1 + len(inner)
        else:
            written[fields] = ".".join(path)
    return result


def _depth(line: str) -> int:
    """Number of spaces before a line."""
    return len(line) - len(line.lstrip())


def _name(line: str) -> str:
    """The name of an entry or a field, with which its line begins."""
    return re.split(r"[ :]", line.strip())[0]


def _entries(lines: list[str]) -> list[list[str]]:
    """The lines of each entry, followed by the indented lines of its fields."""
    result: list[list[str]] = []
    for line in lines:
        if line.startswith("   ") and result:
            result[-1].append(line)
        else:
            result.append([line])
    return result


def method_names(known: Catalog) -> list[str]:
    """The names of the integrators that a file may name."""
    names: list[str] = []
    for way in method_kind(known).ways:
        kind = way.entries["name"].kind
        names += kind.names if isinstance(kind, OneName) else ()
    # Once each: a method may occur in several forms of its table.
    return list(dict.fromkeys(names))


def _classes(
    kinds: Mapping[type, Object], group: Mapping[str, type], known: Catalog | None = None
) -> list[str]:
    """The classes of a group with the keys of their tables; with those of their initial states
    where the catalog is `known`."""
    lines = []
    for name, cls in group.items():
        lines.append(f"  {name}: {first_sentence(cls)}")
        lines += _ways(kinds[cls])
        if known is not None:
            lines.append(f"    initial: {_keys(initial_kind(known, cls))}")
    return lines


def _ways(kind: Object, indent: str = "    ") -> list[str]:
    lines = []
    for number, way in enumerate(kind.ways):
        if number:
            lines.append(f"{indent}or")
        for key, entry in way.entries.items():
            lines.append(f"{indent}{key}{_unit(entry)}: {entry.doc}{_default(entry)}")
            # A bare object reads like a number: its entries need no separate lines.
            inner = entry.kind.kind if isinstance(entry.kind, OneOrMore) else entry.kind
            if isinstance(inner, Object) and not inner.ways[0].bare:
                lines += _ways(inner, indent + "  ")
    return lines


def _initials(known: Catalog) -> list[str]:
    lines = [f"  {_keys(initial_kind(known, None))}"]
    for key, ways in initial_ways(known, BodyState).items():
        lines.append(f"  {key}")
        lines += _ways(Object(tuple(ways)))
    return lines


def _branch(known: Catalog) -> list[str]:
    entries = branch_table(known).entries
    # Its body and its phases have the keys of those of the mission.
    keys = [
        f"    {key}{_unit(entry)}: {entry.doc}{_default(entry)}" for key, entry in entries.items()
    ]
    return ["  branch.NAME: A part that leaves the mission and continues separately", *keys]


def _functions(group: Mapping[str, object], mark: str) -> list[str]:
    return [
        f"  {name} [{getattr(function, mark).unit or '1'}]: {first_sentence(function)}"
        for name, function in group.items()
    ]


def _events(known: Catalog) -> list[str]:
    return _functions(known.events, "event") + _classes(known.kinds, known.conditions)


def _times(known: Catalog) -> list[str]:
    return [
        f"  {name} [s]: {first_sentence(getattr(cls, name))} ({effect})"
        for effect, cls in known.effects.items()
        for name in known.known_times(effect)
    ]


def _methods(known: Catalog) -> list[str]:
    every = {effect: known.effect_outputs(effect) for effect in known.effects}
    every[SITE] = output_methods(LaunchSite)
    return [
        line.replace("  ", f"  {owner}.", 1)
        for owner, methods in every.items()
        for line in _functions(methods, "output")
    ]


def _keys(kind: Kind) -> str:
    if isinstance(kind, Object):
        return "; or ".join(_keys(Table(way.entries)) for way in kind.ways)
    assert isinstance(kind, Table)
    return ", ".join(f"{key}{_unit(entry)}" for key, entry in kind.entries.items())


def _unit(entry: Entry) -> str:
    kind = entry.kind
    # The unit of a list is that of its numbers.
    while isinstance(kind, ListOf):
        kind = kind.kind
    if isinstance(kind, Object) and kind.ways[0].bare:
        return _unit(kind.ways[0].first)
    if isinstance(kind, Number):
        return f" [{kind.quantity.unit or '1'}]"
    if isinstance(kind, OneName):
        return f" ({', '.join(kind.names)})"
    if isinstance(kind, FilePath):
        return " (file)"
    if isinstance(kind, OneOrMore):
        return " (one or a list)"
    return ""


def _default(entry: Entry) -> str:
    if entry.shared:
        return f" (by default {entry.shared})"
    if entry.default is REQUIRED:
        return ""
    return " (optional)" if entry.default is None else f" (by default {entry.default})"


def first_sentence(thing: object) -> str:
    """The first sentence of a docstring, on one line."""
    # The blocks of a docstring begin behind an empty line, with no capital letter.
    text = " ".join((thing.__doc__ or "").split("\n\n")[0].split())
    # A capital letter must follow, so that "e.g. this" and decimal points end no sentence.
    return re.split(r"\.(?= [A-Z])", text)[0].rstrip(".")
