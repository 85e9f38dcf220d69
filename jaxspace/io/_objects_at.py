"""What moves at a place of a file, in every run: the body, the scene or system, and an effect.

The place of an output is the number of a phase, or -1 - k for the end of the k-th line of phases
(`OutputSpec.at`). Each function takes the `values` of the file and the `samples` of the inputs by
their paths, each (runs,)."""

from collections.abc import Mapping

from jaxtyping import Array

from ..bodies import AbstractBody, AbstractEffect
from ..core import AbstractSystem
from ..simulation.legs import legs_of
from ..vehicles import LaunchSite
from ._build import build_mission, replaced
from ._kinds import Values
from ._objects import Building, Runs
from ._parsed import Parsed


def body_at(
    file: Parsed, values: Values, samples: Mapping[str, Array], runs: int, place: int
) -> AbstractBody:
    """The body at a place."""
    building = _building(file, values, samples, runs)
    # A rocket makes its body from the parts of its table.
    if file.kind == "flight":
        return building.make("vehicle").body
    return building.make(file.legs[file.last_leg(place)].body)


def moving_at(
    file: Parsed, values: Values, samples: Mapping[str, Array], runs: int, place: int
) -> AbstractSystem:
    """The scene or the system at a place."""
    numbers = replaced(values, samples)
    legs, _ = legs_of(build_mission(file, numbers, Runs(runs))[0])
    return legs[file.last_leg(place, len(legs))].phase.moving


def effect_named(
    file: Parsed, values: Values, samples: Mapping[str, Array], runs: int, name: str
) -> AbstractEffect | LaunchSite:
    """An effect by its name, or the site of a flight."""
    building = _building(file, values, samples, runs)
    if file.kind == "flight":
        return building.make(name)
    return building.effects(file.active_effects())[name]


def _building(file: Parsed, values: Values, samples: Mapping[str, Array], runs: int) -> Building:
    return Building(replaced(values, samples), file.makers, Runs(runs))
