"""The states of each phase that a campaign saves, for its outputs and for its trajectories."""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ..simulation.masking import nan_unless, scaled
from ..simulation.mission_result import MissionTrajectory
from ..simulation.phase_runs import MissionTimes, SaveTimes
from ..simulation.trajectory import Trajectory


class ChosenTimes(NamedTuple):
    """Places in a phase at which its states are saved.

    - `fractions`: of its duration, ascending from 0 to 1, (times,).
    - `outputs`: indices of those that the outputs read, evenly spaced.
    - `kept`: indices of the requested ones."""

    fractions: Float[Array, " times"]
    outputs: Int[Array, " num_saved"]
    kept: Int[Array, " chosen"]


StatesToStore: TypeAlias = int | tuple[ChosenTimes | MissionTimes | None, ...]
"""Number of states to store of each phase, evenly from its start to its end; or their places."""


def saved_states(num_saved: int, kept: int) -> tuple[int, int]:
    """Number of states of a phase to save, and n, of which every n-th one goes into the store.

    The number is at least `num_saved`, and `kept` of the states are stored."""
    if kept < 2:
        return num_saved, 1
    # Rounded up: no fewer states than the outputs need, and both ends of a phase among the stored.
    every_nth = -(-(num_saved - 1) // (kept - 1))
    return every_nth * (kept - 1) + 1, every_nth


def saved_of(num_saved: int, kept: StatesToStore) -> int | list[SaveTimes]:
    """The save times of each phase, for `run_mission`."""
    if isinstance(kept, int):
        return saved_states(num_saved, kept)[0]
    fractions = [c.fractions if isinstance(c, ChosenTimes) else c for c in kept]
    return [num_saved if x is None else x for x in fractions]


def for_outputs(result: MissionTrajectory, kept: StatesToStore) -> MissionTrajectory:
    """The states that the outputs read: evenly spaced, from the start of each phase to its end."""
    if isinstance(kept, int):
        return result
    pairs = zip(result.phases, kept, strict=True)
    phases = tuple(_even(phase, chosen) for phase, chosen in pairs)
    return dataclasses.replace(result, phases=phases)


def _even(phase: Trajectory, chosen: ChosenTimes | MissionTimes | None) -> Trajectory:
    if chosen is None:
        return phase
    if isinstance(chosen, MissionTimes):
        # The chosen times are the first rows, the evenly spaced ones follow.
        return _picked(phase, slice(chosen.times.shape[0], None))
    return _picked(phase, chosen.outputs)


def for_store(
    result: MissionTrajectory, num_saved: int, kept: StatesToStore
) -> Sequence[Trajectory | None]:
    """States of each phase that go into the store; `None` where there are none."""
    if isinstance(kept, int):
        return list(thinned(result, saved_states(num_saved, kept)[1]).phases) if kept else []
    pairs = enumerate(zip(result.phases, kept, strict=True))
    return [_chosen(phase, chosen, number == 0) for number, (phase, chosen) in pairs]


def _chosen(
    phase: Trajectory, chosen: ChosenTimes | MissionTimes | None, first: bool
) -> Trajectory | None:
    if chosen is None:
        return None
    if isinstance(chosen, ChosenTimes):
        return _picked(phase, chosen.kept)
    count = chosen.times.shape[0]
    times = chosen.times.astype(phase.ts.dtype)[:, None]
    start, end = phase.ts[count], phase.ts[-1]
    # The next phase starts at this very end, so that one phase alone of a run has a time.
    covered = jnp.sign(end - start) * (times - start) > 0.0
    covered = covered & (jnp.sign(end - start) * (times - end) <= 0.0)
    # A time at a border belongs to the phase that ends there; no phase ends at the start of the
    # mission.
    inside = nan_unless(covered | (times == start) if first else covered)
    picked = _picked(phase, slice(None, count))
    states = scaled(picked.states, inside)
    return dataclasses.replace(picked, ts=times * inside, states=states)


def thinned(result: MissionTrajectory, every_nth: int) -> MissionTrajectory:
    """Each n-th state of every phase, from its start to its end."""
    phases = tuple(_picked(phase, slice(None, None, every_nth)) for phase in result.phases)
    return dataclasses.replace(result, phases=phases)


def _picked(phase: Trajectory, which: slice | Int[Array, " times"]) -> Trajectory:
    # The time axis precedes the single batch axis.
    states = jax.tree.map(lambda x: x[..., which, :], phase.states)
    return dataclasses.replace(phase, ts=phase.ts[which], states=states)
