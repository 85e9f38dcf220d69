"""Runs of a system or of a mission, in the layout of the physics: one run or many, runs last.

`simulate` has no axis of runs; `simulate_batch` and the campaigns of `dispersion` have one.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from ..core import AbstractSystem, Scalar, State, safe_divide
from ..integration._config import IntegrationConfig
from ..integration._event_search import first_event, happened_together
from ..integration._events import Event, newton_correct
from ..integration._integrate import (
    DenseOutput,
    IntegrationResult,
    broadcast_state,
    integrate,
    state_at,
)
from ..integration._status import Status, combine_status
from ._checks import check_events
from ._mission import Mission, Phase


class RunResult(NamedTuple):
    """What one run, or a batch of them, leaves: the fields of a `Trajectory`, and the recorded
    ends of the steps in normalised time."""

    ts: Float[Array, "times *#runs"]
    states: State
    status: Int[Array, "*runs"]
    event: Int[Array, "*runs"]
    happened: Bool[Array, "events *#runs"]
    stats: dict[str, Array]
    dense: DenseOutput | None
    step_ends: Float[Array, " steps"] | None


class MissionResult(NamedTuple):
    """What a mission leaves.

    - `phases`: of each phase, up to and including its end before the jump.
    - `final`, `end`: the state after the last jump, and its time, s.
    - `status`: of each run: its first failure, or how its last phase ended."""

    phases: list[RunResult]
    final: State
    end: Float[Array, "*runs"]
    status: Int[Array, "*runs"]


def _runs_of(y: State, run_axes: int) -> tuple[int, ...]:
    leaf = jax.tree.leaves(y)[0]
    return leaf.shape[leaf.ndim - run_axes :]


def _with_start(y0: State, states: State, run_axes: int) -> State:
    """The state `y0` and then the `states`, along the axis of times."""

    def leaf(a: Array, b: Array) -> Array:
        axis = a.ndim - run_axes
        return jnp.concatenate([jnp.expand_dims(a, axis), b], axis=axis)

    return jax.tree.map(leaf, y0, states)


def _replace_state(states: State, index: int, y: State, run_axes: int) -> State:
    """The states with that at one of the times replaced."""

    def leaf(xs: Array, x: Array) -> Array:
        return xs.at[(..., index, *(slice(None),) * run_axes)].set(x)

    return jax.tree.map(leaf, states, y)


def integrate_through_times(
    system: AbstractSystem, y0: State, times: Array, config: IntegrationConfig, run_axes: int
) -> IntegrationResult:
    """States at `times`, (times, *runs), which differ between runs: interval by interval."""

    def interval(
        carry: tuple[State, Array], ends: tuple[Array, Array]
    ) -> tuple[tuple[State, Array], tuple[State, dict[str, Array]]]:
        y, status = carry
        result = integrate(system, y, *ends, None, config, run_axes)
        y = state_at(result.states, -1, run_axes)
        return (y, combine_status(status, result.status)), (y, result.stats)

    start = (y0, jnp.zeros(_runs_of(y0, run_axes), jnp.int32))
    (_, status), (states, stats) = jax.lax.scan(interval, start, (times[:-1], times[1:]))
    states = jax.tree.map(lambda x: jnp.moveaxis(x, 0, x.ndim - 1 - run_axes), states)
    total = {
        name: jnp.max(x, axis=0) if name == "largest_local_error" else jnp.sum(x, axis=0)
        for name, x in stats.items()
    }
    states = _with_start(y0, states, run_axes)
    return IntegrationResult(states, status, total, None, None)


def _at_times(
    system: AbstractSystem,
    y0: State,
    ts: Array,
    config: IntegrationConfig,
    run_axes: int,
    dense: bool,
) -> IntegrationResult:
    """States at `ts`, (times,) or (times, *runs), the first of which is that of `y0`."""
    if ts.ndim > 1 and ts.shape[0] > 2:
        return integrate_through_times(system, y0, ts, config, run_axes)
    if ts.shape[0] == 2:
        result = integrate(system, y0, ts[0], ts[1], None, config, run_axes, dense=dense)
        return result._replace(states=_with_start(y0, result.states, run_axes))
    fractions = safe_divide(ts - ts[0], ts[-1] - ts[0])
    result = integrate(system, y0, ts[0], ts[-1], fractions, config, run_axes, dense=dense)
    # The state at the first time is the initial one to the last bit.
    return result._replace(states=_replace_state(result.states, 0, y0, run_axes))


def run_system(
    system: AbstractSystem,
    y0: State,
    ts: Array,
    events: tuple[Event, ...],
    config: IntegrationConfig,
    run_axes: int,
    dense: bool = False,
) -> RunResult:
    """One system from `y0` through `ts`, (times,) or (times, *runs), or to its first event.

    From the event on, states and times are those of the event."""
    y0 = broadcast_state(system, ts[0], y0)
    runs = _runs_of(y0, run_axes)
    if not events:
        result = _at_times(system, y0, ts, config, run_axes, dense)
        none = -jnp.ones(runs, jnp.int32)
        ts = jnp.broadcast_to(_with_runs(ts, runs), (ts.shape[0], *runs))
        happened = jnp.zeros((0, *runs), bool)
        return RunResult(
            ts, result.states, result.status, none, happened, result.stats, result.dense, None
        )
    # Each run may stop at a time of its own.
    asked = jnp.broadcast_to(_with_runs(ts, runs), (ts.shape[0], *runs))
    found = first_event(system, y0, asked[0], asked[-1], events, config, run_axes)
    when, which = found.time, found.which
    sign = jnp.where(asked[-1] < asked[0], -1.0, 1.0).astype(when.dtype)
    ts = sign * jnp.minimum(sign * asked, sign * when)
    # Run again to the events alone: each run lands on its own, as accurate as its steps.
    result = _at_times(system, y0, ts, config, run_axes, dense)
    last = state_at(result.states, -1, run_axes)
    t_event, y_event = newton_correct(system, events, which, ts[-1], last)
    stopped = (which >= 0) & (sign * asked >= sign * when)
    ts = jnp.where(stopped, t_event, ts)

    def leaf(xs: Array, x: Array) -> Array:
        flags = stopped.reshape(*(1,) * (xs.ndim - stopped.ndim), *stopped.shape)
        return jnp.where(flags, jnp.expand_dims(x, x.ndim - run_axes), xs)

    states = jax.tree.map(leaf, result.states, y_event)
    status = combine_status(result.status, found.status)
    happened = (which >= 0) & (status == Status.COMPLETED)
    status = jnp.where(happened, Status.EVENT, status)
    together = happened_together(system, events, found, asked[0], t_event, y_event, run_axes)
    return RunResult(ts, states, status, which, together, result.stats, result.dense, None)


def _with_runs(ts: Array, runs: tuple[int, ...]) -> Array:
    """Times with axes of length one for the runs that they do not differ in."""
    missing = (1,) * (len(runs) - ts.ndim + 1)
    return ts.reshape(ts.shape[0], *missing, *ts.shape[1:])


@eqx.filter_jit
def _run_phase(
    system: AbstractSystem,
    until: Scalar | Event,
    y0: State,
    t0: Scalar,
    num_saved: int,
    config: IntegrationConfig,
    run_axes: int,
    plan: Array | None,
    record_steps: bool,
) -> RunResult:
    """A phase without its name and its jump, so that equal phases are compiled once."""
    y0 = broadcast_state(system, t0, y0)
    runs = _runs_of(y0, run_axes)
    dtype = jnp.result_type(*jax.tree.leaves(y0))
    t0 = jnp.broadcast_to(jnp.asarray(t0, dtype), runs)
    t1 = t0 + (until.within if isinstance(until, Event) else until)
    which = -jnp.ones(runs, jnp.int32)
    happened = jnp.zeros((0, *runs), bool)
    found = None
    if isinstance(until, Event):
        check_events((until,), system, y0, t0, run_axes, "Phase.until")
        found = first_event(system, y0, t0, t1, (until,), config, run_axes)
        t1, which = found.time, found.which
    fractions = jnp.linspace(0.0, 1.0, num_saved, dtype=dtype)
    result = integrate(
        system,
        y0,
        t0,
        t1,
        fractions if num_saved > 2 else None,
        config,
        run_axes,
        plan=plan,
        record_steps=record_steps,
    )
    states = result.states
    if num_saved == 2:
        states = _with_start(y0, states, run_axes)
    ts = t0 + jnp.multiply.outer(fractions, t1 - t0)
    status = result.status
    if found is not None:
        assert isinstance(until, Event)
        last = state_at(states, -1, run_axes)
        t_event, y_event = newton_correct(system, (until,), which, t1, last)
        happened = (which >= 0)[None]
        ts = ts.at[-1].set(t_event)
        states = _replace_state(states, -1, y_event, run_axes)
        ended = jnp.where(which >= 0, Status.EVENT, Status.EVENT_MISSED)
        status = combine_status(status, found.status)
        status = jnp.where(status == Status.COMPLETED, ended, status)
    return RunResult(ts, states, status, which, happened, result.stats, None, result.step_ends)


@eqx.filter_jit
def _jump(phase: Phase, t: Scalar, y: State) -> State:
    assert phase.then is not None
    return phase.then(t, y)


def after_jump(phase: Phase, t: Scalar, y: State) -> State:
    """The state after the jump at the end of a phase."""
    return y if phase.then is None else _jump(phase, t, y)


def run_mission(
    mission: Mission,
    y0: State,
    t0: Scalar,
    num_saved: int,
    configs: tuple[IntegrationConfig, ...],
    run_axes: int,
    plans: tuple[Array | None, ...] | None = None,
    record_steps: bool = False,
) -> MissionResult:
    """All phases of a mission.

    **Arguments**

    - `mission`, `y0`, `t0`: what runs, its initial state and the time of its start, s.
    - `num_saved`: how many states each phase saves from its start to its end.
    - `configs`: one for each phase, from `resolve_phases`.
    - `plans`: fixed steps for each phase, as nodes in normalised time.
    - `record_steps`: whether to return the ends of the steps."""
    results = []
    y, t, status = y0, t0, None
    for number, (phase, config) in enumerate(zip(mission.phases, configs, strict=True)):
        plan = None if plans is None else plans[number]
        result = _run_phase(
            phase.system, phase.until, y, t, num_saved, config, run_axes, plan, record_steps
        )
        results.append(result)
        status = result.status if status is None else combine_status(status, result.status)
        t = result.ts[-1]
        y = after_jump(phase, t, state_at(result.states, -1, run_axes))
    assert status is not None
    return MissionResult(results, y, t, status)


def refine_plan(plan: ArrayLike, factor: float) -> np.ndarray:
    """A plan with about `factor` times as many steps in every segment, distributed alike."""
    plan = np.asarray(plan)
    pieces = [plan[:1]]
    for k in range(round(plan[-1])):
        nodes = plan[(plan >= k) & (plan <= k + 1)]
        count = int(np.ceil(factor * (len(nodes) - 1)))
        places = np.linspace(0.0, len(nodes) - 1.0, count + 1)[1:]
        piece = np.interp(places, np.arange(len(nodes)), nodes)
        # A step has to land on the end of the segment to the last bit.
        piece[-1] = k + 1.0
        pieces.append(piece)
    return np.concatenate(pieces)
