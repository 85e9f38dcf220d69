"""What the loop of an integration writes down as it goes: saved states, and checkpoints.

Checkpoints lie as densely as a fixed buffer allows: after every step at first, and after every
second one of those whenever the buffer is full.
"""

from typing import NamedTuple

import diffrax
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PyTree

from ..core import State

CHECKPOINT_BYTES = 2**18
"""Size of the checkpoint buffer. A larger one takes longer to fill and to move than the steps
between two checkpoints take to be computed again (measured by `benchmarks/gradients.py`)."""


def capacity_for(y0: State, limit: int) -> int:
    """How many checkpoints of at most `limit` steps fit the buffer.

    An even number where they do not all fit, so that it can be halved."""
    size = sum(leaf.size * leaf.dtype.itemsize for leaf in jax.tree.leaves(y0))
    return min(limit, max(2, CHECKPOINT_BYTES // size // 2 * 2))


def empty_buffer(count: int, y: State) -> State:
    """Memory for `count` states: most of a buffer is never used."""
    # Not `jax.lax.empty`, which is zero on a CPU all the same: JAX 0.10 gives it, and then all that
    # is written to it, an axis of its own under every map.
    return jax.tree.map(lambda x: jnp.zeros((count, *x.shape), x.dtype), y)


def nan_buffer(count: int, y: State) -> State:
    """Memory for `count` states, NaN until they are reached."""
    return jax.tree.map(lambda x: jnp.full((count, *x.shape), jnp.nan, x.dtype), y)


def get_row(rows: PyTree, index: Int[Array, ""]) -> PyTree:
    """One row of a tree of rows."""
    return jax.tree.map(lambda x: x[index], rows)


def put_row(rows: PyTree, index: Int[Array, ""], row: PyTree) -> PyTree:
    """A tree of rows with one of them replaced."""
    return jax.tree.map(lambda x, a: x.at[index].set(a), rows, row)


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
