"""Runs of a system, in the layout of the physics: one run or many, runs last.

`simulate` has no axis of runs; `simulate_batch` and the campaigns of `dispersion` have one.
"""

import dataclasses
from collections.abc import Callable
from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from ..core import AbstractSystem, Scalar, State
from ..core.barrier import barrier
from ..core.safe import safe_divide
from ..integration.config import IntegrationConfig
from ..integration.crossings import Crossings, crossings_between
from ..integration.events import Event, closures_of_events, newton_correct
from ..integration.integrate import locates_events
from ..integration.layout import broadcast_state, replace_state, runs_of, state_at, with_start
from ..integration.result import IntegrationResult
from ..integration.simultaneous import simultaneous_events
from ..integration.status import Status, combine_status, time_unresolved
from ._integrator import Integrator, of_each_run
from ._restarts import collected, restarts_between, states_between
from .reached import known_crossings, nan_unless, reached, scaled
from .trajectory import Trajectory


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
        y0 = broadcast_state(system, ts[0], y0)
    result = _run_of_kind(Integrator(system, config, run_axes), y0, ts, events, dense)
    lost = time_unresolved(ts[0], ts[-1] - ts[0], rounded=True)
    status = jnp.where(lost, Status.TIME_UNRESOLVED, result.status).astype(jnp.int32)
    return reached(dataclasses.replace(result, status=status))


def _run_of_kind(
    integrator: Integrator, y0: State, ts: Array, events: tuple[Event, ...], dense: bool
) -> Trajectory:
    """The run by the way that its events ask for."""
    system, config, run_axes = integrator
    runs = runs_of(y0, run_axes)
    asked = of_each_run(ts, runs)
    events = closures_of_events(events, asked[0], y0)
    if any(event.then is not None for event in events):
        return _with_restarts(integrator, y0, asked, events)
    if any(event.terminal for event in events):
        straight = not dense and ts.ndim == 1 and all(event.terminal for event in events)
        if straight and locates_events(config, system, y0, asked[0]):
            return straight_to_event(integrator, y0, ts, events)
        return _to_event(integrator, y0, asked, events, dense)
    if events:
        result, crossings = _with_crossings(integrator, y0, ts, events, dense)
    else:
        result = integrator.at_times(y0, ts, dense=dense)
        crossings = ()
    which = -jnp.ones(runs, jnp.int32)
    happened = jnp.zeros((len(events), *runs), bool)
    return Trajectory(
        *(asked, result.states, result.status, which, happened, result.stats, run_axes),
        dense=result.dense,
        crossings=crossings,
    )


def _with_crossings(
    integrator: Integrator, y0: State, ts: Array, events: tuple[Event, ...], dense: bool
) -> tuple[IntegrationResult, tuple[Crossings, ...]]:
    """`at_times`, with every zero of these events."""
    system, config, run_axes = integrator
    samples = max(event.samples for event in events)
    result, times, states = integrator.sampled(y0, ts, samples, dense=dense)
    found = []
    status = result.status
    for event in events:
        crossings = crossings_between(system, event, times, states, config, run_axes)
        ended = combine_status(result.status, crossings.status)
        found.append(known_crossings(crossings, ended))
        status = combine_status(status, crossings.status)
    return result._replace(status=status), tuple(found)


def _to_event(
    integrator: Integrator, y0: State, asked: Array, events: tuple[Event, ...], dense: bool
) -> Trajectory:
    """A run to the first of its terminal events, through `asked`, (times, *runs)."""
    system, _, run_axes = integrator
    passed = tuple(event for event in events if not event.terminal)
    numbers = [number for number, event in enumerate(events) if event.terminal]
    ending = tuple(events[number] for number in numbers)
    found = integrator.first_event(y0, asked[0], asked[-1], ending)
    # Outside of every derivative: `newton_correct` below carries the derivatives of the time.
    when, which = found.time, found.which
    # Each run may stop at another time; times descend in a run backwards.
    sign = jnp.where(asked[-1] < asked[0], -1.0, 1.0).astype(when.dtype)
    ts = sign * jnp.minimum(sign * asked, sign * when)
    # Integrated again to the events: each run lands on its event, with the accuracy of its steps.
    if passed:
        result, crossings = _with_crossings(integrator, y0, ts, passed, dense)
        # Where the search failed, the run might have ended there.
        crossings = tuple(
            dataclasses.replace(
                each.until(asked[0], found.failed), status=combine_status(each.status, found.status)
            )
            for each in crossings
        )
    else:
        result = integrator.at_times(y0, ts, dense=dense)
        crossings = ()
    last = state_at(result.states, -1, run_axes)
    at = which, ts[-1], found.met(last)
    t_event, y_event = newton_correct(system, ending, *at, located=found.state is not None)
    stopped = (which >= 0) & (sign * asked >= sign * when)
    ts = jnp.where(stopped, t_event, ts)
    states = _where_stopped(stopped, y_event, result.states, run_axes)
    status = combine_status(result.status, found.status)
    hit = (which >= 0) & (status == Status.COMPLETED)
    status = jnp.where(hit, Status.EVENT, status)
    places = (asked[0], y0), (t_event, y_event)
    together = simultaneous_events(system, ending, found, *places, run_axes).happened
    # Numbers among all events, as the caller gave them.
    happened = jnp.zeros((len(events), *which.shape), bool).at[jnp.array(numbers)].set(together)
    event = jnp.where(which >= 0, jnp.array(numbers)[which], -1).astype(jnp.int32)
    return Trajectory(
        *(ts, states, status, event, happened, result.stats, run_axes),
        dense=result.dense,
        crossings=crossings,
    )


@final
class SoughtCondition(eqx.Module):
    """The condition of an event while it is `sought`; otherwise seconds since `start`, and one
    more, which for a run forwards is never zero, nor at rest as at a touch.

    For a loop whose passes share a program, and of which some seek the event."""

    condition: Callable[[Scalar, State], Scalar]
    sought: Bool[Array, ""]
    start: Scalar

    def __call__(self, t: Scalar, y: State) -> Scalar:
        return jnp.where(self.sought, self.condition(t, y), 1.0 + (t - self.start))


@eqx.filter_custom_jvp
def straight_to_event(
    integrator: Integrator, y0: State, ts: Array, events: tuple[Event, ...]
) -> Trajectory:
    """A run to the first of its events, by one integration that locates it.

    Only for a method that `locates_events`. If states are saved on the way, its derivatives are
    those of a second integration, to the located time.

    **Arguments**

    - `ts`: save times, s, (times,); or start and end of each run, (2, *runs)."""
    return _straight_to_event(integrator, y0, ts, events)


def _straight_to_event(
    integrator: Integrator,
    y0: State,
    ts: Array,
    events: tuple[Event, ...],
    *,
    differentiated: bool = False,
) -> Trajectory:
    system, _, run_axes = integrator
    asked = of_each_run(ts, runs_of(y0, run_axes))
    ends_alone = ts.shape[0] == 2
    fractions = None if ends_alone else safe_divide(ts - ts[0], ts[-1] - ts[0])
    result = integrator.run(y0, ts[0], ts[-1], fractions, until=events)
    found = result.found
    assert found is not None
    if differentiated:
        last = state_at(result.states, -1, run_axes)
        at = found.which, found.time, last
        time, state = newton_correct(system, events, *at, located=True)
        found = found._replace(time=time, state=state)
    states = result.states if ends_alone else replace_state(result.states, 0, y0, run_axes)
    sign = jnp.where(asked[-1] < asked[0], -1.0, 1.0).astype(ts.dtype)
    stopped = (found.which >= 0) & (sign * asked >= sign * found.time)
    status = combine_status(result.status, found.status)
    hit = (found.which >= 0) & (status == Status.COMPLETED)
    if len(events) == 1:
        happened = (found.which >= 0)[None]
    else:
        places = (asked[0], y0), (found.time, found.state)
        happened = simultaneous_events(system, events, found, *places, run_axes).happened
    stopped, hit, status = barrier((stopped, hit, status))
    if ends_alone:
        # The state at the start stays, also where the run ends at once.
        states = _where_stopped(stopped[1:], found.state, states, run_axes)
        states = with_start(y0, states, run_axes)
    else:
        states = _where_stopped(stopped, found.state, states, run_axes)
    return Trajectory(
        jnp.where(stopped, found.time, asked),
        states,
        jnp.where(hit, Status.EVENT, status),
        found.which,
        happened,
        result.stats,
        run_axes,
    )


@straight_to_event.def_jvp
def _straight_to_event_jvp(primals: tuple, tangents: tuple) -> tuple[Trajectory, Trajectory]:
    def again(
        integrator: Integrator, y0: State, ts: Array, events: tuple[Event, ...]
    ) -> Trajectory:
        if ts.shape[0] == 2:
            return _straight_to_event(integrator, y0, ts, events, differentiated=True)
        asked = of_each_run(ts, runs_of(y0, integrator.run_axes))
        return _to_event(integrator, y0, asked, events, False)

    return eqx.filter_jvp(again, primals, tangents)


def _with_restarts(
    integrator: Integrator, y0: State, asked: Array, events: tuple[Event, ...]
) -> Trajectory:
    """A run that goes on from the jumps of its events, through `asked`, (times, *runs)."""
    run_axes = integrator.run_axes
    result = restarts_between(integrator, y0, asked[0], asked[-1], events)
    sign = jnp.where(asked[-1] < asked[0], -1.0, 1.0).astype(asked.dtype)
    stopped = (result.stopped_by >= 0) & (sign * asked >= sign * result.end)
    ts = jnp.where(stopped, result.end, asked)
    states, status, stats = states_between(integrator, y0, ts, result)
    states = _where_stopped(stopped, result.final, states, run_axes)
    # A run that failed may have had further events after its last restart.
    known = (result.status <= Status.EVENT) | (sign * asked <= sign * result.end)
    states = scaled(states, nan_unless(known))
    hit = (result.stopped_by >= 0) & (status == Status.COMPLETED)
    status = jnp.where(hit, Status.EVENT, status)
    event = result.stopped_by.astype(jnp.int32)
    crossings = collected(result, events, run_axes)
    happened = result.happened
    return Trajectory(*(ts, states, status, event, happened, stats, run_axes), crossings=crossings)


def _where_stopped(stopped: Array, y: State, states: State, run_axes: int) -> State:
    """The states, with `y` at those times, (times, *runs), at which a run has `stopped`."""

    def leaf(xs: Array, x: Array) -> Array:
        flags = stopped.reshape(*(1,) * (xs.ndim - stopped.ndim), *stopped.shape)
        return jnp.where(flags, jnp.expand_dims(x, x.ndim - run_axes), xs)

    return jax.tree.map(leaf, states, y)
