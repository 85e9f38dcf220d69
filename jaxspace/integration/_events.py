"""Events: a condition whose zero ends a run, found for every run by itself, differentiable.

    t_e :  g(t_e, y(t_e)) = 0            dt_e = -(dg)/(g_t + g_y f)

The zero is bracketed on samples of the dense output and then closed in by Newton's method within
its bracket, outside every derivative. A dip between the samples is examined, too: where the middle
one of three samples of one sign is nearest to zero, and so near that the second difference
g_- - 2 g + g_+ might reach it, the extremum is found by the secant of the slopes, and the search
continues from the first place beyond zero. One more correction of time and state, inside the
derivatives, carries the exact first derivative through the event: how its time moves, and the state
with it (the saltation).

    symbol  meaning                            unit
    g       condition                          any
    f       vector field of the system         state/s
"""

from collections.abc import Callable
from typing import NamedTuple, final

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from ..core import (
    AbstractSystem,
    InputError,
    Scalar,
    State,
    as_optional_float,
    check_positive,
    safe_divide,
)
from ._config import IntegrationConfig
from ._integrate import integrate, state_at, times_first

# Newton steps within the bracket, at most; four are enough for a simple zero.
CLOSING_STEPS = 24
# Width, as a part of an interval, to which the place of an extremum is sought.
NARROW = 1e-4
# Of the second difference: a parabola dips below its lowest sample by an eighth of it at most.
REACH = 0.25


@final
class Event(eqx.Module):
    """A run stops where `condition(t, y)`, a scalar for each run, passes through zero.

    - `direction`: 1 for a rise, -1 for a fall, 0 for both. A zero at the start is no event.
    - `within`, s: how long to wait for it in a phase.
    - `samples`: how finely the span is searched. Two zeros within one span / `samples` are found
      where the samples about them bend towards zero; a dip so narrow that they do not may be passed
      over.

    Raises `InputError` for another direction or a number of samples below 2."""

    condition: Callable[[Scalar, State], Scalar]
    direction: int = eqx.field(static=True, default=0)
    within: Scalar | None = eqx.field(converter=as_optional_float, default=None)
    samples: int = eqx.field(static=True, default=128)

    def __check_init__(self):
        if self.direction not in (-1, 0, 1):
            raise InputError(
                f"Event.direction is {self.direction}: it must be 1 (rise), -1 (fall) or 0 (both)."
            )
        if self.samples < 2:
            raise InputError(f"Event.samples is {self.samples}: it must be at least 2.")
        check_positive("Event.within", self.within)

    def slope(self, system: AbstractSystem, t: Scalar, y: State) -> tuple[Scalar, Scalar]:
        """The condition and its rate along the motion, 1/s times its unit."""
        rate = system.vector_field(t, y)
        return jax.jvp(self.condition, (t, y), (jnp.ones_like(t), rate))


def _pick(tree: State, index: Array, run_axes: int) -> State:
    """Of blocks with the samples on the first axis, the one at `index` of each run."""

    def leaf(x):
        where = index.reshape(1, *(1,) * (x.ndim - 1 - run_axes), *index.shape)
        return jnp.take_along_axis(
            x, jnp.broadcast_to(where, (1, *x.shape[1 : x.ndim - run_axes], *index.shape)), axis=0
        )[0]

    return jax.tree.map(leaf, tree)


def first_event(
    system: AbstractSystem,
    y0: State,
    t0: Scalar,
    t1: Scalar,
    events: tuple[Event, ...],
    config: IntegrationConfig,
    run_axes: int,
) -> tuple[Scalar, Array]:
    """The time of the first event of each run and its index among `events`; (t1, -1) where none
    happens. Not differentiable."""

    # A system may hold functions among its leaves.
    def fixed(x):
        return jax.lax.stop_gradient(x) if eqx.is_array(x) else x

    system, y0, t0, t1 = jax.tree.map(fixed, (system, y0, t0, t1))
    when, which = t1, -jnp.ones(jnp.shape(t1), jnp.int32)
    for number, event in enumerate(events):
        t, hit = _first_zero(system, y0, t0, t1, event, config, run_axes)
        sooner = hit & ((jnp.abs(t - t0) < jnp.abs(when - t0)) | (which < 0))
        when, which = jnp.where(sooner, t, when), jnp.where(sooner, number, which)
    return when, which


def _first_zero(
    system: AbstractSystem,
    y0: State,
    t0: Scalar,
    t1: Scalar,
    event: Event,
    config: IntegrationConfig,
    run_axes: int,
) -> tuple[Scalar, Array]:
    fractions = jnp.linspace(0.0, 1.0, event.samples + 1, dtype=jnp.result_type(t0))
    states = times_first(
        integrate(system, y0, t0, t1, fractions, config, run_axes).states, run_axes
    )
    times = t0 + jnp.multiply.outer(fractions, t1 - t0)
    g = jax.vmap(event.condition)(times, states)
    # Slopes at the two ends only: they stand in for the samples that lie beyond the run.
    ends = jax.tree.map(lambda x: x[:: event.samples], (times, states))
    slopes = jax.vmap(lambda t, y: event.slope(system, t, y)[1])(*ends)
    dip = _dips(g, (times[1] - times[0]) * slopes)
    # The slope is that along the run, which may go backwards in time.
    g = g.at[0].set(_sign_at_start(g, jnp.sign(t1 - t0) * slopes[0]))
    rise, fall = (g[:-1] < 0.0) & (g[1:] >= 0.0), (g[:-1] > 0.0) & (g[1:] <= 0.0)
    candidate = {1: rise, -1: fall, 0: rise | fall}[event.direction] | dip & ~(rise | fall)
    # Intervals are looked at one by one, because a dip may prove to hold no zero.
    numbers = jnp.arange(event.samples).reshape(-1, *(1,) * (candidate.ndim - 1))

    def look(found: tuple[Scalar, Array, Array]) -> tuple[Scalar, Array, Array]:
        when, hit, first = found
        ahead = candidate & (numbers >= first)
        index = jnp.argmax(ahead, axis=0)
        y, t, value = _pick((states, times, g), index, run_axes)
        end, other = _pick((times, g), index + 1, run_axes)
        wanted = jnp.any(ahead, axis=0) & ~hit
        there, met = _close_in(system, event, (t, end), y, (value, other), wanted, config, run_axes)
        good = wanted & met
        last = good | ~wanted
        return jnp.where(good, there, when), hit | good, jnp.where(last, event.samples, index + 1)

    nowhere = jnp.zeros(candidate.shape[1:], bool)
    start = jnp.broadcast_to(t1, nowhere.shape), nowhere, jnp.zeros(nowhere.shape, int)
    return jax.lax.while_loop(
        lambda found: jnp.any(candidate & (numbers >= found[2])), look, start
    )[:2]


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


def _sign_at_start(g: Array, slope: Scalar) -> Array:
    """The condition at the start; where it is zero to rounding (a ball on the floor), the sign that
    it is about to take."""
    # Some tens of roundings of the largest value: what a state at the event itself leaves.
    zero = jnp.abs(g[0]) <= 64.0 * jnp.finfo(g.dtype).eps * jnp.max(jnp.abs(g), axis=0)
    return jnp.where(zero, jnp.sign(slope), g[0])


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


def _close_in(
    system: AbstractSystem,
    event: Event,
    span: tuple[Scalar, Scalar],
    y: State,
    g: tuple[Scalar, Scalar],
    wanted: Array,
    config: IntegrationConfig,
    run_axes: int,
) -> tuple[Scalar, Array]:
    """The zero within the `span`, from the state `y` on, with the condition `g` at both ends; and
    whether there is one.

    A dip has one sign at both ends: from the first place with the other one on, it is a span like
    all others, up to there or, where only the way back counts, from there."""
    t, end = span
    least = 16.0 * float(jnp.finfo(t.dtype).eps)
    forwards, back = jnp.sign(end - t), jnp.sign(g[0]) * event.direction > 0.0

    def step(search: _Search) -> _Search:
        low, high, guess, sign, dip, slopes, moving, left = search
        there = state_at(
            integrate(system, y, t, guess, None, config, run_axes).states, -1, run_axes
        )
        value, slope = event.slope(system, guess, there)
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
        return _Search(low, high, following, sign, dip, slopes, moving & changes, left - 1)

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
    )
    found = jax.lax.while_loop(
        lambda search: (search.left > 0) & jnp.any(search.moving), step, start
    )
    return found.guess, ~found.dip


def newton_correct(
    system: AbstractSystem, events: tuple[Event, ...], which: Array, t: Scalar, y: State
) -> tuple[Scalar, State]:
    """Time and state at the event, moved by one Newton step whose derivative is that of the
    event."""
    delay = jnp.zeros_like(t)
    for number, event in enumerate(events):
        g, slope = event.slope(system, t, y)
        # The derivative of the slope would only enter the second order, and cost a Jacobian.
        slope = jax.lax.stop_gradient(slope)
        hit = (which == number) & (slope != 0.0)
        delay = jnp.where(hit, -g / jnp.where(hit, slope, 1.0), delay)
    return t + delay, jax.tree.map(lambda a, k: a + k * delay, y, system.vector_field(t, y))
