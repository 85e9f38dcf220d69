"""One run of a scene file, computed with the functions for batches: its states and outputs, a final
output as a function for studies, and the warning of a run below the surface."""

import dataclasses
import warnings
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, PyTree

from ...bodies import AbstractEffect, BodyState
from ...control import LoopRun
from ...core import InputError, Scalar, State, output
from ...core.jit import compiled
from ...scene.ground_check import ground_warning, lowest_below_ground
from ...simulation import MissionTrajectory, Trajectory
from ...simulation.finish import with_doubts
from ...simulation.mission_result import Result, Simulated, numbers_of
from .._kinds.kind import Values
from .._mission.parsed import Parsed
from .._requests.output_entries import read_output
from .._requests.output_spec import FINAL, OutputSpec
from ..by_numpy import by_numpy
from ..units import WrittenUnits
from .outputs import Outputs, line_ends


@by_numpy()
def outputs_of(nominal: Simulated | LoopRun, outputs: Outputs) -> dict[str, tuple[float, str]]:
    """The `outputs` of the nominal run, with their units."""
    # Outputs take runs on the last axis, so that the nominal run is a batch of one; and traced as a
    # whole, because an operation that is carried out by itself takes three times as long as one of
    # a traced function.
    numbers = compiled(lambda o, run: o(run, {}))(outputs, as_batch(nominal))
    return {spec.name: (float(numbers[spec.name][0]), spec.unit) for spec in outputs.specs}


def as_batch(nominal: Simulated | LoopRun) -> Simulated:
    """The run with an axis of one run."""
    run = numbers_of(nominal.trajectory if isinstance(nominal, LoopRun) else nominal)
    phases = [dataclasses.replace(phase, run_axes=1) for phase in run.phases]
    return with_run(run.with_phases(phases, run.status))


@by_numpy()
def nominal_states(nominal: MissionTrajectory) -> dict[int, State]:
    """The states of the nominal run by phase, and at its ends (`line_ends`), with an axis of one
    run."""
    states = {**line_ends(nominal)[0], **{k: p.final for k, p in enumerate(nominal.phases)}}
    return with_run(states)


def with_run(tree: PyTree) -> PyTree:
    """The arrays with an axis of one run behind."""
    # By NumPy, as above: outside of `jit` each shape would be a program of JAX.
    return jax.tree.map(lambda x: jnp.asarray(np.asarray(x)[..., None]), tree)


class FinalOutput(NamedTuple):
    """An output of the final state of a run.

    - `function`: of the state `y` and its time `t`, s; its unit is the one of the file.
    - `si`: the unit in SI; `factor`: the conversion factor to units of the file."""

    function: Callable[..., Array]
    si: str
    factor: float


def spec_of_end(name: str, file: Parsed, units: WrittenUnits) -> OutputSpec:
    """The output of this name at the end of a run; as of `SceneFile.final_output`."""
    try:
        spec = read_output("output", {"output": name}, file, units)
    # The name is the caller's, and no error of the file.
    except ValueError as error:
        raise InputError(str(error)) from None
    if spec.at >= 0:
        raise InputError(f"output is {name}: it must be an output of the final state.")
    return spec


def function_of(outputs: Outputs, spec: OutputSpec) -> Callable[..., Array]:
    """The function of the output of the `spec`, which is among the `outputs`, for one run."""

    def of_end(y: State, t: Scalar) -> Array:
        # Outputs take runs on the last axis, so that this is a batch of one run.
        y, t = jax.tree.map(lambda x: jnp.asarray(x)[..., None], (y, t))
        return outputs.numbers({-1: y}, {-1: t}, {})[spec.name][0]

    # Its label does not repeat that it is final.
    of_end.__name__ = spec.name.removeprefix(f"{FINAL}.")
    return output(spec.unit)(of_end)


def warned_of_ground(run: Result, values: Values, stacklevel: int) -> Result:
    """The run, with the status of one that passes below the ground, of which it warns.

    An effect that states the ground warns of it itself.

    **Arguments**

    - `values`: of the file, whose [planet] has `mu`, m^3/s^2, and `radius`, m.
    - `stacklevel`: of the verb that the user calls, from here."""
    planet = values.get("planet") or {}
    mu, radius = planet.get("mu"), planet.get("radius")
    if mu is None or radius is None:
        return run
    below = False
    for phase in run.phases:
        words = _words(phase, mu, radius)
        if words:
            warnings.warn(words, stacklevel=stacklevel + 1)
            below = True
    return with_doubts(run, jnp.asarray(below)) if below else run


def _words(phase: Trajectory, mu: float, radius: float) -> str:
    """A warning message about a phase that passes below the surface; empty if it stays above."""
    parts = (phase.system, *getattr(phase.system, "effects", ()))
    # Over flat ground the origin is not a centre.
    about_centre = any(hasattr(part, "mu") for part in parts)
    known = any(isinstance(e, AbstractEffect) and e.ground() is not None for e in parts)
    if not about_centre or known or not isinstance(phase.states, BodyState):
        return ""
    within = mu if phase.undisturbed else None
    return ground_warning(
        lowest_below_ground(phase.ts, phase.states, radius, within), radius, "planet.radius"
    )
