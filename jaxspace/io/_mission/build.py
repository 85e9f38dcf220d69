"""Systems, missions and initial states from the values of a file, for one run or for many."""

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
from jaxtyping import Array

from ...bodies import AbstractEffect, AbstractJump, Detached
from ...bodies.effects import with_parts
from ...bodies.parting import release
from ...core import AbstractSystem, InputError, Scalar, State
from ...scene import Scene
from ...simulation import Event, Mission, Phase
from .._kinds.kind import Values
from .building import Building, Runs, at, referred
from .control import controlled, end_of_loop
from .ends import condition_of
from .flight import build_flight
from .lines import Leg, Line
from .parsed import ROTATION, Parsed
from .states import needed_parts, state_of

ONE_PHASE = {"system": "run", "scene": "scene"}


def build_mission(
    file: Parsed, values: Values, runs: Runs, seeds: Array | None = None
) -> tuple[Mission, State]:
    """Mission and initial state.

    **Arguments**

    - `values`: those of the file, whose numbers are scalars or (runs,).
    - `seeds`: of the noise of each run, (runs,), between 0 and 1.

    **Returns** the mission (with a single phase for a system or a scene) and the state, with the
    runs on the last axis."""
    if file.kind == "flight":
        return build_flight(file, values, runs)
    building = Building(values, file.makers, runs)
    if file.kind == "system":
        system, y0 = build_system(file, values, runs)
        return _one_phase(file, building, system, seeds), y0
    body = building.make("body")
    effects = building.effects(file.active_effects())
    initial = build_state(file, building)
    # A constant mass is not part of the state, because every part is integrated.
    if file.changes_mass:
        mass = runs.scalar(body.loaded_mass())
        initial = eqx.tree_at(lambda y: y.mass, initial, mass, is_leaf=lambda x: x is None)
    # Before the phases, because a part that one of them integrates is in the states of all.
    initial = with_parts(initial, effects.values(), body)
    carry = initial.present
    if file.kind == "scene":
        scene = Scene(tuple(effects.values()), body, carry)
        return _one_phase(file, building, scene, seeds), initial
    making = _Making(file, building, effects, carry, seeds)
    return making.mission(file.lines[0], 0.0), initial


class _Making(NamedTuple):
    """Components of the phases of a file: its `effects` by name, and the parts of the state that
    all of them `carry`."""

    file: Parsed
    building: Building
    effects: dict[str, AbstractEffect]
    carry: tuple[str, ...]
    seeds: Array | None

    def mission(
        self, line: Line, start: Scalar, parting: Callable[[Scalar, State], State] | None = None
    ) -> Mission:
        """The mission of a line of phases, with its branches.

        `start`: its time, s; `parting`: computes its state from that of the whole."""
        # All phases carry the same parts, so that one state passes through all of them.
        lost = ROTATION if line in self.file.points else frozenset()
        carry = tuple(part for part in self.carry if part not in lost)
        phases = []
        for leg in line.legs:
            active = {name: self.effects[name] for name in leg.phase["effects"]}
            until = _until(self.file, leg, active, start, self.building)
            scene = Scene(tuple(active.values()), self.building.make(leg.body), carry)
            path = f"{leg.path}.control"
            system = controlled(self.file, path, self.building, scene, self.seeds)
            # After an event the time is unknown before the run: known times cannot end a phase.
            start = start + (0.0 if isinstance(until, Event) else until)
            then, branches = self._end(leg, start)
            phases.append(Phase(system, until, then, leg.phase["name"], branches))
        return Mission(phases, parting, line.key or "mission")

    def _end(
        self, leg: Leg, end: Scalar
    ) -> tuple[Callable[[Scalar, State], State] | None, tuple[Mission, ...]]:
        """The jump at the end of a phase, at the time `end`, s, and the branches that leave
        there."""
        jump = _jump(leg, self.building)
        lines = self.file.leaving(leg)
        if not lines:
            return jump, ()
        rest, starts = release(*map(self._part, lines))
        branches = []
        for line, start in zip(lines, starts, strict=True):
            start = start.as_point() if line in self.file.points else start
            branches.append(self.mission(line, end, start))
        return (rest if jump is None else _InTurn((rest, jump))), tuple(branches)

    def _part(self, line: Line) -> Detached:
        """A part that separates as a branch."""
        branch = at(self.building.values, line.path)
        vectors = (self.building.runs.vector(branch[key]) for key in ("offset", "kick"))
        return Detached(self.building.make(f"{line.path}.body").loaded_mass(), *vectors)


class _InTurn(eqx.Module):
    """Jumps one after the other."""

    jumps: tuple[Callable[[Scalar, State], State], ...]

    def __call__(self, t: Scalar, y: State) -> State:
        for jump in self.jumps:
            y = jump(t, y)
        return y


def _one_phase(
    file: Parsed, building: Building, system: AbstractSystem, seeds: Array | None
) -> Mission:
    """A system or a scene as a mission, under a controller where the file has one."""
    span = building.values["times"]["end"] - building.values["times"]["start"]
    end = end_of_loop(file, span) if file.values["control"] else span
    moving = controlled(file, "control", building, system, seeds)
    return Mission([Phase(moving, end, name=ONE_PHASE[file.kind])])


def build_system(file: Parsed, values: Values, runs: Runs) -> tuple[AbstractSystem, State]:
    """The system of a file, and its initial state; arguments as in `build_mission`."""
    building = Building(values, file.makers, runs)
    system = building.make("system")
    return system, build_state(file, building, system)


def build_state(file: Parsed, building: Building, system: AbstractSystem | None = None) -> State:
    """The initial state, of every run; the mass of a body is not among its parts."""
    # The state has the axis of runs from the start, because the carry of a loop must not change its
    # shape.
    full = building._replace(full=True)
    if "initial" in full.makers:
        maker = full.makers["initial"]._replace(make=system.state)  # type: ignore[union-attr]
        return full._replace(makers={**full.makers, "initial": maker}).make("initial")
    parts: dict[str, State] = {}
    pending = {}
    for key, value in full.values["initial"].items():
        path = f"initial.{key}"
        if path in full.makers:
            pending[path] = full.makers[path]
        elif value is not None:
            parts[key] = (
                full.runs.full(value) if isinstance(value, list) else full.runs.scalar(value)
            )
    while pending:
        # A direction of the orbit waits until position and velocity are there.
        path = next(p for p, m in pending.items() if set(needed_parts(m)) <= set(parts))
        maker = pending.pop(path)
        made = full.make(path, **{part: parts[part] for part in needed_parts(maker)})
        # In the order of the declaration, which is that of the returned tuple.
        gives = maker.make.initial.gives  # type: ignore[attr-defined]
        parts |= dict(zip(gives, made if len(gives) > 1 else (made,), strict=True))
    return state_of(file)(**parts)


def system_errors(file: Parsed) -> list[str]:
    """Errors for parts of the initial state that the vector field of the system does not accept,
    without a computation."""
    state = state_of(file)
    if "initial" not in file.makers:
        needed = [f.name for f in dataclasses.fields(state) if f.default is dataclasses.MISSING]
        absent = [name for name in needed if name not in file.parts()]
        if absent:
            return [f"initial has no {name}, which {state.__name__} requires." for name in absent]
    # Shapes are enough, because the parts that a vector field needs do not depend on numbers.
    system, y0 = eqx.filter_eval_shape(
        lambda values: build_system(file, values, Runs()), file.numbers()
    )
    name = type(system).__name__
    try:
        rate = jax.eval_shape(lambda s, y: s.vector_field(0.0, y), system, y0)
    except InputError as error:
        return [f"initial: {error}"]
    except (AssertionError, AttributeError, TypeError):
        # A user's vector field may raise anything where a part is absent.
        parts = ", ".join(n for n, part in vars(y0).items() if part is not None)
        return [f"initial has {parts}: the vector field of {name} requires other parts."]
    for part, value in vars(y0).items():
        # A part without a rate would stay constant, most likely by mistake.
        if value is not None and getattr(rate, part, None) is None:
            return [f"initial has {part}, which {name} does not change: remove it."]
    return []


def _until(
    file: Parsed, leg: Leg, active: dict[str, AbstractEffect], start: Scalar, building: Building
) -> Scalar | Event:
    """The duration of a phase, s, or the event that ends it; `start` is its time, s."""
    phase, events = at(building.values, leg.path), file.catalog.events
    until = phase["until"]
    name = condition_of(phase["until"])
    if until is None:
        return phase["duration"]
    if name is not None:
        path = f"{leg.path}.until.{name}"
        condition = building.make(path, **referred(file.makers[path], active))
        return Event(condition, condition.direction, phase["within"])
    if until in events:
        return Event(events[until], events[until].event.direction, phase["within"])
    known = next(e for n, e in active.items() if until in file.catalog.known_times(n))
    if known.started_at(0.0) is not known:
        # It counts from the start of the phase, at whatever time that is.
        return getattr(known, until)()
    return getattr(known, until)() - start


def _jump(leg: Leg, building: Building) -> AbstractJump | None:
    names = [name for name, table in leg.phase["jump"].items() if table is not None]
    return building.make(f"{leg.path}.jump.{names[0]}") if names else None
