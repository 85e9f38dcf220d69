"""The first event of each run, located by the steps of the run itself.

Each accepted step is searched by its dense output: the conditions are sampled, and a change of
sign, or a dip that might hide two, is bracketed (`_event_bracket`). A run whose event lies in the
step waits there. When all runs wait or have ended, the steps that hold the events are repeated with
a shorter length, until Newton's method has brought the condition at their ends to zero. A state at
an event is thus the end of a step, and the program holds the vector field once.

    x_{k+1} = x_k - g / (dg/ds)            x: length of the last step, normalised time

The runs repeat these steps together, and each run takes its part of the common step (`OwnStep`).

    symbol    meaning                                                      unit
    g         condition of an event                                        any
    s         normalised time                                              1
"""

from typing import NamedTuple, final

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..core import Scalar, State
from ..core.barrier import barrier
from ..core.safe import safe_divide
from ..solvers.tolerances import Tolerance
from ._event_bracket import Place
from .event_zero import APART, ROUNDINGS, Zero, candidates, dips, first_in_intervals
from .events import Event
from .normalised_time import OwnStep
from .status import Status

# Number of parts of a step that are sampled at once.
PARTS = 16
# Most repetitions of a step until its end is at the event. Three reach rounding where the condition
# is smooth; elsewhere the best result so far is used.
REPETITIONS = 12


@final
class SoughtEvents(eqx.Module):
    """Which events end the runs.

    - `events`: all of them end a run.
    - `rounding`: change of each condition for a relative change of one in all components of the
      initial state."""

    events: tuple[Event, ...]
    rounding: Float[Array, "events *#runs"]


class Location(NamedTuple):
    """State of the search for the first event of each run.

    - `waiting`: whether the run waits at the step that holds its event; `which`: the number of the
      event, or -1 for a run that has ended for another reason, given by its `status`.
    - `start`, `y0`: the normalised time and the state at which that step begins; `whole`: its
      length; `length`: that up to the event; `y`: the state there.
    - `sizes`: the largest value of each condition so far.
    - `change`: the last change of the length; `again`: whether the step is still repeated.
    - `placed`, `missed`: the length by the dense output, and the condition there, once another
      place is tried; NaN before that, and a `missed` that is infinite where the other one is worse.
    - `repetitions`: their number so far."""

    waiting: Bool[Array, "*runs"]
    which: Int[Array, "*runs"]
    status: Int[Array, "*runs"]
    start: Float[Array, "*runs"]
    y0: State
    length: Float[Array, "*runs"]
    whole: Float[Array, "*runs"]
    y: State
    sizes: Float[Array, "events *#runs"]
    change: Float[Array, "*runs"]
    placed: Float[Array, "*runs"]
    missed: Float[Array, "*runs"]
    again: Bool[Array, "*runs"]
    repetitions: Int[Array, ""]

    def ended(self, y: State) -> State:
        """The state at the event of each run; `y` of those without one."""
        return jax.tree.map(lambda a, b: jnp.where(self.waiting, a, b), self.y, y)

    @classmethod
    def none_yet(
        cls, sought: SoughtEvents, s: Array, y0: State, tolerance: Tolerance
    ) -> "Location":
        """The search before the first step, at the normalised time `s`."""
        no = jnp.zeros_like(tolerance.alive(y0))
        zero = jnp.zeros(no.shape, s.dtype)
        count = len(sought.events)
        sizes = jnp.zeros((count, *no.shape), jax.tree.leaves(y0)[0].dtype)
        return cls(
            waiting=no,
            which=-jnp.ones(no.shape, jnp.int32),
            status=jnp.zeros(no.shape, jnp.int32),
            start=zero + s,
            y0=y0,
            length=zero,
            whole=zero,
            y=y0,
            sizes=sizes,
            change=zero + jnp.inf,
            placed=zero + jnp.nan,
            missed=sizes[0] + jnp.nan,
            again=no,
            repetitions=jnp.asarray(0),
        )


class FoundEvents(NamedTuple):
    """The first event of each run.

    - `time`, `which`: its time, s, and its number; the end of the run and -1 where none happens.
    - `status`: `COMPLETED`, or why the search failed before that time; `failed`: how long after the
      start, s, infinite where it did not.
    - `hits`, `sizes`: of each event, whether it may happen together with the first one, and the
      largest value of its condition.
    - `state`: the state at its time, if the search has integrated to it."""

    time: Scalar
    which: Int[Array, "*runs"]
    status: Int[Array, "*runs"]
    failed: Scalar
    hits: Bool[Array, "events *#runs"]
    sizes: Float[Array, "events *#runs"]
    state: State | None = None

    def met(self, y: State) -> State:
        """The state `y` of a second run to the event, with the numbers that the search met there.

        Two runs differ by the tolerance, and what jumps at the event must not have jumped yet: the
        rate beyond it does not determine the time. The derivatives stay those of `y`."""
        if self.state is None:
            return y
        fixed = jax.lax.stop_gradient
        return jax.tree.map(
            lambda a, b: jnp.where(self.which >= 0, fixed(a) + (b - fixed(b)), b), self.state, y
        )


class _AlongStep(NamedTuple):
    """The condition of an event within a step, by its polynomial."""

    event: Event
    segment: OwnStep
    step: diffrax.AbstractLocalInterpolation
    runs: tuple[int, ...]

    def condition(self, t: Scalar, y: State = None) -> Scalar:
        """The condition at the normalised time `t`."""
        y = self.step.evaluate(t)
        # One time for each run, also where all share it.
        time = jnp.broadcast_to(self.segment.time(t), self.runs)
        return self.event.condition(time.astype(jax.tree.leaves(y)[0].dtype), y)

    def value(self, t: Scalar) -> Scalar:
        """The function that is zero at the event: the condition, or its rate for a touch."""
        if self.event.touch is None:
            return self.condition(t)
        rate = jax.jvp(self.condition, (t,), (jnp.ones_like(t),))[1]
        return rate / self.segment.rate.astype(rate.dtype)

    def at(self, t: Scalar) -> Place:
        """The `value` and its rate in normalised time."""
        # Many operations read them, with each of which the compiler would evaluate them again.
        return Place(*barrier(jax.jvp(self.value, (t,), (jnp.ones_like(t),))))


class SearchedStep(NamedTuple):
    """An accepted step: its times, its polynomial, its start and its end in normalised time, the
    state where it starts, and the part of the run that it passes."""

    segment: OwnStep
    polynomial: diffrax.AbstractLocalInterpolation
    s0: Float[Array, ""]
    s1: Float[Array, ""]
    y0: State
    width: Float[Array, ""]


class _SearchState(NamedTuple):
    """The first event of each run in the parts of a step that were searched, as in `Location`.

    - `part`: the number of the next part to search."""

    part: Int[Array, ""]
    here: Bool[Array, "*runs"]
    s: Float[Array, "*runs"]
    which: Int[Array, "*runs"]
    status: Int[Array, "*runs"]
    sizes: Float[Array, "events *#runs"]


def searched(
    location: Location,
    sought: SoughtEvents,
    step: SearchedStep,
    going: Bool[Array, "*runs"],
    first: Bool[Array, ""],
    span: tuple[Scalar, Scalar],
    tolerance: Tolerance,
) -> Location:
    """The location after a search of the step for the first event of the runs that are `going`.

    `first`: whether the run starts with this step; `span`: its start and its duration, s."""
    runs = going.shape
    samples = max(event.samples for event in sought.events)
    count = jnp.maximum(jnp.ceil(step.width * (samples / PARTS)), 1.0).astype(int)
    shares = jnp.linspace(0.0, 1.0, PARTS + 1, dtype=step.s0.dtype)

    def searching(search: _SearchState) -> Array:
        return (search.part < count) & jnp.any(going & ~search.here)

    def part(search: _SearchState) -> _SearchState:
        length = (step.s1 - step.s0) / count.astype(step.s0.dtype)
        begin = step.s0 + search.part.astype(length.dtype) * length
        end = jnp.where(search.part + 1 == count, step.s1, begin + length)
        nodes = begin + shares * (end - begin)
        earliest = jnp.full(runs, jnp.inf)
        which = -jnp.ones(runs, jnp.int32)
        status = jnp.full(runs, Status.COMPLETED, jnp.int32)
        sizes = []
        at_start = first & (search.part == 0)
        for number, event in enumerate(sought.events):
            size = search.sizes[number]
            along = _AlongStep(event, step.segment, step.polynomial, runs)
            zero = _first_zero(along, nodes, at_start, sought.rounding[number], size, span)
            sizes.append(zero.size)
            sooner = zero.hit & (zero.time < earliest)
            which = jnp.where(sooner, number, which)
            status = jnp.where(sooner, Status.EVENT, status)
            # A failure counts if it comes before the event.
            failed = zero.failed <= jnp.minimum(earliest, jnp.where(zero.hit, zero.time, jnp.inf))
            earliest = jnp.where(sooner, zero.time, earliest)
            status = jnp.where(failed, zero.status, status)
            earliest = jnp.where(failed, zero.failed, earliest)
        here = going & ~search.here & jnp.isfinite(earliest)
        # What is selected by them would compute them again.
        here, earliest, which, status = barrier((here, earliest, which, status))
        return _SearchState(
            search.part + 1,
            search.here | here,
            jnp.where(here, earliest, search.s),
            jnp.where(here, which, search.which),
            jnp.where(here, status, search.status),
            jnp.where(going & ~search.here, jnp.stack(sizes), search.sizes),
        )

    nothing = _SearchState(
        jnp.asarray(0),
        jnp.zeros(runs, bool),
        jnp.broadcast_to(step.s1, runs),
        location.which,
        location.status,
        location.sizes,
    )
    search = jax.lax.while_loop(searching, part, nothing)
    here = search.here

    def updated(new: Array, old: Array) -> Array:
        return jnp.where(here, new, old)

    return location._replace(
        waiting=location.waiting | here,
        which=updated(search.which, location.which),
        status=updated(search.status, location.status),
        start=updated(step.s0, location.start),
        y0=jax.tree.map(updated, step.y0, location.y0),
        length=updated(search.s - step.s0, location.length),
        y=jax.tree.map(updated, step.y0, location.y),
        whole=updated(step.s1 - step.s0, location.whole),
        # The dense output is accurate to a hundredth of the step.
        change=updated(0.02 * (step.s1 - step.s0), location.change),
        again=jnp.where(here, search.which >= 0, location.again),
        sizes=search.sizes,
    )


def _first_zero(
    along: _AlongStep,
    nodes: Float[Array, " nodes"],
    at_start: Bool[Array, ""],
    rounding: Scalar,
    size: Scalar,
    span: tuple[Scalar, Scalar],
) -> Zero:
    """The first zero of an event between the `nodes` of a step, all in normalised time.

    `rounding` and `size` are of the condition, so far; `span` the start and duration of the run,
    s."""
    event, runs = along.event, along.runs
    g, slopes, *_ = jax.vmap(along.at)(nodes)
    columns = jnp.broadcast_to(nodes.reshape(-1, *(1,) * len(runs)), g.shape)
    dip = dips(columns, g, slopes)
    size = jnp.maximum(size, jnp.max(jnp.abs(g), axis=0))
    start, duration = span
    # The rounding of the time, from the rate per second and the largest time of the run.
    second = along.segment.rate.astype(g.dtype)
    longest = jnp.maximum(jnp.abs(start), jnp.abs(duration))
    change = rounding + size + jnp.abs(safe_divide(slopes[0], second)) * longest
    eps = float(jnp.finfo(g.dtype).eps)
    at_zero = at_start & (jnp.abs(g[0]) <= ROUNDINGS * eps * change)
    ill = ~jnp.isfinite(g)
    g, candidate = candidates(g, dip, at_zero, slopes[0], event.direction)
    when, hit, unresolved = first_in_intervals(lambda index: along, columns, g, slopes, candidate)
    if event.at_start:
        now = at_zero & (event.direction * slopes[0] >= 0.0)
        when = jnp.where(now, nodes[0], when)
        hit = hit | now
        unresolved = unresolved & ~now
    time = along.segment.time(when)
    after = jnp.abs(time - start)
    resolved = APART * eps * jnp.maximum(jnp.abs(start), jnp.abs(time))
    piled = at_zero & hit & (after <= resolved) & (not event.at_start)
    status = jnp.where(piled, Status.EVENTS_PILE_UP, Status.EVENT_UNRESOLVED)
    failed = jnp.where(piled | unresolved, when, jnp.inf)
    ill_at = jnp.where(jnp.any(ill, axis=0), nodes[jnp.argmax(ill, axis=0)], jnp.inf)
    status = jnp.where(ill_at <= failed, Status.CONDITION_NOT_FINITE, status)
    return Zero(when, hit, size, status.astype(jnp.int32), jnp.minimum(ill_at, failed))


def shortened(
    location: Location,
    sought: SoughtEvents,
    segment: OwnStep,
    polynomial: diffrax.AbstractLocalInterpolation,
    s1: Float[Array, ""],
    y1: State,
) -> Location:
    """The location after the steps that hold the events were repeated with their `length`, up to
    `s1` in shared time, where the states are `y1`."""
    none = jnp.zeros(location.which.shape, jax.tree.leaves(y1)[0].dtype)
    value = none
    slope = none
    first = none
    first_slope = none
    for number, event in enumerate(sought.events):
        along = _AlongStep(event, segment, polynomial, location.which.shape)
        # At both ends of the step, with one copy of the condition in the program.
        values, slopes, *_ = jax.vmap(along.at)(jnp.stack([jnp.zeros_like(s1), s1]))
        mine = location.which == number
        value, slope = jnp.where(mine, values[1], value), jnp.where(mine, slopes[1], slope)
        first = jnp.where(mine, values[0], first)
        first_slope = jnp.where(mine, slopes[0], first_slope)
    length = location.length
    # dg/ds of a step that is `length` long in s.
    change = -safe_divide(value, slope).astype(length.dtype) * length
    # Newton's method converges from the zero of the dense output, unless the field jumps at the
    # event, as at the end of the propellant. Beyond it the condition may be flat, and the stages of
    # a step that lie there bend its dense output and falsify its end. The slope at its start is
    # right: the place to which it leads is taken if the condition is nearer to zero there. Where
    # the condition itself jumps it is not, and the place by the dense output stays.
    lost = ~(jnp.abs(change) <= 0.5 * location.change)
    flat = (slope == 0.0) & (value * first < 0.0)
    place = -safe_divide(first, first_slope).astype(length.dtype) * length
    untried = jnp.isnan(location.placed)
    tried = untried & (flat | lost & (location.repetitions == 0))
    tried = tried & (place > 0.0) & (place <= location.whole)
    worse = ~untried & ~(jnp.abs(value) < location.missed)
    change = jnp.where(tried, place - length, change)
    change = jnp.where(worse, location.placed - length, change)
    within = jnp.clip(length + change, 0.0, location.whole)
    change = within - length
    least = 16.0 * jnp.finfo(length.dtype).eps
    resolved = least * jnp.maximum(jnp.abs(location.start + length), location.whole)
    more = location.again & (~lost | tried | worse) & (jnp.abs(change) > resolved)
    more = more & ~jnp.isinf(location.missed) & (location.repetitions + 1 < REPETITIONS)
    taken = location.again
    change, within, more = barrier((change, within, more))
    return location._replace(
        y=jax.tree.map(lambda a, b: jnp.where(taken, a, b), y1, location.y),
        length=jnp.where(more, within, length),
        change=jnp.where(more, jnp.abs(change), location.change),
        placed=jnp.where(tried, length, location.placed),
        missed=jnp.where(tried, jnp.abs(value), jnp.where(worse, jnp.inf, location.missed)),
        again=more,
        repetitions=location.repetitions + 1,
    )
