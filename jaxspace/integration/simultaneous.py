"""The events that occur at the time of the first one: all whose conditions are zero there.

    |g| <= R eps (sum |g_y| |y| + max |g| + |dg/dt| max(|t|, |t - t0|))

The bound is the rounding of the condition, and its change in a few roundings of the located time.

The search finds the zeros on the dense output of a step, or by an integration for each event; the
state at the first one is the end of another step. It may be behind the zero of a second event by
the difference of both, which is within the tolerance. The search has placed that zero not before
the first one, so that both happen together.

    symbol  meaning                                         unit
    g       condition of an event, along the run            any
    R, eps  allowed number of roundings, relative rounding  1
    t0      start of the run                                s
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..core import AbstractSystem, Scalar, State
from ..core.safe import safe_divide
from .event_search import FirstEvent, fixed
from .event_zero import RESOLVED_ROUNDINGS, ROUNDINGS, rounding_change
from .events import Event

# Largest difference of the times at which two integrations pass a zero, in lengths of the step or
# distances between samples. A condition that returns to zero so soon after it has left it is beyond
# what samples resolve.
AGREEING = 1e-2


class Simultaneous(NamedTuple):
    """The conditions of all events at the time of the first one, before any of them acts.

    - `happened`: whether each event happens then, and `zero`, whether its condition is zero, where
      an event of the other `direction` does not happen.
    - `values`, `slopes`: the function that is zero at the event, and its rate along the motion.
    - `limits`: up to this size the function is zero, to rounding."""

    happened: Bool[Array, "events *#runs"]
    zero: Bool[Array, "events *#runs"]
    values: Float[Array, "events *#runs"]
    slopes: Float[Array, "events *#runs"]
    limits: Float[Array, "events *#runs"]


def simultaneous_events(
    system: AbstractSystem,
    events: tuple[Event, ...],
    found: FirstEvent,
    start: tuple[Scalar, State],
    at: tuple[Scalar, State],
    run_axes: int,
    start_known: Float[Array, "events *#runs"] | None = None,
) -> Simultaneous:
    """The events of runs from their `start`, time and state, that happen `at` the time and the
    state of the first one. Not differentiable.

    A zero at the start is an event as in `first_event`, with the same `start_known`."""
    system, start, at, events = jax.tree.map(fixed, (system, start, at, events))
    t0, y0 = start
    t, y = at
    forwards = jnp.sign(t - t0)
    rows = []
    for number, event in enumerate(events):
        value, slope = event.slope(system, t, y)
        limit = _limit(event, system, found.sizes[number], slope, t0, at, run_axes)
        zero = jnp.abs(value) <= limit
        zero = zero | _just_passed(event, system, found, number, at, (value, forwards * slope))
        if event.touch is not None:
            zero = zero & (jnp.abs(event.condition(t, y)) <= event.touch)
        # A run that continues only for rounding times has not left the zero at its start.
        near = jnp.abs(t - t0) <= RESOLVED_ROUNDINGS * _eps(value) * jnp.maximum(
            jnp.abs(t0), jnp.abs(t)
        )
        stays = near & (jnp.abs(event.value(system, t0, y0)) <= limit)
        if event.at_start:
            stays = stays & (False if start_known is None else start_known[number] == jnp.inf)
        ahead = event.direction * forwards * slope >= 0.0
        also = found.hits[number] & zero & ahead & ~stays & (found.which >= 0)
        rows.append(((found.which == number) | also, zero, value, slope, limit))
    return Simultaneous(*map(jnp.stack, zip(*rows, strict=True)))


def _just_passed(
    event: Event,
    system: AbstractSystem,
    found: FirstEvent,
    number: int,
    at: tuple[Scalar, State],
    ends: tuple[Scalar, Scalar],
) -> Bool[Array, "*runs"]:
    """Whether the state has passed the zero of an event that the search does not place before it.

    `ends`: the condition there, and its slope along the run."""
    t, _ = at
    value, slope = ends
    behind = jnp.abs(safe_divide(value, slope))
    leaving = value * slope > 0.0
    if found.step_start is not None:
        start, y, _ = found.step_start
        before = event.value(system, start, y)
        return leaving & (before * value < 0.0) & (behind <= AGREEING * jnp.abs(t - start))
    assert found.times is not None and found.spacings is not None
    apart = jnp.abs(found.times[number] - t) + behind
    return leaving & (apart <= AGREEING * found.spacings[number])


def _limit(
    event: Event,
    system: AbstractSystem,
    size: Scalar,
    slope: Scalar,
    t0: Scalar,
    at: tuple[Scalar, State],
    run_axes: int,
) -> Scalar:
    """The size of the condition up to which it is zero, to rounding, in units of the condition.

    `size`: the largest so far."""
    t, y = at
    change = rounding_change(event, system, t, y, run_axes)
    change = change + size + jnp.abs(slope) * jnp.maximum(jnp.abs(t), jnp.abs(t - t0))
    # Twice the limit for a zero at the start, so that no event is lost between two runs.
    return 2.0 * ROUNDINGS * _eps(change) * change


def _eps(x: Array) -> float:
    return float(jnp.finfo(x.dtype).eps)
