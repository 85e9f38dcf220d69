"""The nominal run of a scene file: its states and its outputs, as those of a batch of one run."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from ..control import LoopRun
from ..core import State
from ..simulation import MissionTrajectory
from ..simulation.mission_result import Simulated, numbers_of
from ._outputs import Outputs, line_ends
from .by_numpy import by_numpy


@by_numpy()
def outputs_of(nominal: Simulated | LoopRun, outputs: Outputs) -> dict[str, tuple[float, str]]:
    """The `outputs` of the nominal run, with their units."""
    # Outputs take runs on the last axis, so that the nominal run is a batch of one; and traced as a
    # whole, because an operation that is carried out by itself takes three times as long as one of
    # a traced function.
    numbers = eqx.filter_jit(lambda o, run: o(run, {}))(outputs, _as_batch(nominal))
    return {spec.name: (float(numbers[spec.name][0]), spec.unit) for spec in outputs.specs}


def _as_batch(nominal: Simulated | LoopRun) -> Simulated:
    """The run with an axis of one run."""
    run = numbers_of(nominal.trajectory if isinstance(nominal, LoopRun) else nominal)
    phases = [dataclasses.replace(phase, run_axes=1) for phase in run.phases]
    return with_run(run.with_phases(phases, run.status))


def nominal_states(nominal: MissionTrajectory) -> dict[int, State]:
    """The states of the nominal run by phase, and at its ends (`line_ends`), with an axis of one
    run."""
    states = {**line_ends(nominal)[0], **{k: p.final for k, p in enumerate(nominal.phases)}}
    return with_run(states)


def with_run(tree: PyTree) -> PyTree:
    """The arrays with an axis of one run behind."""
    # By NumPy, as above: outside of `jit` each shape would be a program of JAX.
    return jax.tree.map(lambda x: jnp.asarray(np.asarray(x)[..., None]), tree)
