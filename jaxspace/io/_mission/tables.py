"""The tables of the dynamics: a system by its name; a body, its effects and its initial state; the
phases of a mission and its branches.

Their entries follow from the declarations of the classes in the catalog."""

import inspect

from ...bodies import BodyState
from ...core import AbstractSystem, argument
from ...vehicles.local_air import LocalAir
from .._catalog.catalog import Catalog, part_entries, state_class, state_way
from .._catalog.declared import entry_of, function_way, object_kind
from .._kinds.kind import Entry, Kind, Maker
from .._kinds.tables import NamedTables, Object, Table
from .._kinds.values import ListOf, Number, OneName, PartOfFileName, Text, Whole
from .control import control_kind
from .effect_tables import AIR, EffectName, EffectTables
from .ends import end_kind

TIME = Number(argument("s", fixed=True, doc="time"), shapes=False)
DURATION = Number(argument("s", positive=True, doc="duration"))
TIMES = Table(
    {
        "start": Entry(TIME, 0.0, doc="time of the initial state"),
        "end": Entry(TIME, doc="time of the last state"),
        "samples": Entry(Whole(2, 10**7), 200, doc="number of saved states from start to end"),
    }
)


def system_entries(catalog: Catalog, system: str) -> dict[str, Entry]:
    """The tables of a system, which is a complete model, without bodies and effects."""
    cls = catalog.systems[system]
    named = _named(system, catalog.kinds[cls])
    return {
        "system": Entry(named, doc="the system and its parameters"),
        "initial": Entry(initial_kind(catalog, cls), doc="the initial state"),
        **_one_run(catalog),
    }


def scene_entries(catalog: Catalog) -> dict[str, Entry]:
    """The tables of a body under effects, in one run."""
    return {**_body_entries(catalog), **_one_run(catalog)}


def mission_entries(catalog: Catalog) -> dict[str, Entry]:
    """The tables of a mission."""
    return {
        **_body_entries(catalog),
        "phase": Entry(ListOf(_phase(catalog), least=1), doc="the phases in sequence"),
        "branch": Entry(NamedTables(branch_table(catalog)), {}, doc="separated parts by name"),
    }


def _body_entries(catalog: Catalog) -> dict[str, Entry]:
    """The tables of a body and of its effects."""
    effects = {name: Entry(catalog.kinds[cls], None) for name, cls in catalog.effects.items()}
    air = object_kind(LocalAir)
    assert air is not None
    return {
        "body": Entry(bodies_kind(catalog), {}, doc="mass properties"),
        AIR: Entry(air, None, doc="the air, for all effects without another"),
        # A body without any effect moves freely, which is a scene as well.
        "effects": Entry(
            EffectTables(effects, catalog.refused), {}, doc="the effects that act on the body"
        ),
        "initial": Entry(initial_kind(catalog, None), doc="the initial state"),
    }


def _one_run(catalog: Catalog) -> dict[str, Entry]:
    """The tables of a run that has no phases."""
    return {
        "times": Entry(TIMES, doc="time span of the run"),
        "control": Entry(control_kind(catalog), None, doc="sampled control"),
    }


def bodies_kind(catalog: Catalog) -> Object:
    """The file entries for the mass properties of a body."""
    return Object(tuple(way for cls in catalog.bodies.values() for way in catalog.kinds[cls].ways))


def _named(name: str, kind: Object) -> Object:
    """The ways to give a system, each with the entry `name`."""
    name_entry = {"name": Entry(OneName((name,)), doc="of the system")}

    def made(way: Maker) -> Maker:
        # A table with a name is never given by its only number alone.
        return way._replace(entries={**name_entry, **way.entries}, bare=False)

    return Object(tuple(made(way) for way in kind.ways))


def initial_kind(catalog: Catalog, system: type[AbstractSystem] | None) -> Kind:
    """The file entries for the initial state of a system, or of a body under effects (`None`)."""
    way = None if system is None else state_way(system)
    if way is not None:
        return Object((way,))
    cls = BodyState if system is None else state_class(system)
    entries = part_entries(cls)
    if system is None:
        entries.pop("mass")  # The mass at the start is that of the body.
    for key, ways in initial_ways(catalog, cls).items():
        entries[key] = Entry(Object(tuple(ways)), None)
    return Table(entries)


def initial_ways(catalog: Catalog, cls: type) -> dict[str, list[Maker]]:
    """The makers of parts of a state of the class, by the key of their table."""
    result: dict[str, list[Maker]] = {}
    parts = set(inspect.signature(cls).parameters)
    for function in catalog.initials.values():
        declared = function.initial
        # Makers of parts that this state does not have are left out.
        if set(declared.gives) <= parts:
            result.setdefault(declared.key, []).append(function_way(function, declared.arguments))
    return result


def _phase(catalog: Catalog) -> Table:
    jumps = {name: Entry(catalog.kinds[cls], None) for name, cls in catalog.jumps.items()}
    active = ListOf(EffectName(tuple(catalog.effects)))
    return Table(
        {
            "name": Entry(PartOfFileName(), doc="of the phase, for tables and figures"),
            "effects": Entry(active, (), doc="the effects that act in this phase"),
            "duration": Entry(DURATION, None, doc="duration of the phase"),
            "until": Entry(end_kind(catalog), None, doc="the time or event at which it ends"),
            "within": Entry(DURATION, None, doc="longest time to wait for the event"),
            "jump": Entry(Table(jumps), {}, doc="jumps of the state at the end"),
            "control": Entry(control_kind(catalog, True), None, doc="sampled control"),
            "body": Entry(
                bodies_kind(catalog), None, doc="mass properties from this phase on, if they change"
            ),
        }
    )


def branch_table(catalog: Catalog) -> Table:
    """The table of a branch: a part that leaves, and its phases."""

    def vector(unit: str, doc: str) -> Entry:
        return entry_of(argument(unit, shape=(3,), default=(0.0, 0.0, 0.0), doc=doc))

    return Table(
        {
            "after": Entry(Text(), doc="name of the phase at whose end it separates"),
            "body": Entry(
                bodies_kind(catalog), doc="its mass properties; a point mass without inertia"
            ),
            "offset": vector(
                "m", "of its centre of mass from that of the remaining body, in body axes"
            ),
            "kick": vector("m/s", "its velocity relative to the remaining body, in body axes"),
            "phase": Entry(ListOf(_phase(catalog), least=1), doc="its phases, as [[phase]]"),
        }
    )
