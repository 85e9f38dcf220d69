"""Runs of a system, in the layout of the physics: one run or many, runs last.

`simulate` has no batch axis; `simulate_batch` and the campaigns of `dispersion` have one.
"""

import dataclasses

import jax.numpy as jnp
from jaxtyping import Array

from ..core import AbstractSystem, State
from ..core.jit import quick_jit
from ..core.status import Status, combine_status, time_unresolved
from ..integration.config import IntegrationConfig
from ..integration.crossings import crossings_between
from ..integration.event_search import FirstEvent
from ..integration.events import Event, closures_of_events
from ..integration.integrate import locates_events
from ..integration.layout import broadcast_state, runs_of
from ._integrator import Integrator, of_each_run
from ._jumps import collected, jumps_between, states_between
from ._to_event import integrate_to_event, stopped_states, through_times_to_event
from .masking import known_crossings, mask_invalid, nan_unless, scaled
from .trajectory import Trajectory, without_events


def run_system(
    system: AbstractSystem,
    y0: State,
    ts: Array,
    events: tuple[Event, ...],
    config: IntegrationConfig,
    run_axes: int,
    dense: bool = False,
) -> Trajectory:
    """One system from `y0` through `ts`, (times,) or (times, *runs), or to its first event.

    From the event on, states and times are those of the event. Events that are not terminal are
    collected. States that a failed run did not reach are NaN."""
    if run_axes:
        # Shared states get an axis of runs first: the runs leave the common start at once.
        y0 = broadcast_state(system, ts[0], y0)
    result = _run_of_kind(Integrator(system, config, run_axes), y0, ts, events, dense)
    # Far from time zero a short run has no digits left in its times, whatever its steps did.
    lost = time_unresolved(ts[0], ts[-1] - ts[0], rounded=True)
    status = jnp.where(lost, Status.TIME_UNRESOLVED, result.status).astype(jnp.int32)
    return mask_invalid(dataclasses.replace(result, status=status))


# Compiled, because outside of `jit` each operation would be compiled and called separately.
run_one_system = quick_jit(run_system, has_loop=True)


def _run_of_kind(
    integrator: Integrator, y0: State, ts: Array, events: tuple[Event, ...], dense: bool
) -> Trajectory:
    """The run by the way that its events ask for."""
    if not events:
        return _through(integrator, y0, ts, events, dense)
    system, config, run_axes = integrator
    asked = of_each_run(ts, runs_of(y0, run_axes))
    events = closures_of_events(events, asked[0], y0)
    if any(event.then is not None for event in events):
        return _with_jumps(integrator, y0, asked, events)
    if any(event.terminal for event in events):
        # Events that are passed need samples of the whole run, and `dense` its steps: both come of
        # a run to the known end.
        straight = not dense and ts.ndim == 1 and all(event.terminal for event in events)
        if straight and locates_events(config, system, y0, asked[0]):
            return integrate_to_event(integrator, y0, ts, events)
        return _to_event(integrator, y0, asked, events, dense)
    return _through(integrator, y0, ts, events, dense)


def _through(
    integrator: Integrator, y0: State, ts: Array, events: tuple[Event, ...], dense: bool
) -> Trajectory:
    """A run through `ts`, (times,) or (times, *runs), with every zero of these events."""
    if not events:
        return without_events(ts, integrator.at_times(y0, ts, dense=dense), integrator.run_axes)
    system, config, run_axes = integrator
    # One run for all events: the finest of their samples is used for all.
    samples = max(event.samples for event in events)
    result, times, states = integrator.sampled(y0, ts, samples, dense=dense)
    run = without_events(ts, result, run_axes)
    found = []
    status = run.status
    for event in events:
        crossings = crossings_between(system, event, times, states, config, run_axes)
        found.append(known_crossings(crossings, combine_status(run.status, crossings.status)))
        status = combine_status(status, crossings.status)
    happened = jnp.zeros((len(events), *run.status.shape), bool)
    return dataclasses.replace(run, status=status, happened=happened, crossings=tuple(found))


def _to_event(
    integrator: Integrator, y0: State, asked: Array, events: tuple[Event, ...], dense: bool
) -> Trajectory:
    """A run to the first of its terminal events, through `asked`, (times, *runs)."""
    passed = tuple(event for event in events if not event.terminal)
    numbers = [number for number, event in enumerate(events) if event.terminal]
    ending = tuple(events[number] for number in numbers)

    def through(times: Array, found: FirstEvent) -> Trajectory:
        run = _through(integrator, y0, times, passed, dense)
        # Where the search failed, the run might have ended there.
        crossings = tuple(
            dataclasses.replace(
                each.until(asked[0], found.failed), status=combine_status(each.status, found.status)
            )
            for each in run.crossings
        )
        return dataclasses.replace(run, crossings=crossings)

    run = through_times_to_event(integrator, y0, asked, ending, through)
    # Numbers among all events, as the caller gave them.
    places = jnp.array(numbers)
    happened = jnp.zeros((len(events), *run.status.shape), bool).at[places].set(run.happened)
    event = jnp.where(run.event >= 0, places[run.event], -1).astype(jnp.int32)
    return dataclasses.replace(run, event=event, happened=happened)


def _with_jumps(
    integrator: Integrator, y0: State, asked: Array, events: tuple[Event, ...]
) -> Trajectory:
    """A run that continues after the jumps of its events, through `asked`, (times, *runs)."""
    run_axes = integrator.run_axes
    result = jumps_between(integrator, y0, asked[0], asked[-1], events)
    sign = jnp.where(asked[-1] < asked[0], -1.0, 1.0).astype(asked.dtype)
    stopped = (result.stopped_by >= 0) & (sign * asked >= sign * result.end)
    ts = jnp.where(stopped, result.end, asked)
    states, status, stats = states_between(integrator, y0, ts, result)
    states = stopped_states(stopped, result.final, states, run_axes)
    # A run that failed may have had further events after its last jump.
    known = (result.status <= Status.EVENT) | (sign * asked <= sign * result.end)
    states = scaled(states, nan_unless(known))
    hit = (result.stopped_by >= 0) & (status == Status.COMPLETED)
    status = jnp.where(hit, Status.EVENT, status)
    event = result.stopped_by.astype(jnp.int32)
    crossings = collected(result, events, run_axes)
    happened = result.happened
    return Trajectory(*(ts, states, status, event, happened, stats, run_axes), crossings=crossings)
