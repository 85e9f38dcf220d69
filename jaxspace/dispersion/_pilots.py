"""The pilots of a campaign: runs with adaptive steps, whose steps become the plans of all runs."""

import dataclasses
import functools
from collections.abc import Callable, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PyTree

from ..core.tables import breaks_of
from ..integration.accuracy import Accuracy
from ..integration.compiling import QUICK
from ..integration.config import IntegrationConfig
from ..integration.programs import Runs, is_small
from ..integration.status import SimulationError, Status
from ..simulation import Mission, Phase
from ..simulation.legs import legs_of
from ..simulation.mission_result import MissionTrajectory
from ..simulation.mission_runs import run_mission
from ..simulation.phase_runs import OwnTimes, SaveTimes, ends_on_the_way
from ..simulation.phases import resolve_and_count, resolve_phases
from ..simulation.runnable import AbstractRunnable
from ._campaign import Campaign
from ._exact_parts import for_turns
from ._isolation import isolate
from ._outputs import PilotRuns
from ._plans import nodes_of
from ._program import Drawn
from ._saved_states import StatesToStore, saved_of

# Number of pilots besides the nominal run.
PILOTS = 15
# The pilots share steps as short as the strictest of them needs: together they may take this many
# times the steps of a single run; the factors are tried one after the other.
ROOM = (1, 4, 16, 64)


class StepsForTurns(Exception):
    """The nominal run exceeds the limit of steps, and its motion has an exact part."""


@eqx.filter_jit(**QUICK)
def _pilots(
    campaign: Campaign,
    accuracy: Accuracy,
    drawn: dict[str, Float[Array, " runs"]],
    kept: StatesToStore,
) -> tuple[list[Array | None], PilotRuns]:
    """Adaptive runs of the pilots, the nominal one first and then the first runs of those drawn.

    **Returns** the ends of the steps of every phase (`None` where it follows no plan), and the runs
    themselves."""
    nominal = campaign.nominal()
    samples = {name: jnp.concatenate([x, drawn[name][:PILOTS]]) for name, x in nominal.items()}
    mission, y0 = campaign.mission(samples)
    configs = tuple(c.small_program() for c in resolve_phases(mission, y0, accuracy, 1))
    every = _saved(campaign, kept, len(configs))
    # If the runs differ in their breaks or save times, steps also end at save times, which the plan
    # must contain.
    every_phase = [leg.phase for leg in legs_of(mission)[0]]
    pairs = zip(every_phase, every, strict=True)
    saved = [n if isinstance(n, OwnTimes) or _breaks_differ(phase) else 2 for phase, n in pairs]
    record = _planned(mission, configs, every)
    result = run_mission(mission, y0, campaign.start, saved, configs, 1, record_steps=record)
    return [run.step_ends for run in result.phases], PilotRuns(_as_run(result), samples)


def _saved(campaign: Campaign, kept: StatesToStore, phases: int) -> list[SaveTimes]:
    """What the runs of the campaign save of each phase."""
    saved = saved_of(campaign.along, kept)
    return [saved] * phases if isinstance(saved, int) else saved


def _planned(
    mission: Mission, configs: Sequence[IntegrationConfig], saved: Sequence[SaveTimes]
) -> list[bool]:
    """Which phases follow a plan of steps, and need the pilots' ones: not a closed form, and none
    of a mission with a phase whose steps are searched for its end.

    Every run takes its own steps in such a phase anyway, and a mission of which no phase follows a
    plan needs no pilots: their program would be compiled for the rest."""
    triples = list(zip(legs_of(mission)[0], saved, configs, strict=True))
    if any(ends_on_the_way(leg.phase, n, config) for leg, n, config in triples):
        return [False] * len(triples)
    return [config.method != "closed_form" for config in configs]


@eqx.filter_jit(**QUICK)
def _alone(campaign: Campaign, accuracy: Accuracy) -> Array:
    """The status of the nominal run when it is computed alone."""
    mission, y0 = campaign.build(campaign.nominal())
    configs = tuple(c.small_program() for c in resolve_phases(mission, y0, accuracy, 1))
    return run_mission(mission, y0, campaign.start, 2, configs, 1).status


def _ends_alone(campaign: Campaign, accuracy: Accuracy) -> bool:
    return Status(int(np.ravel(_alone(campaign, accuracy))[0])) != Status.MAX_STEPS


def _as_run(result: MissionTrajectory) -> MissionTrajectory:
    """The result as all runs of the campaign have it."""
    phases = tuple(dataclasses.replace(run, step_ends=None) for run in result.phases)
    return dataclasses.replace(result, phases=phases)


def _breaks_differ(phase: Phase) -> bool:
    """Whether the times at which the vector field jumps differ between runs."""
    if isinstance(phase.system, AbstractRunnable):
        return False
    breaks = breaks_of(phase.system)
    # What counts from the start of the phase jumps with it, and each run may start at its own time.
    return breaks is not None and (breaks.ndim > 1 or phase.counts_from_start)


def expected_steps(
    campaign: Campaign, accuracy: Accuracy, kept: StatesToStore, block: int, runs: int
) -> tuple[list[PyTree], bool]:
    """Shape and type of the number that records each phase's steps, `None` for one without a plan;
    and whether the steps of this many planned `runs` are a small program.

    They follow from the methods alone, because tracing the pilot runs takes much longer. `block`:
    runs in a block, whose program then finds its vector fields traced."""

    def steps(campaign: Campaign, accuracy: Accuracy) -> tuple[list[Array | None], bool]:
        mission, y0 = campaign.mission(campaign.nominal(block))
        configs, operations = resolve_and_count(mission, y0, accuracy, 1)
        planned = _planned(mission, configs, _saved(campaign, kept, len(configs)))
        ends = [campaign.start if follows else None for follows in planned]
        return ends, is_small(Runs.CAMPAIGN, operations, runs)

    return eqx.filter_eval_shape(steps, campaign, accuracy)


def check_nominal(campaign: Campaign, accuracy: Accuracy, status: int) -> None:
    """Raise `SimulationError` for a nominal run that failed with this status, and `StepsForTurns`
    where it could be run with the exact part of its motion beside the steps."""
    if for_turns(campaign, accuracy, status) is not None:
        raise StepsForTurns
    # A missed tolerance is no failure here, because the runs are checked on finer plans.
    if status in (Status.NOT_FINITE, Status.MAX_STEPS):
        raise SimulationError(f"The nominal run cannot be run. {Status(status).sentence}")


def pilot_plans(
    campaign: Campaign,
    accuracy: Accuracy,
    draw: Callable[[np.ndarray], Drawn],
    runs: int,
    kept: StatesToStore,
) -> tuple[list[np.ndarray | None], PilotRuns]:
    """The nodes at which the steps of the pilots ended, phase by phase; and the pilots.

    `draw(used)` are the inputs of the first `runs` runs. **Raises** as `check_nominal`."""

    def simulating(used: np.ndarray, room: int) -> tuple[list[np.ndarray | None], PilotRuns]:
        drawn = draw(np.pad(used, (0, runs - PILOTS)))
        roomy = dataclasses.replace(accuracy, max_steps=room * accuracy.max_steps)
        result = _pilots(campaign, roomy, drawn.used, kept)
        return jax.tree.map(lambda x: np.asarray(x) if eqx.is_array(x) else x, result)

    for room in ROOM:
        taken, used = isolate(functools.partial(simulating, room=room), PILOTS)
        nominal = int(np.ravel(used.result.status)[0])
        # The status of the nominal run is that of `simulate_mission`, which runs it alone.
        if nominal != Status.MAX_STEPS or not _ends_alone(campaign, accuracy):
            break
    check_nominal(campaign, accuracy, nominal)
    return [None if ends is None else nodes_of(np.asarray(ends)) for ends in taken], used
