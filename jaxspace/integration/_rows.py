"""Rows of arrays, rows first and runs last, which the runs read and write at individual
positions."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int, PyTree

from ..core import State


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


def put_rows(rows: State, index: Int[Array, "*runs"], due: Bool[Array, "*runs"], y: State) -> State:
    """Rows of states, rows first and runs last, with the state of each run that is `due` in its row
    `index`. Where the runs share the index, in that row, which is written in any case."""
    if index.ndim == 0:
        return put_row(rows, index, y)
    runs = index.size
    flat = jax.tree.map(lambda x: x.reshape(x.shape[0], -1, runs), rows)
    new = jax.tree.map(lambda x: x.reshape(-1, runs), y)
    # On a CPU the compiler makes a loop of a scatter as well, one of ten times as many operations.
    flat = jax.lax.platform_dependent(
        flat, index.reshape(runs), due.reshape(runs), new, cpu=_put_in_turn, default=_put_at_once
    )
    return jax.tree.map(lambda x, old: x.reshape(old.shape), flat, rows)


def _put_in_turn(rows: PyTree, index: Array, due: Array, new: PyTree) -> PyTree:
    """Write one run after the other. With operations of `lax`: those of `jax.numpy` count indices
    from the end, too, which doubles the time of the loop."""
    pick = jax.lax.dynamic_index_in_dim
    index = index.astype(int)

    def put(i: Array, rows: PyTree) -> PyTree:
        here = pick(due, i, keepdims=False)
        start = pick(index, i, keepdims=False), jnp.zeros_like(i), i

        def leaf(x: Array, values: Array) -> Array:
            old = jax.lax.dynamic_slice(x, start, (1, x.shape[1], 1))
            value = jnp.where(here, pick(values, i, axis=1), old)
            return jax.lax.dynamic_update_slice(x, value, start)

        return jax.tree.map(leaf, rows, new)

    return jax.lax.fori_loop(0, index.size, put, rows)


def _put_at_once(rows: PyTree, index: Array, due: Array, new: PyTree) -> PyTree:
    """Write all runs by a scatter."""

    def leaf(x: Array, values: Array) -> Array:
        row = jnp.where(due, index, x.shape[0])
        return x.at[row, :, jnp.arange(index.size)].set(values.T, mode="drop")

    return jax.tree.map(leaf, rows, new)


def get_rows(rows: State, index: Int[Array, "*runs"], due: Bool[Array, "*runs"]) -> State:
    """The row `index` of each run that is `due`, and zeros of the others; of rows as in
    `put_rows`."""
    if index.ndim == 0:
        return jax.tree.map(lambda x: jnp.where(due, x[index], 0.0), rows)
    runs = index.size

    def leaf(x: Array) -> Array:
        flat = x.reshape(x.shape[0], -1, runs)
        values = flat[index.reshape(runs), :, jnp.arange(runs)].T.reshape(x.shape[1:])
        return jnp.where(due, values, jnp.zeros_like(values))

    return jax.tree.map(leaf, rows)


def rows_of(rows: Array, index: Int[Array, "*runs"]) -> Array:
    """The row `index` of each run, of rows that all share or of each run."""
    if index.ndim == 0 or rows.ndim == 1:
        return rows[index]
    return jnp.take_along_axis(
        jnp.broadcast_to(rows, (rows.shape[0], *index.shape)), index[None], 0
    )[0]
