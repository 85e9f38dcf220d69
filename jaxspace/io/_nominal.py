"""The nominal run of a scene file: its states and its outputs, as those of a batch of one run."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from ..control import LoopRun
from ..core import State
from ..core.by_numpy import by_numpy
from ..simulation import MissionTrajectory, Trajectory
from ._outputs import BEGAN, Curve, Outputs, OutputSpec, line_ends


@by_numpy()
def outputs_of(
    nominal: Trajectory | MissionTrajectory | LoopRun,
    specs: tuple[OutputSpec, ...],
    outputs: Outputs,
) -> dict[str, tuple[float, str]]:
    """The `outputs` of the nominal run, which the `specs` name, with their units."""
    if isinstance(nominal, MissionTrajectory):
        states = nominal_states(nominal)
        ends = {**line_ends(nominal)[1], **{k: _last(p.ts) for k, p in enumerate(nominal.phases)}}
    else:
        states = {-1: with_run(nominal.final)}
        ends = {-1: _last(nominal.ts)}
    # Outputs take runs on the last axis, so that the nominal run is a batch of one.
    ends = with_run(ends)
    phases = nominal.phases if isinstance(nominal, MissionTrajectory) else [nominal]
    along = {k for spec in specs for k in spec.phases}
    curves = {k: with_run(Curve(phases[k].ts, phases[k].states)) for k in along}
    began = {
        spec.at: with_run(_first(phases[outputs.file.parsed.first_leg(spec.at)].states))
        for spec in specs
        if BEGAN in spec.arguments()
    }
    # Traced as a whole, because an operation that is carried out by itself takes three times as
    # long as one of a traced function.
    numbers = eqx.filter_jit(lambda o, *given: o.numbers(given[0], given[1], {}, *given[2:]))(
        outputs, states, ends, curves, began
    )
    return {spec.name: (float(numbers[spec.name][0]), spec.unit) for spec in specs}


def nominal_states(nominal: MissionTrajectory) -> dict[int, State]:
    """The states of the nominal run by phase, and at its ends (`line_ends`), with an axis of one
    run."""
    states = {**line_ends(nominal)[0], **{k: p.final for k, p in enumerate(nominal.phases)}}
    return with_run(states)


def with_run(tree: Any) -> Any:
    """The arrays with an axis of one run behind."""
    # By NumPy, as below: outside of `jit` each shape would be a program of JAX.
    return jax.tree.map(lambda x: jnp.asarray(np.asarray(x)[..., None]), tree)


def _first(states: State) -> State:
    """The state at the first of the times, of one run."""
    return jax.tree.map(lambda x: np.asarray(x)[..., 0], states)


def _last(ts: ArrayLike) -> np.ndarray:
    """The last of the times, s."""
    return np.asarray(np.asarray(ts)[-1])
