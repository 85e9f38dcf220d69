"""The zeros of a condition by further integrations: samples of the dense output of one, and short
ones from the sample before each zero.

For methods whose steps cannot be searched while they are taken (`_event_location`)."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..core import AbstractSystem, Scalar, State
from ..core.barrier import barrier
from ._event_bracket import Place, WithinSpan, close_in
from ._in_turn import in_turn
from .config import IntegrationConfig
from .event_zero import (
    APART,
    ROUNDINGS,
    Zero,
    candidates,
    dips,
    ill_after,
    pick,
    rounding_change,
)
from .events import Event
from .integrate import integrate
from .layout import state_at, times_first
from .status import Status


class ConditionOnRun(NamedTuple):
    """The condition of an event along the runs of a system, and the configuration of these runs."""

    system: AbstractSystem
    event: Event
    config: IntegrationConfig
    run_axes: int

    def slope(self, t: Scalar, y: State) -> tuple[Scalar, Scalar]:
        """The `value` and its rate along the motion, 1/s times its unit."""
        return self.event.slope(self.system, t, y)

    def state(self, y: State, t: Scalar, end: Scalar) -> State:
        """The state at `end`, s, of the run that has the state `y` at `t`."""
        # Short integrations, and one more program of a step: a small one.
        config = self.config.small_program()
        result = integrate(self.system, y, t, end, None, config, self.run_axes, trimmed=True)
        return state_at(result.states, -1, self.run_axes)

    def states(self, y: State, t: Scalar, end: Scalar, fractions: Float[Array, " times"]) -> State:
        """The states at these fractions of the time from `t` to `end`, times first."""
        result = integrate(
            self.system, y, t, end, fractions, self.config, self.run_axes, for_search=True
        )
        return times_first(result.states, self.run_axes)


class FromSample(NamedTuple):
    """The condition of an event, by integrations from the state `y` at the time `t`, s."""

    along: ConditionOnRun
    y: State
    t: Scalar

    @property
    def event(self) -> Event:
        """The event."""
        return self.along.event

    def at(self, t: Scalar) -> Place:
        """The function that is zero at the event, and its rate along the run."""
        system = self.along.system
        y = barrier(self.along.state(self.y, self.t, t))
        rate = system.vector_field(t, y)
        # Many operations read them, with each of which the compiler would evaluate them again.
        return barrier(Place(*self.event.slope_along(system, t, y, rate), y, rate))

    def condition(self, t: Scalar, y: State) -> Scalar:
        """The condition itself."""
        return self.event.condition(t, y)


class Samples(NamedTuple):
    """A condition along each run.

    - `times`, `states`, `g`, `slopes`: of the samples, on the first axis; where the start is a
      zero, `g` has the sign that follows.
    - `candidate`: the intervals in which there may be a zero.
    - `at_zero`: whether the start is a zero, to rounding; `away`, the rate along the run there.
    - `size`: the largest condition; `unexplained`: the root mean square of the part of its change
      that its rates do not explain, relative to its own.
    - `ill`: time after the start, s, at which it is first not finite."""

    times: Float[Array, "samples *#runs"]
    states: State
    g: Float[Array, "samples *#runs"]
    slopes: Float[Array, "samples *#runs"]
    candidate: Bool[Array, "intervals *#runs"]
    at_zero: Bool[Array, "*runs"]
    away: Scalar
    size: Scalar
    unexplained: Scalar
    ill: Scalar


def first_zero(along: ConditionOnRun, y0: State, t0: Scalar, t1: Scalar) -> Zero:
    """The first zero of the condition of each run between `t0` and `t1`, s."""
    # Equal parts of the time, from the dense output of one integration.
    fractions = jnp.linspace(0.0, 1.0, along.event.samples + 1, dtype=jnp.result_type(t0))
    times = t0 + jnp.multiply.outer(fractions, t1 - t0)
    samples = sampled(along, times, along.states(y0, t0, t1, fractions))

    def within(index: Array) -> WithinSpan:
        return FromSample(along, *pick((samples.states, samples.times), index, along.run_axes))

    given = samples.times, samples.g, samples.slopes, samples.candidate
    result = _first_in_intervals(within, *given)
    when, hit, unresolved = result
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
    # An event within the rounding of the time of the start, as of a ball at rest.
    piled = at_zero & hit & (after <= resolved) & (not event.at_start)
    status = jnp.where(piled, Status.EVENTS_PILE_UP, Status.EVENT_UNRESOLVED)
    failed = jnp.where(piled | unresolved, after, jnp.inf)
    # If there are two reasons, the one that comes first along the run counts.
    status = jnp.where(samples.ill <= failed, Status.CONDITION_NOT_FINITE, status)
    failed = jnp.minimum(samples.ill, failed)
    return Zero(when, hit, samples.size, status.astype(jnp.int32), failed)


def _first_in_intervals(
    within: Callable[[Int[Array, "*runs"]], WithinSpan],
    times: Float[Array, "samples *#runs"],
    g: Float[Array, "samples *#runs"],
    slopes: Float[Array, "samples *#runs"],
    candidate: Bool[Array, "intervals *#runs"],
) -> tuple[Scalar, Bool[Array, "*runs"], Bool[Array, "*runs"]]:
    """The first zero of a condition between samples.

    **Arguments**

    - `within`: the condition in the interval of this number, of each run.
    - `times`, `g`, `slopes`: of the samples, the condition there and its rates.
    - `candidate`: the intervals in which there may be a zero.

    **Returns** the time, that of the last sample where there is none; whether there is a zero; and
    whether the search for it did not converge."""
    count, *runs = candidate.shape
    numbers = jnp.arange(count).reshape(-1, *(1,) * len(runs))

    # Intervals are searched one by one, because a dip may turn out to hold no zero.
    def look(search: tuple[Scalar, Array, Array, Array]) -> tuple[Scalar, Array, Array, Array]:
        when, hit, unresolved, first = search
        ahead = candidate & (numbers >= first)
        index = jnp.argmax(ahead, axis=0)
        samples = times, g, slopes
        first_end, last_end = (pick(samples, index + k, len(runs)) for k in (0, 1))
        span, values, rates = zip(first_end, last_end, strict=True)
        sought = jnp.any(ahead, axis=0) & ~hit & ~unresolved
        zero = close_in(within(index), span, values, rates, sought)
        good = sought & zero.met & zero.sure
        unresolved = unresolved | (sought & ~zero.sure)
        last = good | ~sought | unresolved
        when = jnp.where(sought & (good | unresolved), zero.time, when)
        return when, hit | good, unresolved, jnp.where(last, count, index + 1)

    nowhere = jnp.zeros(tuple(runs), bool)
    start = (
        jnp.broadcast_to(times[-1], tuple(runs)),
        nowhere,
        nowhere,
        jnp.zeros(tuple(runs), int),
    )
    when, hit, unresolved, _ = jax.lax.while_loop(
        lambda search: jnp.any(candidate & (numbers >= search[3])), look, start
    )
    return when, hit, unresolved


def sampled(along: ConditionOnRun, times: Float[Array, "samples *#runs"], states: State) -> Samples:
    """The condition at these times, s, and the states there, times first."""
    system, event, _, run_axes = along
    t0, t1 = times[0], times[-1]
    y0 = jax.tree.map(lambda x: x[0], states)
    g, slopes = in_turn(lambda sample: along.slope(*sample), (times, states))
    g, slopes = jnp.broadcast_to(g, times.shape), jnp.broadcast_to(slopes, times.shape)
    dip = dips(times, g, slopes)
    size = jnp.max(jnp.abs(g), axis=0)
    span = jnp.maximum(jnp.abs(t0), jnp.abs(t1 - t0))
    change = rounding_change(event, system, t0, y0, run_axes) + size + jnp.abs(slopes[0]) * span
    at_zero = jnp.abs(g[0]) <= ROUNDINGS * float(jnp.finfo(g.dtype).eps) * change
    ill = ill_after(g, states, times, run_axes)
    away = jnp.sign(t1 - t0) * slopes[0]
    unexplained = _change_unexplained(times, g, slopes)
    g, candidate = candidates(g, dip, at_zero, away, event.direction)
    return Samples(times, states, g, slopes, candidate, at_zero, away, size, unexplained, ill)


def _change_unexplained(times: Array, g: Array, slopes: Array) -> Scalar:
    """Root mean square of the part of the condition's change that its rates do not explain,
    relative to that of the condition."""
    steps = jnp.diff(times, axis=0)
    change = jnp.diff(g, axis=0) - 0.5 * steps * (slopes[1:] + slopes[:-1])
    size = jnp.sqrt(jnp.mean(g * g, axis=0))
    rms = jnp.sqrt(jnp.mean(change * change, axis=0))
    return jnp.where(size > 0.0, rms / jnp.where(size > 0.0, size, 1.0), 0.0)
