"""The loop of an integration: adaptive or planned steps, saved states, checkpoints.

diffrax's own loop does the same work. This one is traced once where diffrax's is traced three
times, which halves the first call, and it stores checkpoints as densely as a fixed buffer allows:
after every step at first, and after every second one of those whenever the buffer is full.
"""

from typing import Any, NamedTuple, final

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PyTree

from ..core import State
from ..solvers import (
    BatchStepController,
    ErrorTrackingSolver,
    StepTo,
    Tolerance,
)

CHECKPOINT_BYTES = 2**18
"""Size of the checkpoint buffer. A larger one takes longer to fill and to move than the steps
between two checkpoints take to be computed again (measured by `benchmarks/gradients.py`)."""


@final
class LoopSettings(eqx.Module):
    """What one integration in normalised time needs. Nothing in it is differentiated.

    - `method`: a solver that is bound to the run.
    - `lengths`: of the segments, as fractions of the run.
    - `longest_steps`: the longest step allowed in each segment, in normalised time.
    - `save_ts`: the normalised times at which states are saved; `None` saves the last one.
    - `plan`: the nodes of steps that are fixed beforehand.
    - `record_steps`: whether to return the ends of the steps, `dense` the states there too."""

    method: diffrax.AbstractSolver
    tolerance: Tolerance
    lengths: Float[Array, " segments"]
    longest_steps: Float[Array, " segments"] | None
    save_ts: Float[Array, " times"] | None
    plan: Float[Array, " nodes"] | None
    max_steps: int = eqx.field(static=True)
    record_steps: bool = eqx.field(static=True)
    dense: bool = eqx.field(static=True)

    @property
    def end(self) -> Float[Array, ""]:
        """The normalised time at which the run ends."""
        return jnp.asarray(self.lengths.shape[0], self.lengths.dtype)

    def solver(self) -> ErrorTrackingSolver:
        """The method, with the largest local error of each run in its state."""
        return ErrorTrackingSolver(self.method, self.tolerance)

    def controller(self) -> BatchStepController | StepTo:
        """Adaptive steps, or those of the plan."""
        if self.plan is None:
            return BatchStepController(self.tolerance, self.lengths, self.longest_steps)
        return StepTo(self.plan.astype(self.lengths.dtype))


class SavedStates(NamedTuple):
    """States at the save times, times first, filled from the front. `count` of them are there."""

    states: State
    count: Int[Array, ""]

    def record(
        self,
        interpolation: diffrax.AbstractLocalInterpolation,
        save_ts: Float[Array, " times"],
        t1: Float[Array, ""],
    ) -> "SavedStates":
        """Append the states at every save time up to `t1`, from the dense output of a step."""
        size = save_ts.shape[0]

        def due(saved: SavedStates) -> Bool[Array, ""]:
            # Clamped, because the condition is evaluated once more after the last save time.
            following = save_ts[jnp.minimum(saved.count, size - 1)]
            return (saved.count < size) & (following <= t1)

        def append(saved: SavedStates) -> SavedStates:
            y = interpolation.evaluate(save_ts[jnp.minimum(saved.count, size - 1)])
            return SavedStates(put_row(saved.states, saved.count, y), saved.count + 1)

        return jax.lax.while_loop(due, append, self)


class Checkpoints(NamedTuple):
    """States after every `stride`-th step, in a buffer whose last row takes what is not kept."""

    states: State
    stride: Int[Array, ""]

    def record(
        self, accepted: Bool[Array, ""], count: Int[Array, ""], y: State, capacity: int, limit: int
    ) -> "Checkpoints":
        """Keep the state `y` after step number `count`, if it was accepted and is due.

        When the buffer is full, every second row is dropped and the stride doubles."""
        due = accepted & (count % self.stride == 0)
        # What is not due goes to the last row: a condition around the writing would copy the
        # whole buffer.
        row = jnp.where(due, count // self.stride - 1, capacity)
        states = put_row(self.states, row, y)

        def full(kept: Checkpoints) -> Bool[Array, ""]:
            return accepted & (count // kept.stride >= capacity) & (capacity < limit)

        def thin(kept: Checkpoints) -> Checkpoints:
            half = capacity // 2
            states = jax.tree.map(lambda x: x.at[:half].set(x[1:capacity:2]), kept.states)
            return Checkpoints(states, 2 * kept.stride)

        return jax.lax.while_loop(full, thin, Checkpoints(states, self.stride))


class LoopState(NamedTuple):
    """What one pass of the loop hands to the next. Times are normalised.

    - `t`, `t_next`: the time reached, and the proposed end of the next step.
    - `made_jump`: whether the vector field jumped at `t`, so that the solver starts again.
    - `step_ends`, `step_states`: ends of the accepted steps and the states there, where asked for.
    """

    t: Float[Array, ""]
    t_next: Float[Array, ""]
    y: State
    solver_state: PyTree
    controller_state: PyTree
    made_jump: Bool[Array, ""]
    num_accepted: Int[Array, ""]
    num_rejected: Int[Array, ""]
    saved: SavedStates | None
    step_ends: Float[Array, " steps"] | None
    step_states: State | None
    checkpoints: Checkpoints | None


def capacity_for(y0: State, limit: int) -> int:
    """How many checkpoints of at most `limit` steps fit the buffer.

    An even number where they do not all fit, so that it can be halved."""
    size = sum(leaf.size * leaf.dtype.itemsize for leaf in jax.tree.leaves(y0))
    return min(limit, max(2, CHECKPOINT_BYTES // size // 2 * 2))


def empty_buffer(count: int, y: State) -> State:
    """Uninitialised memory for `count` states: most of a buffer is never used."""
    return jax.tree.map(lambda x: jax.lax.empty((count, *x.shape), x.dtype), y)


def nan_buffer(count: int, y: State) -> State:
    """Memory for `count` states, NaN until they are reached."""
    return jax.tree.map(lambda x: jnp.full((count, *x.shape), jnp.nan, x.dtype), y)


def get_row(rows: PyTree, index: Int[Array, ""]) -> PyTree:
    """One row of a tree of rows."""
    return jax.tree.map(lambda x: x[index], rows)


def put_row(rows: PyTree, index: Int[Array, ""], row: PyTree) -> PyTree:
    """A tree of rows with one of them replaced."""
    return jax.tree.map(lambda x, a: x.at[index].set(a), rows, row)


@eqx.filter_jit
def _field(t: Array, y: State, field: Any) -> State:
    """The vector field, traced once for all places of a program that evaluate it."""
    return field(t, y)


TERM: diffrax.ODETerm = diffrax.ODETerm(_field)  # pyright: ignore[reportArgumentType]
"""The vector field as diffrax takes it; the field itself is the argument `args` of every step."""


def integrate_loop(
    settings: LoopSettings, field: Any, y0: State, *, checkpointed: bool = False
) -> LoopState:
    """Integrate dy/dt = field(t, y) in normalised time, from 0 to `settings.end`.

    **Arguments**

    - `settings`: method, step control, save times and limits.
    - `field`: the vector field, a `ScaledVectorField` or what stands for it.
    - `y0`: the initial state, components first and runs last.
    - `checkpointed`: whether to keep step ends and checkpoints for derivatives.

    **Returns** the last `LoopState`. The run is complete if its `t` is `settings.end`; otherwise
    the steps ran out, and the caller reports it in the status."""
    solver = settings.solver()
    controller = settings.controller()
    limit = settings.max_steps
    end = settings.end
    order = solver.error_order(TERM)
    capacity = capacity_for(y0, limit)
    t_next, controller_state = controller.init(
        TERM, jnp.zeros_like(end), end, y0, None, field, solver.func, order
    )

    def body(loop: LoopState) -> LoopState:
        y1, error, dense_info, solver_state, result = solver.step(
            TERM, loop.t, loop.t_next, loop.y, field, loop.solver_state, loop.made_jump
        )
        # A root finder that failed leaves a state of no meaning: its step is rejected.
        failed = result != diffrax.RESULTS.successful
        error = jax.tree.map(lambda e: jnp.where(failed, jnp.inf, e), error)
        accept, t_after, t_next, made_jump, controller_state, _ = controller.adapt_step_size(
            loop.t, loop.t_next, loop.y, y1, field, error, order, loop.controller_state
        )
        accept = jnp.asarray(accept)

        # A rejected step changes nothing but the step size. Selecting is cheaper than `lax.cond`,
        # which copies the whole state on CPU.
        def select(new: PyTree, old: PyTree) -> PyTree:
            return jax.tree.map(lambda a, b: jnp.where(accept, a, b), new, old)

        count = jnp.where(accept, loop.num_accepted + 1, loop.num_accepted)
        saved, step_ends, step_states, checkpoints = loop[-4:]
        if saved is not None:
            assert settings.save_ts is not None
            interpolation = solver.interpolation_cls(t0=loop.t, t1=loop.t_next, **dense_info)
            # Nothing lies before time -1: a rejected step saves no state.
            reached = jnp.where(accept, loop.t_next, -1.0)
            saved = saved.record(interpolation, settings.save_ts, reached)
        if step_ends is not None:
            # A rejected step writes to the row that the next accepted one overwrites.
            step_ends = step_ends.at[loop.num_accepted].set(loop.t_next)
        if step_states is not None:
            step_states = put_row(step_states, loop.num_accepted, y1)
        if checkpoints is not None:
            checkpoints = checkpoints.record(accept, loop.num_accepted + 1, y1, capacity, limit)
        return LoopState(
            t=t_after,
            t_next=jnp.minimum(t_next, end),
            y=select(y1, loop.y),
            solver_state=select(solver_state, loop.solver_state),
            controller_state=controller_state,
            made_jump=select(made_jump, loop.made_jump),
            num_accepted=count,
            num_rejected=jnp.where(accept, loop.num_rejected, loop.num_rejected + 1),
            saved=saved,
            step_ends=step_ends,
            step_states=step_states,
            checkpoints=checkpoints,
        )

    def unfinished(loop: LoopState) -> Bool[Array, ""]:
        return (loop.t < end) & (loop.num_accepted + loop.num_rejected < limit)

    zero = jnp.asarray(0)
    saved = step_ends = step_states = checkpoints = None
    if settings.save_ts is not None:
        saved = SavedStates(nan_buffer(settings.save_ts.shape[0], y0), zero)
    if settings.record_steps or settings.dense or checkpointed:
        step_ends = jax.lax.empty((limit,), end.dtype)
    if settings.dense:
        step_states = empty_buffer(limit, y0)
    if checkpointed:
        checkpoints = Checkpoints(empty_buffer(capacity + 1, y0), zero + 1)
    start = LoopState(
        t=jnp.zeros_like(end),
        t_next=t_next,
        y=y0,
        solver_state=solver.init(TERM, jnp.zeros_like(end), t_next, y0, field),
        controller_state=controller_state,
        made_jump=jnp.array(False),
        num_accepted=zero,
        num_rejected=zero,
        saved=saved,
        step_ends=step_ends,
        step_states=step_states,
        checkpoints=checkpoints,
    )
    return jax.lax.while_loop(unfinished, body, start)
