"""Channels of a run: its quantities over the time, by the names that scene files give them.

A channel is an output of the scene ("altitude", "site.east"), a number of the state ("position.2"),
or, without a scene, a declared function (`jaxspace.core.output`) of the parts of a state."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..core import InputError, State
from ..core.jit import compiled, quick_jit
from ..core.quantities import quantities
from ..simulation import MissionTrajectory, Trajectory
from ..simulation.mission_result import Simulated
from ._kinds.errors import hint
from ._mission.states import parts_of_state
from ._requests.output_entries import read_output, unit_of
from ._requests.output_spec import OutputSpec, arguments_of
from ._runs.nominal import as_batch
from ._runs.outputs import Outputs, at_path
from ._scene_file import SceneFile

FINE = 1000
"""States of a phase between which channels are interpolated."""
Function: TypeAlias = Callable[..., Array]
Along: TypeAlias = Mapping[str, Mapping[int, tuple[Array, Array]]]


class Curve(NamedTuple):
    """A channel over one run: for each of its phases, by their numbers, times, s, and values."""

    phases: dict[int, tuple[np.ndarray, np.ndarray]]

    def at(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The values at ascending times, NaN outside, and the number of the phase, -1 outside; a
        time at a border belongs to the phase that ends there."""
        from scipy.interpolate import CubicSpline

        values = np.full(times.shape, np.nan)
        phase = np.full(times.shape, -1)
        for number, (t, x) in self.phases.items():
            inside = (times >= t[0]) & (times <= t[-1]) & (phase < 0)
            if t.size > 3 and inside.any():
                values[inside] = CubicSpline(t, x)(times[inside])
            elif inside.any():
                values[inside] = np.interp(times[inside], t, x)
            phase[inside] = number
        return values, phase

    @property
    def points(self) -> tuple[np.ndarray, np.ndarray]:
        """All times and values, in the order of the phases."""
        t, x = (np.concatenate(parts) for parts in zip(*self.phases.values(), strict=True))
        return t, x


class Channels:
    """The channels of a run, SI.

    - `units`: their units by name."""

    def __init__(
        self, names: Mapping[str, str | Function], scene: SceneFile | None, run: Simulated
    ):
        """`names`: what each channel is, by its name: an output, a path or a function."""
        self.outputs: Outputs | None = None
        self.units: dict[str, str] = {}
        self.functions: dict[str, Function] = {}
        if scene is None:
            for name, what in names.items():
                self.functions[name], self.units[name] = _of_state(name, what, run)
            return
        specs = []
        for name, what in names.items():
            if not isinstance(what, str):
                raise InputError(f"channels[{name!r}] is a function: with a scene it must be text.")
            spec = _spec(scene, name, what)
            specs.append(spec._replace(name=name, factor=1.0))
            self.units[name] = unit_of(spec, scene.parsed)
        self.outputs = scene.outputs_along(tuple(specs))

    def of(self, run: Simulated) -> dict[str, Curve]:
        """The channels of a single run."""
        each = self.of_each(as_batch(run), {})
        return {name: curves[0] for name, curves in each.items()}

    def of_each(self, runs: Simulated, samples: dict[str, Array]) -> dict[str, list[Curve]]:
        """The channels of each run of a batch with these inputs."""
        if self.outputs is None:
            found = compiled(self._of_states)(runs)
        else:
            found = compiled(lambda o, r, s: o.along(r, s))(self.outputs, runs, samples)
        found = jax.tree.map(np.asarray, found)
        count = runs.status.shape[-1]
        return {name: [_curve(x, k) for k in range(count)] for name, x in found.items()}

    def _of_states(self, runs: Simulated) -> Along:
        found: dict[str, dict[int, tuple[Array, Array]]] = {}
        for name, function in self.functions.items():
            found[name] = {}
            for k, phase in enumerate(runs.phases):
                shape = phase.ts.shape[0], runs.status.shape[-1]
                ts = jnp.broadcast_to(phase.ts.reshape(shape[0], -1), shape)
                values = jax.vmap(function, in_axes=(0, -2))(ts, phase.states)
                found[name][k] = ts, jnp.broadcast_to(values, shape)
        return found


def _curve(phases: Mapping[int, tuple[np.ndarray, np.ndarray]], run: int) -> Curve:
    """The channel of one run of a batch, without times that repeat and values that are missing."""
    found = {}
    for number, (ts, values) in phases.items():
        t, x = ts[:, run], values[:, run]
        good = np.isfinite(t) & np.isfinite(x)
        t, first = np.unique(t[good], return_index=True)
        if t.size:
            found[number] = t, x[good][first]
    return Curve(found)


def _spec(scene: SceneFile, channel: str, what: str) -> OutputSpec:
    """The output of a scene for a channel, along the whole run."""
    declared = what.partition(".")[0] in parts_of_state(scene.parsed)
    entry = {"output": f"run.{what}" if declared else what, "take": "greatest", "name": "channel"}
    try:
        return read_output(f"channels[{channel!r}]", entry, scene.parsed, scene.units)
    except ValueError as error:
        raise InputError(str(error)) from None


def known_channel(scene: SceneFile | None, name: str, run: Simulated) -> bool:
    """Whether a run has a channel of this name."""
    try:
        Channels({name: name}, scene, run)
    except InputError:
        return False
    return True


def _of_state(channel: str, what: str | Function, run: Simulated) -> tuple[Function, str]:
    """A channel as a function of time and state, and its unit."""
    if isinstance(what, str):
        return _of_path(channel, what, run)
    declared = getattr(what, "output", None)
    if declared is None:
        raise InputError(
            f"channels[{channel!r}] has no unit: declare it with jaxspace.core.output."
        )
    names = arguments_of(what)

    def function(t: Array, y: State) -> Array:
        special = {"t": t, "y": y}
        return what(**{n: special[n] if n in special else getattr(y, n) for n in names})

    return function, declared.unit


def _of_path(channel: str, what: str, run: Simulated) -> tuple[Function, str]:
    path = tuple(what.split("."))
    state = run.final
    declared = quantities(type(state))
    if path[0] not in declared or getattr(state, path[0]) is None:
        known = [name for name in declared if getattr(state, name) is not None]
        raise InputError(
            f"channels[{channel!r}] is {what!r}: it must be a part of the state, one of "
            f"{', '.join(known)}, with the numbers of its components, such as position.2."
            + hint(path[0], known)
        )
    try:
        good = jnp.ndim(at_path(state, path)) == 0
    except (IndexError, ValueError):
        good = False
    if not good:
        raise InputError(f"channels[{channel!r}] is {what!r}: it must be a single number.")
    return (lambda t, y: at_path(y, path)), declared[path[0]].unit


def resolved(run: Simulated) -> Simulated:
    """A single run whose phases have enough states to interpolate between: those with fewer are
    repeated, unless a controller acts in them."""
    main = run.without_branches() if isinstance(run, MissionTrajectory) else run
    return main.with_phases([_fine(phase) for phase in main.phases], main.status)


def _fine(phase: Trajectory) -> Trajectory:
    if phase.ts.shape[0] >= FINE or phase.control is not None:
        return phase
    parts = phase.with_steps()
    if not parts:
        return phase
    ts, states = [], []
    for part in parts:
        ts.append(jnp.linspace(part.ts[0], part.ts[-1], max(FINE // len(parts), 4)))
        states.append(_states_at(part, ts[-1]))
    joined = jax.tree.map(lambda *x: jnp.concatenate(x, axis=-1), *states)
    return dataclasses.replace(phase, ts=jnp.concatenate(ts), states=joined, dense=None)


@quick_jit
def _states_at(part: Trajectory, ts: Array) -> State:
    return jax.vmap(part.at, out_axes=-1)(ts)
