"""The outputs of every run of a campaign: numbers at its end, at the end of a phase, or extremes
along it.

An output is a declared function of a state (`jaxspace.core.output`), a declared method of an effect
(`drag.dynamic_pressure`), or the path of a number of the state, `final.omega.2`, in which the name
of a phase may replace `final`, and `run` denotes the whole run. The places of a branch have its
name before theirs: `booster.final.position.2`, `booster.fall`."""

import dataclasses
import functools
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from ...bodies import AbstractBody, AbstractEffect
from ...core import AbstractSystem, InputError, Scalar, State
from ...simulation import CompactRun, MissionTrajectory
from ...simulation.legs import legs_of
from ...simulation.mission_result import Simulated
from ...statistics.extremes import greatest, least
from ...vehicles import LaunchSite
from .._kinds.kind import Values
from .._mission.build import build_mission
from .._mission.building import Building, Runs, at, replaced
from .._mission.parsed import Parsed
from .._requests.output_spec import BEGAN, INITIAL, NOMINAL, OutputSpec


class Curve(NamedTuple):
    """The times and the states of a phase, runs last, and their rates where they are known."""

    times: Array
    states: State
    rates: State | None = None


OutputFunction: TypeAlias = Callable[[MissionTrajectory, dict[str, Array]], dict[str, Array]]
"""Computes the outputs, each (runs,), from a result and the inputs of its runs."""
Curves: TypeAlias = Mapping[int, Curve]
"""The curves along phases by their numbers."""


class Span(NamedTuple):
    """The times at which a phase starts and ends in each run, s."""

    start: Array
    end: Array

    @classmethod
    def of(cls, ts: Array) -> "Span":
        """The output at saved times, (times, *runs)."""
        return cls(jnp.min(ts, axis=0), jnp.max(ts, axis=0))

    def inside(self, t: Scalar) -> Scalar:
        """The time `t`, s, a few roundings inside where the phase starts or ends: a motor whose
        burnout ends the phase still burns there."""
        edge = 8.0 * jnp.finfo(self.end.dtype).eps * (jnp.abs(self.start) + jnp.abs(self.end))
        near = jnp.clip(t, self.start + edge, jnp.maximum(self.end - edge, self.start + edge))
        return t + jax.lax.stop_gradient(near - t)


class _Context(NamedTuple):
    """Arguments of outputs besides a state: as for `Outputs.numbers`, the number of `runs`, the
    `effects` with output methods, by name, and the `spans` of phases by their location."""

    samples: dict[str, Array]
    runs: int
    began: dict[int, State]
    effects: Mapping[str, Any]
    spans: Mapping[int, Span]


class Outputs(eqx.Module):
    """The `outputs` of a campaign of the `file`, one for each of the `specs`.

    - `values`: the numbers of the file.
    - `reference`: the states of the nominal run by phase (-1: the end), with an axis of one run;
      `None` if no output needs them.
    - `initial`: the initial state of the file; `None` if no output needs it. Known, because in the
      program of all runs it would be built by some forty kernels."""

    file: Parsed = eqx.field(static=True)
    specs: tuple[OutputSpec, ...] = eqx.field(static=True)
    values: Values
    reference: dict[int, State] | None
    initial: State | None = None

    @property
    def to_check(self) -> "Outputs | None":
        """The outputs of user-defined functions, or `None` if there are none.

        A campaign checks that the outputs of a run do not depend on other runs. Outputs of the
        library are tested for it, and left out to save the time of another trace."""
        own = __name__.partition(".")[0]
        given = tuple(
            spec
            for spec in self.specs
            if spec.function is not None and spec.function.__module__.partition(".")[0] != own
        )
        return dataclasses.replace(self, specs=given) if given else None

    def __call__(self, result: Simulated, samples: dict[str, Array]) -> dict[str, Array]:
        states, ends = line_ends(result)
        began, curves, spans = {}, {}, {}
        for spec in self.specs:
            if "scene" in spec.arguments() and not spec.take:
                last = self.file.last_leg(spec.at, len(result.phases))
                spans[spec.at] = Span.of(result.phases[last].ts)
            if BEGAN in spec.arguments():
                first = self.file.first_leg(spec.at)
                began[spec.at] = result.phases[first].initial
            # Only requested phases, because the compiled program does not save the states of
            # others.
            if spec.at >= 0:
                states[spec.at] = result.phases[spec.at].final
                ends[spec.at] = result.phases[spec.at].ts[-1]
            curves |= {k: Curve(result.phases[k].ts, result.phases[k].states) for k in spec.phases}
        return self.numbers(states, ends, samples, curves, began, spans)

    def numbers(
        self,
        states: dict[int, State],
        ends: dict[int, Array],
        samples: dict[str, Array],
        curves: Curves | None = None,
        began: dict[int, State] | None = None,
        spans: Mapping[int, Span] | None = None,
    ) -> dict[str, Array]:
        """The outputs, each (runs,).

        **Arguments**

        - `states`, `ends`: the states at the ends of the phases, and the times there, s.
        - `samples`: the inputs of the runs.
        - `curves`: all states of the phases along which extremes are taken.
        - `began`: the states at the starts of the phases, for outputs that compare with them.
        - `spans`: of the phases at whose ends outputs read the scene."""
        runs = jax.tree.leaves(states[-1])[0].shape[-1]
        context = self._context(samples, runs, began, spans)
        result = {}
        for spec in self.specs:
            if spec.take:
                value = self._extreme(spec, curves or {}, context)
            else:
                value = self._value(spec, spec.at, states[spec.at], ends[spec.at], context)
            # An output of shared numbers alone has no axis of runs, which the store needs.
            result[spec.name] = jnp.broadcast_to(spec.factor * value, (runs,))
        return result

    def _context(
        self,
        samples: dict[str, Array],
        runs: int,
        began: dict[int, State] | None = None,
        spans: Mapping[int, Span] | None = None,
    ) -> _Context:
        # Made once, because several outputs may be methods of one effect.
        names = dict.fromkeys(spec.effect for spec in self.specs if spec.effect)
        effects = {
            name: effect_named(self.file, self.values, samples, runs, name) for name in names
        }
        return _Context(samples, runs, began or {}, effects, spans or {})

    def along(
        self, result: Simulated, samples: dict[str, Array]
    ) -> dict[str, dict[int, tuple[Array, Array]]]:
        """Times and values, each (times, runs), of the outputs at all states of their `phases`, by
        the names of the outputs and the numbers of the phases."""
        runs = jax.tree.leaves(result.final)[0].shape[-1]
        places = {spec.at for spec in self.specs if BEGAN in spec.arguments()}
        began = {at: result.phases[self.file.first_leg(at)].initial for at in places}
        context = self._context(samples, runs, began)
        found: dict[str, dict[int, tuple[Array, Array]]] = {}
        for spec in self.specs:
            found[spec.name] = {}
            for k in spec.phases:
                ts = result.phases[k].ts
                ts = jnp.broadcast_to(ts.reshape(ts.shape[0], -1), (ts.shape[0], runs))
                in_phase = context._replace(spans={k: Span.of(ts)})

                one = functools.partial(self._one, spec, k, in_phase)
                values = jax.vmap(one, in_axes=(0, -2))(ts, result.phases[k].states)
                found[spec.name][k] = ts, spec.factor * values
        return found

    def _extreme(self, spec: OutputSpec, curves: Curves, context: _Context) -> Array:
        times, values, slopes = [], [], []
        for k in spec.phases:
            in_phase = context._replace(spans={k: Span.of(curves[k].times)})

            one = functools.partial(self._one, spec, k, in_phase)

            def moving(
                t: Scalar, y: State, rate: State, one: Callable[[Scalar, State], Array] = one
            ) -> tuple[Array, Array]:
                return jax.jvp(one, (t, y), (jnp.ones_like(t), rate))

            curve = curves[k]
            times.append(curve.times)
            # Mapped over the times, which are before the axis of runs.
            if curve.rates is None:
                values.append(jax.vmap(one, in_axes=(0, -2))(curve.times, curve.states))
            else:
                q, s = jax.vmap(moving, in_axes=(0, -2, -2))(*curve)
                values.append(q)
                slopes.append(s)
        # Several phases simultaneously, because the extreme of the run may be in any of them.
        extreme = greatest if spec.take.endswith("greatest") else least
        result = extreme(times, values, slopes or None)
        return result.time if spec.take.startswith("time") else result.value

    def _one(self, spec: OutputSpec, place: int, context: _Context, t: Scalar, y: State) -> Array:
        """The output of one state of each run, (runs,)."""
        return jnp.broadcast_to(self._value(spec, place, y, t, context), (context.runs,))

    def _value(self, spec: OutputSpec, place: int, y: State, t: Scalar, context: _Context) -> Array:
        """The output of the state `y` at the time `t`, at a place: the number of a phase, or that
        of an end as `OutputSpec.at`."""
        if spec.function is None:
            return at_path(y, spec.path)
        samples, runs = context.samples, context.runs
        arguments = {}
        shared = dict(spec.shared)
        for name in spec.arguments():
            if name in shared:
                arguments[name] = at(replaced(self.values, samples), shared[name])
            elif name == "self":
                arguments[name] = context.effects[spec.effect]
            elif name == "y":
                arguments[name] = y
            elif name == "t":
                span = context.spans.get(place) if "scene" in spec.arguments() else None
                arguments[name] = t if span is None else span.inside(t)
            elif name == "body":
                arguments[name] = body_at(self.file, self.values, samples, runs, place)
            elif name == "scene":
                scene = moving_at(self.file, self.values, samples, runs, place)
                span = context.spans.get(place)
                arguments[name] = scene if span is None else scene.started_at(span.start)
            elif name == INITIAL:
                arguments[name] = self.initial
            elif name == BEGAN:
                arguments[name] = context.began[spec.at]
            elif name == NOMINAL:
                # Without a reference only the shapes are used, and these are the same.
                arguments[name] = y if self.reference is None else self.reference[spec.at]
            else:
                arguments[name] = getattr(y, name)
        return spec.function(**arguments)


class MoreOutputs(eqx.Module):
    """The outputs of a file, and those of a `further` function."""

    of_file: Outputs
    further: OutputFunction

    @property
    def to_check(self) -> OutputFunction:
        """The outputs for the check that no run depends on another: the further function and users'
        functions of the file."""
        return self.further if self.of_file.to_check is None else self

    def __call__(self, result: MissionTrajectory, samples: dict[str, Array]) -> dict[str, Array]:
        numbers = self.of_file(result, samples)
        more = self.further(result, samples)
        if not isinstance(more, Mapping):
            raise InputError(
                f"outputs returns an object of type {type(more).__name__}: it must return a dict "
                "of outputs by name."
            )
        for name in numbers:
            if name in more:
                raise InputError(
                    f"outputs returns {name!r}, which is already an output of the file: use "
                    "another name."
                )
        return {**numbers, **more}


def line_ends(
    result: Simulated | CompactRun,
) -> tuple[dict[int, State], dict[int, Array]]:
    """States and times, s, at the end of a mission, at -1, and of its branches."""
    ends = [(result.final, result.end), *((b.final, b.end) for b in result.branches)]
    states = {-1 - k: state for k, (state, _) in enumerate(ends)}
    return states, {-1 - k: time for k, (_, time) in enumerate(ends)}


def at_path(y: State, path: tuple[str, ...]) -> Array:
    """A number of a state: the name of a part, then indices."""
    part = getattr(y, path[0])
    # An array, or an object with a single one, such as a quaternion.
    (array,) = jax.tree.leaves(part)
    for index in path[1:]:
        array = array[int(index)]
    return array


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
