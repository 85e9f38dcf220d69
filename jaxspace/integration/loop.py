"""The loop of an integration: every run goes on by its own steps to its own end.

In a pass each run takes one step, accepted or rejected, of its own length: the method steps from 0
to 1, of which every run takes its own part (`OwnStep`). What a run does thus does not depend on
its neighbours. Runs that take planned steps share their times.

diffrax's own loop does the same work for one run. This one is traced once where diffrax's is traced
three times, which halves the first call, and it records the steps for derivatives (`_record.py`).
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PyTree

from ..core import Scalar, State
from ..core.barrier import barrier
from ..solvers.dense_output import AbstractDenseOutput
from ..solvers.protocol import AbstractDeclaredSolver, bind, field_of_step
from ..solvers.step_control import Following, of_segment
from ..solvers.vector_field import ScaledField, evaluate
from ._buffers import Buffers, place_in_step
from ._event_location import Location, SearchedStep, located
from ._loop_settings import LoopSettings
from ._step_zero import AlongStep
from ._tangents import Probes, ProbeState, StepTaken, TangentControl
from .events import Event
from .normalised_time import OwnStep, ScaledVectorField, Segments, field_of_part

# Part of the largest error from which a run limits a step that all share.
LIMITING = 0.5


class LoopState(NamedTuple):
    """Carry of the loop. Times are normalised, those of each run or of all together.

    - `t`, `t_next`: the time reached, and the proposed end of the next step.
    - `carried`: what the method carries into the next step; `worst`: the largest local error of
      each run, in units of the tolerance.
    - `jumped`: whether the vector field jumped at `t`, so that the solver starts again.
    - `count`: number of the passes in which a run moved.
    - `location`: of the first event of each run, where some are sought.
    - `tangents`: that control the steps, of a run that is differentiated.
    - `limiting`: number of the accepted steps that were limited by each run, where they share them;
      `left_out`: runs that used them up, and without which the others went on.
    """

    t: Float[Array, "*runs"]
    t_next: Float[Array, "*runs"]
    y: State
    carried: PyTree
    worst: Float[Array, "*runs"]
    control: PyTree
    jumped: Bool[Array, "*runs"]
    accepted: Int[Array, "*runs"]
    rejected: Int[Array, "*runs"]
    count: Int[Array, ""]
    buffers: Buffers
    location: Location | None
    tangents: ProbeState | None
    limiting: Int[Array, "*runs"]
    left_out: Bool[Array, "*runs"]
    going: Bool[Array, "*runs"]


class Attempt(NamedTuple):
    """A step of each run: from `s` on, `length` long in normalised time, from the state `y0` to
    `y1`; its error in units of the tolerance, its dense output, and what the method carries."""

    s: Float[Array, "*runs"]
    length: Float[Array, "*runs"]
    y0: State
    y1: State
    error: Float[Array, "*runs"]
    polynomial: diffrax.AbstractLocalInterpolation
    carried: PyTree
    segment: OwnStep | None


@eqx.filter_jit
def _field(t: Array, y: State, field: ScaledField) -> State:
    """The vector field, traced once for all evaluations in a program."""
    return field(t, y)


TERM: diffrax.ODETerm = diffrax.ODETerm(_field)  # pyright: ignore[reportArgumentType]
"""The vector field as diffrax takes it; the field itself is the argument `args` of every step."""


def integrate_loop(
    settings: LoopSettings,
    field: ScaledField,
    y0: State,
    *,
    recorded: bool = False,
    probes: Probes | None = None,
) -> LoopState:
    """Integrate dy/dt = field(t, y) in normalised time, from `settings.start` to `settings.end`.

    **Arguments**

    - `settings`: method, step control, save times and limits.
    - `field`: the vector field, a `ScaledVectorField` or its hoisted form.
    - `y0`: the initial state, components first and runs last.
    - `recorded`: whether to record the steps for derivatives.
    - `probes`: the tangents that the steps should resolve.

    **Returns** the last `LoopState`. A run whose `t` is `settings.end` is complete. Another one has
    failed, or its steps ran out, which the caller reports in the status."""

    control = None
    if probes is not None:
        control = TangentControl.of(probes, settings.tolerance, settings.method, TERM)

    def run(
        settings: LoopSettings, before: LoopState | None, left_out: Array | None = None
    ) -> LoopState:
        def unfinished(loop: LoopState) -> Bool[Array, ""]:
            going = jnp.any(loop.going)
            return going if loop.location is None else going | jnp.any(loop.location.again)

        def by_motion(loop: LoopState) -> LoopState:
            return jax.lax.while_loop(
                unfinished, lambda loop: _advance(settings, field, control, loop), loop
            )

        start = _start(settings, field, y0, recorded, control, left_out)
        if before is not None:
            start = start._replace(buffers=before.buffers.again(start.buffers))
        return by_motion(start) if control is None else control.run(start, by_motion)

    layout = settings.layout(y0, settings.clock(y0))
    if recorded and layout.rows < layout.limit:
        own = settings.shared(jnp.array(False))
        shapes = jax.eval_shape(lambda: _start(own, field, y0, recorded, control))
        return _until_recorded(settings, layout.rows, shapes, run)
    return run(settings, None)


def _until_recorded(
    settings: LoopSettings,
    rows: int,
    shapes: PyTree,
    run: Callable[..., LoopState],
) -> LoopState:
    """The loop at its end: with steps of each run, and if they are more than these `rows` of the
    record, with steps that all runs share. Where these run out, the runs that kept them short are
    left out."""

    def short(loop: LoopState) -> Bool[Array, "*runs"]:
        """Which runs lack steps."""
        lacking = settings.tolerance.alive(loop.y) & (loop.t < settings.end)
        return lacking if loop.location is None else lacking & ~loop.location.waiting

    def attempt(carry: tuple[LoopState, Array]) -> tuple[LoopState, Array]:
        before, number = carry
        slow = 2 * before.limiting >= jnp.maximum(jnp.max(before.limiting), 1)
        left_out = before.left_out | short(before) & slow & (number > 1)
        return run(settings.shared(number > 0), before, left_out), number + 1

    def unfinished(carry: tuple[LoopState, Array]) -> Bool[Array, ""]:
        loop, number = carry
        full = (number > 1) | (loop.count >= rows)
        return (number == 0) | full & jnp.any(short(loop))

    first = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), shapes)
    return jax.lax.while_loop(unfinished, attempt, (first, jnp.asarray(0)))[0]


def _going_on(settings: LoopSettings, loop: LoopState) -> Bool[Array, "*runs"]:
    """Whether each run takes a further step: it has not reached its end, nor failed, nor waits at
    its event."""
    going = settings.tolerance.alive(loop.y)
    if loop.location is not None:
        going = going & ~loop.location.waiting
    if loop.t.ndim < going.ndim:
        going = jnp.any(going)
    left = loop.accepted + loop.rejected < settings.max_steps
    if settings.sharing is not None:
        layout = settings.layout(loop.y, loop.t)
        left = left & (loop.count < jnp.where(settings.sharing, layout.limit, layout.rows))
    return going & (loop.t < settings.end) & left


def _start(
    settings: LoopSettings,
    field: ScaledField,
    y0: State,
    recorded: bool,
    control: TangentControl | None,
    left_out: Bool[Array, "*runs"] | None = None,
) -> LoopState:
    """The loop before its first step, with the buffers that it fills."""
    if left_out is not None:
        y0 = jax.tree.map(lambda x: jnp.where(left_out, jnp.nan, x), y0)
    t, alive = settings.clock(y0), settings.tolerance.alive(y0)
    zero, one = jnp.zeros_like(t, shape=()), jnp.ones_like(t, shape=())
    if settings.plan is None:
        controller = settings.controller()
        part = field_of_part(field, t, jnp.ones_like(t))[0]
        t_next, steps = controller.first(
            lambda ds, y: evaluate(TERM, ds, y, part), t, y0, _error_order(settings)
        )
        t_next = jnp.minimum(t_next, settings.end)
        sharing = settings.sharing
        if sharing is not None:
            shortest = jnp.where(sharing, jnp.min(steps.proposal), steps.proposal)
            steps = steps._replace(proposal=shortest)
            t_next = jnp.where(sharing, jnp.min(t_next), t_next)
    else:
        t_next, steps = settings.planned().plan[1], jnp.asarray(2)
    none = jnp.broadcast_to(jnp.asarray(0), t.shape)
    location = None
    if settings.sought is not None:
        location = Location.none_yet(settings.sought, t, y0, settings.tolerance)
    first = field_of_part(field, t, t_next - t)[0]
    start = LoopState(
        t=t,
        t_next=t_next,
        y=y0,
        carried=settings.method.init(TERM, zero, one, y0, first) if _carries(settings) else None,
        # A run that starts with numbers that are not finite has no accuracy.
        worst=jnp.where(alive, 0.0, jnp.inf).astype(jax.tree.leaves(y0)[0].dtype),
        control=steps,
        jumped=jnp.zeros(t.shape, bool),
        accepted=none,
        rejected=none,
        count=jnp.asarray(0),
        buffers=settings.buffers(y0, t, t if recorded else None),
        location=location,
        tangents=None if control is None else control.probes.begin(settings.tolerance),
        limiting=jnp.zeros(alive.shape, jnp.int32),
        left_out=jnp.zeros_like(alive) if left_out is None else left_out,
        going=jnp.zeros(t.shape, bool),
    )
    return start._replace(going=_going_on(settings, start))


def _carries(settings: LoopSettings) -> bool:
    """Whether the method may carry values from step to step. Those of diffrax begin anew, because
    the steps differ in their length."""
    return isinstance(settings.method, AbstractDeclaredSolver)


def _error_order(settings: LoopSettings) -> Any:
    return settings.solver().error_order(TERM)


def _attempt(
    settings: LoopSettings,
    field: ScaledField,
    loop: LoopState,
    s: Array,
    length: Array,
    y0: State,
    jumped: Array,
) -> Attempt:
    """A step of each run from `s` on, `length` long in normalised time, from the state `y0`."""
    zero, one = jnp.zeros_like(s, shape=()), jnp.ones_like(s, shape=())
    if settings.tolerance.run_axes == 0:
        # What follows from the parameters alone would be moved out of the loop, which for a single
        # run is one kernel, operation by operation: each into a kernel of its own.
        arrays, static = eqx.partition(field, eqx.is_array)
        arrays, s, length = barrier((arrays, s, length))
        field = eqx.combine(arrays, static)
    part, segment = field_of_part(field, s, length)
    method = settings.method
    if loop.buffers.saved is not None and settings.sought is None:
        # The next state to save, as a place in this step.
        place = place_in_step(loop.buffers.saved.next_ts, s, length)
        method = bind(
            method,
            tolerance=settings.tolerance,
            save_ts=place[None],
            run_axes=settings.tolerance.run_axes,
        )
    inner = field_of_step(method, part, zero, one)
    carried = loop.carried if _carries(settings) else method.init(TERM, zero, one, y0, inner)
    y1, error, dense_info, carried, result = method.step(
        TERM, zero, one, y0, inner, carried, jumped
    )
    # Where the root finder failed, the state is meaningless: the step is rejected.
    failed = result != diffrax.RESULTS.successful
    local = settings.tolerance.error(y0, y1, error)
    local = jax.lax.stop_gradient(jnp.where(failed, jnp.inf, local))
    polynomial = method.interpolation_cls(t0=zero, t1=one, **dense_info)
    return Attempt(s, length, y0, y1, local, polynomial, carried, segment)


def _advance(
    settings: LoopSettings,
    field: ScaledField,
    control: TangentControl | None,
    loop: LoopState,
) -> LoopState:
    """The loop after one more pass."""
    going = loop.going
    location = loop.location
    s, length, y0 = loop.t, jnp.where(going, loop.t_next - loop.t, 0.0), loop.y
    jumped = loop.jumped
    if location is not None:
        # A run that waits at its event takes the step that holds it again.
        s = jnp.where(going, s, location.start)
        length = jnp.where(going, length, location.length)
        y0 = jax.tree.map(lambda a, b: jnp.where(going, a, b), y0, location.y0)
        jumped = jumped | ~going
    step = _attempt(settings, field, loop, s, length, y0, jumped)
    y1, error, tangents = step.y1, step.error, loop.tangents
    if control is not None:
        assert tangents is not None
        taken = StepTaken(s, length, y0, y1, error, loop.accepted + loop.rejected)
        tangents, of_tangents = control.look(field, taken, going, tangents)
        error = jnp.maximum(error, of_tangents)
    following = _following(settings, loop, _shared_error(settings, error, going))
    accept = following.accept & going
    limiting = loop.limiting
    if settings.sharing is not None:
        largest = jnp.max(jnp.where(going, error, 0.0))
        limits = accept & (error >= LIMITING * largest)
        limiting = limiting + limits.astype(limiting.dtype)
    if location is not None:
        again = location.again
        assert isinstance(field, ScaledVectorField) and isinstance(field.segments, Segments)
        span = field.segments.t0, field.segments.total
        location = _located(settings, loop, step, going, accept, span)
        # Of a run that waits no step counts any more, and no error but that of the step that ends
        # at its event. Beyond the event the field may jump.
        y1 = jax.tree.map(lambda x: jnp.where(location.waiting, jnp.nan, x), y1)
        counts = jnp.where(going, accept & ~location.waiting, again & ~location.again)
    else:
        counts = accept
    # A rejected step changes nothing but the step size. Selecting is cheaper than `lax.cond`,
    # which copies the whole state on CPU.
    y = jax.tree.map(lambda a, b: jnp.where(accept, a, b), y1, loop.y)
    worst = jnp.where(counts, jnp.maximum(loop.worst, error), loop.worst)
    t = jnp.where(going, following.start, loop.t)
    # The last step must not pass the end, where the vector field may not be defined.
    t_next = jnp.where(going, jnp.minimum(following.end, settings.end), loop.t_next)
    steps = jax.tree.map(lambda a, b: jnp.where(going, a, b), following.state, loop.control)
    after = loop._replace(
        t=t,
        t_next=t_next,
        y=y,
        carried=_carried(settings, loop, step, accept, t_next - t),
        worst=worst,
        control=steps,
        jumped=jnp.where(accept, following.jumped, loop.jumped),
        accepted=jnp.where(accept, loop.accepted + 1, loop.accepted),
        rejected=jnp.where(going & ~accept, loop.rejected + 1, loop.rejected),
        count=loop.count + jnp.any(accept).astype(int),
        buffers=_filled(settings, loop, step, accept, t, y, location),
        location=location,
        tangents=tangents,
        limiting=limiting,
    )
    going = _going_on(settings, after)
    # Beyond its end no run starts again: a stage for it would be one for all.
    return after._replace(going=going, jumped=after.jumped & going)


def _shared_error(settings: LoopSettings, error: Array, going: Array) -> Array:
    """The error of each run, or the largest one of those that are `going` on if they share their
    steps."""
    if settings.sharing is None:
        return error
    return jnp.where(settings.sharing, jnp.max(jnp.where(going, error, 0.0)), error)


def _carried(
    settings: LoopSettings, loop: LoopState, step: Attempt, accept: Array, length: Array
) -> PyTree:
    """What the method carries into the next step, of this `length`."""
    if not _carries(settings):
        return None
    old = jax.tree.map(
        lambda a, b: jnp.where(accept, a, b) if a.ndim >= accept.ndim else a,
        step.carried,
        loop.carried,
    )
    assert isinstance(settings.method, AbstractDeclaredSolver)
    factor = length / jnp.where(step.length > 0.0, step.length, 1.0)
    return settings.method.longer(old, factor)


def _following(settings: LoopSettings, loop: LoopState, error: Array) -> Following:
    """What follows a step of each run, by the control or by the plan."""
    if settings.plan is None:
        order = _error_order(settings)
        controller = settings.controller()
        if settings.together:
            # A run that is no longer finite has its status, and the others go on.
            error = jnp.where(settings.tolerance.alive(loop.y), error, 0.0)
        return controller.following(loop.t, loop.t_next, error, order, loop.control)
    planned = settings.planned().adapt_step_size(
        loop.t, loop.t_next, loop.y, loop.y, None, None, None, loop.control
    )
    accept, start, end, jumped, state, _ = planned
    return Following(jnp.asarray(accept), start, end, jnp.asarray(jumped), state)


def _filled(
    settings: LoopSettings,
    loop: LoopState,
    step: Attempt,
    accept: Bool[Array, "*runs"],
    t: Array,
    y: State,
    location: Location | None,
) -> Buffers:
    """The buffers after this step, at the times `t` with the states `y`, and the saved states
    within."""
    buffers = loop.buffers
    if buffers.saved is not None:
        assert settings.save_ts is not None
        # Nothing lies before time -1: a rejected step saves no state.
        reached = jnp.where(accept, loop.t_next, -1.0)
        saved = buffers.saved.record(
            step.polynomial, settings.save_ts, step.s, step.length, reached
        )
        buffers = buffers._replace(saved=saved)
    if buffers.recording is not None and location is not None:
        # A run that waits stays at the start of the step that holds its event: a derivative takes
        # steps of no length there.
        y = location.ended(y)
    return buffers.add(loop.accepted, loop.count, t, y, t, accept, settings.layout(y, t))


def _located(
    settings: LoopSettings,
    loop: LoopState,
    attempt: Attempt,
    going: Bool[Array, "*runs"],
    accept: Bool[Array, "*runs"],
    span: tuple[Scalar, Scalar],
) -> Location:
    """The location after a step of each run, in a run with this `span`: start and duration, s.

    An accepted step is searched; the steps that hold the events become shorter."""
    sought, location, segment = settings.sought, loop.location, attempt.segment
    assert sought is not None and location is not None and segment is not None
    polynomial = attempt.polynomial
    assert isinstance(polynomial, AbstractDenseOutput)
    tolerance = settings.tolerance
    width = attempt.length
    if settings.lengths.shape[0] > 1:
        width = width * of_segment(settings.lengths, attempt.s)
    moving = accept & tolerance.alive(attempt.y1)

    def along(event: Event) -> AlongStep:
        return AlongStep(event, segment, polynomial, moving.shape)

    step = SearchedStep(along, attempt.s, attempt.length, attempt.y0, attempt.y1, width)
    first = loop.t == settings.start
    return located(location, sought, step, going, moving, first, span)
