"""The table [control] of a scene file: a controller that acts at samples, and its sensors.

[control]                        period, hold, delay, limit, quantum, until, seed
[control.law.quaternion_feedback]    one law, or one for each part that takes a command
[control.sensors.omega]          what reads a part of the state; without any the law sees all
"""

import functools

import jax

from ..control import (
    AbstractSensor,
    ClosedLoop,
    LoopRun,
    Sensor,
    StarTracker,
    Together,
)
from ..core import InputError, argument, quantities
from ..scene import Scene
from ..simulation import Event
from ._catalog import Catalog
from ._checks import Parsed
from ._kinds import Entry, Maker, Values
from ._objects import Building, entry_of
from ._table_kinds import Object, Table
from ._value_kinds import Number, OneName, Whole

READ = ("attitude", "omega", "position", "velocity", "mass", "wheels")
"""What a sensor of a file may read."""

PERIOD = Number(argument("s", positive=True, fixed=True, doc="time between samples"))
DELAY = Number(argument("s", non_negative=True, fixed=True, doc="delay"))
SIZE = Number(argument("", positive=True, doc="size of a command, in its unit of SI"))


def control_kind(catalog: Catalog) -> Table:
    """The table [control]."""
    laws = {name: Entry(catalog.kinds[cls], None) for name, cls in catalog.controllers.items()}
    sensors = {name: Entry(_sensor_kind(name), None) for name in READ}
    return Table(
        {
            "period": Entry(PERIOD, doc="time between two samples of the controller"),
            "hold": Entry(OneName(("zero", "first")), "zero", doc="between samples"),
            "delay": Entry(DELAY, 0.0, doc="until a command arrives"),
            "limit": Entry(SIZE, None, doc="greatest component of a command"),
            "quantum": Entry(SIZE, None, doc="step between commands"),
            "until": Entry(OneName(tuple(catalog.events)), None, doc="the event that ends it"),
            "seed": Entry(Whole(0), 0, doc="what the noise of the sensors is drawn from"),
            "law": Entry(Table(laws), doc="the controllers, by name"),
            "sensors": Entry(Table(sensors), {}, doc="by what they read"),
        }
    )


def _sensor_kind(name: str) -> Object:
    """How a file gives the sensor of a part of the state."""
    cls = StarTracker if name == "attitude" else Sensor
    make = StarTracker if name == "attitude" else functools.partial(Sensor, name)
    entries = {key: entry_of(declared) for key, declared in quantities(cls).items()}
    entries["period"] = Entry(PERIOD, None, doc="time between readings, that of the controller")
    return Object((Maker(cls.__name__, make, {key: key for key in entries}, entries, {}),))


def control_errors(file: Parsed) -> list[str]:
    """What does not fit together in the table [control] and what it controls."""
    control = file.values.get("control")
    if control is None:
        return []
    found = []
    if not _named(control["law"]):
        laws = ", ".join(file.catalog.controllers)
        found.append(f"control.law is empty: it must have a table of {laws}.")
    if file.values["dispersion"] is not None:
        found.append("control and dispersion are both there: a controlled scene flies one run.")
    return found


def loop_of(file: Parsed, building: Building, scene: Scene) -> ClosedLoop:
    """The loop of a file that has a table [control]."""
    control: Values = building.values["control"]
    laws = [building.make(f"control.law.{name}") for name in _named(control["law"])]
    names = _named(control["sensors"])
    sensors: dict[str, AbstractSensor] = {
        name: building.make(f"control.sensors.{name}") for name in names
    }
    try:
        return ClosedLoop(
            scene,
            laws[0] if len(laws) == 1 else Together(laws),
            sensors or None,
            period=control["period"],
            hold=control["hold"],
            delay=control["delay"],
            limit=control["limit"],
            quantum=control["quantum"],
        )
    except InputError as error:
        raise InputError(f"control: {error}") from error


def flown(file: Parsed, loop: ClosedLoop, y0: object, ts: object, **options: object) -> LoopRun:
    """The run of a loop with the event, the noise and the options of its file."""
    control, events = file.values["control"], file.catalog.events
    given: dict[str, object] = {"key": jax.random.key(control["seed"])}
    if control["until"] is not None:
        times = file.values["times"]
        condition = events[control["until"]]
        span = times["end"] - times["start"]
        given["events"] = Event(condition, condition.event.direction, span)
    return loop.simulate(y0, ts, **{**given, **options})  # type: ignore[arg-type]


def _named(table: Values) -> list[str]:
    """The entries of a table that the file gives, in its order."""
    return [name for name, value in table.items() if value is not None]
