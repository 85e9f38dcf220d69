"""The first event of each run, located by the steps of the run itself.

Each accepted step is searched by its dense output (`_step_zero`). A run whose event is in the step
repeats it in the following iterations with a shorter length, until Newton's method has brought the
condition at its end to zero, and waits there. A state at an event is therefore the end of a step,
and the program contains the vector field once.

    x_{k+1} = x_k - g / (dg/ds)            x: length of the last step, normalised time


    symbol    meaning                                                      unit
    g         condition of an event                                        any
    s         normalised time                                              1
"""

from collections.abc import Callable
from typing import NamedTuple, final

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..core import AbstractSystem, Scalar, State
from ..core.barrier import barrier
from ..core.safe import safe_divide
from ..core.status import Status
from ..solvers.tolerances import Tolerance
from ._step_zero import PARTS, Bracket, BracketEnds, FlowCondition, StepCondition
from .event_zero import rounding_change
from .events import Event
from .layout import runs_of
from .normalised_time import Segments, StepTimes

# Most repetitions of a step until its end is at the event. Three reach rounding where the condition
# is smooth; elsewhere the best result so far is used.
REPETITIONS = 12
# Fraction of the time before a step, and of a segment, and the least one of a segment.
RESTING, LEAST_RESTING = 1e-8, 5e-10
# Fraction of the time before a step, for any length of the segment.
SHORT_STEP = 1e-6


def resting(s: Float[Array, "*#runs"]) -> Float[Array, "*#runs"]:
    """The length of a step from `s` below which its tangents may rest, in normalised time."""
    return jnp.clip(RESTING * s, LEAST_RESTING, RESTING)


@final
class TerminalEvents(eqx.Module):
    """The events that end the runs.

    - `events`: all of them end a run.
    - `rounding`: change of each condition for a relative change of one in all components of the
      initial state, and `start_known` where that is not zero."""

    events: tuple[Event, ...]
    rounding: Float[Array, "events *#runs"]

    @classmethod
    def of(
        cls,
        events: tuple[Event, ...],
        system: AbstractSystem,
        t0: Scalar,
        y0: State,
        run_axes: int,
        start_known: Float[Array, "events *#runs"] | None = None,
    ) -> "TerminalEvents":
        """The events of runs from the state `y0` at `t0`, s; `start_known` as in `first_event`."""
        t = jnp.broadcast_to(t0, runs_of(y0, run_axes))
        rounding = jnp.stack([rounding_change(each, system, t, y0, run_axes) for each in events])
        return cls(events, rounding if start_known is None else rounding + start_known)


class EventState(NamedTuple):
    """State of the search for the first event of each run.

    - `waiting`: whether the run waits at the step that contains its event; `which`: the number of
      the event, or -1 for a run that has ended for another reason, given by its `status`.
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
    repetitions: Int[Array, "*runs"]

    def stopped(self, y: State) -> State:
        """The state at the event of each run; `y` of those without one."""
        return jax.tree.map(lambda a, b: jnp.where(self.waiting, a, b), self.y, y)

    @property
    def met(self) -> Bool[Array, "*runs"]:
        """Whether each run waits at an event."""
        return self.waiting & (self.which >= 0)

    @property
    def rests(self) -> Bool[Array, "*runs"]:
        """Whether the tangents of each run rest from the start of the step that holds its event.

        No step is as short unless it resolves the tangents of a vector field whose slope is
        infinite at the event (`_sensitivity_control`), where the stages must not be evaluated."""
        return self.met & (self.whole <= jnp.minimum(resting(self.start), SHORT_STEP * self.start))

    @property
    def ends(self) -> Float[Array, "*runs"]:
        """The normalised time up to which the tangents of each run that waits are integrated;
        infinite for the other runs."""
        length = jnp.where(self.rests, 0.0, self.length)
        return jnp.where(self.waiting, self.start + length, jnp.inf)

    def located(self, segments: Segments | StepTimes, t0: Scalar, t1: Scalar) -> "FirstEvent":
        """The events in the time of runs from `t0` to `t1`, s."""
        time = segments.time(self.start + self.length)
        failed = self.waiting & (self.status > Status.EVENT)
        hits = jnp.ones(self.sizes.shape, bool)
        return FirstEvent(
            jnp.where(self.waiting, time, t1),
            self.which,
            jnp.where(failed, self.status, Status.COMPLETED).astype(jnp.int32),
            jnp.where(failed, jnp.abs(time - t0), jnp.inf),
            hits & (self.which >= 0),
            self.sizes,
            self.y,
            (segments.time(self.start), self.y0, self.rests),
        )

    @classmethod
    def none_yet(
        cls, terminal: TerminalEvents, s: Array, y0: State, tolerance: Tolerance
    ) -> "EventState":
        """The search before the first step, at the normalised time `s`."""
        no = jnp.zeros_like(tolerance.alive(y0))
        zero = jnp.zeros(no.shape, s.dtype)
        count = len(terminal.events)
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
            repetitions=jnp.zeros(no.shape, int),
        )


class FirstEvent(NamedTuple):
    """The first event of each run.

    - `time`, `which`: its time, s, and its number; the end of the run and -1 where none happens.
    - `status`: `COMPLETED`, or why the search failed before that time; `failed`: how long after the
      start, s, infinite where it did not.
    - `hits`, `sizes`: of each event, whether it may happen together with the first one, and the
      largest value of its condition.
    - `state`: the state at its time, if the search has integrated to it.
    - `step_start`: time, s, and state at which the step with the event begins, and whether the
      derivatives are those of a run to this place, if steps were searched; otherwise `times` and
      `spacings`: of the first zero of each condition, and between its samples, s."""

    time: Scalar
    which: Int[Array, "*runs"]
    status: Int[Array, "*runs"]
    failed: Scalar
    hits: Bool[Array, "events *#runs"]
    sizes: Float[Array, "events *#runs"]
    state: State | None = None
    step_start: tuple[Scalar, State, Bool[Array, "*runs"]] | None = None
    times: Float[Array, "events *#runs"] | None = None
    spacings: Float[Array, "events *#runs"] | None = None

    def differentiated(
        self, y: State, correct: Callable[[Scalar, State], tuple[Scalar, State]]
    ) -> tuple[Scalar, State]:
        """Time and state of the event with the derivatives of `correct(time, state)`, which adds
        those of the event to those of a run to a fixed time, whose last state is `y`."""
        if self.step_start is None:
            return correct(self.time, y)
        fixed = jax.lax.stop_gradient

        def moved(a: Array, b: Array) -> Array:
            return fixed(a) + (b - fixed(b))

        t_start, y_start, rests = self.step_start
        t = jnp.where(rests, t_start, self.time)
        at = jax.tree.map(lambda a, b: jnp.where(rests, moved(a, b), b), y_start, y)
        time, state = correct(t, at)
        return jax.tree.map(
            lambda a, b: jnp.where(rests, moved(a, b), b), (self.time, y), (time, state)
        )

    def met(self, y: State) -> State:
        """The state `y` of a second run to the event, with the numbers that the search met there.

        Two runs differ by the tolerance, and discontinuities at the event must not have occurred
        yet: the rate beyond it does not determine the time. The derivatives stay those of `y`."""
        if self.state is None:
            return y
        fixed = jax.lax.stop_gradient
        return jax.tree.map(
            lambda a, b: jnp.where(self.which >= 0, fixed(a) + (b - fixed(b)), b), self.state, y
        )


class StepToSearch(NamedTuple):
    """A step of each run, and the part of the run that it passes, `width`.

    - `condition_of`: an event along it, in the time of a step from 0 to 1.
    - `start`, `length`: in normalised time.
    - `y0`, `y1`: the states where it starts and where it ends."""

    condition_of: Callable[[Event], StepCondition | FlowCondition]
    start: Float[Array, "*runs"]
    length: Float[Array, "*runs"]
    y0: State
    y1: State
    width: Float[Array, "*runs"]


class _StepSearch(NamedTuple):
    """The first event of each run in the parts of a step that were searched, as in `EventState`.

    - `part`: the number of the next part to search.
    - `ends`: of the event at which a run waits."""

    part: Int[Array, ""]
    here: Bool[Array, "*runs"]
    s: Float[Array, "*runs"]
    which: Int[Array, "*runs"]
    status: Int[Array, "*runs"]
    sizes: Float[Array, "events *#runs"]
    ends: BracketEnds


def located(
    event_state: EventState,
    terminal: TerminalEvents,
    step: StepToSearch,
    going: Bool[Array, "*runs"],
    moving: Bool[Array, "*runs"],
    first: Bool[Array, "*runs"],
    span: tuple[Scalar, Scalar],
) -> EventState:
    """The location after a step: of a run that is `going` on, after a search if it is `moving`;
    otherwise after the step that holds its event was repeated with its `length`.

    `first`: whether the run starts with this step; `span`: its start and its duration, s."""
    search = _searched(event_state, terminal, step, going, moving, first, span)
    here = search.here
    change, tried, worse, more = _shorter(event_state, search.ends)
    missed = jnp.abs(search.ends.value)
    taken, tried, worse, more = (~going & x for x in (event_state.again, tried, worse, more))
    change, taken, tried, worse, more = barrier((change, taken, tried, worse, more))
    length = event_state.length

    def updated(new: Array, old: Array) -> Array:
        return jnp.where(here, new, old)

    def at_event(start: Array, end: Array, old: Array) -> Array:
        return updated(start, jnp.where(taken, end, old))

    return EventState(
        waiting=event_state.waiting | here,
        which=updated(search.which, event_state.which),
        status=updated(search.status, event_state.status),
        start=updated(step.start, event_state.start),
        y0=jax.tree.map(updated, step.y0, event_state.y0),
        length=updated(search.s * step.length, jnp.where(more, length + change, length)),
        whole=updated(step.length, event_state.whole),
        y=jax.tree.map(at_event, step.y0, step.y1, event_state.y),
        sizes=search.sizes,
        # The dense output is accurate to a hundredth of the step.
        change=updated(0.02 * step.length, jnp.where(more, jnp.abs(change), event_state.change)),
        placed=jnp.where(tried, length, event_state.placed),
        missed=jnp.where(tried, missed, jnp.where(worse, jnp.inf, event_state.missed)),
        again=jnp.where(going, updated(search.which >= 0, event_state.again), more),
        repetitions=event_state.repetitions + event_state.again.astype(int),
    )


def _searched(
    event_state: EventState,
    terminal: TerminalEvents,
    step: StepToSearch,
    going: Bool[Array, "*runs"],
    moving: Bool[Array, "*runs"],
    first: Bool[Array, "*runs"],
    span: tuple[Scalar, Scalar],
) -> _StepSearch:
    """The first event of each run in the parts of its step; for a run that is not `going` on, the
    conditions at the ends of the step. Arguments as of `located`."""
    runs = moving.shape
    samples = max(event.samples for event in terminal.events)
    count = jnp.maximum(jnp.ceil(step.width * (samples / PARTS)), 1.0).astype(int)
    # One sampling provides the conditions at both ends of a repeated step.
    count = jnp.where(going, count, 1)
    searched = jnp.where(going, moving, event_state.again)

    def left(search: _StepSearch) -> Array:
        return (search.part < count) & searched & ~search.here

    def part(search: _StepSearch) -> _StepSearch:
        length = 1.0 / count.astype(step.start.dtype)
        begin = search.part.astype(length.dtype) * length
        end = jnp.where(search.part + 1 == count, 1.0, begin + length)
        at_start = first & (search.part == 0)

        def of(event: Event, rounding: Array) -> Bracket:
            return Bracket(step.condition_of(event), begin, end, at_start, rounding, *span)

        parts = list(map(of, terminal.events, terminal.rounding))
        return _first_of(parts, search, event_state.which, left(search), going)

    none = jnp.zeros(runs, jax.tree.leaves(step.y1)[0].dtype)
    nothing = _StepSearch(
        jnp.asarray(0),
        jnp.zeros(runs, bool),
        jnp.ones(runs, step.start.dtype),
        event_state.which,
        event_state.status,
        event_state.sizes,
        BracketEnds(none, none, none, none),
    )
    return jax.lax.while_loop(lambda search: jnp.any(left(search)), part, nothing)


def _first_of(
    parts: list[Bracket],
    search: _StepSearch,
    waited_for: Int[Array, "*runs"],
    here_now: Bool[Array, "*runs"],
    going: Bool[Array, "*runs"],
) -> _StepSearch:
    """The search after one more part of the step.

    **Arguments**

    - `parts`: that part, for each event.
    - `waited_for`: the number of the event at which each run waits.
    - `here_now`: which runs are searched; `going`: which are not waiting."""
    earliest = jnp.full(going.shape, jnp.inf)
    which = -jnp.ones(going.shape, jnp.int32)
    status = jnp.full(going.shape, Status.COMPLETED, jnp.int32)
    sizes = []
    ends = search.ends
    for number, part in enumerate(parts):
        zero, at_ends = part.first_zero(search.sizes[number], here_now, going)
        sizes.append(zero.size)
        mine = (waited_for == number) & here_now
        ends = jax.tree.map(lambda a, b, mine=mine: jnp.where(mine, a, b), at_ends, ends)
        sooner = zero.hit & (zero.time < earliest)
        which = jnp.where(sooner, number, which)
        status = jnp.where(sooner, Status.EVENT, status)
        # A failure counts if it comes before the event.
        failed = zero.failed <= jnp.minimum(earliest, jnp.where(zero.hit, zero.time, jnp.inf))
        earliest = jnp.where(sooner, zero.time, earliest)
        status = jnp.where(failed, zero.status, status)
        earliest = jnp.where(failed, zero.failed, earliest)
    here = going & here_now & jnp.isfinite(earliest)
    # Selections that depend on them would recompute them.
    here, earliest, which, status = barrier((here, earliest, which, status))
    return _StepSearch(
        search.part + 1,
        search.here | here,
        jnp.where(here, earliest, search.s),
        jnp.where(here, which, search.which),
        jnp.where(here, status, search.status),
        jnp.where(going & here_now, jnp.stack(sizes), search.sizes),
        ends,
    )


def _shorter(event_state: EventState, ends: BracketEnds) -> tuple[Scalar, Array, Array, Array]:
    """The change of the length of the steps that hold the events, from the conditions at their
    `ends`; whether another place is tried; whether the one that was tried is worse; and whether the
    step is repeated with the changed length."""
    first, first_slope, value, slope = ends
    length = event_state.length
    # dg/ds of a step that is `length` long in s.
    change = -safe_divide(value, slope).astype(length.dtype) * length
    # Newton's method converges from the zero of the dense output, unless the field jumps at the
    # event, as at the end of the propellant. Beyond it the condition may be flat, and the stages of
    # a step beyond it distort its dense output and its end. The slope at its start is correct: the
    # place to which it leads is taken if the condition is nearer to zero there. Where the condition
    # itself jumps it is not, and the result of the dense output is used.
    lost = ~(jnp.abs(change) <= 0.5 * event_state.change)
    flat = (slope == 0.0) & (value * first < 0.0)
    place = -safe_divide(first, first_slope).astype(length.dtype) * length
    untried = jnp.isnan(event_state.placed)
    tried = untried & (flat | lost & (event_state.repetitions == 0))
    tried = tried & (place > 0.0) & (place <= event_state.whole)
    worse = ~untried & ~(jnp.abs(value) < event_state.missed)
    change = jnp.where(tried, place - length, change)
    change = jnp.where(worse, event_state.placed - length, change)
    change = jnp.clip(length + change, 0.0, event_state.whole) - length
    least = 16.0 * jnp.finfo(length.dtype).eps
    resolved = least * jnp.maximum(jnp.abs(event_state.start + length), event_state.whole)
    more = event_state.again & (~lost | tried | worse) & (jnp.abs(change) > resolved)
    more = more & ~jnp.isinf(event_state.missed) & (event_state.repetitions + 1 < REPETITIONS)
    return change, tried, worse, more
