"""A file whose entries are individually valid: its values, its phases, and the constructors of its
body and effects."""

import dataclasses
import functools
from collections.abc import Hashable, Mapping

from jax.typing import ArrayLike

from ...scene.reading import read_effects
from .._catalog.catalog import Catalog
from .._kinds.kind import Maker, Value, Values
from .._kinds.named_files import NamedFile
from .building import NUMBERS, Building, Runs, replaced
from .lines import Leg, Line, lines_of, phase_tables

ROTATION = frozenset({"attitude", "omega"})
TRANSLATION = frozenset({"position", "velocity"})
# The entries of a file on which no system, mission or output depends.
OUTSIDE = ("format", "modules", "title", "dispersion", "optimize", "final_error", "accuracy")
# In place of a number, which is an argument of programs: any use of it raises an error.
NUMBER = float


@dataclasses.dataclass(frozen=True)
class Parsed:
    """A file whose entries are right one by one: its kind, values, and makers of objects."""

    # One of `_form.KINDS`.
    kind: str
    values: Values = dataclasses.field(compare=False)
    makers: dict[str, Maker] = dataclasses.field(compare=False)
    catalog: Catalog = dataclasses.field(compare=False)
    # All other fields follow from these, which are compared instead, because campaigns contain a
    # file as a static field: when it is loaded again, the compiled programs are reused.
    source: Hashable

    @property
    def is_mission(self) -> bool:
        """Whether it runs in phases."""
        return self.kind in ("mission", "flight")

    @functools.cached_property
    def structure(self) -> "Parsed":
        """The file without its numbers, its title and its requests: what a program depends on that
        has the numbers as arguments. Files that differ in these only have equal structures."""
        values = {key: x for key, x in self.values.items() if key not in OUTSIDE}
        values = _without_numbers(values, "", _known_numbers(self.values))
        made = tuple((path, *maker.identity) for path, maker in sorted(self.makers.items()))
        named = (*self.catalog.systems.items(), *self.catalog.events.items())
        points = tuple(line.path for line in self.points)
        source = (_frozen(values), made, named, self.changes_mass, points)
        result = dataclasses.replace(self, values=values, source=source)
        # The answers may depend on numbers; the lines are those of the structure itself.
        lines = tuple(line for line in result.lines if line.path in points)
        result.__dict__.update(changes_mass=self.changes_mass, points=lines, structure=result)
        return result

    def numbers(self, samples: Mapping[str, ArrayLike] | None = None) -> Values:
        """The values for a program: arrays as numbers, those of `samples` at their paths.

        Entries on which no system, mission or output depends are left out."""
        values = {key: x for key, x in self.values.items() if key not in OUTSIDE}
        return replaced(values, samples or {})

    def building(self) -> Building:
        """For one run, with the numbers of the file."""
        return Building(self.values, self.makers, Runs())

    @functools.cached_property
    def lines(self) -> tuple[Line, ...]:
        """The sequences of phases: that of the mission itself, then those of its branches. A scene
        is a single phase."""
        if self.kind == "mission":
            return lines_of(self.values)
        # As a mission of one phase, so that all that reads places reads them in one way.
        scene = {"name": "scene", "effects": list(self.active_effects())}
        return (Line("", "", (Leg(0, "scene", "", scene, "body"),), -1),)

    @property
    def legs(self) -> tuple[Leg, ...]:
        """All phases, in the order of their numbers."""
        return tuple(leg for line in self.lines for leg in line.legs)

    def leaving(self, leg: Leg) -> tuple[Line, ...]:
        """The branches that start at the end of a phase."""
        return tuple(line for line in self.lines if line.after == leg.number)

    def first_leg(self, place: int) -> int:
        """The number of the first phase of the segment that ends at the location of an output; a
        system or a flight begins with its first one."""
        if place >= 0 or self.kind not in ("scene", "mission"):
            return max(place, 0)
        return self.lines[-1 - place].legs[0].number

    def last_leg(self, place: int, count: int = 1) -> int:
        """The number of the phase at whose end the place of an output is; a system or a flight, of
        `count` phases, has its end at that of the last one."""
        if place >= 0:
            return place
        mission = self.kind in ("scene", "mission")
        return self.lines[-1 - place].legs[-1].number if mission else count - 1

    def before(self, line: Line, leg: Leg) -> tuple[Leg, ...]:
        """The phases that lead to a phase of a line, first to last."""
        own = tuple(other for other in line.legs if other.number < leg.number)
        if line.after < 0:
            return own
        last = self.legs[line.after]
        return (*self.before(self.line_at(line.after), last), last, *own)

    def active_effects(self) -> tuple[str, ...]:
        """The effects that have a table."""
        tables = self.values.get("effects", {})
        return tuple(name for name, table in tables.items() if table is not None)

    @functools.cached_property
    def changes_mass(self) -> bool:
        """Whether an effect or a branch changes the mass, which is then a part of the state."""
        if self.kind in ("system", "flight"):
            return self.kind == "flight"
        # A branch takes its share of the mass, whatever its effects do.
        if len(self.lines) > 1:
            return True
        building = self.building()
        effects = building.effects(self.active_effects()).values()
        result = read_effects(effects, building.make("body")).effects
        return any("mass_rate" in reading.adds for reading in result)

    def parts(self, line: Line | None = None) -> set[str]:
        """The parts of the state that the file gives; those that are left in a branch."""
        # The whole may turn, and the part that leaves it a point.
        if line is not None and line in self.points:
            return self.parts() - ROTATION
        # After its rail a rocket becomes a point under its parachutes, without an attitude.
        if self.kind == "flight":
            return set(TRANSLATION)
        initial = self.values["initial"]
        given = {key for key, value in initial.items() if value is not None}
        result = {key for key in given if f"initial.{key}" not in self.makers}
        for key in given - result:
            result |= set(self.makers[f"initial.{key}"].make.initial.gives)
        return result

    @functools.cached_property
    def points(self) -> tuple[Line, ...]:
        """The branches that fly as points: their bodies have no inertia."""
        building = self.building()
        return tuple(
            line for line in self.lines[1:] if not building.make(f"{line.path}.body").has_inertia()
        )

    def line_at(self, place: int) -> Line:
        """The sequence of phases of a place of an output: -1 - k is the end of the line of this
        number, any other number is that of a phase."""
        if place < 0:
            return self.lines[-1 - place]
        return next(line for line in self.lines if self.legs[place] in line.legs)


def _known_numbers(values: Values) -> tuple[str, ...]:
    """The paths of the numbers on which the length of a closed loop depends, and with it the shapes
    of its program."""
    phases = phase_tables(values)
    looped = [path for path, phase in phases.items() if phase["control"] is not None]
    own = ("times",) if values.get("control") is not None else ()
    return (*own, *(f"{path}.{key}" for path in looped for key in ("duration", "within")))


def _without_numbers(values: Value, path: str, known: tuple[str, ...]) -> Value:
    """The tree with `NUMBER` in place of numbers that are arguments of programs."""
    if path in known:
        return values
    if isinstance(values, NUMBERS):
        return NUMBER
    if isinstance(values, Mapping):
        prefix = f"{path}." if path else ""
        return {k: _without_numbers(x, f"{prefix}{k}", known) for k, x in values.items()}
    if isinstance(values, list):
        return [_without_numbers(x, f"{path}.{k}", known) for k, x in enumerate(values)]
    return values


def _frozen(values: Value) -> Hashable:
    """A tree of values that can be compared and hashed. The paths of files are left out."""
    if isinstance(values, Mapping):
        return tuple((key, _frozen(x)) for key, x in values.items())
    if isinstance(values, list):
        return ("list", *map(_frozen, values))
    return values.text if isinstance(values, NamedFile) else values
