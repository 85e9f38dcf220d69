"""Runs of one phase of a mission, to its end after a duration, or at an event, which occurs at an
individual time for each run."""

import dataclasses
from typing import NamedTuple, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from ..core import Scalar, State
from ..core.safe import safe_divide
from ..core.status import Status, time_unresolved
from ..integration.event_search import FirstEvent
from ..integration.events import Event, closures_of_events
from ..integration.integrate import locates_events
from ..integration.layout import (
    broadcast_state,
    of_each,
    replace_state,
    runs_of,
    state_at,
    with_start,
)
from ..integration.result import IntegrationResult
from ._integrator import Integrator
from ._to_event import SwitchedCondition, integrate_to_event, search_to_event, stopped_at_event
from .checks import check_events
from .trajectory import Trajectory, without_events


class MissionTimes(NamedTuple):
    """Save times of a phase that starts or ends at different times in different runs.

    - `times`: of the mission, s, (chosen,); a time outside of the phase of a run becomes the nearer
      end of the phase.
    - `samples`: number of further states, evenly spaced from its start to its end."""

    times: Float[Array, " chosen"]
    samples: int

    def fractions(self, t0: Float[Array, "*runs"], t1: Float[Array, "*runs"]) -> Array:
        """Fractions of the phase at which each run saves, (chosen + samples, *runs).

        The phase of a run lasts from `t0` to `t1`, s."""
        times = self.times.astype(t0.dtype).reshape(-1, *(1,) * t0.ndim)
        x = safe_divide(times - t0, t1 - t0)
        # NaN becomes zero, because the end of a failed run must not change the steps of the others.
        shares = jnp.where(x > 0.0, jnp.minimum(x, 1.0), 0.0)
        even = jnp.linspace(0.0, 1.0, self.samples, dtype=t0.dtype).reshape(-1, *(1,) * t0.ndim)
        return jnp.concatenate([shares, jnp.broadcast_to(even, (self.samples, *t0.shape))])


# The axis of times has no name, because each phase has its own number of them.
SaveTimes: TypeAlias = int | Float[Array, " _"] | MissionTimes
"""Save times of a phase: a number of states, evenly from its start to its end; or fractions of its
duration, from 0 to 1; or times of the mission."""


def run_to_end(
    integrator: Integrator,
    until: Scalar | Event,
    y0: State,
    t0: Scalar,
    num_saved: SaveTimes,
) -> Trajectory:
    """A phase up to its end, before its jump.

    **Arguments**

    - `until`: of the phase; `y0`: the state at its start `t0`, s.
    - `num_saved`: as that of `run_mission`, of one phase."""
    system, _, run_axes = integrator
    if run_axes:
        y0 = broadcast_state(system, t0, y0)
    runs = runs_of(y0, run_axes)
    dtype = jnp.result_type(*jax.tree.leaves(y0))
    # Each run may start, and reach its event, at a different time.
    t0 = jnp.broadcast_to(jnp.asarray(t0, dtype), runs)
    t1 = t0 + (until.within if isinstance(until, Event) else until)
    if not isinstance(until, Event):
        run = _saved(integrator, y0, t0, t1, num_saved)
        duration = jnp.broadcast_to(jnp.asarray(until, dtype), runs)
        lost = time_unresolved(t0, duration, rounded=False)
        status = jnp.where(lost, Status.TIME_UNRESOLVED, run.status).astype(jnp.int32)
        return dataclasses.replace(run, status=status)
    check_events((until,), system, y0, t0, run_axes, "Phase.until")
    (until,) = closures_of_events((until,), t0, y0)
    beyond = until.beyond(t0, y0)
    # Nothing happens in no time, and the state at the end has the derivatives of that at the start.
    span = t0, t1 if beyond is None else jnp.where(beyond, t0, t1)
    run = _run_to_event(integrator, until, y0, span, num_saved)
    return with_missed(run, beyond)


def with_missed(run: Trajectory, beyond: Array | None, sought: ArrayLike = True) -> Trajectory:
    """The run of a phase with the status of an event that did not happen while it was `sought`,
    and with the event of a run that was `beyond` its zero when it started."""
    missed = (run.status == Status.COMPLETED) & sought
    status = jnp.where(missed, Status.EVENT_MISSED, run.status)
    if beyond is None:
        return dataclasses.replace(run, status=status)
    at_once = missed & beyond
    return dataclasses.replace(
        run,
        status=jnp.where(at_once, Status.EVENT, status),
        event=jnp.where(at_once, 0, run.event),
        happened=run.happened | at_once,
    )


def _run_to_event(
    integrator: Integrator,
    until: Event,
    y0: State,
    span: tuple[Scalar, Scalar],
    num_saved: SaveTimes,
) -> Trajectory:
    """`run_to_end` for an event within a `span`, s."""
    system, config, run_axes = integrator
    t0, t1 = span
    if locates_events(config, system, y0, t0):
        if isinstance(num_saved, int) and num_saved == 2:
            times = jnp.stack([t0, t1])
            return integrate_to_event(integrator, y0, times, (until,))
        # A batch would have all of its states in memory twice.
        if isinstance(num_saved, int) and not run_axes:
            return _sampled_to_event(integrator, y0, t0, t1, until, num_saved)
    return _search_and_run(integrator, y0, t0, t1, until, num_saved)


def _saved(
    integrator: Integrator, y0: State, t0: Scalar, t1: Scalar, num_saved: SaveTimes
) -> Trajectory:
    """A phase from `t0` to `t1`, with its saved states."""
    run_axes = integrator.run_axes
    if isinstance(num_saved, int):
        fractions = jnp.linspace(0.0, 1.0, num_saved, dtype=t0.dtype)
    elif isinstance(num_saved, MissionTimes):
        fractions = num_saved.fractions(t0, t1)
    else:
        fractions = num_saved.astype(t0.dtype)
    ends_alone = fractions.shape[0] == 2
    # Start and end alone need no save times within a step, which would cost evaluations.
    result = integrator.run(y0, t0, t1, None if ends_alone else fractions)
    if ends_alone:
        result = result._replace(states=with_start(y0, result.states, run_axes))
    return without_events(t0 + of_each(fractions, t1 - t0), result, run_axes)


def _search_and_run(
    integrator: Integrator,
    y0: State,
    t0: Scalar,
    t1: Scalar,
    event: Event,
    num_saved: SaveTimes,
) -> Trajectory:
    """A phase up to an event, whose search is one integration, and whose states are another."""

    def run_until(found: FirstEvent) -> Trajectory:
        run = _saved(integrator, y0, t0, found.time, num_saved)
        # To the last bit, by which it is the one of the event.
        return dataclasses.replace(run, ts=run.ts.at[-1].set(found.time))

    return search_to_event(integrator, y0, t0, t1, (event,), run_until)


@eqx.filter_custom_jvp
def _sampled_to_event(
    integrator: Integrator, y0: State, t0: Scalar, t1: Scalar, event: Event, num_saved: int
) -> Trajectory:
    """`_search_and_run` of one run by half of the program: a loop over two integrations, of which
    the first one locates the event, and the other one saves the states up to it.

    Only for a method that `locates_events`."""
    fractions = jnp.linspace(0.0, 1.0, num_saved, dtype=t0.dtype)

    def once(end: Scalar, sought: Array) -> tuple[Scalar, IntegrationResult]:
        condition = SwitchedCondition(event.condition, sought, t0)
        until = (eqx.tree_at(lambda e: e.condition, event, condition),)
        result = integrator.run(y0, t0, end, fractions, until=until)
        assert result.events is not None
        return result.events.time, result

    _, both = jax.lax.scan(once, t1, jnp.array([True, False]))
    found = jax.tree.map(lambda x: x[0], both.events)
    result = jax.tree.map(lambda x: x[1], both)
    states = replace_state(result.states, 0, y0, 0)
    ts = (t0 + fractions * (found.time - t0)).at[-1].set(found.time)
    phase = without_events(ts, result._replace(states=states), 0)
    end = found.time, found.met(state_at(states, -1, 0))
    return stopped_at_event(integrator, y0, phase, (event,), found, end)


@_sampled_to_event.def_jvp
def _sampled_to_event_jvp(primals: tuple, tangents: tuple) -> tuple[Trajectory, Trajectory]:
    return eqx.filter_jvp(_search_and_run, primals, tangents)
