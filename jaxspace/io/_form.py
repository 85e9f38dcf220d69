"""The form of a scene file: which tables there are in each of its three kinds, and what stands in
them.

    kind       tables
    system     [system], [initial], [times]                              a textbook system by its name
    scene      [planet], [body], [effects.*], [initial], [times]         a body and what acts on it
    mission    [planet], [body], [effects.*], [initial], [[phase]]       phases, each with the effects that act in it

A scene and a mission may have [dispersion]; every kind has `title` and `accuracy`.
"""

from typing import Any

from ._errors import missing, unknown, wrong
from ._quantities import Choice, Quantity
from ._registry import Registry
from ._tables import Key, ListOf, Table

MASS = Quantity("mass", "kg", "60 kg", "positive")
INERTIA = Quantity("moment of inertia", "kg m^2", "12 slug ft^2", "positive")
LENGTH = Quantity("length", "m", "1.2 ft")
RADIUS = Quantity("length", "m", "1.2 ft", "not negative")
TIME = Quantity("time", "s", "90 min", "", fixed=True)
DURATION = Quantity("time", "s", "84 s", "positive")
TOLERANCE = Quantity("relative tolerance", "", "1e-9", "positive", fixed=True)

BODY: Table = {
    "mass": Key(MASS, None),
    "dry_mass": Key(MASS, None),
    "propellant_mass": Key(MASS, None),
    "inertia": Key(ListOf(INERTIA, 3), None),
    "gyration_radii": Key(ListOf(RADIUS, 3), None),
    "propellant_station": Key(LENGTH, 0.0),
}
TIMES: Table = {"start": Key(TIME, 0.0), "end": Key(TIME), "samples": Key(int, 200)}
COMMON: Table = {"title": Key(str, ""), "accuracy": Key(TOLERANCE, 1e-9)}
KINDS = ("system", "scene", "mission")


def kind_of(data: dict[str, Any]) -> str:
    """The kind of a file, from the tables that it has."""
    return "system" if "system" in data else "mission" if "phase" in data else "scene"


def form(data: dict[str, Any], registry: Registry) -> tuple[Table, list[str]]:
    """The description of a file of the kind of `data`; or, for a system whose name is not known,
    what is wrong with it."""
    kind = kind_of(data)
    if kind == "system":
        return _system_form(data, registry)
    tables = {
        "planet": Key(registry.planet, None),
        "body": Key(BODY, {}),
        "effects": Key(
            {name: Key(entry.table, None) for name, entry in registry.effects.items()}, {}
        ),
        "initial": Key(registry.initial.table),
        "dispersion": Key(_dispersion(registry), None),
    }
    ending = (
        {"phase": Key(ListOf(_phase(registry), least=1))}
        if kind == "mission"
        else {"times": Key(TIMES)}
    )
    return {**COMMON, **tables, **ending}, []


def _system_form(data: dict[str, Any], registry: Registry) -> tuple[Table, list[str]]:
    names = Choice(tuple(registry.systems))
    system = data["system"]
    if not isinstance(system, dict):
        return {}, [wrong("system", system, "a table")]
    if "name" not in system:
        return {}, [missing("system.name", names.allowed())]
    if system["name"] not in names.names:
        return {}, [
            unknown(f'system.name = "{system["name"]}"', system["name"], names.names, "system")
        ]
    entry = registry.systems[system["name"]]
    parameters = {"name": Key(names), **entry.parameters}
    return {
        **COMMON,
        "system": Key(parameters),
        "initial": Key(entry.initial),
        "times": Key(TIMES),
    }, []


def _phase(registry: Registry) -> Table:
    return {
        "name": Key(str),
        "effects": Key(ListOf(Choice(tuple(registry.effects))), []),
        "duration": Key(DURATION, None),
        "until": Key(Choice(("burnout", *registry.events)), None),
        "within": Key(DURATION, None),
        "jump": Key({name: Key(entry.table, None) for name, entry in registry.jumps.items()}, {}),
    }


def _dispersion(registry: Registry) -> Table:
    return {
        "runs": Key(int, 1000),
        "seed": Key(int, 1),
        "outputs": Key(ListOf(Choice(tuple(registry.outputs)), least=1)),
        "inputs": Key(dict),
    }
