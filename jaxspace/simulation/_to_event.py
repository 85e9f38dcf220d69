"""Runs to the first of their events, which occurs at an individual time for each run.

A method whose steps have a polynomial locates the event in the integration that runs up to it
(`integrate_to_event`). Otherwise one integration searches for it, and another one runs up to it
(`search_to_event`). The search is outside of every derivative: one Newton step at the event
carries those of its time.
"""

import dataclasses
from collections.abc import Callable
from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from ..core import Scalar, State
from ..core.barrier import barrier
from ..core.safe import safe_divide
from ..core.status import Status, combine_status
from ..integration.event_search import FirstEvent
from ..integration.events import Event, newton_correct
from ..integration.layout import replace_state, runs_of, state_at, with_start
from ..integration.simultaneous import simultaneous_events
from ._integrator import Integrator, of_each_run
from .masking import nan_unless, scaled
from .trajectory import Trajectory, without_events


@final
class SwitchedCondition(eqx.Module):
    """The condition of an event while it is `sought`; otherwise seconds since `start`, and one
    more, which for a run forwards is never zero, nor at rest as at a touch.

    For a loop whose passes share a program, and of which some seek the event."""

    condition: Callable[[Scalar, State], Scalar]
    sought: Bool[Array, ""]
    start: Scalar

    def __call__(self, t: Scalar, y: State) -> Scalar:
        return jnp.where(self.sought, self.condition(t, y), 1.0 + (t - self.start))


def search_to_event(
    integrator: Integrator,
    y0: State,
    t0: Scalar,
    t1: Scalar,
    events: tuple[Event, ...],
    run_until: Callable[[FirstEvent], Trajectory],
) -> Trajectory:
    """A run to the first of its events, by a search from `t0` to `t1`, s, (*runs,), and the run up
    to what was found, `run_until(found)`."""
    found = integrator.first_event(y0, t0, t1, events)
    run = run_until(found)
    last = found.met(state_at(run.states, -1, integrator.run_axes))
    at = found.which, found.time, last
    # The derivatives of the end are those of the correction, and not of the search.
    end = newton_correct(integrator.system, events, *at, located=found.state is not None)
    return stopped_at_event(integrator, y0, run, events, found, end)


def stopped_at_event(
    integrator: Integrator,
    y0: State,
    run: Trajectory,
    events: tuple[Event, ...],
    found: FirstEvent,
    end: tuple[Scalar, State],
) -> Trajectory:
    """The run with its end at the event that was `found`: from then on its times and states are
    those of the `end`. `y0`: its initial state."""
    hit = found.which >= 0
    if len(events) == 1:
        happened = hit[None]
    else:
        places = (run.ts[0], y0), end
        arguments = integrator.system, events, found, *places, integrator.run_axes
        happened = simultaneous_events(*arguments).happened
    # Times descend in a run backwards.
    sign = jnp.where(run.ts[-1] < run.ts[0], -1.0, 1.0).astype(run.ts.dtype)
    # The state at the start stays, also where the run ends at once.
    later = jnp.arange(len(run)).reshape(-1, *(1,) * hit.ndim) > 0
    stopped = later & hit & (sign * run.ts >= sign * found.time)
    status = combine_status(run.status, found.status)
    # A run that failed on its way has met no event.
    hit = hit & (status == Status.COMPLETED)
    # Once for all saved states, of which each would compute its own.
    stopped, hit, status, t, y = barrier((stopped, hit, status, *end))
    return dataclasses.replace(
        run,
        ts=jnp.where(stopped, t, run.ts),
        states=stopped_states(stopped, y, run.states, integrator.run_axes),
        status=jnp.where(hit, Status.EVENT, status),
        event=found.which,
        happened=happened,
    )


@eqx.filter_custom_jvp
def integrate_to_event(
    integrator: Integrator, y0: State, ts: Array, events: tuple[Event, ...]
) -> Trajectory:
    """A run to the first of its events, by one integration that locates it.

    Only for a method that `locates_events`. If states are saved on the way, its derivatives are
    those of a second integration, to the located time.

    **Arguments**

    - `ts`: save times, s, (times,); or start and end of each run, (2, *runs)."""
    return _integrate_to_event(integrator, y0, ts, events)


def _integrate_to_event(
    integrator: Integrator,
    y0: State,
    ts: Array,
    events: tuple[Event, ...],
    *,
    differentiated: bool = False,
) -> Trajectory:
    run_axes = integrator.run_axes
    ends_alone = ts.shape[0] == 2
    fractions = None if ends_alone else safe_divide(ts - ts[0], ts[-1] - ts[0])
    result = integrator.run(y0, ts[0], ts[-1], fractions, until=events)
    found = result.events
    assert found is not None
    if differentiated:
        which = found.which

        def correct(t: Scalar, y: State) -> tuple[Scalar, State]:
            # It is located already: the correction adds the derivatives.
            return newton_correct(integrator.system, events, which, t, y, located=True)

        time, state = found.differentiated(state_at(result.states, -1, run_axes), correct)
        found = found._replace(time=time, state=state)
    if ends_alone:
        states = with_start(y0, result.states, run_axes)
    else:
        states = replace_state(result.states, 0, y0, run_axes)
    run = without_events(ts, result._replace(states=states), run_axes)
    return stopped_at_event(integrator, y0, run, events, found, (found.time, found.state))


@integrate_to_event.def_jvp
def _integrate_to_event_jvp(primals: tuple, tangents: tuple) -> tuple[Trajectory, Trajectory]:
    def again(
        integrator: Integrator, y0: State, ts: Array, events: tuple[Event, ...]
    ) -> Trajectory:
        if ts.shape[0] == 2:
            return _integrate_to_event(integrator, y0, ts, events, differentiated=True)

        def through(times: Array, found: FirstEvent) -> Trajectory:
            del found
            return without_events(times, integrator.at_times(y0, times), integrator.run_axes)

        return through_times_to_event(integrator, y0, ts, events, through)

    run, of_run = eqx.filter_jvp(again, primals, tangents)
    # The derivatives of the times of a failed run, whose states are masked.
    of_ts = scaled(of_run.ts, nan_unless(run.status <= Status.EVENT))
    # Not by its constructor, because the tangents of integers are missing.
    return run, eqx.tree_at(lambda x: x.ts, of_run, of_ts)


def through_times_to_event(
    integrator: Integrator,
    y0: State,
    ts: Array,
    events: tuple[Event, ...],
    through: Callable[[Array, FirstEvent], Trajectory],
) -> Trajectory:
    """`search_to_event` for save times `ts`, s, (times,) or (times, *runs).

    `through(times, found)`: the run through these times, individual for each run: those up to the
    event found."""
    # Every run ends at its own time, and so has its own save times.
    asked = of_each_run(ts, runs_of(y0, integrator.run_axes))
    sign = jnp.where(asked[-1] < asked[0], -1.0, 1.0).astype(asked.dtype)

    def run_until(found: FirstEvent) -> Trajectory:
        return through(sign * jnp.minimum(sign * asked, sign * found.time), found)

    return search_to_event(integrator, y0, asked[0], asked[-1], events, run_until)


def stopped_states(stopped: Array, y: State, states: State, run_axes: int) -> State:
    """The states, with `y` at those times, (times, *runs), at which a run has `stopped`."""

    def leaf(xs: Array, x: Array) -> Array:
        flags = stopped.reshape(*(1,) * (xs.ndim - stopped.ndim), *stopped.shape)
        return jnp.where(flags, jnp.expand_dims(x, x.ndim - run_axes), xs)

    return jax.tree.map(leaf, states, y)
