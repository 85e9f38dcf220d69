"""Buffers that the loop of an integration fills: rows of states."""

from typing import NamedTuple

import diffrax
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PyTree

from ..core import State
from ._memory import check_memory


def empty_buffer(count: int, y: State) -> State:
    """Memory for `count` states, most of which is never used."""
    # Not `jax.lax.empty`, which is zeros on a CPU anyway: with JAX 0.10 every map gives it, and all
    # that is written to it, a further axis.
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


def empty_steps(
    limit: int, clock: Array, y: State, dense: bool
) -> tuple[Float[Array, " steps"], State | None]:
    """Memory for the ends of `limit` steps, like the times of the `clock`, (*runs,), and, for a
    `dense` output, the states at them. Raises `InputError` where the memory does not suffice."""
    recorded = (clock, *jax.tree.leaves(y)) if dense else (clock,)
    check_memory("the steps of the run", limit, sum(x.size * x.dtype.itemsize for x in recorded))
    ends = jnp.zeros((limit, *clock.shape), clock.dtype)
    return ends, empty_buffer(limit, y) if dense else None


class SavedStates(NamedTuple):
    """States at the save times, times first, of which the first `count` are filled in."""

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
            # Clamped, because the condition is also evaluated after the last save time.
            following = save_ts[jnp.minimum(saved.count, size - 1)]
            return (saved.count < size) & (following <= t1)

        def append(saved: SavedStates) -> SavedStates:
            y = interpolation.evaluate(save_ts[jnp.minimum(saved.count, size - 1)])
            return SavedStates(put_row(saved.states, saved.count, y), saved.count + 1)

        return jax.lax.while_loop(due, append, self)
