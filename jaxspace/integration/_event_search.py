"""The search for the first event of each run, outside every derivative.

The zero is bracketed on samples of the dense output and then closed in by Newton's method within
its bracket. A dip between the samples is examined, too: where the middle one of three samples of
one sign is nearest to zero, and so near that the second difference g_- - 2 g + g_+ might reach it,
the extremum is found by the secant of the slopes, and the search continues from the first place
beyond zero.

A zero at the start, to rounding, is the event at which the run before has ended. Nothing is
reported unchecked: a search that does not converge, a condition that is not finite and events that
follow each other faster than the time resolves have a status each.
"""

import math
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from ..core import AbstractSystem, Scalar, State, safe_divide
from ._config import IntegrationConfig
from ._events import Event
from ._integrate import integrate, state_at, times_first
from ._status import Status

# Steps within the bracket, at most. Four are enough for a simple zero; one of a ball's last bounces
# is next to another zero, the start, where Newton's method gains a bit a step, as bisection does.
CLOSING_STEPS = 128
# Width, as a part of an interval, to which the place of an extremum is sought.
NARROW = 1e-4
# Of the second difference: a parabola dips below its lowest sample by an eighth of it at most.
REACH = 0.25
# Roundings that a state at an event itself leaves in its condition.
ROUNDINGS = 64.0
# Roundings of the time between two events that are resolved as two.
APART = 256.0


class FoundEvents(NamedTuple):
    """What the search has found for each run.

    - `time`, `which`: of the first event: its time, s, and its number; the end of the run and -1
      where none happens.
    - `status`: `COMPLETED`, or why the search failed before that time.
    - `times`, `hits`, `sizes`: of each event its first time, s, whether it happens, and the largest
      condition among the samples."""

    time: Scalar
    which: Int[Array, "*runs"]
    status: Int[Array, "*runs"]
    times: list[Scalar]
    hits: list[Bool[Array, "*runs"]]
    sizes: list[Scalar]


class _Zero(NamedTuple):
    """The first zero of one event: its time, whether it happens, and the size of the condition; how
    the search failed, and how long after the start, s (infinite where it did not)."""

    time: Scalar
    hit: Bool[Array, "*runs"]
    size: Scalar
    status: Int[Array, "*runs"]
    failed: Scalar


def first_event(
    system: AbstractSystem,
    y0: State,
    t0: Scalar,
    t1: Scalar,
    events: tuple[Event, ...],
    config: IntegrationConfig,
    run_axes: int,
) -> FoundEvents:
    """The first event of each run between `t0` and `t1`, s. Not differentiable."""
    system, y0, t0, t1, events = jax.tree.map(_fixed, (system, y0, t0, t1, events))
    zeros = [_first_zero(system, y0, t0, t1, event, config, run_axes) for event in events]
    when, which = t1, -jnp.ones(jnp.shape(t1), jnp.int32)
    for number, zero in enumerate(zeros):
        sooner = zero.hit & ((jnp.abs(zero.time - t0) < jnp.abs(when - t0)) | (which < 0))
        when, which = jnp.where(sooner, zero.time, when), jnp.where(sooner, number, which)
    status = jnp.full(jnp.shape(t1), Status.COMPLETED, jnp.int32)
    # What fails after the first event does not concern the run.
    earliest = jnp.abs(when - t0)
    for zero in zeros:
        sooner = zero.failed <= earliest
        earliest = jnp.where(sooner, zero.failed, earliest)
        status = jnp.where(sooner, zero.status, status)
    return FoundEvents(
        when,
        which,
        status,
        [zero.time for zero in zeros],
        [zero.hit for zero in zeros],
        [zero.size for zero in zeros],
    )


def happened_together(
    system: AbstractSystem,
    events: tuple[Event, ...],
    found: FoundEvents,
    t0: Scalar,
    t: Scalar,
    y: State,
    run_axes: int,
) -> Bool[Array, "events *#runs"]:
    """Which of the events happen at the time `t`, s, of the first one, to rounding.

    All that a run from there on would take for a zero at its start are among them."""
    system, t0, t, y, events = jax.tree.map(_fixed, (system, t0, t, y, events))
    flags = []
    for number, (event, hit, size) in enumerate(zip(events, found.hits, found.sizes, strict=True)):
        value, slope = event.slope(system, t, y)
        zero = _rounding(event, system, t, y, run_axes)
        zero = zero + size + jnp.abs(slope) * jnp.maximum(jnp.abs(t), jnp.abs(t - t0))
        eps = float(jnp.finfo(value.dtype).eps)
        # Twice what counts as a zero at the start, so that none is lost between two runs.
        also = hit & (found.which >= 0) & (jnp.abs(value) <= 2.0 * ROUNDINGS * eps * zero)
        flags.append((found.which == number) | also)
    return jnp.stack(flags)


# A system may hold functions among its leaves.
def _fixed(x: object) -> object:
    return jax.lax.stop_gradient(x) if eqx.is_array(x) else x


def _pick(tree: State, index: Array, run_axes: int) -> State:
    """Of blocks with the samples on the first axis, the one at `index` of each run."""

    def leaf(x):
        where = index.reshape(1, *(1,) * (x.ndim - 1 - run_axes), *index.shape)
        return jnp.take_along_axis(
            x, jnp.broadcast_to(where, (1, *x.shape[1 : x.ndim - run_axes], *index.shape)), axis=0
        )[0]

    return jax.tree.map(leaf, tree)


def _first_zero(
    system: AbstractSystem,
    y0: State,
    t0: Scalar,
    t1: Scalar,
    event: Event,
    config: IntegrationConfig,
    run_axes: int,
) -> _Zero:
    fractions = jnp.linspace(0.0, 1.0, event.samples + 1, dtype=jnp.result_type(t0))
    states = times_first(
        integrate(system, y0, t0, t1, fractions, config, run_axes).states, run_axes
    )
    times = t0 + jnp.multiply.outer(fractions, t1 - t0)
    g = jax.vmap(lambda t, y: event.value(system, t, y))(times, states)
    g = jnp.broadcast_to(g, times.shape)
    ill = _ill_after(g, states, times, run_axes)
    # Slopes at the two ends only: they stand in for the samples that lie beyond the run.
    ends = jax.tree.map(lambda x: x[:: event.samples], (times, states))
    slopes = jax.vmap(lambda t, y: event.slope(system, t, y)[1])(*ends)
    dip = _dips(g, (times[1] - times[0]) * slopes)
    size = jnp.max(jnp.abs(g), axis=0)
    span = jnp.maximum(jnp.abs(t0), jnp.abs(t1 - t0))
    rounding = _rounding(event, system, t0, y0, run_axes) + size + jnp.abs(slopes[0]) * span
    at_zero = jnp.abs(g[0]) <= ROUNDINGS * float(jnp.finfo(g.dtype).eps) * rounding
    # From a zero (a ball on the floor) the condition has the sign that it is about to take. The
    # slope is that along the run, which may go backwards in time.
    away = jnp.sign(t1 - t0) * slopes[0]
    g = g.at[0].set(jnp.where(at_zero, jnp.sign(away), g[0]))
    rise, fall = (g[:-1] < 0.0) & (g[1:] >= 0.0), (g[:-1] > 0.0) & (g[1:] <= 0.0)
    candidate = {1: rise, -1: fall, 0: rise | fall}[event.direction] | dip & ~(rise | fall)
    # Intervals are looked at one by one, because a dip may prove to hold no zero.
    numbers = jnp.arange(event.samples).reshape(-1, *(1,) * (candidate.ndim - 1))

    def look(
        found: tuple[Scalar, Array, Array, Array],
    ) -> tuple[Scalar, Array, Array, Array]:
        when, hit, open_, first = found
        ahead = candidate & (numbers >= first)
        index = jnp.argmax(ahead, axis=0)
        y, t, value = _pick((states, times, g), index, run_axes)
        end, other = _pick((times, g), index + 1, run_axes)
        wanted = jnp.any(ahead, axis=0) & ~hit & ~open_
        there, met, sure = _close_in(
            system, event, (t, end), y, (value, other), wanted, config, run_axes
        )
        good = wanted & met & sure
        open_ = open_ | (wanted & ~sure)
        last = good | ~wanted | open_
        when = jnp.where(wanted & (good | open_), there, when)
        return when, hit | good, open_, jnp.where(last, event.samples, index + 1)

    nowhere = jnp.zeros(candidate.shape[1:], bool)
    start = (
        jnp.broadcast_to(t1, nowhere.shape),
        nowhere,
        nowhere,
        jnp.zeros(nowhere.shape, int),
    )
    when, hit, open_, _ = jax.lax.while_loop(
        lambda found: jnp.any(candidate & (numbers >= found[3])), look, start
    )
    if event.at_start:
        now = at_zero & (event.direction * away >= 0.0)
        when, hit, open_ = jnp.where(now, t0, when), hit | now, open_ & ~now
    after = jnp.abs(when - t0)
    resolved = APART * float(jnp.finfo(g.dtype).eps) * jnp.maximum(jnp.abs(t0), jnp.abs(when))
    piled = at_zero & hit & (after <= resolved) & (not event.at_start)
    # Of two reasons, the one that comes first on the way.
    status = jnp.where(piled, Status.EVENTS_PILE_UP, Status.EVENT_UNRESOLVED)
    failed = jnp.where(piled | open_, after, jnp.inf)
    return _Zero(
        when,
        hit,
        size,
        jnp.where(ill <= failed, Status.CONDITION_NOT_FINITE, status).astype(jnp.int32),
        jnp.minimum(ill, failed),
    )


def _ill_after(g: Array, states: State, times: Array, run_axes: int) -> Scalar:
    """How long after the start, s, the condition of a finite state is first not finite; infinite
    where it always is. A state that is not finite has a status of its own."""
    ill = ~jnp.isfinite(g)
    for x in jax.tree.leaves(states):
        ill = ill & jnp.all(jnp.isfinite(x), axis=tuple(range(1, x.ndim - run_axes)))
    after = jnp.abs(_pick(times, jnp.argmax(ill, axis=0), run_axes) - times[0])
    return jnp.where(jnp.any(ill, axis=0), after, jnp.inf)


def _rounding(event: Event, system: AbstractSystem, t: Scalar, y: State, run_axes: int) -> Scalar:
    """sum |dg/dy_i| |y_i|: what a relative change of one in every component does to the condition.

    Times the rounding, it is what the rounded state leaves of a zero."""
    leaves, structure = jax.tree.flatten(y)
    total = jnp.zeros_like(t)
    for k, leaf in enumerate(leaves):
        shape = leaf.shape[: leaf.ndim - run_axes]
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


class _Search(NamedTuple):
    """Where the zero is sought: between `low`, still on the side of `sign`, and `high`; next at
    `guess`.

    `slopes`: rates at both, positive away from zero, infinite where unknown; `moving`: whether the
    guess still changes."""

    low: Scalar
    high: Scalar
    guess: Scalar
    sign: Scalar
    dip: Array
    slopes: tuple[Scalar, Scalar]
    moving: Array
    left: Array | int
    finite: Array


def _close_in(
    system: AbstractSystem,
    event: Event,
    span: tuple[Scalar, Scalar],
    y: State,
    g: tuple[Scalar, Scalar],
    wanted: Array,
    config: IntegrationConfig,
    run_axes: int,
) -> tuple[Scalar, Array, Array]:
    """The zero within the `span`, from the state `y` on, with the condition `g` at both ends;
    whether there is one, and whether the search converged.

    A dip has one sign at both ends: from the first place with the other one on, it is a span like
    all others, up to there or, where only the way back counts, from there."""
    t, end = span
    least = 16.0 * float(jnp.finfo(t.dtype).eps)
    forwards, back = jnp.sign(end - t), jnp.sign(g[0]) * event.direction > 0.0

    def state(at: Scalar) -> State:
        result = integrate(system, y, t, at, None, config, run_axes)
        return state_at(result.states, -1, run_axes)

    def step(search: _Search) -> _Search:
        low, high, guess, sign, dip, slopes, moving, left, finite = search
        value, slope = event.slope(system, guess, state(guess))
        finite = finite & jnp.isfinite(value)
        same, away = value * sign > 0.0, forwards * sign * slope
        # In a dip, the first place beyond zero ends one search and begins another: which of the two
        # zeros counts depends on the direction.
        turned = dip & ~same & back
        before = jnp.where(dip & same, away < 0.0, same) | turned
        low, high = jnp.where(before, guess, low), jnp.where(before, high, guess)
        slopes = jnp.where(before, away, slopes[0]), jnp.where(before, slopes[1], away)
        sign, dip = jnp.where(turned, -sign, sign), dip & same
        newton = guess - value / jnp.where(slope == 0.0, 1.0, slope)
        # Newton's step only within the bracket: outside of it the dense output is no bound.
        inside = (slope != 0.0) & ((newton - low) * (newton - high) <= 0.0) & ~dip
        share = jnp.where(
            dip & jnp.isfinite(slopes[1] - slopes[0]),
            safe_divide(slopes[0], slopes[0] - slopes[1]),
            0.5,
        )
        following = jnp.where(inside, newton, low + jnp.clip(share, 0.1, 0.9) * (high - low))
        enough = jnp.where(
            dip, NARROW * jnp.abs(end - t), least * jnp.maximum(jnp.abs(guess), jnp.abs(end - t))
        )
        changes = jnp.where(dip, jnp.abs(high - low), jnp.abs(following - guess)) > enough
        moving = moving & changes
        new = _Search(low, high, following, sign, dip, slopes, moving, left, finite)
        # A run that has its zero stays there, however long the others search.
        new = jax.tree.map(
            lambda a, b: jnp.where(search.moving, a, b),
            new._replace(left=0),
            search._replace(left=0),
        )
        return new._replace(left=left - 1)

    unknown = jnp.full_like(t, jnp.inf)
    start = _Search(
        t,
        end,
        0.5 * (t + end),
        jnp.sign(g[0]),
        g[0] * g[1] > 0.0,
        (-unknown, unknown),
        wanted,
        CLOSING_STEPS,
        jnp.ones(jnp.shape(t), bool),
    )
    found = jax.lax.while_loop(
        lambda search: (search.left > 0) & jnp.any(search.moving), step, start
    )
    met = ~found.dip
    if event.touch is not None:
        met = met & (jnp.abs(event.condition(found.guess, state(found.guess))) <= event.touch)
    return found.guess, met, ~found.moving & found.finite
