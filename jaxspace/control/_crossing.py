"""The event that ends a loop, located within the interval between two nodes.

The crossing is bracketed by the ends of the interval and located by the Illinois method, a false
position that halves the weight of an end that stays, outside of every derivative. One further
correction of time and state has the exact first derivative (`newton_correct`).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array

from ..core import AbstractSystem, State
from ..integration.events import Event, newton_correct
from ..solvers import FixedSteps
from ._advance import advance, select
from ._loop_parts import LoopParts

ITERATIONS = 60
"""Iterations of false position; a smooth condition requires about six."""


class Stop(NamedTuple):
    """The event that ended each run: its number (-1 before) and time, s, the last values of the
    conditions, (events, *runs), and whether one was not finite."""

    number: Array
    t: Array
    values: Array
    bad: Array


def values_of(events: tuple[Event, ...], t: Array, y: State, runs: Array) -> Array:
    """The conditions, (events, *runs)."""
    dtype = jnp.result_type(*jax.tree.leaves(y))
    result = [jnp.broadcast_to(event.condition(t, y), runs.shape) for event in events]
    return jnp.stack(result).astype(dtype) if result else jnp.zeros((0, *runs.shape), dtype)


def not_stopped(events: tuple[Event, ...], t: Array, y: State, runs: Array) -> Stop:
    """The state of the search before the first interval."""
    values = values_of(events, t, y, runs)
    none = jnp.full(runs.shape, -1, jnp.int32)
    return Stop(none, jnp.zeros(runs.shape, values.dtype) + t, values, jnp.zeros(runs.shape, bool))


def crossed(
    parts: LoopParts,
    held: AbstractSystem,
    stop: Stop,
    still: Array,
    t: Array,
    duration: Array,
    y0: State,
    y1: State,
) -> tuple[State, Stop]:
    """The state at the end of an interval or at the event within it, and the event of each run.

    **Arguments**

    - `still`: the runs that ended before.
    - `t`, `duration`: start and length of the interval, s; `y0`, `y1`: the states at its ends."""
    events = parts.events
    # A few steps of each run, so that the cost of the search is its compilation.
    method = parts.method.rolled_stages()
    values = values_of(events, t + duration, y1, still)
    hits = jnp.stack(
        [_hit(event, stop.values[k], values[k]) & ~still for k, event in enumerate(events)]
    )
    bad = stop.bad | (~still & ~jnp.all(jnp.isfinite(values), axis=0))
    any_hit = jnp.any(hits, axis=0)

    def located(_: None) -> tuple[State, Array, Array]:
        parts = []
        for k, event in enumerate(events):
            parts.append(
                jnp.where(
                    hits[k],
                    _share(
                        method, held, event, t, duration, y0, hits[k], stop.values[k], values[k]
                    ),
                    2.0,
                )
            )
        # An event that is not hit has the share 2, later than any that is.
        shares = jnp.stack(parts)
        which = jnp.where(any_hit, jnp.argmin(shares, axis=0), -1).astype(jnp.int32)
        share = jnp.where(any_hit, jnp.min(shares, axis=0), 1.0)
        # The derivative is that of Newton's correction below, and not of the search.
        dt = jax.lax.stop_gradient(share) * duration
        y, _ = advance(held, y0, t, dt, method)
        te, ye = newton_correct(held, events, which, t + dt, y)
        return select(any_hit, ye, y1), jnp.where(any_hit, te, stop.t), which

    def uncrossed(_: None) -> tuple[State, Array, Array]:
        return y1, jnp.where(still, stop.t, t + duration), jnp.full(still.shape, -1, jnp.int32)

    # Most intervals have no crossing: the search costs nothing where no run has one.
    y, te, which = jax.lax.cond(jnp.any(hits), located, uncrossed, None)
    # A run that ended before keeps the time of its event; the others have come to the next node.
    te = jnp.where(still | any_hit, te, t + duration)
    number = jnp.where(any_hit, which, stop.number)
    return y, Stop(number, te, jnp.where(still, stop.values, values), bad)


def _hit(event: Event, before: Array, after: Array) -> Array:
    """Whether a condition passes through zero; a zero at the start is that of the run before."""
    rise = (before < 0.0) & (after >= 0.0)
    fall = (before > 0.0) & (after <= 0.0)
    return {1: rise, -1: fall, 0: rise | fall}[event.direction]


def _share(
    method: FixedSteps,
    held: AbstractSystem,
    event: Event,
    t: Array,
    duration: Array,
    y0: State,
    hit: Array,
    before: Array,
    after: Array,
) -> Array:
    """Fraction of the interval at which the condition is zero, for the runs that `hit`."""
    held, t, duration, y0, before, after = jax.lax.stop_gradient(
        (held, t, duration, y0, before, after)
    )
    rounding = 4.0 * jnp.finfo(before.dtype).eps

    def value(x: Array) -> Array:
        y, _ = advance(held, y0, t, x * duration, method)
        return jnp.broadcast_to(event.condition(t + x * duration, y), x.shape)

    def unfinished(c: tuple) -> Array:
        _, _, _, gb, moved, k = c
        return jnp.any(hit & (moved > rounding) & (gb != 0.0)) & (k < ITERATIONS)

    def improve(c: tuple) -> tuple:
        a, ga, b, gb, _, k = c
        slope = gb - ga
        x = b - gb * (b - a) / jnp.where(slope == 0.0, 1.0, slope)
        # Some steps are bisections, because a false position may converge slowly.
        x = jnp.where((slope == 0.0) | (k % 8 == 7), 0.5 * (a + b), x)
        # A run whose search has ended retains its result while others continue.
        x = jnp.where(gb == 0.0, b, x)
        g = value(x)
        across = jnp.sign(g) != jnp.sign(gb)
        # An end that stays is halved in weight, or it would stay until the last iteration.
        a, ga = jnp.where(across, b, a), jnp.where(across, gb, 0.5 * ga)
        return a, ga, x, g, jnp.abs(x - b), k + 1

    zero = jnp.zeros_like(before)
    one = jnp.ones_like(before)
    result = jax.lax.while_loop(unfinished, improve, (zero, before, one, after, one, 0))
    return jax.lax.stop_gradient(result[2])
