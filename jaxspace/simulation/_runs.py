"""Runs of a system, in the layout of the physics: one run or many, runs last.

`simulate` has no axis of runs; `simulate_batch` and the campaigns of `dispersion` have one.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..core import AbstractSystem, State, safe_divide
from ..integration._config import IntegrationConfig
from ..integration._event_search import first_event, happened_together
from ..integration._events import Event, newton_correct
from ..integration._integrate import integrate
from ..integration._layout import (
    broadcast_state,
    replace_state,
    runs_of,
    state_at,
    times_behind_components,
    with_start,
)
from ..integration._result import DenseOutput, IntegrationResult
from ..integration._status import Status, combine_status


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

    start = (y0, jnp.zeros(runs_of(y0, run_axes), jnp.int32))
    # By a scan, so that the integration is traced and compiled once for all intervals.
    (_, status), (states, stats) = jax.lax.scan(interval, start, (times[:-1], times[1:]))
    total = {
        name: jnp.max(x, axis=0) if name == "largest_local_error" else jnp.sum(x, axis=0)
        for name, x in stats.items()
    }
    states = with_start(y0, times_behind_components(states, run_axes), run_axes)
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
        return result._replace(states=with_start(y0, result.states, run_axes))
    fractions = safe_divide(ts - ts[0], ts[-1] - ts[0])
    result = integrate(system, y0, ts[0], ts[-1], fractions, config, run_axes, dense=dense)
    # The state at the first time is the initial one to the last bit.
    return result._replace(states=replace_state(result.states, 0, y0, run_axes))


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
    runs = runs_of(y0, run_axes)
    asked = jnp.broadcast_to(_with_runs(ts, runs), (ts.shape[0], *runs))
    if not events:
        result = _at_times(system, y0, ts, config, run_axes, dense)
        which = -jnp.ones(runs, jnp.int32)
        happened = jnp.zeros((0, *runs), bool)
        return RunResult(
            asked, result.states, result.status, which, happened, result.stats, result.dense, None
        )
    found = first_event(system, y0, asked[0], asked[-1], events, config, run_axes)
    when, which = found.time, found.which
    # Each run may stop at a time of its own.
    sign = jnp.where(asked[-1] < asked[0], -1.0, 1.0).astype(when.dtype)
    ts = sign * jnp.minimum(sign * asked, sign * when)
    # Run again to the events alone: each run lands on its own, as accurate as its steps.
    result = _at_times(system, y0, ts, config, run_axes, dense)
    last = state_at(result.states, -1, run_axes)
    t_event, y_event = newton_correct(system, events, which, ts[-1], last)
    stopped = (which >= 0) & (sign * asked >= sign * when)
    ts = jnp.where(stopped, t_event, ts)
    states = _where_stopped(stopped, y_event, result.states, run_axes)
    status = combine_status(result.status, found.status)
    happened = (which >= 0) & (status == Status.COMPLETED)
    status = jnp.where(happened, Status.EVENT, status)
    together = happened_together(system, events, found, asked[0], t_event, y_event, run_axes)
    return RunResult(ts, states, status, which, together, result.stats, result.dense, None)


def _where_stopped(stopped: Array, y: State, states: State, run_axes: int) -> State:
    """The states, with `y` at the times, (times, *runs), at which a run has `stopped`."""

    def leaf(xs: Array, x: Array) -> Array:
        flags = stopped.reshape(*(1,) * (xs.ndim - stopped.ndim), *stopped.shape)
        return jnp.where(flags, jnp.expand_dims(x, x.ndim - run_axes), xs)

    return jax.tree.map(leaf, states, y)


def _with_runs(ts: Array, runs: tuple[int, ...]) -> Array:
    """Times with axes of length one for the runs that they do not differ in."""
    missing = (1,) * (len(runs) - ts.ndim + 1)
    return ts.reshape(ts.shape[0], *missing, *ts.shape[1:])
