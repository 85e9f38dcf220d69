"""The form of a scene file: the tables of each of its four kinds.

    kind       tables
    system     [system], [planet], [initial], [times]               a system by its name
    scene      [planet], [body], [effects.*], [initial], [times]    a body and what acts on it
    mission    [planet], [body], [effects.*], [initial], [[phase]]  phases, each with its effects,
               [branch.*]                                           and parts that leave after one
    flight     [vehicle], [site], [waiting]                         a rocket from rail to ground

Every kind may have [dispersion], [optimize], `format`, `title` and how to integrate: `accuracy` or
`final_error`, `method`, `max_step`, `max_steps`. The entries of the tables follow from the
declarations of the classes.
"""

import inspect
from collections.abc import Mapping

import diffrax
import numpy as np

import jaxspace

from ..bodies import BodyState
from ..core import AbstractSystem, argument
from ..core.quantities import REQUIRED
from ..dispersion.covariance import METHODS
from ..dispersion.purpose import BY_PURPOSE
from ._accuracy import Tolerance
from ._catalog import Catalog, part_entries, state_class, state_way
from ._control import control_kind
from ._effect_tables import EffectName, EffectTables
from ._ends import end_kind
from ._errors import missing, unknown, wrong
from ._final_error import final_error_kind
from ._flight import flight_entries
from ._kinds import Entry, Kind, Maker, Reading, Schema, Value
from ._objects import entry_of, function_way
from ._optimize_table import optimize_table
from ._table_kinds import AnyTable, NamedTables, Object, Table
from ._value_kinds import ListOf, Number, OneName, Text, Whole

KINDS = ("system", "scene", "mission", "flight")
FORMAT = 1
"""The format of scene files that this version reads. It rises when a file that was right would mean
something else or be refused; a key that is added leaves it."""
DESIGNS = ("random", "latin_hypercube", "sobol")
TIME = Number(argument("s", fixed=True, doc="time"))
DURATION = Number(argument("s", positive=True, doc="duration"))
LONGEST_STEP = Number(argument("s", positive=True, fixed=True, doc="longest step"))
# The engine resolves sixteen units in the last place of a state of 64 bits, and no tolerance above
# a half has a digit.
LEAST_ACCURACY = 16.0 * float(np.finfo(float).eps)
ACCURACY = Tolerance(argument("", low=LEAST_ACCURACY, high=0.5, fixed=True, doc="of each step"))
TOLERANCE = Number(argument("", positive=True, fixed=True, doc="relative tolerance"))
TIMES = Table(
    {
        "start": Entry(TIME, 0.0, doc="time of the initial state"),
        "end": Entry(TIME, doc="time of the last state"),
        "samples": Entry(Whole(2, 10**7), 200, doc="how many states are kept from start to end"),
    }
)

SHARE = Number(argument("", low=0.0, high=1.0, strict=True, fixed=True, doc="from 0 to 1"))
UNTIL = Table(
    {
        "output": Entry(Text(), doc="whose limit is to be known"),
        "share": Entry(SHARE, 0.99, doc="of the runs that lie below the limit"),
        "precision": Entry(SHARE, 0.01, doc="in distances of the limit from the mean"),
        "confidence": Entry(SHARE, 0.95, doc="with which it is known"),
    }
)


def kind_of(data: Mapping[str, object]) -> str:
    """The kind of a file, from the tables that it has."""
    # No key gives the kind, because the tables of the file determine it.
    named = {"system": "system", "vehicle": "flight", "phase": "mission"}
    return next((kind for key, kind in named.items() if key in data), "scene")


def format_error(data: Mapping[str, object]) -> str:
    """The error for a file of a later format, with what to do; empty for any other file."""
    written = data.get("format")
    # Another type is reported by reading it.
    if not isinstance(written, int) or written <= FORMAT:
        return ""
    return (
        f"format is {written}: jaxspace {jaxspace.__version__} reads up to {FORMAT}, so that it "
        f"must be read by a later version (pip install --upgrade jaxspace)."
    )


def form(data: Mapping[str, object], catalog: Catalog) -> tuple[Table, list[str]]:
    """The form of a file of the kind of `data`; or, for a system of unknown name, the error."""
    kind = kind_of(data)
    if kind != "system":
        return form_of(kind, catalog), []
    system = data["system"]
    names = tuple(catalog.systems)
    if not isinstance(system, Mapping):
        return Table({}), [wrong("system", system, "a table")]
    if "name" not in system:
        return Table({}), [missing("system.name", OneName(names).expected())]
    name = system["name"]
    if not isinstance(name, str):
        return Table({}), [wrong("system.name", name, OneName(names).expected())]
    if name in catalog.refused:
        return Table({}), [f'system.name = "{name}" {catalog.refused[name]}']
    if name not in names:
        return Table({}), [unknown(f'system.name = "{name}"', name, names, "system")]
    return form_of(kind, catalog, name), []


def form_of(kind: str, catalog: Catalog, system: str = "") -> Table:
    """The form of a file of a kind, with the name of its `system` where it has one."""
    state = BodyState if kind != "system" else state_class(catalog.systems[system])
    common, campaign = _common_entries(catalog, state), _campaign_entries()
    if kind == "flight":
        return Table({**common, **flight_entries(), **campaign})
    common["planet"] = Entry(Table(catalog.shared("planet")), None, doc="what attracts")
    if kind == "system":
        return Table({**common, **_system_entries(catalog, system), **campaign})
    body = _body_entries(catalog)
    if kind == "scene":
        refused = {"branch": "leaves at the end of a phase: there must be a [[phase]]."}
        return Table({**common, **body, **_one_run(catalog), **campaign}, refused)
    phases = {
        "phase": Entry(ListOf(_phase(catalog), least=1), doc="the phases, one after the other"),
        "branch": Entry(NamedTables(branch_table(catalog)), {}, doc="parts that leave, by name"),
    }
    return Table({**common, **body, **phases, **campaign}, {})


def _common_entries(catalog: Catalog, state: type) -> dict[str, Entry]:
    """What every file may give, for states of this class."""
    return {
        "format": Entry(Whole(1, FORMAT), FORMAT, doc="of scene files, for which it is written"),
        "modules": Entry(
            ListOf(Text()), (), doc="Python files that it needs; each runs only by --with"
        ),
        "title": Entry(Text(), "", doc="for tables and figures; by default the name of the file"),
        # Far below the errors of the data of a flight, and within reach of every method in double
        # precision.
        "accuracy": Entry(
            ACCURACY, 1e-9, doc=f'relative tolerance of each step; of campaigns also "{BY_PURPOSE}"'
        ),
        "final_error": Entry(
            final_error_kind(state, ACCURACY.quantity),
            None,
            doc="that the nominal run may have at its end",
        ),
        "method": Entry(method_kind(catalog), None, doc="integrator; by default chosen by rules"),
        "max_step": Entry(LONGEST_STEP, None, doc="longest step"),
        "max_steps": Entry(Whole(), None, doc="how many steps a run may take"),
    }


def _campaign_entries() -> dict[str, Entry]:
    """The tables of a campaign and of a search."""
    search = optimize_table(OutputList(), TOLERANCE)
    return {
        "dispersion": Entry(_dispersion(), None, doc="what scatters, and what is kept"),
        "optimize": Entry(search, None, doc="what is best, and what is free"),
    }


def _system_entries(catalog: Catalog, system: str) -> dict[str, Entry]:
    """The tables of a system, which is a complete model, without bodies and effects."""
    cls = catalog.systems[system]
    named = _named(system, catalog.kinds[cls])
    return {
        "system": Entry(named, doc="the system and its parameters"),
        "initial": Entry(initial_kind(catalog, cls), doc="the initial state"),
        **_one_run(catalog),
    }


def _body_entries(catalog: Catalog) -> dict[str, Entry]:
    """The tables of a body and of what acts on it."""
    effects = {name: Entry(catalog.kinds[cls], None) for name, cls in catalog.effects.items()}
    return {
        "body": Entry(bodies_kind(catalog), {}, doc="mass properties"),
        # A body without any effect moves freely, which is a scene as well.
        "effects": Entry(EffectTables(effects, catalog.refused), {}, doc="what acts on the body"),
        "initial": Entry(initial_kind(catalog, None), doc="the initial state"),
    }


def _one_run(catalog: Catalog) -> dict[str, Entry]:
    """The tables of a run that has no phases."""
    return {
        "times": Entry(TIMES, doc="from when to when"),
        "control": Entry(control_kind(catalog), None, doc="what acts at samples"),
    }


def bodies_kind(catalog: Catalog) -> Object:
    """How a file gives the mass properties of a body."""
    return Object(tuple(way for cls in catalog.bodies.values() for way in catalog.kinds[cls].ways))


def _named(name: str, kind: Object) -> Object:
    """The ways to give a system, each with the entry `name`."""
    name_entry = {"name": Entry(OneName((name,)), doc="of the system")}

    def made(way: Maker) -> Maker:
        # A table with a name is never given by its only number alone.
        return way._replace(entries={**name_entry, **way.entries}, bare=False)

    return Object(tuple(made(way) for way in kind.ways))


def initial_kind(catalog: Catalog, system: type[AbstractSystem] | None) -> Kind:
    """How a file gives the initial state of a system, or of a body under effects (`None`)."""
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


def method_kind(catalog: Catalog) -> Object:
    """The names of the integrators; one with parameters is a table with `name` and whole
    numbers."""
    names = ["auto"]
    ways = []
    for name, cls in catalog.methods.items():
        whole = {
            key: Entry(Whole(), REQUIRED if p.default is inspect.Parameter.empty else p.default)
            for key, p in inspect.signature(cls).parameters.items()
            if p.annotation is int
        }
        # It has an argument that a file cannot give, such as a function.
        if any(
            p.default is inspect.Parameter.empty and key not in whole
            for key, p in inspect.signature(cls).parameters.items()
        ):
            continue
        if not any(entry.default is REQUIRED for entry in whole.values()):
            names.append(name)
        if whole:
            entries = {"name": Entry(OneName((name,)), doc="of the method"), **whole}
            ways.append(Maker(name, cls, {key: key for key in whole}, entries, {}))
    plain = {"name": Entry(OneName(tuple(names)), doc="of the method")}
    named = {name: cls for name, cls in catalog.methods.items() if name in names}

    def make(name: str) -> diffrax.AbstractSolver | str:
        return "auto" if name == "auto" else named[name]()

    return Object((Maker("method", make, {"name": "name"}, plain, {}, bare=True), *ways))


def _phase(catalog: Catalog) -> Table:
    jumps = {name: Entry(catalog.kinds[cls], None) for name, cls in catalog.jumps.items()}
    active = ListOf(EffectName(tuple(catalog.effects)))
    return Table(
        {
            "name": Entry(Text(), doc="of the phase, for tables and figures"),
            "effects": Entry(active, (), doc="the effects that act in this phase"),
            "duration": Entry(DURATION, None, doc="how long it lasts"),
            "until": Entry(end_kind(catalog), None, doc="the time or event at which it ends"),
            "within": Entry(DURATION, None, doc="how long to wait for the event"),
            "jump": Entry(Table(jumps), {}, doc="what changes the state at the end"),
            "control": Entry(control_kind(catalog, True), None, doc="what acts at samples"),
            "body": Entry(
                bodies_kind(catalog), None, doc="mass properties from this phase on, if others"
            ),
        }
    )


def branch_table(catalog: Catalog) -> Table:
    """The table of a branch: a part that leaves, and its phases."""

    def vector(unit: str, doc: str) -> Entry:
        return entry_of(argument(unit, shape=(3,), default=(0.0, 0.0, 0.0), doc=doc))

    return Table(
        {
            "after": Entry(Text(), doc="the phase at whose end it leaves, by its name"),
            "body": Entry(
                bodies_kind(catalog), doc="its mass properties; without inertia it is a point"
            ),
            "offset": vector("m", "of its centre of mass from that of what is left, in body axes"),
            "kick": vector("m/s", "its velocity relative to what is left, in body axes"),
            "phase": Entry(ListOf(_phase(catalog), least=1), doc="its phases, as [[phase]]"),
        }
    )


def _dispersion() -> Table:
    return Table(
        {
            # Enough for a mean and a deviation to a few percent.
            "runs": Entry(Whole(), 1000, doc="how many runs"),
            "seed": Entry(Whole(0), 1, doc="what the inputs are drawn from"),
            "outputs": Entry(OutputList(), doc="what is kept of each run"),
            # The paths that exist are known only after the rest of the file has been read.
            "inputs": Entry(AnyTable(), {}, doc="what scatters, by path"),
            "correlated": Entry(
                ListOf(AnyTable()), (), doc="inputs that are correlated, by a matrix"
            ),
            "direction": Entry(ListOf(AnyTable()), (), doc="vectors whose direction scatters"),
            "until": Entry(UNTIL, None, doc="when there are enough runs"),
            "compare": Entry(
                ListOf(OneName(METHODS)), (), doc="cheaper methods, put beside these runs"
            ),
            "extreme_samples": Entry(
                Whole(5, 10**5), 65, doc="states of each phase among which extremes are sought"
            ),
            "sampling": Entry(
                OneName(DESIGNS), "random", doc="where the runs lie among the inputs"
            ),
        }
    )


class OutputList(Kind):
    """A list of names or paths, or tables with the keys `output`, `at`, `take`, `unit`, `name`, and
    for a requirement `at_least`, `at_most`, the share of the runs that may violate it (`allowed`)
    and the `confidence` of its verdict."""

    # Those that may be numbers without a unit.
    NUMBERS = ("at_least", "at_most", "allowed", "confidence")
    KEYS = ("output", "at", "take", "unit", "name", *NUMBERS)

    def read(self, value: object, path: str, reading: Reading) -> Value:
        if not (isinstance(value, list) and value):
            reading.errors.append(wrong(path, value, self.expected()))
            return None
        return [self._one(v, f"{path}.{k}", reading) for k, v in enumerate(value)]

    def _one(self, value: object, path: str, reading: Reading) -> dict[str, object]:
        if isinstance(value, str):
            return {"output": value}
        if not isinstance(value, Mapping):
            reading.errors.append(wrong(path, value, "a name, or a table with the key output"))
            return {}
        for key, text in value.items():
            if key not in self.KEYS:
                reading.errors.append(unknown(f"{path}.{key}", key, self.KEYS))
            elif not isinstance(text, str) and key not in self.NUMBERS:
                reading.errors.append(wrong(f"{path}.{key}", text, "text"))
        if "output" not in value:
            reading.errors.append(missing(f"{path}.output", "the name of an output"))
        return dict(value)

    def expected(self) -> str:
        return 'a list of names of outputs, paths such as "final.omega.2", or tables of them'

    def schema(self) -> Schema:
        text = {"type": "string"}
        limit = {"type": ["string", "number"]}
        kinds = {key: limit if key in self.NUMBERS else text for key in self.KEYS}
        table = {
            "type": "object",
            "properties": kinds,
            "required": ["output"],
            "additionalProperties": False,
        }
        return {"type": "array", "minItems": 1, "items": {"anyOf": [text, table]}}
