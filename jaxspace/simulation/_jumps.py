"""Runs that continue after an event changes the state, such as a bouncing ball.

    y(t_k+) = then(t_k, y(t_k-)),   g(t_k, y(t_k-)) = 0        k = 1, 2, ... up to the capacity

From one jump to the next the run is like a phase: the search is outside of every derivative, and
one Newton step carries the derivatives of the time, so that they pass through all jumps. The
states at the save times are computed afterwards, each from the last jump or save time before
it.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..core import State
from ..core.status import Status, combine_status
from ..integration.crossings import Crossings
from ..integration.event_zero import pick
from ..integration.events import Event, newton_correct
from ..integration.layout import runs_of, times_behind_components, with_start
from ._integrator import Integrator, total_of
from ._pending_events import PendingEvents


class Jumps(NamedTuple):
    """Every jump of each run, on the first axis, and the end of the run.

    - `ts`, `before`, `after`: times, s, and the states on both sides; behind the last jump those
      of the end of the run.
    - `which`: the number of the event, -1 behind the last one; `rising`: whether its
      condition rises.
    - `end`, `final`: the time at which the run ends, s, and the state there; `stopped_by`: the
      number of the event that ended it, or -1; `happened`: all events of that time. A run that
      failed ends with the last jump before.
    - `counts`, `overflow`: of each event, its number of jumps, and whether its capacity was
      exceeded."""

    ts: Float[Array, "jumps *#runs"]
    before: State
    after: State
    which: Int[Array, "jumps *#runs"]
    rising: Bool[Array, "jumps *#runs"]
    end: Float[Array, "*runs"]
    final: State
    stopped_by: Int[Array, "*runs"]
    happened: Bool[Array, "events *#runs"]
    counts: Int[Array, "events *#runs"]
    overflow: Bool[Array, "events *#runs"]
    status: Int[Array, "*runs"]
    stats: dict[str, Array]


class _RunState(NamedTuple):
    """Progress of a run: time, state, status, the number of jumps of each event, the terminal
    event, and the events of the last time at which some happened."""

    t: Array
    y: State
    status: Array
    counts: Array
    stopped_by: Array
    pending: PendingEvents


def jumps_between(
    integrator: Integrator, y0: State, t0: Array, t1: Array, events: tuple[Event, ...]
) -> Jumps:
    """All jumps from `t0` to `t1`, s, (*runs,); events without `then` end the run, and so does a
    jump beyond the capacity.

    Simultaneous events each have a separate jump, in the listed order (`_pending_events`)."""
    runs = runs_of(y0, integrator.run_axes)
    axes = (1,) * len(runs)
    capacities = [0 if event.then is None else event.capacity for event in events]
    capacity = jnp.array(capacities, jnp.int32).reshape(-1, *axes)

    def one(run: _RunState, _: None) -> tuple[_RunState, tuple]:
        stopped = (run.stopped_by >= 0) | (run.status > Status.EVENT)
        run, stats = _to_next_events(integrator, run, stopped, t1, events)
        run, row = _after_next_event(integrator, run, stopped, t1 - t0, events, capacity)
        return run, (*row, stats)

    t0 = jnp.broadcast_to(t0, runs)
    start = _RunState(
        t0,
        y0,
        jnp.zeros(runs, jnp.int32),
        jnp.zeros((len(events), *runs), jnp.int32),
        jnp.full(runs, -1, jnp.int32),
        PendingEvents.none_yet(events, t0),
    )
    # One iteration more than jumps: the last one reaches the end, or exceeds the capacity.
    run, (ts, before, after, which, rising, stats) = jax.lax.scan(
        one, start, None, length=sum(capacities) + 1
    )
    # An event with a jump ends a run only where its capacity is exceeded.
    overflow = (_numbers(events, runs) == run.stopped_by) & (capacity > 0)
    happened = run.pending.events.happened & (run.stopped_by >= 0)
    return Jumps(
        ts, before, after, which, rising, run.t, run.y, run.stopped_by, happened, run.counts,
        overflow, run.status, total_of(stats),
    )  # fmt: skip


def _numbers(events: tuple[Event, ...], runs: tuple[int, ...]) -> Int[Array, "events *#runs"]:
    """The numbers of the events, with axes for the runs."""
    return jnp.arange(len(events), dtype=jnp.int32).reshape(-1, *(1,) * len(runs))


def _to_next_events(
    integrator: Integrator, run: _RunState, stopped: Array, t1: Array, events: tuple[Event, ...]
) -> tuple[_RunState, dict[str, Array]]:
    """The run at the next time at which events happen, or at `t1`, s, and the work up to there.

    A run that has `stopped`, and one whose events of one time have yet to act, stays where it
    is."""
    system, _, run_axes = integrator
    # They pass an interval of no length, because the other runs need the loop.
    idle = stopped | jnp.any(run.pending.waiting, axis=0)
    last = jnp.where(idle, run.t, t1)
    known = run.pending.start_known()
    found = integrator.first_event(run.y, run.t, last, events, known)
    y, result = integrator.to(run.y, run.t, found.time)
    found = found._replace(which=jnp.where(idle, -1, found.which))
    t, y = found.time, found.met(y)
    if found.state is None:
        # To the zero itself; its derivatives are those of the correction where the event acts.
        t, y = newton_correct(system, events, found.which, t, y)
    ended = combine_status(result.status, found.status)
    status = jnp.where(idle, run.status, combine_status(run.status, ended))
    # The end of an interval that failed is neither a jump nor the end of the run.
    good = (status <= Status.EVENT) & ~idle
    t, y = jax.tree.map(lambda a, b: jnp.where(good, a, b), (t, y), (run.t, run.y))
    found = found._replace(which=jnp.where(good, found.which, -1))
    pending = run.pending.updated(system, events, found, (run.t, run.y), (t, y), run_axes)
    return run._replace(t=t, y=y, status=status, pending=pending), result.stats


def _after_next_event(
    integrator: Integrator,
    run: _RunState,
    stopped: Array,
    duration: Array,
    events: tuple[Event, ...],
    capacity: Array,
) -> tuple[_RunState, tuple]:
    """The run after the next of the events that have yet to act, and the row of its jump.

    `duration`: of the run, s, of which the sign counts; `capacity`: of each event, 0 for one
    without a jump."""
    system = integrator.system
    jumping = run.counts < capacity
    acting = jnp.where(stopped, -1, run.pending.next_to_act(jumping))
    here = _numbers(events, acting.shape) == acting
    own = jnp.any(here & run.pending.kept & run.pending.ahead, axis=0)
    corrected = jnp.where(own, acting, -1)
    t, y = newton_correct(system, events, corrected, run.t, run.y, located=True)
    jumped = here & jumping
    goes_on = jnp.any(jumped, axis=0)
    after = y
    for number, event in enumerate(events):
        if event.then is not None:
            moved = event.then(t, y)
            after = jax.tree.map(lambda a, b, k=number: jnp.where(jumped[k], a, b), moved, after)
    # Before the jumps, which may reverse the signs of the slopes.
    rising = jnp.any(here & (run.pending.events.slopes * jnp.sign(duration) > 0.0), axis=0)
    run = run._replace(
        t=t,
        y=after,
        counts=run.counts + jumped.astype(jnp.int32),
        stopped_by=jnp.where((acting >= 0) & ~goes_on, acting, run.stopped_by),
        pending=run.pending.after(here, system, events, t, after),
    )
    return run, (t, y, after, jnp.where(goes_on, acting, -1), rising)


def states_between(
    integrator: Integrator, y0: State, ts: Float[Array, "times *#runs"], jumps: Jumps
) -> tuple[State, Int[Array, "*runs"], dict[str, Array]]:
    """The states at the save times `ts`, (times, *runs), status and work.

    The times end with the run; at a save time with a jump the state is that after it."""
    run_axes = integrator.run_axes
    sign = jnp.where(jumps.end < ts[0], -1.0, 1.0).astype(ts.dtype)
    happened = jumps.which >= 0

    def one(carry: tuple[State, Array, Array], t: Array) -> tuple[tuple, tuple]:
        y, t_before, status = carry
        passed = happened & (sign * jumps.ts <= sign * t) & (sign * jumps.ts >= sign * t_before)
        # The last jump since the save time before, if there is one.
        index = passed.shape[0] - 1 - jnp.argmax(passed[::-1], axis=0)
        y_after, t_jump = pick((jumps.after, jumps.ts), index, run_axes)
        jumped = jnp.any(passed, axis=0)
        y = jax.tree.map(lambda a, b: jnp.where(jumped, a, b), y_after, y)
        start = jnp.where(jumped, t_jump, t_before)
        y, result = integrator.to(y, start, t)
        status = combine_status(status, result.status)
        return (y, t, status), (y, result.stats)

    # A scan over save times, because the interval before each has another length in every run.
    start = (y0, ts[0], jumps.status)
    (_, _, status), (states, stats) = jax.lax.scan(one, start, ts[1:])
    states = with_start(y0, times_behind_components(states, run_axes), run_axes)
    work = {name: jnp.stack([x, jumps.stats[name]]) for name, x in total_of(stats).items()}
    return states, status, total_of(work)


def collected(jumps: Jumps, events: tuple[Event, ...], run_axes: int) -> tuple[Crossings, ...]:
    """The jumps of each event with a jump, as its `Crossings`."""
    return tuple(
        _of_event(jumps, number, event.capacity, run_axes)
        for number, event in enumerate(events)
        if event.then is not None
    )


def _of_event(jumps: Jumps, number: int, capacity: int, run_axes: int) -> Crossings:
    # The jumps by this event come first, in their order.
    order = jnp.argsort(jumps.which != number, axis=0, stable=True)[:capacity]
    both = jumps.ts, jumps.before, jumps.after
    ts, before, after = jax.vmap(lambda index: pick(both, index, run_axes))(order)
    rising = jnp.take_along_axis(jumps.rising, order, axis=0)
    used = (
        jnp.arange(capacity, dtype=jnp.int32).reshape(-1, *(1,) * run_axes) < jumps.counts[number]
    )

    def leaf(x: Array) -> Array:
        return jnp.where(used, x, jnp.nan)

    before, after = (times_behind_components(y, run_axes) for y in (before, after))
    return Crossings(
        leaf(ts),
        jax.tree.map(leaf, before),
        rising & used,
        jumps.counts[number],
        jumps.overflow[number],
        jumps.status,
        jax.tree.map(leaf, after),
    )
