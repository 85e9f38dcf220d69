"""What a scene file may name: the strings, and what stands behind each of them."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from ..bodies import AbstractEffect
from ._tables import Table


class EffectEntry(NamedTuple):
    """An effect: the keys of its table, its class, and `build(values, lanes)` from the values of
    the whole file.

    - `uses`: the entries outside its table that it reads, such as "planet.j2"."""

    table: Table
    cls: type[AbstractEffect]
    build: Callable[[dict[str, Any], Any], AbstractEffect]
    uses: tuple[str, ...] = ()


class SystemEntry(NamedTuple):
    """A textbook system: the keys of its parameters and of its initial state; `build(values, lanes)
    -> (system, y0)`."""

    parameters: Table
    initial: Table
    build: Callable[[dict[str, Any], Any], tuple[Any, Any]]
    check: Callable[[dict[str, Any]], list[str]] = lambda values: []


class JumpEntry(NamedTuple):
    """What may happen at the end of a phase: the keys of its table, and `build(values of the table,
    whole file, lanes)`.

    - `uses`: the parts of the state that it reads."""

    table: Table
    build: Callable[[dict[str, Any], dict[str, Any], Any], Callable[..., Any]]
    uses: tuple[str, ...] = ()


class InitialEntry(NamedTuple):
    """The initial state of a body: the keys, `check(values)` for what does not fit together,
    `parts(values)` that it gives, and `build(values of the whole file, lanes)` of all parts but the
    mass."""

    table: Table
    check: Callable[[dict[str, Any]], list[str]]
    parts: Callable[[dict[str, Any]], set[str]]
    build: Callable[[dict[str, Any], Any], Any]


class OutputEntry(NamedTuple):
    """A number of interest: `value(end)` in `unit`, from the `End` of a mission.

    - `uses`: the parts of the state and the entries of the file that it reads."""

    unit: str
    value: Callable[[Any], Any]
    uses: tuple[str, ...] = ()


class Registry(NamedTuple):
    """Everything that a scene file may name. `events`: conditions on which a phase may end, with
    their direction."""

    effects: Mapping[str, EffectEntry]
    systems: Mapping[str, SystemEntry]
    jumps: Mapping[str, JumpEntry]
    events: Mapping[str, tuple[Callable[..., Any], int]]
    outputs: Mapping[str, OutputEntry]
    initial: InitialEntry
    planet: Table
