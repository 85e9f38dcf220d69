"""One iteration of the loop: a step of each run, and its effects.

A rejected step changes nothing but the length of the next one.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..core import State
from ..solvers.dense_output import AbstractDenseOutput
from ..solvers.step_control import Following, of_segment
from ..solvers.vector_field import ScaledField
from ._buffers import Buffers
from ._event_state import EventState, StepToSearch, located
from ._loop_settings import LoopSettings
from ._loop_state import LoopState
from ._sensitivity_control import SHORTER, SensitivityControl
from ._step_zero import StepCondition
from ._tangents import StepTaken, TangentState
from ._trial_step import TrialStep, carried_on, error_order, trial_step
from .events import Event
from .normalised_time import ScaledVectorField, Segments

# Part of the largest error from which a run limits a step that all share.
LIMITING = 0.5


def advance(
    settings: LoopSettings, field: ScaledField, control: SensitivityControl | None, loop: LoopState
) -> LoopState:
    """The loop after one more iteration; `control` by tangents, if any."""
    going = loop.going
    step = trial_step(settings, field, loop)
    tangents, error, at_event = _with_tangents(field, control, loop, step)
    following = _following(settings, loop, _shared_error(settings, error, going))
    accept = following.accept & going
    stop = _at_events(settings, field, loop, step, accept)
    # Selecting is cheaper than `lax.cond`, which copies the whole state on CPU.
    y = jax.tree.map(lambda a, b: jnp.where(accept, a, b), stop.y1, loop.y)
    t = jnp.where(going, following.start, loop.t)
    # The last step must not pass the end, where the vector field may not be defined.
    t_next = jnp.where(going, jnp.minimum(following.end, settings.end), loop.t_next)
    after = loop._replace(
        t=t,
        t_next=t_next,
        y=y,
        carried=carried_on(settings, loop, step, accept, t_next - t),
        worst=jnp.maximum(loop.worst, jnp.where(stop.counts, error, at_event)),
        control=jax.tree.map(lambda a, b: jnp.where(going, a, b), following.state, loop.control),
        jumped=jnp.where(accept, following.jumped, loop.jumped),
        accepted=jnp.where(accept, loop.accepted + 1, loop.accepted),
        rejected=jnp.where(going & ~accept, loop.rejected + 1, loop.rejected),
        count=loop.count + jnp.any(accept).astype(int),
        buffers=_filled(settings, loop, step, accept, t, y, stop.event_state),
        event_state=stop.event_state,
        tangents=tangents,
        limiting=_limiting(settings, loop, error, accept),
        outside=_outside(field, loop, t, step.y1, accept, stop.event_state),
    )
    return after.going_on(settings)


def _with_tangents(
    field: ScaledField, control: SensitivityControl | None, loop: LoopState, step: TrialStep
) -> tuple[TangentState | None, Float[Array, "*runs"], Float[Array, "*runs"]]:
    """The tangents after this step, its error or theirs, the larger one, and theirs at an event."""
    none = jnp.zeros_like(step.error)
    if control is None:
        return loop.tangents, step.error, none
    assert loop.tangents is not None
    number = loop.accepted + loop.rejected
    begin = step.begin
    retried = loop.control.rejected
    taken = StepTaken(begin.s, begin.length, begin.y0, step.y1, step.error, number, retried)
    before, location = loop.tangents, loop.event_state
    at_event = none > 0.0
    if location is not None:
        # The steps that end at the events are monitored in one pass, the last one, and only if they
        # are short, which most are not.
        whole = jnp.abs(field.duration(location.start, location.whole))
        known = before.ended | location.met & ~before.controlled & (
            whole >= SHORTER * before.longest
        )
        here = location.met & ~known & ~jnp.any(loop.going | location.again)
        at_event = here & ~location.rests
        before = before._replace(ended=known | here)
    tangents, of_tangents = control.monitor(field, taken, loop.going, at_event, before)
    error = jnp.maximum(step.error, of_tangents)
    return tangents, error, jnp.where(at_event, of_tangents, none)


def _outside(
    field: ScaledField,
    loop: LoopState,
    t: Array,
    y1: State,
    accept: Bool[Array, "*runs"],
    event_state: EventState | None,
) -> Bool[Array, "*runs"] | None:
    """Whether a step of each run has ended outside the range of its system, at `t` with the state
    `y1`; beyond an event none does."""
    if loop.outside is None:
        return None
    assert isinstance(field, ScaledVectorField)
    flag = field.outside(t, jax.tree.map(jax.lax.stop_gradient, y1))
    assert flag is not None
    counts = accept if event_state is None else accept & ~event_state.waiting
    return loop.outside | (counts & flag)


def _shared_error(settings: LoopSettings, error: Array, going: Array) -> Array:
    """The error of each run, or the largest one of those that are `going` on if they share their
    steps."""
    if settings.sharing is None:
        return error
    return jnp.where(settings.sharing, jnp.max(jnp.where(going, error, 0.0)), error)


def _limiting(
    settings: LoopSettings, loop: LoopState, error: Array, accept: Bool[Array, "*runs"]
) -> Array:
    """The number of accepted steps limited by each run, where they are shared."""
    if settings.sharing is None:
        return loop.limiting
    largest = jnp.max(jnp.where(loop.going, error, 0.0))
    limits = accept & (error >= LIMITING * largest)
    return loop.limiting + limits.astype(loop.limiting.dtype)


def _following(settings: LoopSettings, loop: LoopState, error: Array) -> Following:
    """The next step of each run, from the control or of fixed length."""
    if settings.fixed_step:
        yes = jnp.ones_like(loop.t, bool)
        return Following(yes, loop.t_next, loop.t_next + 1.0, yes, loop.control)
    order = error_order(settings)
    return settings.controller().following(loop.t, loop.t_next, error, order, loop.control)


class StepToEvent(NamedTuple):
    """A step of each run that may hold its event.

    - `event_state`: of the events; `y1`: the state at the end of the step, NaN beyond an event,
      because the field may jump there.
    - `counts`: whether the error of the step counts: of a run that waits that of the step alone
      that ends at its event."""

    event_state: EventState | None
    y1: State
    counts: Bool[Array, "*runs"]


def _at_events(
    settings: LoopSettings,
    field: ScaledField,
    loop: LoopState,
    step: TrialStep,
    accept: Bool[Array, "*runs"],
) -> StepToEvent:
    """The step, up to the events that it holds."""
    if loop.event_state is None:
        return StepToEvent(None, step.y1, accept)
    event_state = _located(settings, field, loop, step, accept)
    y1 = jax.tree.map(lambda x: jnp.where(event_state.waiting, jnp.nan, x), step.y1)
    ended = loop.event_state.again & ~event_state.again
    return StepToEvent(event_state, y1, jnp.where(loop.going, accept & ~event_state.waiting, ended))


def _located(
    settings: LoopSettings,
    field: ScaledField,
    loop: LoopState,
    step: TrialStep,
    accept: Bool[Array, "*runs"],
) -> EventState:
    """The location after a step of each run.

    An accepted step is searched; the steps that hold the events become shorter."""
    terminal, event_state, segment = settings.terminal, loop.event_state, step.segment
    assert terminal is not None and event_state is not None and segment is not None
    assert isinstance(field, ScaledVectorField) and isinstance(field.segments, Segments)
    polynomial, begin = step.polynomial, step.begin
    assert isinstance(polynomial, AbstractDenseOutput)
    width = begin.length
    if settings.lengths.shape[0] > 1:
        width = width * of_segment(settings.lengths, begin.s)
    moving = accept & settings.tolerance.alive(step.y1)

    def condition_of(event: Event) -> StepCondition:
        return StepCondition(event, segment, polynomial, moving.shape)

    searched = StepToSearch(condition_of, begin.s, begin.length, begin.y0, step.y1, width)
    first = loop.t == settings.start
    span = field.segments.t0, field.segments.total
    return located(event_state, terminal, searched, loop.going, moving, first, span)


def _filled(
    settings: LoopSettings,
    loop: LoopState,
    step: TrialStep,
    accept: Bool[Array, "*runs"],
    t: Array,
    y: State,
    event_state: EventState | None,
) -> Buffers:
    """The buffers after this step, at the times `t` with the states `y`, and the saved states
    within."""
    buffers = loop.buffers
    if buffers.saved is not None:
        assert settings.save_ts is not None
        # No time is before -1: a rejected step saves no state.
        reached = jnp.where(accept, loop.t_next, -1.0)
        begin = step.begin
        saved = buffers.saved.record(
            step.polynomial, settings.save_ts, begin.s, begin.length, reached
        )
        buffers = buffers._replace(saved=saved)
    if buffers.recording is not None and event_state is not None:
        # A waiting run stays at the start of the step that contains its event: a derivative has
        # steps of zero length there.
        y = event_state.stopped(y)
    return buffers.add(loop.accepted, loop.count, t, y, t, accept)
