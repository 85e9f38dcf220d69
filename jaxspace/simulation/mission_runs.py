"""Runs of a mission: one phase after the other, in the layout of the physics, runs last."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeAlias, final

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..core import AbstractSystem, Scalar, State
from ..core.jit import quick_jit
from ..core.safe import safe_divide
from ..integration.config import IntegrationConfig
from ..integration.event_search import FoundEvents, first_event
from ..integration.events import Event, closures_of_events, newton_correct
from ..integration.integrate import integrate, locates_events, of_each, searches_steps
from ..integration.layout import broadcast_state, replace_state, runs_of, state_at, with_start
from ..integration.result import IntegrationResult
from ..integration.status import Status, combine_status
from ._alike_phases import alike_legs, run_alike
from ._mission import Mission, Phase
from ._runs import straight_to_event
from .checks import check_events
from .legs import Leg, legs_of
from .mission_result import BranchEnd, MissionResult, status_of_all
from .run_result import RunResult
from .runnable import AbstractRunnable


class OwnTimes(NamedTuple):
    """Save times of a phase that starts or ends at different times in different runs.

    - `times`: of the mission, s, (chosen,); a time outside of the phase of a run becomes the nearer
      end of the phase.
    - `along`: number of further states, evenly spaced from its start to its end."""

    times: Float[Array, " chosen"]
    along: int

    def fractions(self, t0: Float[Array, "*runs"], t1: Float[Array, "*runs"]) -> Array:
        """Fractions of the phase at which each run saves, (chosen + along, *runs).

        The phase of a run lasts from `t0` to `t1`, s."""
        times = self.times.astype(t0.dtype).reshape(-1, *(1,) * t0.ndim)
        x = safe_divide(times - t0, t1 - t0)
        # NaN becomes zero, because the end of a failed run must not change the steps of the others.
        shares = jnp.where(x > 0.0, jnp.minimum(x, 1.0), 0.0)
        even = jnp.linspace(0.0, 1.0, self.along, dtype=t0.dtype).reshape(-1, *(1,) * t0.ndim)
        return jnp.concatenate([shares, jnp.broadcast_to(even, (self.along, *t0.shape))])


# The axis of times has no name, because each phase has its own number of them.
SaveTimes: TypeAlias = int | Float[Array, " _"] | OwnTimes
"""Save times of a phase: a number of states, evenly from its start to its end; or fractions of its
duration, from 0 to 1; or times of the mission."""


def ends_on_the_way(phase: Phase, num_saved: SaveTimes, config: IntegrationConfig) -> bool:
    """Whether one integration of a phase locates the event that ends it: where no states are saved
    at times that depend on the event. It does not take planned steps."""
    ends_alone = isinstance(num_saved, int) and num_saved == 2
    event = isinstance(phase.until, Event) and not isinstance(phase.system, AbstractRunnable)
    return event and ends_alone and searches_steps(config)


def _up_to_jump(
    system: AbstractSystem,
    until: Scalar | Event,
    y0: State,
    t0: Scalar,
    num_saved: SaveTimes,
    config: IntegrationConfig,
    run_axes: int,
    plan: Array | None,
    record_steps: bool,
) -> RunResult:
    """A phase up to its end, before the jump."""
    if run_axes:
        y0 = broadcast_state(system, t0, y0)
    runs = runs_of(y0, run_axes)
    dtype = jnp.result_type(*jax.tree.leaves(y0))
    # Each run may start, and meet its event, at another time.
    t0 = jnp.broadcast_to(jnp.asarray(t0, dtype), runs)
    t1 = t0 + (until.within if isinstance(until, Event) else until)
    if isinstance(until, Event):
        check_events((until,), system, y0, t0, run_axes, "Phase.until")
        (until,) = closures_of_events((until,), t0, y0)
        if plan is None and not record_steps and locates_events(config, system, y0, t0):
            if isinstance(num_saved, int) and num_saved == 2:
                times = jnp.stack([t0, t1])
                run = straight_to_event(system, y0, times, (until,), config, run_axes)
                missed = run.status == Status.COMPLETED
                return run._replace(status=jnp.where(missed, Status.EVENT_MISSED, run.status))
            # A batch would hold all of its states twice.
            if isinstance(num_saved, int) and not run_axes:
                return _sampled_to_event(system, y0, t0, t1, until, num_saved, config)
    given = num_saved, config, run_axes, plan, record_steps
    if isinstance(until, Event):
        return _search_and_run(system, y0, t0, t1, until, *given)
    return _saved(system, y0, t0, t1, *given)


def _saved(
    system: AbstractSystem,
    y0: State,
    t0: Scalar,
    t1: Scalar,
    num_saved: SaveTimes,
    config: IntegrationConfig,
    run_axes: int,
    plan: Array | None,
    record_steps: bool,
) -> RunResult:
    """A phase from `t0` to `t1`, with its saved states."""
    if isinstance(num_saved, int):
        fractions = jnp.linspace(0.0, 1.0, num_saved, dtype=t0.dtype)
    elif isinstance(num_saved, OwnTimes):
        fractions = num_saved.fractions(t0, t1)
    else:
        fractions = num_saved.astype(t0.dtype)
    ends_alone = fractions.shape[0] == 2
    result = integrate(
        system,
        y0,
        t0,
        t1,
        # Start and end alone need no save times within a step, which would cost evaluations.
        None if ends_alone else fractions,
        config,
        run_axes,
        plan=plan,
        record_steps=record_steps,
    )
    # Only runs of a system store their steps: `dense` is no argument of a mission.
    return RunResult(
        ts=t0 + of_each(fractions, t1 - t0),
        states=with_start(y0, result.states, run_axes) if ends_alone else result.states,
        status=result.status,
        event=-jnp.ones(runs_of(y0, run_axes), jnp.int32),
        happened=jnp.zeros((0, *runs_of(y0, run_axes)), bool),
        stats=result.stats,
        dense=None,
        step_ends=result.step_ends,
    )


def _search_and_run(
    system: AbstractSystem,
    y0: State,
    t0: Scalar,
    t1: Scalar,
    event: Event,
    num_saved: SaveTimes,
    config: IntegrationConfig,
    run_axes: int,
    plan: Array | None = None,
    record_steps: bool = False,
) -> RunResult:
    """A phase up to an event, whose search is one integration, and whose states are another."""
    found = first_event(system, y0, t0, t1, (event,), config, run_axes)
    given = num_saved, config, run_axes, plan, record_steps
    phase = _saved(system, y0, t0, found.time, *given)
    last = found.met(state_at(phase.states, -1, run_axes))
    t_event, y_event = newton_correct(system, (event,), found.which, found.time, last)
    # The derivatives of the end are those of the correction, and not of the search.
    return _ended_by(found, phase, t_event, y_event, run_axes)


@final
class _Ahead(eqx.Module):
    """The condition of an event while it is `sought`; otherwise seconds since `start`, and one
    more, which are never zero, nor at rest."""

    condition: Callable[[Scalar, State], Scalar]
    sought: Bool[Array, ""]
    start: Scalar

    def __call__(self, t: Scalar, y: State) -> Scalar:
        return jnp.where(self.sought, self.condition(t, y), 1.0 + (t - self.start))


@eqx.filter_custom_jvp
def _sampled_to_event(
    system: AbstractSystem,
    y0: State,
    t0: Scalar,
    t1: Scalar,
    event: Event,
    num_saved: int,
    config: IntegrationConfig,
) -> RunResult:
    """`_search_and_run` of one run by half of the program: a loop over two integrations, of which
    the first one locates the event, and the other one saves the states up to it.

    Only for a method that `locates_events`."""
    fractions = jnp.linspace(0.0, 1.0, num_saved, dtype=t0.dtype)

    def once(end: Scalar, sought: Array) -> tuple[Scalar, IntegrationResult]:
        condition = _Ahead(event.condition, sought, t0)
        until = (eqx.tree_at(lambda e: e.condition, event, condition),)
        result = integrate(system, y0, t0, end, fractions, config, 0, until=until)
        assert result.found is not None
        return result.found.time, result

    _, both = jax.lax.scan(once, t1, jnp.array([True, False]))
    found = jax.tree.map(lambda x: x[0], both.found)
    result = jax.tree.map(lambda x: x[1], both)
    phase = RunResult(
        ts=t0 + fractions * (found.time - t0),
        states=replace_state(result.states, 0, y0, 0),
        status=result.status,
        event=found.which,
        happened=jnp.zeros((0,), bool),
        stats=result.stats,
        dense=None,
        step_ends=None,
    )
    return _ended_by(found, phase, found.time, found.met(state_at(phase.states, -1, 0)), 0)


@_sampled_to_event.def_jvp
def _sampled_to_event_jvp(primals: tuple, tangents: tuple) -> tuple[RunResult, RunResult]:
    def searched_first(*given: Any) -> RunResult:
        return _search_and_run(*given, run_axes=0)

    return eqx.filter_jvp(searched_first, primals, tangents)


def _ended_by(
    found: FoundEvents, phase: RunResult, time: Scalar, state: State, run_axes: int
) -> RunResult:
    """The phase with its end at the `time` and the `state` of the event, and with the status of
    the search."""
    hit = found.which >= 0
    ended = jnp.where(hit, Status.EVENT, Status.EVENT_MISSED)
    status = combine_status(phase.status, found.status)
    return phase._replace(
        ts=phase.ts.at[-1].set(time),
        states=replace_state(phase.states, -1, state, run_axes),
        status=jnp.where(status == Status.COMPLETED, ended, status),
        event=found.which,
        happened=hit[None],
    )


# Compiled, because outside of `jit` each operation would be called separately.
@eqx.filter_jit
def _left_by(
    then: Callable[[Scalar, State], State] | None, run: RunResult, run_axes: int
) -> tuple[Scalar, State]:
    """Time and state after the jump at the end of a phase."""
    # One time for each run, because an event ends the phase of every run at another time.
    t = run.ts[-1]
    y = state_at(run.states, -1, run_axes)
    return t, y if then is None else then(t, y)


@quick_jit
def _run_phase(
    system: AbstractSystem,
    until: Scalar | Event,
    then: Callable[[Scalar, State], State] | None,
    y0: State,
    t0: Scalar,
    num_saved: SaveTimes,
    config: IntegrationConfig,
    run_axes: int,
    plan: Array | None,
    record_steps: bool,
) -> tuple[RunResult, Scalar, State]:
    """A phase without its name, so that equal phases are compiled once; and the time and the state
    after its jump."""
    run = _up_to_jump(system, until, y0, t0, num_saved, config, run_axes, plan, record_steps)
    return run, *_left_by(then, run, run_axes)


def _groups(
    legs: Sequence[Leg],
    num_saved: int | Sequence[SaveTimes],
    configs: tuple[IntegrationConfig, ...],
    plans: tuple[Array | None, ...] | None,
) -> dict[int, list[int]]:
    """The phases that can share a program, by the first of each group."""
    saved = [num_saved] * len(legs) if isinstance(num_saved, int) else num_saved
    planned = [False] * len(legs) if plans is None else [plan is not None for plan in plans]
    plain = [
        isinstance(n, int) and n == 2 and not follows and searches_steps(config)
        for n, follows, config in zip(saved, planned, configs, strict=True)
    ]
    groups = alike_legs(legs, configs, plain)
    return {group[0]: group for group in groups if len(group) > 1}


def run_mission(
    mission: Mission,
    y0: State,
    t0: Scalar,
    # Each phase has its own number of times.
    num_saved: int | Sequence[SaveTimes],
    configs: tuple[IntegrationConfig, ...],
    run_axes: int,
    plans: tuple[Array | None, ...] | None = None,
    record_steps: bool | Sequence[bool] = False,
    *,
    rolled: bool = False,
) -> MissionResult:
    """All phases of a mission, and of its branches, in the order of `legs_of`.

    **Arguments**

    - `mission`, `y0`, `t0`: the mission, its initial state and the time of its start, s.
    - `num_saved`: number of states that each phase saves from its start to its end; or the
      `SaveTimes` of each phase.
    - `configs`: one for each phase, from `resolve_phases`.
    - `plans`: fixed steps for each phase, as nodes in normalised time.
    - `record_steps`: whether to return the ends of the steps, of all phases or of each.
    - `rolled`: whether phases that differ in their numbers alone share a program (`run_alike`),
      which compiles sooner and takes other steps."""
    legs, branch_names = legs_of(mission)
    groups: dict[int, list[int]] = {}
    if rolled:
        groups = _groups(legs, num_saved, configs, plans)
    alike: dict[int, RunResult] = {}
    results: list[RunResult] = []
    # Of each phase: time and state after its jump, and the status up to there.
    ends: list[BranchEnd] = []
    # Not a scan, because each phase has another system, and may have another kind of state.
    for number, (leg, config) in enumerate(zip(legs, configs, strict=True)):
        phase = leg.phase
        if leg.after is None:
            y = y0 if leg.start is None else leg.start(t0, y0)
            t = t0
            status = None
        else:
            y, t, status = ends[leg.after]
            if leg.parted:
                # A branch starts from the state of the whole, before the jump of the phase.
                t, y = _left_by(leg.start, results[leg.after], run_axes)
        plan = None if plans is None else plans[number]
        saved = num_saved if isinstance(num_saved, int) else num_saved[number]
        if number in groups:
            members = [legs[k].phase for k in groups[number]]
            together = run_alike(members, y, t, config, run_axes)
            alike |= zip(groups[number], together or (), strict=bool(together))
        if number in alike:
            result = alike[number]
            t, y = _left_by(phase.then, result, run_axes)
        elif isinstance(phase.system, AbstractRunnable):
            assert isinstance(saved, int)
            # A closed loop takes fixed steps between its samples, and no plan.
            result = phase.system.run(phase.until, y, t, saved, config, run_axes)
            t, y = _left_by(phase.then, result, run_axes)
        else:
            given = phase.system, phase.until, phase.then, y, t, saved
            record = record_steps if isinstance(record_steps, bool) else record_steps[number]
            result, t, y = _run_phase(*given, config, run_axes, plan, record)
        results.append(result)
        status = result.status if status is None else combine_status(status, result.status)
        ends.append(BranchEnd(y, t, status))
    # The last phase of each line: that of the mission itself, then those of its branches.
    last = {leg.line: end for leg, end in zip(legs, ends, strict=True)}
    own, *branches = (last[line] for line in range(len(last)))
    return MissionResult(
        results,
        tuple(leg.name for leg in legs),
        own.final,
        own.end,
        status_of_all(own.status, branches),
        tuple(branches),
        branch_names,
    )
