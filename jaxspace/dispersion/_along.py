"""Which states a campaign saves of each phase, for its outputs and for its trajectories."""

from typing import NamedTuple, TypeAlias

import jax
from jaxtyping import Array, Float, Int

from ..simulation._mission_runs import MissionResult
from ..simulation._run_result import RunResult


class ChosenTimes(NamedTuple):
    """Where the states of a phase are saved.

    - `fractions`: of its duration, ascending from 0 to 1, (times,).
    - `outputs`: which of them the outputs read, even ones.
    - `kept`: which of them were chosen."""

    fractions: Float[Array, " times"]
    outputs: Int[Array, " along"]
    kept: Int[Array, " chosen"]


Kept: TypeAlias = int | tuple[ChosenTimes | None, ...]
"""How many states are kept of each phase, evenly from its start to its end; or where they are."""


def saved_states(along: int, kept: int) -> tuple[int, int]:
    """How many states of a phase are saved, so that the outputs have `along` of them or a few more,
    and each n-th is one of the `kept`; and this n."""
    if kept < 2:
        return along, 1
    every_nth = -(-(along - 1) // (kept - 1))
    return every_nth * (kept - 1) + 1, every_nth


def saved_of(along: int, kept: Kept) -> int | list:
    """What `run_mission` saves."""
    if isinstance(kept, int):
        return saved_states(along, kept)[0]
    return [along if chosen is None else chosen.fractions for chosen in kept]


def for_outputs(result: MissionResult, kept: Kept) -> MissionResult:
    """The states that the outputs read: even ones, from the start of each phase to its end."""
    if isinstance(kept, int):
        return result
    pairs = zip(result.phases, kept, strict=True)
    phases = [p if c is None else _picked(p, c.outputs) for p, c in pairs]
    return result._replace(phases=phases)


def for_store(result: MissionResult, along: int, kept: Kept) -> list[RunResult | None]:
    """Of each phase the states that are kept; `None` where there are none."""
    if isinstance(kept, int):
        return list(thinned(result, saved_states(along, kept)[1]).phases) if kept else []
    pairs = zip(result.phases, kept, strict=True)
    return [None if c is None else _picked(p, c.kept) for p, c in pairs]


def thinned(result: MissionResult, every_nth: int) -> MissionResult:
    """Each n-th state of every phase, from its start to its end."""
    phases = [_picked(phase, slice(None, None, every_nth)) for phase in result.phases]
    return result._replace(phases=phases)


def _picked(phase: RunResult, which: slice | Int[Array, " times"]) -> RunResult:
    # Times lie before the one axis of runs.
    states = jax.tree.map(lambda x: x[..., which, :], phase.states)
    return phase._replace(ts=phase.ts[which], states=states)
