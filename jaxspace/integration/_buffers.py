"""Buffers that the loop of an integration fills: rows of states, and the record of its steps."""

from typing import Any, NamedTuple

import diffrax
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PyTree

from ..core import State
from ..solvers.dense_output import evaluated
from ._record import Recording, RecordLayout


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
    """Rows of states, rows first and runs last, with the state of each run that is `due` in its
    own row `index`. Where the runs share the index, in that row, which is written in any case."""
    if index.ndim == 0:
        return put_row(rows, index, y)
    runs = index.size

    def leaf(x: Array, new: Array) -> Array:
        flat = x.reshape(x.shape[0], -1, runs)
        row = jnp.where(due, index, x.shape[0]).reshape(runs)
        values = new.reshape(-1, runs).T
        return flat.at[row, :, jnp.arange(runs)].set(values, mode="drop").reshape(x.shape)

    return jax.tree.map(leaf, rows, y)


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


def next_save(
    save_ts: Float[Array, "times *#runs"], count: Int[Array, "*runs"]
) -> Float[Array, "*runs"]:
    """The next save time of each run that has saved a `count` of states, the last one after it."""
    return rows_of(save_ts, jnp.minimum(count, save_ts.shape[0] - 1))


class SavedStates(NamedTuple):
    """States at the save times, times first, of which the first `count` of each run are filled
    in."""

    states: State
    count: Int[Array, "*runs"]

    def following(self, save_ts: Float[Array, "times *#runs"]) -> Float[Array, "*runs"]:
        """The next save time of each run, the last one after it."""
        return next_save(save_ts, self.count)

    def sorted(self) -> "SavedStates":
        """With all states in their rows, where they are."""
        return self

    def record(
        self,
        polynomial: diffrax.AbstractLocalInterpolation,
        save_ts: Float[Array, "times *#runs"],
        start: Float[Array, "*runs"],
        length: Float[Array, "*runs"],
        reached: Float[Array, "*runs"],
    ) -> "SavedStates":
        """Append the states at every save time up to the one `reached`, from the dense output of a
        step from 0 to 1, which has its `start` and its `length` in each run."""
        size = save_ts.shape[0]

        def due(saved: SavedStates) -> Bool[Array, "*runs"]:
            return (saved.count < size) & (saved.following(save_ts) <= reached)

        def append(saved: SavedStates) -> SavedStates:
            place = (saved.following(save_ts) - start) / jnp.where(length > 0.0, length, 1.0)
            here = due(saved)
            states = put_rows(saved.states, saved.count, here, evaluated(polynomial, place))
            return SavedStates(states, saved.count + here.astype(int))

        return jax.lax.while_loop(lambda saved: jnp.any(due(saved)), append, self)


class Buffers(NamedTuple):
    """What a loop fills as it goes on, each where it is requested.

    - `saved`: the states at the save times.
    - `step_ends`, `step_states`: ends of the accepted steps, and the states there.
    - `recording`: the steps, for derivatives."""

    saved: Any
    step_ends: Float[Array, " steps *runs"] | None
    step_states: State | None
    recording: Recording | None

    def completed(self) -> "Buffers":
        """The buffers with all saved states in their rows, after the last step."""
        return self if self.saved is None else self._replace(saved=self.saved.sorted())

    def add(
        self,
        n: Int[Array, "*runs"],
        number: Int[Array, ""],
        end: Array | None,
        y: State,
        step: Array,
        taken: Bool[Array, "*runs"],
        layout: RecordLayout,
    ) -> "Buffers":
        """The buffers with step number `n` of each run: its `end`, and the state `y` there. The
        record, of this `layout`, has a row for each pass in which a run moved, this one with its
        `number` and its `step`.

        A step that was not `taken` writes to no row, or to one that the next one overwrites."""
        _, ends, states, recording = self
        if ends is not None:
            ends = put_rows(ends, n, taken, end)
        if states is not None:
            states = put_rows(states, n, taken, y)
        if recording is not None:
            recording = recording.add(layout, number, step, y, jnp.any(taken))
        return self._replace(step_ends=ends, step_states=states, recording=recording)

    def again(self, empty: "Buffers") -> "Buffers":
        """These buffers for the same runs once more, with the counts of the `empty` ones: the
        states and steps in them are overwritten."""

        def leaf(new: Array, old: Array) -> Array:
            return old if old.ndim and jnp.issubdtype(old.dtype, jnp.inexact) else new

        return jax.tree.map(leaf, empty, self)

    def ends_of(self, count: Int[Array, "*runs"]) -> Array | None:
        """The ends of the `count` accepted steps of each run; infinite beyond them."""
        ends = self.step_ends
        if ends is None:
            return None
        rows = jnp.arange(ends.shape[0]).reshape(-1, *(1,) * (ends.ndim - 1))
        return jnp.where(rows < count, ends, jnp.inf)
