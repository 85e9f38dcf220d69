"""The integration loop with individual steps for every run, in regularised variables.

In an iteration of the loop, each unfinished run makes one step, accepted or rejected, of individual
length. Runs of a block that are at different places of their orbits thus do not slow each other
down. Each run lands on the end of every segment, and then begins the next one.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..core import AbstractRegularised
from ..core.barrier import barrier
from ..solvers.regularised_step import (
    CLOSE,
    FIRST_STEP,
    Regular,
    derivative_in,
    form_of,
    order_of,
    trial_step,
)
from ..solvers.step_control import SMALLEST_STEP
from ..solvers.vector_field import ScaledField
from ._buffers import Buffers
from ._individual_control import Trend, bounded, following, ideal_length
from ._individual_state import (
    IndividualLoop,
    IndividualState,
    Segment,
    alive,
    landing_state,
    record_of_iteration,
    unit,
)
from ._loop_settings import LoopSettings
from ._rows import put_row, put_rows

# Of so many iterations the last ones let runs that wait at the end of a segment land without the
# others; to land takes up to three.
PATIENCE, LANDING = 32, 6


def integrate_individual_steps(
    settings: LoopSettings, field: ScaledField, y0: IndividualState, *, recorded: bool = False
) -> IndividualLoop:
    """Integrate every run to the end of its last segment; arguments as of `integrate_loop`."""
    form = form_of(field, y0.z)

    def unfinished(loop: IndividualLoop) -> Bool[Array, ""]:
        left = (loop.y.segment < settings.end) & alive(loop.y.z)
        return jnp.any(left) & (loop.iterations < settings.max_steps)

    start = _start(settings, form, field, y0, recorded)
    return jax.lax.while_loop(unfinished, lambda loop: _advance(settings, form, field, loop), start)


def _start(
    settings: LoopSettings,
    form: AbstractRegularised,
    field: ScaledField,
    y0: IndividualState,
    recorded: bool,
) -> IndividualLoop:
    segment = Segment.of(field, settings, y0.segment)
    rate = derivative_in(form, *segment, y0.z)
    free = FIRST_STEP * unit(form, y0.z, rate)
    free = jnp.broadcast_to(free, y0.segment.shape)
    to_end = form.fictitious_time(segment.duration, y0.z)
    landing = jnp.abs(to_end) <= free
    zero = jnp.asarray(0)
    none = jnp.zeros(y0.segment.shape, int)
    clock = jnp.broadcast_to(settings.end, y0.segment.shape)
    step = record_of_iteration(free, landing) if recorded else None
    buffers = settings.buffers(y0, clock, step)
    if buffers.saved is not None:
        # The first saved state is the initial one.
        first = put_row(buffers.saved.states, zero, y0)
        buffers = buffers._replace(saved=buffers.saved._replace(states=first))
    return IndividualLoop(
        y=y0,
        h=jnp.where(landing, to_end, jnp.sign(segment.duration) * free),
        free=free,
        trend=Trend.before(free),
        landing=landing,
        pending=jnp.zeros_like(landing),
        worst=jnp.where(alive(y0.z), 0.0, jnp.inf).astype(y0.z.dtype),
        accepted=none,
        rejected=none,
        iterations=zero,
        count=zero,
        buffers=buffers,
    )


def _advance(
    settings: LoopSettings, form: AbstractRegularised, field: ScaledField, loop: IndividualLoop
) -> IndividualLoop:
    """The loop after one more iteration."""
    y, free = loop.y, loop.free
    active = (y.segment < settings.end) & alive(y.z)
    moving = active & ~loop.pending
    segment = Segment.of(field, settings, y.segment)
    step = _trial_step(settings, form, segment, loop, moving)
    accept = step.good & ~step.past
    z = jnp.where(accept, step.z1, y.z)
    used = accept & ~loop.landing
    trend, proposal = following(form, loop.trend, step.ideal, step.h, y.z, z, used)
    proposal = bounded(proposal, loop.h, step.good)
    # A step that lands is shorter than the error allows.
    proposal = jnp.where(accept & loop.landing, jnp.maximum(free, proposal), proposal)
    free = jnp.where(moving & ~step.past, proposal, free)
    pending = active & (loop.pending | step.past | (accept & loop.landing))
    y, h, none = (
        IndividualState(z, y.segment),
        jnp.sign(segment.duration) * free,
        jnp.zeros_like(accept),
    )
    # All runs at once, when all have arrived, because a landing costs as much as some steps; but a
    # slow run does not make the others wait until the maximum number of steps.
    waited = loop.iterations % PATIENCE >= PATIENCE - LANDING
    waited = waited | (loop.iterations >= settings.max_steps - LANDING)
    y1, h1, pending, landing, done = jax.lax.cond(
        jnp.any(pending) & (jnp.all(pending | ~active) | waited),
        lambda: _enter_segments(settings, form, field, segment, y, pending, free),
        lambda: (y, h, pending, none, none),
    )
    moved = jnp.any(accept | done)
    return loop._replace(
        y=y1,
        h=h1,
        free=free,
        trend=trend,
        landing=landing,
        pending=pending,
        worst=jnp.where(accept, jnp.maximum(loop.worst, step.local), loop.worst),
        accepted=loop.accepted + accept.astype(int),
        rejected=loop.rejected + (moving & ~accept).astype(int),
        iterations=loop.iterations + 1,
        count=loop.count + moved.astype(int),
        buffers=_filled(settings, field, loop, y1, accept, done),
    )


class _Step(NamedTuple):
    """A step `h` of each run.

    - `z1`: the variables at its end; `local`: its error, in units of the tolerance.
    - `ideal`: the length at which the error is just the allowed one.
    - `good`: whether the error is allowed; `past`: whether the step is, but passes the end of the
      segment on which it was not meant to land."""

    h: Float[Array, "*runs"]
    z1: Regular
    local: Float[Array, "*runs"]
    ideal: Float[Array, "*runs"]
    good: Bool[Array, "*runs"]
    past: Bool[Array, "*runs"]


def _trial_step(
    settings: LoopSettings,
    form: AbstractRegularised,
    segment: Segment,
    loop: IndividualLoop,
    moving: Bool[Array, "*runs"],
) -> _Step:
    """The next step of the runs that are `moving`, and one of zero length for the others."""
    y = loop.y
    h = jnp.where(moving, loop.h, 0.0)
    z1, error, rate = trial_step(form, *segment, y.z, h)
    local = form.size(error, y.z, z1) / settings.tolerance.rtol
    local = jnp.where(jnp.isfinite(local) & alive(z1), local, jnp.inf).astype(h.dtype)
    # Behind a barrier, because many of the following operations read them.
    z1, local = barrier((z1, local))
    if settings.longest_steps is not None:
        local = jnp.maximum(local, _too_long(settings, form, segment, y, z1))
    # A step this short is accepted whatever its error, which the status then reports.
    tiny = ~(jnp.abs(h * rate) > SMALLEST_STEP * jnp.abs(segment.duration))
    good = moving & ((local <= 1.0) | tiny)
    # By the direction of the duration, because a step that lands may be slightly backwards.
    beyond = (segment.duration - z1[-1]) * jnp.sign(segment.duration) < 0.0
    ideal = barrier(ideal_length(form, h, local))
    return _Step(h, z1, local, ideal, good, good & ~loop.landing & beyond)


def _filled(
    settings: LoopSettings,
    field: ScaledField,
    loop: IndividualLoop,
    y: IndividualState,
    accept: Bool[Array, "*runs"],
    done: Bool[Array, "*runs"],
) -> Buffers:
    """The buffers after an iteration to `y`, in which some runs `accept` their step and some are
    `done` with a segment."""
    step = record_of_iteration(jnp.where(accept, loop.h, 0.0), done)
    ends = None
    if loop.buffers.step_ends is not None:
        duration = Segment.of(field, settings, y.segment).duration
        part = y.z[-1] / jnp.where(duration == 0.0, 1.0, duration)
        ends = (y.segment + part).astype(settings.end.dtype)
    buffers = _with_landed(loop.buffers, y, done)
    return buffers.add(loop.count, loop.count, ends, y, step, jnp.any(accept | done))


def _with_landed(buffers: Buffers, y: IndividualState, done: Bool[Array, "*runs"]) -> Buffers:
    """The buffers with the states of the runs that have landed on the end of a segment."""
    if buffers.saved is None:
        return buffers
    # A loop of at most one iteration, because a conditional would copy the whole buffer.
    states, _ = jax.lax.while_loop(
        lambda carry: carry[1],
        lambda carry: (put_rows(carry[0], y.segment.astype(int), done, y), jnp.array(False)),
        (buffers.saved.states, jnp.any(done)),
    )
    return buffers._replace(saved=buffers.saved._replace(states=states))


def _enter_segments(
    settings: LoopSettings,
    form: AbstractRegularised,
    field: ScaledField,
    segment: Segment,
    y: IndividualState,
    pending: Bool[Array, "*runs"],
    free: Array,
) -> tuple[IndividualState, Array, Array, Array, Array]:
    """Advance the `pending` runs, which are close to the end of their segment; those at its end
    enter the next one.

    **Returns** variables and segments, the next steps, which runs are still pending, which of these
    steps should end a segment, and which runs have landed."""
    z = y.z
    rate = derivative_in(form, *segment, z)
    left = segment.duration - z[-1]
    close = jnp.abs(left) <= CLOSE * jnp.abs(rate[-1]) * unit(form, z, rate)
    done = pending & (close | (segment.duration == 0.0))
    y1 = landing_state(form, segment, y, done)
    following = Segment.of(field, settings, y1.segment)
    to_end = form.fictitious_time(following.duration - y1.z[-1], y1.z)
    landing = pending & (~done | (jnp.abs(to_end) <= free)) & (y1.segment < settings.end)
    h = jnp.where(landing, to_end, jnp.sign(following.duration) * free)
    return y1, h, jnp.zeros_like(pending), landing, done


def _too_long(
    settings: LoopSettings,
    form: AbstractRegularised,
    segment: Segment,
    y: IndividualState,
    z1: Regular,
) -> Array:
    """The length of the step relative to the longest one allowed, as an error that makes the
    control shorten it."""
    assert settings.longest_steps is not None
    index = jnp.minimum(y.segment, settings.end - 1.0).astype(int)
    longest = settings.longest_steps[index] * jnp.abs(segment.duration)
    part = jnp.abs(z1[-1] - y.z[-1]) / jnp.where(longest > 0.0, longest, jnp.inf)
    return jnp.where(part > 1.0 + 1e-6, part, 0.0) ** order_of(form)
