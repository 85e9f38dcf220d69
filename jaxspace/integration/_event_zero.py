"""The first zero of one event along each run: sampled, and closed in interval by interval."""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..core import AbstractSystem, Scalar, State
from ._event_bracket import ConditionOnRun, close_in
from ._events import Event
from ._status import Status

# Of the second difference, and some more for what bends: a corner, as of a distance to a place that
# is passed, dips below its lowest sample by half of it at most, a parabola by an eighth.
REACH = 0.55
# Roundings that a state at an event itself leaves in its condition.
ROUNDINGS = 64.0
# Roundings of the time between two events that are resolved as two.
APART = 256.0


class Zero(NamedTuple):
    """The first zero of one event: its time, whether it happens, and the size of the condition; how
    the search failed, and how long after the start, s (infinite where it did not)."""

    time: Scalar
    hit: Bool[Array, "*runs"]
    size: Scalar
    status: Int[Array, "*runs"]
    failed: Scalar


class Samples(NamedTuple):
    """A condition along each run.

    - `times`, `states`, `g`: of the samples, which lead; at a zero at the start `g` has the sign
      that it is about to take.
    - `candidate`: the intervals in which there may be a zero.
    - `at_zero`: whether the start is a zero, to rounding; `away`, the rate along the run there.
    - `size`: the largest condition.
    - `ill`: how long after the start, s, it is first not finite."""

    times: Float[Array, "samples *#runs"]
    states: State
    g: Float[Array, "samples *#runs"]
    candidate: Bool[Array, "intervals *#runs"]
    at_zero: Bool[Array, "*runs"]
    away: Scalar
    size: Scalar
    ill: Scalar


def first_zero(along: ConditionOnRun, y0: State, t0: Scalar, t1: Scalar) -> Zero:
    """The first zero of the condition of each run between `t0` and `t1`, s."""
    # Equal parts of the time, from the dense output of one integration.
    fractions = jnp.linspace(0.0, 1.0, along.event.samples + 1, dtype=jnp.result_type(t0))
    times = t0 + jnp.multiply.outer(fractions, t1 - t0)
    samples = sampled(along, times, along.states(y0, t0, t1, fractions))
    when, hit, unresolved = _first_in_intervals(along, samples, t1)
    event = along.event
    at_zero = samples.at_zero
    if event.at_start:
        now = at_zero & (event.direction * samples.away >= 0.0)
        when = jnp.where(now, t0, when)
        hit = hit | now
        unresolved = unresolved & ~now
    after = jnp.abs(when - t0)
    eps = float(jnp.finfo(samples.g.dtype).eps)
    resolved = APART * eps * jnp.maximum(jnp.abs(t0), jnp.abs(when))
    # An event that the rounding of the time cannot tell from the start, as of a ball at rest.
    piled = at_zero & hit & (after <= resolved) & (not event.at_start)
    status = jnp.where(piled, Status.EVENTS_PILE_UP, Status.EVENT_UNRESOLVED)
    failed = jnp.where(piled | unresolved, after, jnp.inf)
    # Of two reasons, the one that comes first on the way.
    status = jnp.where(samples.ill <= failed, Status.CONDITION_NOT_FINITE, status)
    failed = jnp.minimum(samples.ill, failed)
    return Zero(when, hit, samples.size, status.astype(jnp.int32), failed)


def sampled(along: ConditionOnRun, times: Float[Array, "samples *#runs"], states: State) -> Samples:
    """The condition at these times, s, and the states there, times first."""
    system, event, _, run_axes = along
    t0, t1 = times[0], times[-1]
    y0 = jax.tree.map(lambda x: x[0], states)
    g = jnp.broadcast_to(jax.vmap(along.value)(times, states), times.shape)
    # Slopes at the two ends only: they stand in for the samples that lie beyond the run.
    ends = jax.tree.map(lambda x: x[:: times.shape[0] - 1], (times, states))
    slopes = jax.vmap(lambda t, y: along.slope(t, y)[1])(*ends)
    dip = _dips(g, (times[1] - times[0]) * slopes)
    size = jnp.max(jnp.abs(g), axis=0)
    span = jnp.maximum(jnp.abs(t0), jnp.abs(t1 - t0))
    change = rounding_change(event, system, t0, y0, run_axes) + size + jnp.abs(slopes[0]) * span
    at_zero = jnp.abs(g[0]) <= ROUNDINGS * float(jnp.finfo(g.dtype).eps) * change
    ill = ill_after(g, states, times, run_axes)
    # From a zero (a ball on the floor) the condition has the sign that it is about to take. The
    # slope is that along the run, which may go backwards in time.
    away = jnp.sign(t1 - t0) * slopes[0]
    g = g.at[0].set(jnp.where(at_zero, jnp.sign(away), g[0]))
    rise = (g[:-1] < 0.0) & (g[1:] >= 0.0)
    fall = (g[:-1] > 0.0) & (g[1:] <= 0.0)
    crossing = {1: rise, -1: fall, 0: rise | fall}[event.direction]
    candidate = crossing | dip & ~(rise | fall)
    return Samples(times, states, g, candidate, at_zero, away, size, ill)


def _first_in_intervals(
    along: ConditionOnRun, samples: Samples, t1: Scalar
) -> tuple[Scalar, Array, Array]:
    """The time of the first zero of each run, whether there is one, and whether the search for it
    did not converge."""
    candidate, count = samples.candidate, along.event.samples
    numbers = jnp.arange(count).reshape(-1, *(1,) * (candidate.ndim - 1))

    # Intervals are looked at one by one, because a dip may prove to hold no zero.
    def look(found: tuple[Scalar, Array, Array, Array]) -> tuple[Scalar, Array, Array, Array]:
        when, hit, unresolved, first = found
        ahead = candidate & (numbers >= first)
        index = jnp.argmax(ahead, axis=0)
        y, t, value = pick((samples.states, samples.times, samples.g), index, along.run_axes)
        end, other = pick((samples.times, samples.g), index + 1, along.run_axes)
        wanted = jnp.any(ahead, axis=0) & ~hit & ~unresolved
        there, met, sure = close_in(along, (t, end), y, (value, other), wanted)
        good = wanted & met & sure
        unresolved = unresolved | (wanted & ~sure)
        last = good | ~wanted | unresolved
        when = jnp.where(wanted & (good | unresolved), there, when)
        return when, hit | good, unresolved, jnp.where(last, count, index + 1)

    runs = candidate.shape[1:]
    nowhere = jnp.zeros(runs, bool)
    start = (jnp.broadcast_to(t1, runs), nowhere, nowhere, jnp.zeros(runs, int))
    when, hit, unresolved, _ = jax.lax.while_loop(
        lambda found: jnp.any(candidate & (numbers >= found[3])), look, start
    )
    return when, hit, unresolved


def pick(tree: State, index: Array, run_axes: int) -> State:
    """Of blocks with the samples on the first axis, the one at `index` of each run."""

    def leaf(x):
        where = index.reshape(1, *(1,) * (x.ndim - 1 - run_axes), *index.shape)
        return jnp.take_along_axis(
            x, jnp.broadcast_to(where, (1, *x.shape[1 : x.ndim - run_axes], *index.shape)), axis=0
        )[0]

    return jax.tree.map(leaf, tree)


def ill_after(g: Array, states: State, times: Array, run_axes: int) -> Scalar:
    """How long after the start, s, the condition of a finite state is first not finite; infinite
    where it always is. A state that is not finite has a status of its own."""
    ill = ~jnp.isfinite(g)
    for x in jax.tree.leaves(states):
        ill = ill & jnp.all(jnp.isfinite(x), axis=tuple(range(1, x.ndim - run_axes)))
    after = jnp.abs(pick(times, jnp.argmax(ill, axis=0), run_axes) - times[0])
    return jnp.where(jnp.any(ill, axis=0), after, jnp.inf)


def rounding_change(
    event: Event, system: AbstractSystem, t: Scalar, y: State, run_axes: int
) -> Scalar:
    """sum |dg/dy_i| |y_i|: what a relative change of one in every component does to the condition.

    Times the rounding, it is what the rounded state leaves of a zero."""
    leaves, structure = jax.tree.flatten(y)
    total = jnp.zeros_like(t)
    for k, leaf in enumerate(leaves):
        shape = leaf.shape[: leaf.ndim - run_axes]
        # Component by component, because it is their absolute values that add up.
        basis = jnp.eye(math.prod(shape), dtype=leaf.dtype).reshape(-1, *shape, *(1,) * run_axes)

        def value(x: Array, k: int = k) -> Scalar:
            return event.value(system, t, structure.unflatten([*leaves[:k], x, *leaves[k + 1 :]]))

        def change(direction: Array, leaf: Array = leaf, value=value) -> Array:
            return jax.jvp(value, (leaf,), (direction * leaf,))[1]

        total = total + jnp.sum(jnp.abs(jax.vmap(change)(basis)), axis=0)
    return total


def _dips(g: Array, changes: Array) -> Array:
    """For each interval whether the condition might dip through zero and back within it.

    Beyond the ends of the span it goes on as its slopes there say: by the `changes` in an interval.
    """
    last = jnp.concatenate([g[:1] - changes[:1], g[:-1]])
    following = jnp.concatenate([g[1:], g[-1:] + changes[1:]])
    sign = jnp.sign(g)
    near = (
        (sign * g <= sign * last)
        & (sign * g <= sign * following)
        & (sign * last > 0.0)
        & (sign * following > 0.0)
    )
    near = near & (sign * g < REACH * sign * (last - 2.0 * g + following))
    return near[:-1] | near[1:]
