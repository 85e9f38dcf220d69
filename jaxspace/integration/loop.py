"""The loop of an integration: adaptive or planned steps, saved states, checkpoints.

diffrax's own loop does the same work. This one is traced once where diffrax's is traced three
times, which halves the first call, and it records the steps for derivatives (`_record.py`).
"""

import functools
from typing import NamedTuple, final

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PyTree

from ..core import Scalar, State
from ..core.barrier import barrier
from ..solvers.dense_output import AbstractDenseOutput
from ..solvers.error_tracking import ErrorTrackingSolver
from ..solvers.step_control import BatchStepController, StepTo
from ..solvers.tolerances import Tolerance
from ..solvers.vector_field import ScaledField
from ._buffers import Buffers, SavedStates, empty_buffer, nan_buffer
from ._event_location import Location, SearchedStep, SoughtEvents, located
from ._record import Recording, RecordLayout, check_memory
from ._slow_runs import nan_where, without_slow_runs
from ._step_zero import AlongStep
from ._tangents import Probes, ProbeState, StepTaken, TangentControl
from .events import Event
from .normalised_time import OwnStep, ScaledVectorField, Segments


@final
class LoopSettings(eqx.Module):
    """Settings of one integration in normalised time. Nothing in them is differentiated.

    - `method`: a solver that is bound to the run.
    - `lengths`: of the segments, as fractions of the run.
    - `longest_steps`: the longest step allowed in each segment, in normalised time.
    - `save_ts`: the normalised times at which states are saved; `None` saves the last one.
    - `plan`: the nodes of steps that are fixed beforehand.
    - `reach`: normalised times between which all segments of nonzero length lie; `None` for the
      whole run.
    - `record_steps`, `dense`: whether to return the ends of the steps, and the states there.
    - `restarts`: whether a block that runs out of steps is repeated without its slow runs.
    - `sought`: the events that end the runs.
    - `first_step`: as in `BatchStepController`.
    - `derivative_control`: as in `Accuracy`."""

    method: diffrax.AbstractSolver
    tolerance: Tolerance
    lengths: Float[Array, " segments"]
    longest_steps: Float[Array, " segments"] | None
    save_ts: Float[Array, " times"] | None
    plan: Float[Array, " nodes"] | None
    reach: tuple[Float[Array, ""], Float[Array, ""]] | None
    max_steps: int = eqx.field(static=True)
    record_steps: bool = eqx.field(static=True)
    dense: bool = eqx.field(static=True)
    restarts: bool = eqx.field(static=True)
    sought: SoughtEvents | None = None
    first_step: float | None = eqx.field(static=True, default=None)
    derivative_control: bool = eqx.field(static=True, default=False)

    @property
    def start(self) -> Float[Array, ""]:
        """The normalised time at which the run starts."""
        return jnp.zeros_like(self.end) if self.reach is None else self.reach[0]

    @property
    def end(self) -> Float[Array, ""]:
        """The normalised time at which the run ends."""
        if self.reach is not None:
            return self.reach[1]
        return jnp.asarray(self.lengths.shape[0], self.lengths.dtype)

    def solver(self) -> ErrorTrackingSolver:
        """The method, with the largest local error of each run in its state."""
        return ErrorTrackingSolver(self.method, self.tolerance)

    def controller(self) -> BatchStepController | StepTo:
        """Adaptive steps, or those of the plan."""
        if self.plan is None:
            return BatchStepController(
                self.tolerance, self.lengths, self.longest_steps, self.first_step
            )
        return StepTo(self.plan.astype(self.lengths.dtype))

    def buffers(self, y: State, clock: Array, step: Array | None) -> Buffers:
        """Empty buffers for states like `y` and times like `clock`, and for a derivative for
        recorded steps like `step`. Raises `InputError` where the memory does not suffice."""
        limit = self.max_steps
        saved = ends = states = recording = None
        if self.save_ts is not None:
            saved = SavedStates(nan_buffer(self.save_ts.shape[0], y), jnp.asarray(0))
        if self.record_steps or self.dense:
            stored = (clock, *jax.tree.leaves(y)) if self.dense else (clock,)
            size = sum(x.size * x.dtype.itemsize for x in stored)
            check_memory("the steps of the run", limit, size)
            ends = jnp.zeros((limit, *clock.shape), clock.dtype)
            states = empty_buffer(limit, y) if self.dense else None
        if step is not None:
            recording = Recording.empty(RecordLayout.of(y, step, limit))
        return Buffers(saved, ends, states, recording)


class LoopState(NamedTuple):
    """Carry of the loop. Times are normalised.

    - `t`, `t_next`: the time reached, and the proposed end of the next step.
    - `made_jump`: whether the vector field jumped at `t`, so that the solver starts again.
    - `left_out`: runs that used up the shared steps, and without which the others went on.
    - `location`: of the first event of each run, where some are sought.
    - `tangents`: that control the steps, of a run that is differentiated.
    """

    t: Float[Array, ""]
    t_next: Float[Array, ""]
    y: State
    solver_state: PyTree
    controller_state: PyTree
    made_jump: Bool[Array, ""]
    num_accepted: Int[Array, ""]
    num_rejected: Int[Array, ""]
    buffers: Buffers
    left_out: Bool[Array, "*runs"]
    location: Location | None
    tangents: ProbeState | None


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

    **Returns** the last `LoopState`. If its `t` is `settings.end`, all runs are complete except
    those `left_out`. Otherwise the steps ran out, which the caller reports in the status."""

    def unfinished(loop: LoopState) -> Bool[Array, ""]:
        going = _going_on(settings, loop)
        return going if loop.location is None else going | jnp.any(loop.location.again)

    control = None
    if probes is not None:
        control = TangentControl.of(probes, settings.tolerance, settings.method, TERM)

    def by_motion(loop: LoopState) -> LoopState:
        return jax.lax.while_loop(
            unfinished, lambda loop: _advance(settings, field, control, loop), loop
        )

    def run(loop: LoopState) -> LoopState:
        return by_motion(loop) if control is None else control.run(loop, by_motion)

    start = _start(settings, field, y0, recorded, control)
    # A single run does not wait for others, and a plan does not run out of steps.
    if not settings.restarts or start.left_out.size == 1 or settings.plan is not None:
        return run(start)

    def slow(loop: LoopState) -> Bool[Array, "*runs"]:
        limiting = jnp.where(settings.tolerance.alive(loop.y), loop.controller_state.limiting, 0)
        return (loop.t < settings.end) & (2 * limiting >= jnp.maximum(jnp.max(limiting), 1))

    return without_slow_runs(start, run, slow, nan_where)


def _going_on(settings: LoopSettings, loop: LoopState) -> Bool[Array, ""]:
    """Whether there is a next step: the end is not reached, and not every run waits at its
    event."""
    steps = loop.num_accepted + loop.num_rejected
    going = (loop.t < settings.end) & (steps < settings.max_steps)
    if loop.location is not None:
        going = going & jnp.any(~loop.location.waiting & settings.tolerance.alive(loop.y))
    return going


def _start(
    settings: LoopSettings,
    field: ScaledField,
    y0: State,
    recorded: bool,
    control: TangentControl | None,
) -> LoopState:
    """The loop before its first step, with the buffers that it fills."""
    solver, controller = settings.solver(), settings.controller()
    start, end = settings.start, settings.end
    t_next, controller_state = controller.init(
        TERM, start, end, y0, None, field, solver.func, solver.error_order(TERM)
    )
    zero = jnp.asarray(0)
    location = None
    if settings.sought is not None:
        location = Location.none_yet(settings.sought, start, y0, settings.tolerance)
    return LoopState(
        t=start,
        t_next=t_next,
        y=y0,
        solver_state=solver.init(TERM, start, t_next, y0, field),
        controller_state=controller_state,
        made_jump=jnp.array(False),
        num_accepted=zero,
        num_rejected=zero,
        buffers=settings.buffers(y0, end, end if recorded else None),
        left_out=jnp.zeros_like(settings.tolerance.alive(y0)),
        location=location,
        tangents=None if control is None else control.probes.begin(settings.tolerance),
    )


def _advance(
    settings: LoopSettings,
    field: ScaledField,
    control: TangentControl | None,
    loop: LoopState,
) -> LoopState:
    """The loop after one more step, accepted or rejected; if every run waits at its event, after
    one more repetition of the steps that hold the events."""
    solver, controller = settings.solver(), settings.controller()
    t0 = loop.t
    t1 = loop.t_next
    y0 = loop.y
    made_jump = loop.made_jump
    if settings.tolerance.run_axes == 0:
        # What follows from the parameters alone would be moved out of the loop, which for a single
        # run is one kernel, operation by operation: each into a kernel of its own.
        arrays, static = eqx.partition(field, eqx.is_array)
        arrays, t0, t1 = barrier((arrays, t0, t1))
        field = eqx.combine(arrays, static)
    going = None
    whole = field
    location = loop.location
    if location is not None:
        going = _going_on(settings, loop)
        # By selection: each of two branches would hold the vector field.
        t0, t1 = jnp.where(going, t0, 0.0), jnp.where(going, t1, 1.0)
        y0 = jax.tree.map(lambda a, b: jnp.where(going, a, b), y0, location.y0)
        made_jump = made_jump | ~going
        assert isinstance(field, ScaledVectorField) and isinstance(field.segments, Segments)
        span = field.segments.t0, field.segments.total
        s = jnp.where(going, t0, location.start)
        length = jnp.where(going, t1 - t0, location.length)
        field = ScaledVectorField(field.system, field.segments.step(s, length, t0, t1))
    y1, error, dense_info, solver_state, result = solver.step(
        TERM, t0, t1, y0, field, loop.solver_state, made_jump
    )
    # Where the root finder failed, the state is meaningless: the step is rejected.
    failed = result != diffrax.RESULTS.successful
    error = jax.tree.map(lambda e: jnp.where(failed, jnp.inf, e), error)
    order = solver.error_order(TERM)
    adapt = controller.adapt_step_size
    tangents = loop.tangents
    if control is not None:
        assert tangents is not None
        motion = settings.tolerance.error(y0, y1, error)
        step = StepTaken(t0, t1, y0, y1, motion, loop.num_accepted)
        looked = True if going is None else going
        tangents, of_tangents = control.look(whole, step, looked, tangents)
        solver_state = solver_state[0], jnp.maximum(solver_state[1], of_tangents)
        adapt = functools.partial(adapt, at_least=of_tangents)
    accept, t_after, t_next, made_jump, controller_state, _ = adapt(
        loop.t, loop.t_next, y0, y1, field, error, order, loop.controller_state
    )
    accept = jnp.asarray(accept)
    interpolation = solver.interpolation_cls(t0=t0, t1=t1, **dense_info)
    if location is not None:
        assert going is not None and isinstance(field, ScaledVectorField)
        assert isinstance(field.segments, OwnStep)
        # The repetition of a step changes nothing but the location.
        accept = accept & going
        t_after, t_next = (
            jnp.where(going, a, b) for a, b in ((t_after, loop.t), (t_next, loop.t_next))
        )
        controller_state = jax.tree.map(
            lambda a, b: jnp.where(going, a, b), controller_state, loop.controller_state
        )
        again = location.again
        location = _located(settings, loop, field.segments, span, interpolation, going, accept, y1)
        # Of a run that waits no step counts any more, and no error but that of the step that ends
        # at its event. Beyond the event the field may jump.
        y1 = nan_where(location.waiting, y1)
        counts = jnp.where(going, ~location.waiting, again & ~location.again)
        worst = jnp.where(counts, solver_state[1], loop.solver_state[1])
        solver_state = solver_state[0], worst
        rejected = going & ~accept
    else:
        rejected = ~accept

    # A rejected step changes nothing but the step size. Selecting is cheaper than `lax.cond`,
    # which copies the whole state on CPU.
    def select(new: PyTree, old: PyTree) -> PyTree:
        return jax.tree.map(lambda a, b: jnp.where(accept, a, b), new, old)

    return loop._replace(
        t=t_after,
        # The last step must not pass the end, where the vector field may not be defined.
        t_next=jnp.minimum(t_next, settings.end),
        y=select(y1, loop.y),
        solver_state=select(solver_state, loop.solver_state),
        controller_state=controller_state,
        made_jump=select(made_jump, loop.made_jump),
        num_accepted=jnp.where(accept, loop.num_accepted + 1, loop.num_accepted),
        num_rejected=jnp.where(rejected, loop.num_rejected + 1, loop.num_rejected),
        buffers=_filled(settings, loop, accept, y1, interpolation, location),
        location=location,
        tangents=tangents,
    )


def _filled(
    settings: LoopSettings,
    loop: LoopState,
    accept: Bool[Array, ""],
    y1: State,
    interpolation: diffrax.AbstractLocalInterpolation,
    location: Location | None,
) -> Buffers:
    """The buffers after this step: its final state `y1`, and the saved states within."""
    buffers = loop.buffers
    if buffers.saved is not None:
        assert settings.save_ts is not None
        # Nothing lies before time -1: a rejected step saves no state.
        reached = jnp.where(accept, loop.t_next, -1.0)
        saved = buffers.saved.record(interpolation, settings.save_ts, reached)
        buffers = buffers._replace(saved=saved)
    if buffers.recording is not None and location is not None:
        # A run that waits stays at the start of the step that holds its event: a derivative takes
        # steps of no length there.
        y1 = location.ended(y1)
    end = loop.t_next
    return buffers.add(loop.num_accepted, end, y1, end, accept, settings.max_steps)


def _located(
    settings: LoopSettings,
    loop: LoopState,
    segment: OwnStep,
    span: tuple[Scalar, Scalar],
    polynomial: diffrax.AbstractLocalInterpolation,
    going: Bool[Array, ""],
    accept: Bool[Array, ""],
    y1: State,
) -> Location:
    """The location after a step to the state `y1`.

    An accepted step is searched for the runs that are `going` on; otherwise the steps that hold the
    events become shorter."""
    sought, location = settings.sought, loop.location
    assert sought is not None and location is not None
    assert isinstance(polynomial, AbstractDenseOutput)
    tolerance = settings.tolerance
    width = loop.t_next - loop.t
    if settings.lengths.shape[0] > 1:
        index = jnp.clip(loop.t.astype(int), 0, settings.lengths.shape[0] - 1)
        width = width * settings.lengths[index]
    moving = accept & ~location.waiting & tolerance.alive(loop.y) & tolerance.alive(y1)

    def along(event: Event) -> AlongStep:
        return AlongStep(event, segment, polynomial, moving.shape)

    step = SearchedStep(along, polynomial.t0, polynomial.t1, loop.y, y1, width)
    first = loop.t == settings.start
    return located(location, sought, step, going, moving, first, span)
