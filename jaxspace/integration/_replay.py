"""Derivatives along the recorded steps of a run, forwards and backwards.

    (y_{n+1}, d_n) = step(p, t_n, t_{n+1}, y_n)       d: what the dense output of the step holds
    forwards   (y_{n+1}', d_n') = d(step)/d(p, y_n) (p', y_n')
    backwards  (p*, y_n*) = (p*, 0) + [y_{n+1}*, d_n*] d(step)/d(p, y_n)

If the steps were chosen again, a rounding difference could lead to other steps, and the derivative
would not belong to any run (observed: an error as large as the derivative itself, over a thousand
steps). The ends of the accepted steps are therefore recorded, with as many states as fit into the
buffer. Backwards, the steps between two of these checkpoints are repeated in chunks, whose states
are all in memory at once.
"""

from collections.abc import Callable
from typing import TypeAlias

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, PyTree

from ..core import State
from ..core.barrier import barrier
from ..core.jit import quick_jit
from ..solvers.dense_output import evaluated
from ..solvers.protocol import bind, field_of_step, rolled_stages
from ..solvers.vector_field import TERM
from ._buffers import place_in_step
from ._loop_settings import LoopSettings
from ._needed import needed_only
from ._record import Record
from ._rows import empty_buffer, get_row, get_rows, put_row, put_rows, rows_of
from .normalised_time import field_of_part

CHUNK = 32
"""Number of steps whose states are in memory at once: more of them exceed the cache, and with fewer
of them short runs recompute more steps."""

# The vector field of which reverse mode stores the arguments only. Writing and reading its
# intermediate values takes longer than recomputing them, because a step has all of its stages in
# memory; and the program without storage compiles faster.
CHECKPOINTED: diffrax.ODETerm = diffrax.ODETerm(
    quick_jit(lambda t, y, field: eqx.filter_checkpoint(field)(t, y))
)

# Maps the cotangents of the results of a step to those of the field and of the state before it.
Pullback: TypeAlias = Callable[[PyTree], tuple[PyTree, ...]]


def _add(first: PyTree, second: PyTree) -> PyTree:
    return jax.tree.map(jnp.add, first, second)


def _select(condition: Array, first: PyTree, second: PyTree) -> PyTree:
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), first, second)


class Replay(eqx.Module):
    """The recorded steps of a run as functions of the differentiated part of the field.

    - `settings`: those of the run. `record`: its steps.
    - `fixed`: the part of the field that is not differentiated.
    - `rolled`: whether the stages are rolled (`rolled_stages`).
    - `step_once`: whether the program of reverse mode contains a step once."""

    settings: LoopSettings
    fixed: PyTree
    record: Record
    rolled: bool = eqx.field(static=True)
    step_once: bool = eqx.field(static=True)

    @property
    def method(self) -> diffrax.AbstractSolver:
        """The method of the run."""
        method = self.settings.method
        return rolled_stages(method) if self.rolled else method

    def step_bounds(self, n: Array) -> tuple[Array, Array]:
        """The normalised times at the start and at the end of step `n` of each run. In one that a
        run did not take they are equal."""
        record = self.record
        # Behind a barrier: the compiler would look them up again in each of some sixty kernels.
        return barrier((jnp.where(n > 0, record.step(n - 1), 0.0), record.step(n)))

    def step(
        self, moving: PyTree, n: Array, y: State, backwards: bool = False
    ) -> tuple[State, PyTree]:
        """The state after step `n` from `y`, and the coefficients of the dense output if it is
        needed.

        `backwards`: whether the step is for reverse mode."""
        field = eqx.combine(moving, self.fixed)
        s, end = self.step_bounds(n)
        length = end - s
        if self.settings.terminal is not None:
            # A run ends within a step, at its event. The steps behind it have no length.
            length = jnp.clip(self.record.ends - s, 0.0, length)
        field, _ = field_of_part(field, s, length)
        # Rolled stages are checkpoints already.
        term = CHECKPOINTED if backwards and not self.rolled else TERM
        t0, t1 = jnp.zeros_like(s, shape=()), jnp.ones_like(s, shape=())
        save_ts, method = self.settings.save_ts, self.method
        if save_ts is not None:
            rows = save_ts.reshape(*save_ts.shape, *(1,) * (1 + s.ndim - save_ts.ndim))
            tolerance = self.settings.tolerance
            method = bind(
                method,
                tolerance=tolerance,
                save_ts=place_in_step(rows, s, length),
                run_axes=tolerance.run_axes,
            )
        field = field_of_step(method, field, t0, t1)
        state = method.init(term, t0, t1, y, field)
        y1, _, dense_info, _, _ = method.step(term, t0, t1, y, field, state, jnp.array(False))
        if s.ndim:
            # A step that a run did not take leaves its state, to the last bit.
            y1 = jax.tree.map(lambda a, b: jnp.where(length > 0.0, a, b), y1, y)
        return y1, None if self.settings.save_ts is None else dense_info

    def interpolate(self, n: Array, dense_info: PyTree, t: Array) -> State:
        """The state at the normalised time `t` of each run within step `n`."""
        start, end = self.step_bounds(n)
        t0, t1 = jnp.zeros_like(start, shape=()), jnp.ones_like(start, shape=())
        polynomial = self.method.interpolation_cls(t0=t0, t1=t1, **dense_info)
        return evaluated(polynomial, place_in_step(t, start, end - start))

    # Forwards.

    def jvp(
        self, moving: PyTree, y0: State, d_moving: PyTree, d_y0: State, recorded: bool
    ) -> tuple[State, Array | None]:
        """The tangents of the saved states, from those of the field and of the initial state; where
        they are `recorded`, also those of the numbers of the record, for a second derivative."""
        save_ts, layout = self.settings.save_ts, self.record.layout

        def advance(n: Array, carry: tuple[PyTree, ...]) -> tuple[PyTree, ...]:
            y, dy, saved, k, numbers = carry
            (y, dense), (dy, d_dense) = jax.jvp(
                needed_only(lambda p, y: self.step(p, n, y)), (moving, y), (d_moving, dy)
            )
            if save_ts is not None:
                saved, k = self._save_tangents(n, (y, dense), (dy, d_dense), saved, k)
            if recorded:
                # The last of the steps to a recorded state leaves the tangent.
                numbers = layout.put_state(numbers, n // self.record.stride, dy)
            return y, dy, saved, k, numbers

        saved = numbers = None
        if save_ts is not None:
            saved = self._saved_at_start(save_ts.shape[0], d_y0)
        if recorded:
            numbers = jnp.zeros((layout.size,), layout.dtype)
        none = jnp.zeros(self.record.step(jnp.asarray(0)).shape, int)
        start = (y0, d_y0, saved, none, numbers)
        _, dy, saved, _, numbers = jax.lax.fori_loop(0, self.record.count, advance, start)
        return jax.tree.map(lambda x: x[None], dy) if saved is None else saved, numbers

    def _saved_at_start(self, rows: int, d_y0: State) -> State:
        """The tangents of the saved states before the first step."""
        return jax.tree.map(lambda x: jnp.zeros((rows, *x.shape), x.dtype), d_y0)

    def _save_tangents(
        self,
        n: Array,
        result: tuple[State, PyTree],
        tangent: tuple[State, PyTree],
        saved: State,
        k: Array,
    ) -> tuple[State, Array]:
        """Append the tangents at the save times within step `n`, from number `k` on, by the
        `result` of the step and its `tangent`."""
        dense, d_dense = result[1], tangent[1]
        save_ts = self.settings.save_ts
        assert save_ts is not None
        size = save_ts.shape[0]
        t0, t1 = self.step_bounds(n)

        def due(k: Array) -> Array:
            # Of a run that takes no step here, none is left up to its time.
            return (k < size) & (rows_of(save_ts, jnp.minimum(k, size - 1)) <= t1) & (t1 > t0)

        def append(carry: tuple[State, Array]) -> tuple[State, Array]:
            saved, k = carry
            t = rows_of(save_ts, jnp.minimum(k, size - 1))
            _, dy = jax.jvp(lambda d: self.interpolate(n, d, t), (dense,), (d_dense,))
            return put_rows(saved, k, due(k), dy), k + due(k).astype(int)

        return jax.lax.while_loop(lambda carry: jnp.any(due(carry[1])), append, (saved, k))

    # Backwards.

    def vjp(self, moving: PyTree, y0: State, cotangent: State) -> tuple[PyTree, State]:
        """The cotangents of the field and of the initial state, from those of the saved states."""
        stride = self.record.stride
        num_segments = -(-self.record.count // stride)
        save_ts = self.settings.save_ts
        if save_ts is None:
            at_end = get_row(cotangent, jnp.asarray(0))
            last_save = jnp.asarray(-1)
        else:
            at_end = jax.tree.map(jnp.zeros_like, y0)
            shape = self.record.step(jnp.asarray(0)).shape
            last_save = jnp.full(shape, save_ts.shape[0] - 1)
        total = (jax.tree.map(jnp.zeros_like, moving), at_end, last_save)
        buffer = empty_buffer(self._num_chunks + min(self.record.layout.longest, CHUNK) + 1, y0)

        def segment(i: Array, carry: tuple[PyTree, State]) -> tuple[PyTree, State]:
            # From the last segment to the first, each from the checkpoint at its start.
            j = num_segments - 1 - i
            y = _select(j > 0, self.record.state(j - 1), y0)
            first = j * stride
            length = jnp.minimum(stride, self.record.count - first)
            return self._segment_vjp(moving, y, first, length, cotangent, carry)

        total, _ = jax.lax.fori_loop(0, num_segments, segment, (total, buffer))
        return total[:2]

    @property
    def _num_chunks(self) -> int:
        """Largest number of chunks in a segment."""
        return -(-self.record.layout.longest // CHUNK)

    def _segment_vjp(
        self,
        moving: PyTree,
        y: State,
        first: Array,
        length: Array,
        cotangent: State,
        carry: tuple[PyTree, State],
    ) -> tuple[PyTree, State]:
        """The cotangents before a segment of `length` steps from number `first` and state `y`.

        The buffer contains the states at the start of each chunk, then those within one chunk."""
        chunks = -(-length // CHUNK)
        single = chunks == 1

        def chunk(i: Array, carry: tuple[PyTree, State]) -> tuple[PyTree, State]:
            # Pass zero takes the steps once, to fill in the states at the start of every chunk; a
            # segment of one chunk needs none of it.
            total, buffer = carry
            filling = i == 0
            k = chunks - i
            n = first + jnp.where(filling, 0, k * CHUNK)
            count = jnp.where(filling, chunks, jnp.minimum(CHUNK, length - k * CHUNK))
            start = _select(filling | single, y, get_row(buffer, k))
            to = jnp.where(filling, 0, self._num_chunks)
            apart = jnp.where(filling, CHUNK, 1)
            if self.step_once:
                back = jnp.where(filling, 0, count)
                return self._there_and_back(
                    moving, cotangent, (total, buffer), to, start, n, (count, apart, back)
                )
            buffer = self._fill(moving, buffer, to, start, n, count, apart)

            def backwards(i: Array, total: PyTree) -> PyTree:
                step = count - 1 - i
                y = get_row(buffer, self._num_chunks + step)
                return self._step_vjp(moving, n + step, y, cotangent, total)

            total = jax.lax.fori_loop(0, jnp.where(filling, 0, count), backwards, total)
            return total, buffer

        return jax.lax.fori_loop(jnp.where(single, 1, 0), chunks + 1, chunk, carry)

    def _fill(
        self,
        moving: PyTree,
        buffer: State,
        to: Array,
        y: State,
        n: Array,
        count: Array,
        apart: Array,
    ) -> State:
        """The buffer filled, from row `to` on, with `count` states that are `apart` steps apart.

        The first is `y`, before step `n`. The last row of the buffer receives the states between
        them."""
        buffer = put_row(buffer, to, y)
        if self.record.layout.longest == 1:
            return buffer

        # The last state is carried by itself: read from the buffer that the next one is written
        # to, the whole buffer would be copied.
        def advance(i: Array, carry: tuple[State, State]) -> tuple[State, State]:
            buffer, y = carry
            y, _ = needed_only(self.step)(moving, n + i, y)
            row = jnp.where((i + 1) % apart == 0, to + (i + 1) // apart, -1)
            return put_row(buffer, row, y), y

        return jax.lax.fori_loop(0, (count - 1) * apart, advance, (buffer, y))[0]

    def _there_and_back(
        self,
        moving: PyTree,
        cotangent: State,
        carry: tuple[PyTree, State],
        to: Array,
        y: State,
        n: Array,
        counts: tuple[Array, Array, Array],
    ) -> tuple[PyTree, State]:
        """`_fill`, then the cotangents of `back` steps, with one loop whose program contains a step
        once.

        A large step compiles sooner this way, although it is also linearised in the part that
        fills."""
        count, apart, back = counts
        total, buffer = carry
        buffer = put_row(buffer, to, y)
        ahead = (count - 1) * apart

        def one(i: Array, carry: tuple[PyTree, State, State]) -> tuple[PyTree, State, State]:
            total, buffer, y = carry
            forwards = i < ahead
            step = jnp.where(forwards, i, back - 1 - (i - ahead))
            y = _select(forwards, y, get_row(buffer, jnp.where(forwards, -1, to + step)))
            (y1, dense_info), pull = self._linearised(moving, n + step, y)
            row = jnp.where(forwards & ((i + 1) % apart == 0), to + (i + 1) // apart, -1)

            # A loop of one iteration or none, as that of `SensitivityControl.monitor`.
            def back_once(carry: tuple[Array, PyTree]) -> tuple[Array, PyTree]:
                go, total = carry
                return ~go, self._pulled(pull, dense_info, n + step, cotangent, total)

            _, total = jax.lax.while_loop(lambda carry: carry[0], back_once, (~forwards, total))
            return total, put_row(buffer, row, y1), y1

        return jax.lax.fori_loop(0, ahead + back, one, (total, buffer, y))[:2]

    def _linearised(self, moving: PyTree, n: Array, y: State) -> tuple[PyTree, Pullback]:
        """Result of step `n`, and its vjp."""
        return jax.vjp(needed_only(lambda p, y: self.step(p, n, y, backwards=True)), moving, y)

    def _step_vjp(
        self, moving: PyTree, n: Array, y: State, cotangent: State, total: tuple[PyTree, ...]
    ) -> tuple[PyTree, ...]:
        """The cotangents before step `n`, which starts at the state `y`."""
        (_, dense_info), pull = self._linearised(moving, n, y)
        # Behind a barrier, because the compiler would take parts of the step once more for every
        # result that uses them.
        return self._pulled(barrier(pull), dense_info, n, cotangent, total)

    def _pulled(
        self,
        pull: Pullback,
        dense_info: PyTree,
        n: Array,
        cotangent: State,
        total: tuple[PyTree, ...],
    ) -> tuple[PyTree, ...]:
        """The cotangents before step `n`, by its vjp."""
        of_moving, of_y, k = total
        of_dense = None
        if self.settings.save_ts is not None:
            k, of_dense = self._saved_vjp(n, dense_info, cotangent, k)
        more, of_y = pull((of_y, of_dense))
        return _add(of_moving, more), of_y, k

    def _saved_vjp(
        self, n: Array, dense_info: PyTree, cotangent: State, k: Array
    ) -> tuple[Array, PyTree]:
        """The cotangent of the coefficients of the dense output of step `n`, from the saved states
        in it.

        `k` is the number of the last saved state not yet treated; returned with its new value."""
        save_ts = self.settings.save_ts
        assert save_ts is not None
        t0, t1 = self.step_bounds(n)

        def inside(k: Array) -> Array:
            # The first step of a run begins at its start.
            later = rows_of(save_ts, jnp.maximum(k, 0)) > t0
            return (k >= 0) & (later | (t0 <= self.settings.start)) & (t1 > t0)

        def one(carry: tuple[Array, PyTree]) -> tuple[Array, PyTree]:
            k, total = carry
            here, row = inside(k), jnp.maximum(k, 0)
            t = rows_of(save_ts, row)
            _, pull = jax.vjp(lambda d: self.interpolate(n, d, t), dense_info)
            of_row = get_rows(cotangent, row, here)
            return k - here.astype(int), _add(total, pull(of_row)[0])

        return jax.lax.while_loop(
            lambda carry: jnp.any(inside(carry[0])),
            one,
            (k, jax.tree.map(jnp.zeros_like, dense_info)),
        )
