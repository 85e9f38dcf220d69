"""Runs side by side in one integration: states and parameters with the runs on the last axis.

This is the layout of the physics itself: `simulate` has no axis of runs, `simulate_batch` and the
dispersion have one."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..core import AbstractSystem, Scalar, State, safe_divide
from ..integration._accuracy import Accuracy, settled
from ..integration._events import Event, corrected, first_event
from ..integration._segment import alike, propagate
from ..integration._status import Status, worst
from ._mission import Mission, Phase


class Span(NamedTuple):
    """A span of runs side by side: times and states with the times first and the runs last; `steps`
    taken, if recorded."""

    ts: Array
    states: State
    status: Array
    event: Array
    stats: dict[str, Array]
    steps: Array | None


def _runs(y: State, run_axes: int) -> tuple[int, ...]:
    leaf = jax.tree.leaves(y)[0]
    return leaf.shape[leaf.ndim - run_axes :]


def _last(states: State) -> State:
    return jax.tree.map(lambda x: x[-1], states)


def through(
    system: AbstractSystem, y0: State, times: Array, accuracy: Accuracy, run_axes: int
) -> tuple[State, Array, dict]:
    """States at `times`, (times, *runs), different in every run: interval by interval, landing on
    every time."""

    def interval(carry, ends):
        y, status = carry
        p = propagate(system, y, ends[0], ends[1], None, accuracy, run_axes)
        y = _last(p.states)
        return (y, worst(status, p.status)), (y, p.stats)

    start = (y0, jnp.zeros(_runs(y0, run_axes), jnp.int32))
    (_, status), (states, stats) = jax.lax.scan(interval, start, (times[:-1], times[1:]))
    total = {
        k: jnp.max(v, axis=0) if k == "largest_local_error" else jnp.sum(v, axis=0)
        for k, v in stats.items()
    }
    return jax.tree.map(lambda a, b: jnp.concatenate([a[None], b]), y0, states), status, total


def run_system(
    system: AbstractSystem,
    y0: State,
    ts: Array,
    events: tuple[Event, ...],
    accuracy: Accuracy,
    run_axes: int,
) -> Span:
    """States of one system at `ts`, (times,) or (times, *runs); from the first event on they
    stay."""
    y0 = alike(system, ts[0], y0)
    if not events:
        states, status, stats = _at_times(system, y0, ts, accuracy, run_axes)
        return Span(ts, states, status, -jnp.ones(_runs(y0, run_axes), jnp.int32), stats, None)
    shape = _runs(y0, run_axes)
    asked = jnp.broadcast_to(
        ts.reshape(ts.shape[0], *(1,) * (len(shape) - ts.ndim + 1), *ts.shape[1:]),
        (ts.shape[0], *shape),
    )
    when, which = first_event(system, y0, asked[0], asked[-1], events, accuracy, run_axes)
    sign = jnp.where(asked[-1] < asked[0], -1.0, 1.0).astype(when.dtype)
    ts = sign * jnp.minimum(sign * asked, sign * when)
    states, status, stats = _at_times(system, y0, ts, accuracy, run_axes)
    t_event, y_event = corrected(system, events, which, ts[-1], _last(states))
    stopped = (which >= 0) & (sign * asked >= sign * when)
    ts = jnp.where(stopped, t_event, ts)
    states = jax.tree.map(
        lambda x, e: jnp.where(stopped.reshape(_lead(stopped, x)), e, x), states, y_event
    )
    status = jnp.where((which >= 0) & (status == Status.COMPLETED), Status.EVENT, status)
    return Span(ts, states, status, which, stats, None)


def _at_times(
    system: AbstractSystem, y0: State, ts: Array, accuracy: Accuracy, run_axes: int
) -> tuple[State, Array, dict]:
    """States at `ts`, their status, and what they cost."""
    if ts.ndim > 1 and ts.shape[0] > 2:
        return through(system, y0, ts, accuracy, run_axes)
    fractions = safe_divide(ts - ts[0], ts[-1] - ts[0]) if ts.shape[0] > 2 else None
    p = propagate(system, y0, ts[0], ts[-1], fractions, accuracy, run_axes)
    if fractions is None:
        return (
            jax.tree.map(lambda a, b: jnp.concatenate([a[None], b]), y0, p.states),
            p.status,
            p.stats,
        )
    return jax.tree.map(lambda a, b: b.at[0].set(a), y0, p.states), p.status, p.stats


def _lead(flags: Array, block: Array) -> tuple[int, ...]:
    """The shape in which flags (times, *runs) meet a block (times, components, *runs)."""
    return (flags.shape[0], *(1,) * (block.ndim - flags.ndim), *flags.shape[1:])


def run_phase(
    phase: Phase,
    y0: State,
    t0: Scalar,
    samples: int,
    accuracy: Accuracy,
    run_axes: int,
    plan: Array | None = None,
    record: bool = False,
) -> Span:
    """States of a phase at `samples` times from its start to its end, before its jump.

    Compiled phase by phase, and without their names: phases alike are compiled once."""
    return _phase(phase.system, phase.until, y0, t0, samples, accuracy, run_axes, plan, record)


@eqx.filter_jit
def _phase(
    system: AbstractSystem,
    until: Scalar | Event,
    y0: State,
    t0: Scalar,
    samples: int,
    accuracy: Accuracy,
    run_axes: int,
    plan: Any,
    record: bool,
) -> Span:
    y0 = alike(system, t0, y0)
    shape = _runs(y0, run_axes)
    dtype = jnp.result_type(*jax.tree.leaves(y0))
    events = (until,) if isinstance(until, Event) else ()
    t0 = jnp.broadcast_to(jnp.asarray(t0, dtype), shape)
    t1 = t0 + (until.within if isinstance(until, Event) else until)
    which = -jnp.ones(shape, jnp.int32)
    if events:
        t1, which = first_event(system, y0, t0, t1, events, accuracy, run_axes)
    fractions = jnp.linspace(0.0, 1.0, samples, dtype=dtype) if samples > 2 else None
    p = propagate(system, y0, t0, t1, fractions, accuracy, run_axes, plan, record)
    states = (
        p.states
        if samples > 2
        else jax.tree.map(lambda a, b: jnp.concatenate([a[None], b]), y0, p.states)
    )
    ts = t0 + jnp.multiply.outer(jnp.linspace(0.0, 1.0, samples, dtype=dtype), t1 - t0)
    status = p.status
    if events:
        t_event, y_event = corrected(system, events, which, t1, _last(states))
        ts = ts.at[-1].set(t_event)
        states = jax.tree.map(lambda x, e: x.at[-1].set(e), states, y_event)
        status = jnp.where(
            status == Status.COMPLETED,
            jnp.where(which >= 0, Status.EVENT, Status.EVENT_MISSED),
            status,
        )
    return Span(ts, states, status, which, p.stats, p.plan)


def run_mission(
    mission: Mission,
    y0: State,
    t0: Scalar,
    samples: int,
    accuracy: Accuracy,
    run_axes: int,
    plans: tuple[Array | None, ...] | None = None,
    record: bool = False,
) -> tuple[list[Span], State, Array, Array]:
    """The spans of all phases, the state and the time after the last jump, and the status of each
    run."""
    spans, y, t, status = [], y0, t0, None
    for number, phase in enumerate(mission.phases):
        chosen = settled(accuracy, phase.system, y)
        span = run_phase(
            phase, y, t, samples, chosen, run_axes, None if plans is None else plans[number], record
        )
        spans.append(span)
        status = span.status if status is None else worst(status, span.status)
        t, y = span.ts[-1], _last(span.states)
        y = y if phase.then is None else _jump(phase.then, t, y)
    assert status is not None
    return spans, y, t, status


@eqx.filter_jit
def _jump(then: Any, t: Scalar, y: State) -> State:
    return then(t, y)


def refined(plan: Any, factor: float) -> np.ndarray:
    """The plan with about `factor` times as many steps in every segment between whole numbers,
    distributed alike."""
    plan = np.asarray(plan)
    pieces = [plan[:1]]
    for k in range(round(plan[-1])):
        nodes = plan[(plan >= k) & (plan <= k + 1)]
        count = int(np.ceil(factor * (len(nodes) - 1)))
        pieces.append(
            np.interp(
                np.linspace(0.0, len(nodes) - 1.0, count + 1)[1:], np.arange(len(nodes)), nodes
            )
        )
        pieces[-1][-1] = k + 1.0
    return np.concatenate(pieces)
