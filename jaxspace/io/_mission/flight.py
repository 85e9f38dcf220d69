"""The flight of a rocket from its rail to the ground, as defined in a file: [vehicle] with its
parachutes, [site], and the longest times to wait for the ends of its phases.

[vehicle]                 the arguments of `Vehicle.model_rocket`
[[vehicle.parachutes]]    those of `Recovery`, in the order of their opening
[site]                    those of `LaunchSite`
[waiting]                 those of `sounding_flight`
"""

import math

import jax
import jax.numpy as jnp

from ...bodies import BodyState
from ...core import argument
from ...simulation import Mission
from ...vehicles import LaunchSite, Recovery, Vehicle, sounding_flight
from ...vehicles.flights import flight_phases
from .._catalog.declared import object_kind
from .._kinds.errors import missing, wrong
from .._kinds.kind import Entry, Maker, Values
from .._kinds.tables import Object, Table
from .._kinds.values import ListOf, Number
from .building import Building, Runs
from .parsed import Parsed

SITE = "site"
CLASSES = {"vehicle": Vehicle, "parachutes": Recovery, SITE: LaunchSite}
"""The entries of the tables of a flight, by their names."""


def flight_entries() -> dict[str, Entry]:
    """The tables of a flight."""
    kinds = flight_kinds()

    def waiting(default: float | None, doc: str) -> Entry:
        return Entry(Number(argument("s", positive=True, fixed=True, doc=doc)), default, doc=doc)

    longest = {
        "rail": waiting(None, "for the end of the rail; by default the longest possible time"),
        "ascent": waiting(300.0, "for the apogee"),
        "descent": waiting(2000.0, "for the next parachute, or the ground"),
    }
    return {
        "vehicle": Entry(kinds[Vehicle], doc="the rocket, its motor and its parachutes"),
        "site": Entry(kinds[LaunchSite], doc="the rail, its place, and the air above it"),
        "waiting": Entry(Table(longest), {}, doc="the longest times to wait for an event"),
    }


def flight_kinds() -> dict[type, Object]:
    """The file entries of each class of a flight; a vehicle includes its parachutes."""
    kinds = {cls: object_kind(cls) for cls in CLASSES.values()}
    known = {cls: kind for cls, kind in kinds.items() if kind is not None}
    chutes = Entry(ListOf(known[Recovery]), (), doc="a list of tables, in the order of opening")

    def with_parachutes(way: Maker) -> Maker:
        return way._replace(entries={**way.entries, "parachutes": chutes})

    return {**known, Vehicle: Object(tuple(map(with_parachutes, known[Vehicle].ways)))}


def parachutes(building: Building) -> list[Recovery]:
    """The parachutes, in the order of their opening."""
    count = len(building.values["vehicle"]["parachutes"])
    return [building.make(f"vehicle.parachutes.{k}") for k in range(count)]


def phases_of_flight(file: Parsed) -> list[str]:
    """The names of the phases."""
    return flight_phases(parachutes(file.building()))


def build_flight(file: Parsed, values: Values, runs: Runs) -> tuple[Mission, BodyState]:
    """Mission and initial state, of every run; arguments as in `build_mission`."""
    building = Building(values, file.makers, runs)
    # Omitted entries have the defaults of `sounding_flight`.
    longest = {f"{name}_within": x for name, x in values["waiting"].items() if x is not None}
    mission, y0 = sounding_flight(
        building.make("vehicle"), building.make("site"), parachutes(building), **longest
    )
    if runs.count is None:
        return mission, y0
    # Where only parachutes and air are dispersed, all runs have the same start.
    shared = jnp.ndim(y0.mass) == 0
    batch = jax.tree.map(lambda x: x[..., None], y0) if shared else y0
    return mission, jax.tree.map(lambda x: jnp.broadcast_to(x, (*x.shape[:-1], runs.count)), batch)


def flight_errors(file: Parsed) -> list[str]:
    """Consistency errors of the tables of a flight, one message each."""
    result = []
    building = file.building()
    top = float(building.make("vehicle").ceiling)
    before, earlier = math.inf, 0.0
    # In the order of opening, in which each one bounds the next.
    for number, chute in enumerate(parachutes(building)):
        key = f"vehicle.parachutes.{number}.height"
        if chute.time is not None:
            time = float(chute.time)
            # Each opening ends a phase of the flight, and the phases follow each other.
            if time <= earlier:
                what = f"above {earlier:g} s, when the previous one opens"
                result.append(wrong(f"vehicle.parachutes.{number}.time", time, what))
            earlier = max(earlier, time)
            continue
        if chute.height is None:
            if number:
                what = (
                    "the height of its opening, in m, or its time, because the apogee opens only "
                    "the first one"
                )
                result.append(missing(key, what))
            continue
        height = float(chute.height)
        if height >= top:
            what = f"below {top:.0f} m, the apogee of a flight without air, or it never opens"
            result.append(wrong(key, height, what))
        elif height >= before:
            what = f"below {before:g} m, where the previous one opens, or it never opens"
            result.append(wrong(key, height, what))
        before = min(before, height)
    return result
