"""How many states a campaign saves of each phase, for its outputs and for its trajectories."""

import jax

from ..simulation._mission_runs import MissionResult


def saved_states(along: int, kept: int) -> tuple[int, int]:
    """How many states of a phase are saved, so that the outputs have `along` of them or a few more,
    and each n-th is one of the `kept`; and this n."""
    if kept < 2:
        return along, 1
    every_nth = -(-(along - 1) // (kept - 1))
    return every_nth * (kept - 1) + 1, every_nth


def thinned(result: MissionResult, every_nth: int) -> MissionResult:
    """Each n-th state of every phase, from its start to its end."""
    phases = [
        phase._replace(
            ts=phase.ts[::every_nth],
            # Times lie before the one axis of runs.
            states=jax.tree.map(lambda x: x[..., ::every_nth, :], phase.states),
        )
        for phase in result.phases
    ]
    return result._replace(phases=phases)
