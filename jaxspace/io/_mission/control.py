"""The table [control] of a scene file: a controller that acts at samples, and its sensors.

[control]                        period, hold, delay, limit, quantum, until, steps, seed
[control.law.quaternion_feedback]    one law, or one for each part that takes a command
[control.sensors.omega]          what reads a part of the state; without any the law sees all

In a mission [phase.control] follows the [[phase]] that it controls.
"""

import functools
from collections.abc import Iterable

import jax
import jax.numpy as jnp
from jaxtyping import Array

from ...control import AbstractSensor, ClosedLoop, Sensor, StarTracker
from ...control.point_laws import Together
from ...core import AbstractSystem, InputError, Scalar, argument
from ...core.quantities import quantities
from ...simulation import Event
from .._catalog.catalog import Catalog
from .._catalog.declared import entry_of
from .._kinds.errors import wrong
from .._kinds.kind import Entry, Maker, Values
from .._kinds.tables import Object, Table
from .._kinds.values import Number, OneName, Whole
from .building import Building
from .ends import is_event
from .lines import phase_tables
from .parsed import Parsed

READ = ("attitude", "omega", "position", "velocity", "mass", "wheels")
"""The quantities that a sensor of a file may read."""

# The keys that bound the time of a phase, from which its number of samples follows.
ENDS = ("duration", "within")

PERIOD = Number(argument("s", positive=True, fixed=True, doc="time between samples"))
DELAY = Number(argument("s", non_negative=True, fixed=True, doc="delay"))
SIZE = Number(argument("", positive=True, doc="magnitude of a command, in its SI unit"))


def control_kind(catalog: Catalog, of_phase: bool = False) -> Table:
    """The table [control], or that of a phase, which has a separate end."""
    laws = {name: Entry(catalog.kinds[cls], None) for name, cls in catalog.controllers.items()}
    sensors = {name: Entry(_sensor_kind(name), None) for name in READ}
    until = {"until": Entry(OneName(tuple(catalog.events)), None, doc="the event that ends it")}
    return Table(
        {
            "period": Entry(PERIOD, doc="time between two samples of the controller"),
            "hold": Entry(OneName(("zero", "first")), "zero", doc="between samples"),
            "delay": Entry(DELAY, 0.0, doc="until a command arrives"),
            "limit": Entry(SIZE, None, doc="greatest component of a command"),
            "quantum": Entry(SIZE, None, doc="step between commands"),
            # The table of a phase defines its end.
            **({} if of_phase else until),
            "steps": Entry(Whole(1, 10**4), 1, doc="steps between two samples"),
            "seed": Entry(Whole(0), 0, doc="seed of the sensor noise"),
            "law": Entry(Table(laws), doc="controllers by name"),
            "sensors": Entry(Table(sensors), {}, doc="sensors by the quantity they measure"),
        }
    )


def _sensor_kind(name: str) -> Object:
    """The file entry of a sensor for a part of the state."""
    cls = StarTracker if name == "attitude" else Sensor
    # An attitude is read as a quaternion, whose error is a small rotation and no sum.
    make = StarTracker if name == "attitude" else functools.partial(Sensor, name)
    entries = {key: entry_of(declared) for key, declared in quantities(cls).items()}
    # In place of the declared one, which a campaign could disperse: the number of readings must be
    # known.
    entries["period"] = Entry(PERIOD, None, doc="time between readings, that of the controller")
    return Object((Maker(cls.__name__, make, {key: key for key in entries}, entries, {}),))


def control_errors(file: Parsed) -> list[str]:
    """Errors of the tables of control together with the systems that they control."""
    result = []
    for path, control in controls(file.values).items():
        if not _named(control["law"]):
            laws = ", ".join(file.catalog.controllers)
            result.append(f"{path}.law is empty: it must have a table of {laws}.")
        phase = _phase_of(file.values, path)
        until = None if phase is None else phase["until"]
        if until is not None and not is_event(until, file.catalog):
            what = "an event; or give the phase a duration, because its samples must be known"
            result.append(wrong(f"{path.removesuffix('.control')}.until", until, what))
    return result


def scatter_errors(file: Parsed, inputs: Iterable[str]) -> list[str]:
    """Errors for a dispersed number that fixes the duration of a controlled phase."""
    ends = {
        f"{path.removesuffix('.control')}.{key}" for path in controls(file.values) for key in ENDS
    }
    return [
        f"dispersion.inputs.{path}: it determines the longest time of a controlled phase, which "
        "must be known, so it cannot be dispersed."
        for path in inputs
        if path in ends
    ]


def controls(values: Values) -> dict[str, Values]:
    """The tables of control by their paths: that of a scene, or those of phases."""
    result = {"control": values.get("control")}
    for key, phase in phase_tables(values).items():
        result[f"{key}.control"] = phase["control"]
    return {path: control for path, control in result.items() if control is not None}


def is_noisy(values: Values) -> bool:
    """Whether a sensor of the file draws random numbers."""
    return any(
        sensor is not None and (sensor.get("noise") is not None or sensor.get("walk") is not None)
        for control in controls(values).values()
        for sensor in control["sensors"].values()
    )


def controlled(
    file: Parsed, path: str, building: Building, system: AbstractSystem, seeds: Array | None
) -> AbstractSystem | ClosedLoop:
    """The system of a phase under the controller whose table is at a path; itself without one.

    `seeds`: one number between 0 and 1 for each run of a campaign, from which its noise follows."""
    control = controls(building.values).get(path)
    if control is None:
        return system
    laws = [building.make(f"{path}.law.{name}") for name in _named(control["law"])]
    names = _named(control["sensors"])
    sensors: dict[str, AbstractSensor] = {
        name: building.make(f"{path}.sensors.{name}") for name in names
    }
    phase = _phase_of(file.values, path)
    times = file.values["times"] if phase is None else {}
    # From the file, because in a campaign the dispersed numbers are traced.
    longest = (
        times["end"] - times["start"] if phase is None else phase["duration"] or phase["within"]
    )
    try:
        return ClosedLoop(
            system,
            laws[0] if len(laws) == 1 else Together(laws),
            sensors or None,
            period=control["period"],
            hold=control["hold"],
            delay=control["delay"],
            limit=control["limit"],
            quantum=control["quantum"],
            steps=control["steps"],
            key=_key(control["seed"], _number(file, path), seeds)
            if is_noisy(file.values)
            else None,
            longest=float(longest),
        )
    # The class names its field; the author of a file looks for its table.
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def end_of_loop(file: Parsed, span: Scalar) -> Scalar | Event:
    """The end of the loop of a scene, `span`, s, after its start or at its event."""
    name = file.values["control"]["until"]
    if name is None:
        return span
    condition = file.catalog.events[name]
    return Event(condition, condition.event.direction, span)


def _number(file: Parsed, path: str) -> int:
    """The number of the phase whose table of control is at the path; 0 for that of a scene."""
    return [*phase_tables(file.values), "control"].index(path.removesuffix(".control"))


def _key(seed: int, phase: int, seeds: Array | None) -> Array:
    """The key of the noise of a phase, or one of each run."""
    # The number of the phase is folded in, so that no phase repeats the noise of another.
    key = jax.random.fold_in(jax.random.key(seed), phase)
    if seeds is None:
        return key
    # 2^31, because a number that rounds to one would overflow 2^32.
    numbers = (seeds * 2.0**31).astype(jnp.uint32)
    return jax.vmap(functools.partial(jax.random.fold_in, key))(numbers)


def _phase_of(values: Values, path: str) -> Values | None:
    """The phase whose table of control is at the path; `None` for that of a scene."""
    return phase_tables(values).get(path.removesuffix(".control"))


def _named(table: Values) -> list[str]:
    """The entries of a table that the file gives, in its order."""
    return [name for name, value in table.items() if value is not None]
