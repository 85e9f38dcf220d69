"""The zeros of a condition by further integrations: samples of the dense output of one, and short
ones from the sample before each zero.

For methods whose steps cannot be searched while they are taken (`_event_state`)."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..core import AbstractSystem, Scalar, State
from ..core.barrier import barrier
from ..core.status import Status
from ._event_bracket import ConditionValue, close_in
from ._in_turn import in_turn
from .config import IntegrationConfig
from .event_zero import (
    RESOLVED_ROUNDINGS,
    ROUNDINGS,
    Root,
    candidates,
    dips,
    ill_after,
    next_candidates,
    pick,
    put,
    rounding_change,
)
from .events import Event
from .integrate import integrate
from .layout import state_at, times_first


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
        config = self.config.rolled_stages()
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

    on_run: ConditionOnRun
    y: State
    t: Scalar

    @property
    def event(self) -> Event:
        """The event."""
        return self.on_run.event

    def at(self, t: Scalar) -> ConditionValue:
        """The function that is zero at the event, and its rate along the run."""
        system = self.on_run.system
        y = barrier(self.on_run.state(self.y, self.t, t))
        rate = system.vector_field(t, y)
        # Many operations read them, with each of which the compiler would evaluate them again.
        return barrier(ConditionValue(*self.event.slope_along(system, t, y, rate), y, rate))

    def condition(self, t: Scalar, y: State) -> Scalar:
        """The condition itself."""
        return self.event.condition(t, y)


class Samples(NamedTuple):
    """A condition along each run.

    - `times`, `states`, `g`, `slopes`: of the samples, on the first axis; where the start is a
      zero, `g` has the sign that follows.
    - `candidate`: the intervals in which there may be a zero.
    - `at_zero`: whether the start is a zero, to rounding; `away`, the rate along the run there;
      `counts_at_start`: whether such a zero is an event.
    - `size`: the largest condition; `unexplained`: the root mean square of the part of its change
      that its rates do not explain, relative to its own.
    - `ill`: time after the start, s, at which it is first not finite."""

    times: Float[Array, "samples *#runs"]
    states: State
    g: Float[Array, "samples *#runs"]
    slopes: Float[Array, "samples *#runs"]
    candidate: Bool[Array, "intervals *#runs"]
    at_zero: Bool[Array, "*runs"]
    counts_at_start: Bool[Array, "*#runs"]
    away: Scalar
    size: Scalar
    unexplained: Scalar
    ill: Scalar


class Roots(NamedTuple):
    """The zeros of a condition along each run, while they are searched.

    - `times`, `states`, `rising`: of the zeros, on the first axis, as in `Crossings`; `count`: how
      many there are so far.
    - `following`: the next interval to search; `again`: whether it is searched a second time.
    - `unresolved`: whether the search failed, at the time behind the last zero."""

    times: Float[Array, "zeros *#runs"]
    states: State
    rising: Bool[Array, "zeros *#runs"]
    count: Int[Array, "*runs"]
    following: Int[Array, "*runs"]
    again: Bool[Array, "*runs"]
    unresolved: Bool[Array, "*runs"]


def first_zero(
    on_run: ConditionOnRun, y0: State, t0: Scalar, t1: Scalar, start_known: Scalar | None = None
) -> Root:
    """The first zero of the condition of each run between `t0` and `t1`, s; `start_known` as in
    `first_event`, of this event."""
    # Equal parts of the time, from the dense output of one integration.
    fractions = jnp.linspace(0.0, 1.0, on_run.event.samples + 1, dtype=jnp.result_type(t0))
    times = t0 + jnp.multiply.outer(fractions, t1 - t0)
    samples = sampled(on_run, times, on_run.states(y0, t0, t1, fractions), start_known)
    zeros = zeros_between(on_run, samples, 1, 1)
    at_zero = samples.at_zero
    hit = zeros.count > 0
    # Where there is none, the end of the run.
    when = jnp.where(hit | zeros.unresolved, zeros.times[0], t1)
    after = jnp.abs(when - t0)
    eps = float(jnp.finfo(samples.g.dtype).eps)
    resolved = RESOLVED_ROUNDINGS * eps * jnp.maximum(jnp.abs(t0), jnp.abs(when))
    # An event within the rounding of the time of the start, as of a ball at rest.
    piled = at_zero & hit & (after <= resolved) & ~samples.counts_at_start
    status = jnp.where(piled, Status.EVENTS_PILE_UP, Status.EVENT_UNRESOLVED)
    failed = jnp.where(piled | zeros.unresolved, after, jnp.inf)
    # If there are two reasons, the one that comes first along the run counts.
    status = jnp.where(samples.ill <= failed, Status.CONDITION_NOT_FINITE, status)
    failed = jnp.minimum(samples.ill, failed)
    return Root(when, hit, samples.size, status.astype(jnp.int32), failed)


def zeros_between(on_run: ConditionOnRun, samples: Samples, limit: int, rows: int) -> Roots:
    """The first zeros of each run, `limit` of them at most, of which as many `rows` are stored."""
    event, runs = on_run.event, samples.times.shape[1:]
    intervals = samples.candidate.shape[0]

    def sought_in(zeros: Roots) -> Array:
        """Whether each run has another interval to search."""
        return (zeros.following < intervals) & (zeros.count < limit) & ~zeros.unresolved

    # Intervals are searched one by one, because a dip may turn out to contain no zero.
    def next_root(zeros: Roots) -> Roots:
        sought, index = sought_in(zeros), jnp.minimum(zeros.following, intervals - 1)
        knots = samples.times, samples.g, samples.slopes
        t, value, slope = pick(knots, index, on_run.run_axes)
        end, other, last_slope = pick(knots, index + 1, on_run.run_axes)
        dip = (value * other > 0.0) & ~zeros.again
        # The second zero of a dip is sought from its first one, where the sign is opposite.
        number = jnp.clip(zeros.count - 1, 0, rows - 1)
        last = pick(zeros.times, number, on_run.run_axes)
        start = jnp.where(zeros.again, last, t)
        value = jnp.where(zeros.again, -other, value)
        on_span = FromSample(on_run, pick(samples.states, index, on_run.run_axes), t)
        ends = (t, end), (value, other), (slope, last_slope)
        zero = close_in(on_span, *ends, sought, start)
        good = sought & zero.met & zero.sure
        unsure = sought & ~zero.sure
        row = jnp.where(good | unsure, zeros.count, rows)
        found = zero.time, zero.y, zero.rising
        times, states, rising = put(zeros[:3], row, found, on_run.run_axes)
        # The second zero of a dip counts only for an event of both directions.
        again = good & dip & (event.direction == 0)
        return Roots(
            times,
            states,
            rising,
            zeros.count + good.astype(int),
            jnp.where(sought & ~again, pick(ahead, index + 1, on_run.run_axes), zeros.following),
            again,
            zeros.unresolved | unsure,
        )

    def rows_of(x: Array) -> Array:
        return jnp.broadcast_to(x, (rows, *x.shape))

    ahead = next_candidates(samples.candidate)
    none = jnp.zeros(runs, bool)
    admitted = event.direction * samples.away >= 0.0
    at_start = samples.at_zero & admitted & samples.counts_at_start
    start = Roots(
        times=rows_of(samples.times[0]),
        states=jax.tree.map(lambda x: rows_of(x[0]), samples.states),
        rising=rows_of(samples.away > 0.0),
        count=at_start.astype(int),
        following=ahead[0],
        again=none,
        unresolved=none,
    )
    return jax.lax.while_loop(lambda zeros: jnp.any(sought_in(zeros)), next_root, start)


def sampled(
    on_run: ConditionOnRun,
    times: Float[Array, "samples *#runs"],
    states: State,
    start_known: Scalar | None = None,
) -> Samples:
    """The condition at these times, s, and the states there, times first; `start_known` as in
    `first_event`, of this event."""
    system, event, _, run_axes = on_run
    t0, t1 = times[0], times[-1]
    y0 = jax.tree.map(lambda x: x[0], states)
    g, slopes = in_turn(lambda sample: on_run.slope(*sample), (times, states))
    g, slopes = jnp.broadcast_to(g, times.shape), jnp.broadcast_to(slopes, times.shape)
    dip = dips(times, g, slopes)
    size = jnp.max(jnp.abs(g), axis=0)
    span = jnp.maximum(jnp.abs(t0), jnp.abs(t1 - t0))
    known = jnp.zeros_like(size) if start_known is None else start_known
    change = rounding_change(event, system, t0, y0, run_axes) + size + jnp.abs(slopes[0]) * span
    change = change + known
    at_zero = jnp.abs(g[0]) <= ROUNDINGS * float(jnp.finfo(g.dtype).eps) * change
    ill = ill_after(g, states, times, run_axes)
    away = jnp.sign(t1 - t0) * slopes[0]
    unexplained = _change_unexplained(times, g, slopes)
    g, candidate = candidates(g, dip, at_zero, away, event.direction)
    counts = event.at_start & (known < jnp.inf)
    return Samples(
        times, states, g, slopes, candidate, at_zero, counts, away, size, unexplained, ill
    )


def _change_unexplained(times: Array, g: Array, slopes: Array) -> Scalar:
    """Root mean square of the part of the condition's change that its rates do not explain,
    relative to that of the condition."""
    steps = jnp.diff(times, axis=0)
    change = jnp.diff(g, axis=0) - 0.5 * steps * (slopes[1:] + slopes[:-1])
    size = jnp.sqrt(jnp.mean(g * g, axis=0))
    rms = jnp.sqrt(jnp.mean(change * change, axis=0))
    return jnp.where(size > 0.0, rms / jnp.where(size > 0.0, size, 1.0), 0.0)
