"""Record of a run for its derivatives: its steps, and some of the states between them.

Both are stored in one array, from opposite ends:

    state, state, state, ...                                       ..., step 2, step 1, step 0

The states are those after every `stride`-th step, where the stride is one at first. When the array
is full, every second state is dropped, and the stride doubles. The array therefore has capacity for
all steps of a run, and is small enough that the derivative of a short run is not dominated by
filling and copying it.
"""

import dataclasses
import math
import os
from typing import NamedTuple, final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..core import InputError, State

RECORD_BYTES = 3 * 2**16
"""Size of a record, unless the steps alone need more. Filling and moving a larger one takes longer
than recomputing the steps between two states."""

RECORDED_STEPS = 2**16
"""Capacity of a record in steps per run: more of them exceed the cache for a block of runs. Runs
with more steps are repeated with shared steps, of which one number each is recorded."""

FEWEST_ROWS = 512
"""Least number of steps of each run with room, in the large blocks of accelerators."""

FEWEST_STATES = 4
"""Number of states for which the record has space beside all steps."""

SHARE = 0.5
"""Share of the memory for recorded steps: a derivative has the record and its source in memory
simultaneously."""
UNCHECKED_BYTES = 2**28
"""Bytes that any machine has: below this the memory is not checked."""


class RecordLayout(NamedTuple):
    """Layout of the states and steps in a record.

    - `shapes`, `dtypes`, `structure`: of a state.
    - `step`: shape of the numbers recorded for a step.
    - `limit`: largest number of steps; `rows`: of the individual steps of each run.
    - `dtype`: of the record."""

    shapes: tuple[tuple[int, ...], ...]
    dtypes: tuple[np.dtype, ...]
    structure: jax.tree_util.PyTreeDef
    step: tuple[int, ...]
    limit: int
    rows: int
    dtype: np.dtype

    @classmethod
    def of(cls, y: State, step: Array, limit: int, *, short: bool = False) -> "RecordLayout":
        """The layout for states and steps like these; of a `short` record for steps that the runs
        share when it is full."""
        leaves, structure = jax.tree.flatten(y)
        dtypes = tuple(x.dtype for x in leaves)
        # The time may have a higher precision than the state; both are stored exactly.
        dtype = max((step.dtype, *dtypes), key=lambda d: d.itemsize)
        rows = max(FEWEST_ROWS, RECORDED_STEPS // step.size) if short else limit
        shapes = tuple(x.shape for x in leaves)
        return cls(shapes, dtypes, structure, step.shape, limit, min(rows, limit), dtype)

    @property
    def state_size(self) -> int:
        """Numbers of one state."""
        return sum(map(math.prod, self.shapes))

    @property
    def step_size(self) -> int:
        """Numbers of one step."""
        return math.prod(self.step)

    @property
    def steps_size(self) -> int:
        """Numbers of all steps."""
        return max(self.rows * self.step_size, self.limit + self.step_size - 1)

    @property
    def size(self) -> int:
        """Numbers of the record."""
        steps = self.steps_size
        everything = steps + (self.limit + 1) * self.state_size
        least = steps + (FEWEST_STATES + 1) * self.state_size
        return min(everything, max(RECORD_BYTES // self.dtype.itemsize, least))

    @property
    def longest(self) -> int:
        """Largest number of steps between two recorded states: a power of two."""
        # One row is reserved for the state after the next step.
        rows = (self.size - self.steps_size) // self.state_size - 1
        stride = 1
        while rows * stride < self.limit:
            stride *= 2
        return stride

    def state(self, numbers: Array, k: Array) -> State:
        """State number `k`, after (k + 1) stride steps."""
        first = k * self.state_size
        leaves = []
        for shape, dtype in zip(self.shapes, self.dtypes, strict=True):
            size = math.prod(shape)
            leaf = jax.lax.dynamic_slice_in_dim(numbers, first, size)
            leaves.append(leaf.reshape(shape).astype(dtype))
            first = first + size
        return jax.tree.unflatten(self.structure, leaves)

    def put_state(self, numbers: Array, k: Array, y: State) -> Array:
        """The numbers with state number `k` replaced."""
        first = k * self.state_size
        for leaf in jax.tree.leaves(y):
            flat = leaf.reshape(-1).astype(self.dtype)
            numbers = jax.lax.dynamic_update_slice_in_dim(numbers, flat, first, 0)
            first = first + leaf.size
        return numbers

    def step_start(self, n: Array, shared: Array | bool) -> Array:
        """Index at which step number `n` begins; of steps that are `shared`, with one number each,
        those of later ones precede it."""
        width = self.step_size
        return self.size - jnp.where(shared, n + width, (n + 1) * width)


@final
class Recording(eqx.Module):
    """A record that is being filled; it holds `count` states. `shared`: whether the runs share
    their steps."""

    layout: RecordLayout = eqx.field(static=True)
    numbers: Float[Array, " numbers"]
    stride: Int[Array, ""]
    count: Int[Array, ""]
    shared: Bool[Array, ""]

    @classmethod
    def empty(cls, layout: RecordLayout, shared: Bool[Array, ""] | bool = False) -> "Recording":
        """The record before the first step. Raises `InputError` if all steps exceed the memory."""
        step = layout.steps_size * layout.dtype.itemsize // layout.limit
        check_memory("the record of the steps for a derivative", layout.limit, step)
        zero = jnp.asarray(0)
        none = jnp.zeros((layout.size,), layout.dtype)
        return cls(layout, none, zero + 1, zero, jnp.asarray(shared))

    def add(self, n: Int[Array, ""], step: Array, y: State, taken: Bool[Array, ""]) -> "Recording":
        """Append step number `n`, and the state `y` after it where one is due.

        A step that was not `taken` is written as well, and overwritten by the next one: a condition
        around the writing would copy the whole array."""
        layout = self.layout
        flat = step.reshape(-1).astype(layout.dtype)
        if layout.rows < layout.limit:
            # A run that has failed or waits at its event is behind the others.
            flat = jnp.where(self.shared, jnp.max(flat), flat)
        at = layout.step_start(n, self.shared)
        numbers = jax.lax.dynamic_update_slice_in_dim(self.numbers, flat, at, 0)
        numbers = layout.put_state(numbers, self.count, y)
        due = taken & ((n + 1) & (self.stride - 1) == 0)
        count = self.count + due.astype(self.count.dtype)
        added = dataclasses.replace(self, numbers=numbers, count=count)
        if layout.longest == 1:
            return added

        def full(recording: Recording) -> Bool[Array, ""]:
            left = layout.step_start(n + 1, self.shared)
            free = left - (recording.count + 1) * layout.state_size
            return taken & (n + 1 < layout.limit) & (free < 0)

        return jax.lax.while_loop(full, Recording.thinned, added)

    def thinned(self) -> "Recording":
        """Drop every second state, the first one included, and double the stride."""
        size = self.layout.state_size
        half = self.layout.size // (2 * size)
        count = self.count // 2
        moved = self.numbers[: 2 * half * size].reshape(half, 2, size)[:, 1].reshape(-1)
        # The steps at the other end of the array are left.
        is_state = jnp.arange(half * size) < count * size
        front = jnp.where(is_state, moved, self.numbers[: half * size])
        numbers = jax.lax.dynamic_update_slice_in_dim(self.numbers, front, 0, 0)
        return Recording(self.layout, numbers, 2 * self.stride, count, self.shared)


@final
class Record(eqx.Module):
    """The record of a run of `count` steps.

    - `ends`: the normalised time at which each run ends, at its event; infinite elsewhere.
    - `shared`: whether the runs share their steps."""

    layout: RecordLayout = eqx.field(static=True)
    numbers: Float[Array, " numbers"]
    stride: Int[Array, ""]
    count: Int[Array, ""]
    ends: Float[Array, "*runs"] | float = math.inf
    shared: Bool[Array, ""] | bool = False

    def state(self, k: Int[Array, ""]) -> State:
        """The state after (k + 1) stride steps."""
        return self.layout.state(self.numbers, k)

    def step(self, n: Int[Array, ""]) -> Array:
        """The recorded numbers of step number `n`."""
        layout = self.layout
        first = layout.step_start(n, self.shared)
        flat = jax.lax.dynamic_slice_in_dim(self.numbers, first, layout.step_size)
        if layout.rows < layout.limit:
            flat = jnp.where(self.shared, flat[-1], flat)
        return flat.reshape(layout.step)


def check_memory(what: str, steps: int, per_step: int) -> None:
    """Raise `InputError` if the records of all steps exceed the fraction `SHARE` of the memory.

    **Arguments**

    - `what`: the name of the records.
    - `steps`: the largest number of steps.
    - `per_step`: bytes of one step."""
    size = steps * per_step
    if size <= UNCHECKED_BYTES:
        return
    available = SHARE * memory()
    if size > available:
        raise InputError(
            f"Accuracy.max_steps is {steps}: with a capacity for all of them {what} would require "
            f"{size / 1e9:.0f} GB of memory; on this machine it must be at most "
            f"{int(available) // per_step}."
        )


def memory() -> float:
    """Memory of the device in use, or of this machine, bytes; infinite if both are unknown."""
    # None from a CPU.
    limit = (jax.devices()[0].memory_stats() or {}).get("bytes_limit")
    if limit is not None:
        return limit
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    # Not a POSIX system.
    except (AttributeError, ValueError):
        return float("inf")
