"""Runs of a mission: one phase after the other, in the layout of the physics, runs last."""

import functools
from collections.abc import Callable, Sequence

from jaxtyping import Array

from ..core import Scalar, State
from ..core.jit import quick_jit
from ..core.status import combine_status
from ..integration.config import IntegrationConfig
from ..integration.events import Event
from ..integration.layout import state_at
from ._integrator import Integrator
from ._mission import Mission, Phase
from ._phase_loop import loop_groups, run_in_loop
from .legs import Leg, legs_of
from .mission_result import BranchEnd, MissionTrajectory, status_of_all
from .phase_runs import SaveTimes, run_to_end
from .runnable import AbstractRunnable
from .trajectory import Trajectory


# Compiled, because outside of `jit` each operation would be called separately.
@quick_jit
def _left_by(
    then: Callable[[Scalar, State], State] | None, run: Trajectory, run_axes: int
) -> tuple[Scalar, State]:
    """Time and state after the jump at the end of a phase."""
    # One time for each run, because an event ends the phase of every run at another time.
    t = run.ts[-1]
    y = state_at(run.states, -1, run_axes)
    return t, y if then is None else then(t, y)


@functools.partial(quick_jit, has_loop=True)
def _run_phase(
    integrator: Integrator,
    until: Scalar | Event,
    then: Callable[[Scalar, State], State] | None,
    y0: State,
    t0: Scalar,
    num_saved: SaveTimes,
) -> tuple[Trajectory, Scalar, State]:
    """A phase without its name, so that equal phases are compiled once; and the time and the state
    after its jump."""
    run = run_to_end(integrator, until, y0, t0, num_saved)
    return run, *_left_by(then, run, integrator.run_axes)


def run_mission(
    mission: Mission,
    y0: State,
    t0: Scalar,
    # Each phase has its own number of times.
    num_saved: int | Sequence[SaveTimes],
    configs: tuple[IntegrationConfig, ...],
    run_axes: int,
    *,
    shared_program: bool = False,
) -> MissionTrajectory:
    """All phases of a mission, and of its branches, in the order of `legs_of`.

    **Arguments**

    - `mission`, `y0`, `t0`: the mission, its initial state and the time of its start, s.
    - `num_saved`: number of states that each phase saves from its start to its end; or the
      `SaveTimes` of each phase.
    - `configs`: one for each phase, from `resolve_phases`.
    - `shared_program`: whether phases that differ in their numbers only share a program
      (`run_in_loop`), which compiles faster and uses different steps."""
    legs, branch_names = legs_of(mission)
    saved = [num_saved] * len(legs) if isinstance(num_saved, int) else num_saved
    groups = loop_groups(legs, num_saved, configs) if shared_program else {}
    alike: dict[int, Trajectory] = {}
    results: list[Trajectory] = []
    # Of each phase: time and state after its jump, and the status up to there.
    ends: list[BranchEnd] = []
    # Not a scan, because each phase has another system, and may have another kind of state.
    for number, (leg, config) in enumerate(zip(legs, configs, strict=True)):
        t, y, status = _start_of(leg, y0, t0, results, ends, run_axes)
        if number in groups:
            members = [legs[k].phase for k in groups[number]]
            together = run_in_loop(members, y, t, config, run_axes)
            if together is not None:
                alike.update(zip(groups[number], together, strict=True))
        if number in alike:
            result = alike[number]
            t, y = _left_by(leg.phase.then, result, run_axes)
        else:
            result, t, y = _run_leg(leg.phase, y, t, saved[number], config, run_axes)
        results.append(result)
        status = result.status if status is None else combine_status(status, result.status)
        ends.append(BranchEnd(y, t, status))
    return _as_trajectory(legs, branch_names, results, ends)


def _as_trajectory(
    legs: Sequence[Leg],
    branch_names: tuple[str, ...],
    results: Sequence[Trajectory],
    ends: Sequence[BranchEnd],
) -> MissionTrajectory:
    """The result of a mission from those of its phases, and their ends after their jumps."""
    # The last phase of each line: that of the mission itself, then those of its branches.
    last = {leg.line: end for leg, end in zip(legs, ends, strict=True)}
    own, *branches = (last[line] for line in range(len(last)))
    return MissionTrajectory(
        tuple(results),
        tuple(leg.name for leg in legs),
        own.final,
        own.end,
        status_of_all(own.status, branches),
        tuple(branches),
        branch_names,
    )


def _start_of(
    leg: Leg,
    y0: State,
    t0: Scalar,
    results: Sequence[Trajectory],
    ends: Sequence[BranchEnd],
    run_axes: int,
) -> tuple[Scalar, State, Array | None]:
    """Time and state at which a phase starts, and the status up to there, `None` for the first one:
    from the `results` of the phases before it, and their `ends` after their jumps."""
    if leg.after is None:
        return t0, y0 if leg.start is None else leg.start(t0, y0), None
    y, t, status = ends[leg.after]
    if leg.parted:
        # A branch starts from the state of the whole, before the jump of the phase.
        t, y = _left_by(leg.start, results[leg.after], run_axes)
    return t, y, status


def _run_leg(
    phase: Phase,
    y0: State,
    t0: Scalar,
    saved: SaveTimes,
    config: IntegrationConfig,
    run_axes: int,
) -> tuple[Trajectory, Scalar, State]:
    """A phase of a system or of a closed loop, and the time and the state after its jump."""
    moving = phase.system.started_at(t0)
    if isinstance(moving, AbstractRunnable):
        assert isinstance(saved, int)
        # A closed loop takes fixed steps between its samples.
        result = moving.run(phase.until, y0, t0, saved, config, run_axes)
        return result, *_left_by(phase.then, result, run_axes)
    integrator = Integrator(moving, config, run_axes)
    return _run_phase(integrator, phase.until, phase.then, y0, t0, saved)
