"""Buffers that the loop of an integration fills: rows of states, and the record of its steps."""

from typing import NamedTuple

import diffrax
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PyTree

from ..core import State
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


class Buffers(NamedTuple):
    """What a loop fills as it goes on, each where it is requested.

    - `saved`: the states at the save times.
    - `step_ends`, `step_states`: ends of the accepted steps, and the states there.
    - `recording`: the steps, for derivatives."""

    saved: SavedStates | None
    step_ends: Float[Array, " steps *runs"] | None
    step_states: State | None
    recording: Recording | None

    def add(
        self,
        n: Int[Array, ""],
        end: Array | None,
        y: State,
        step: Array,
        taken: Bool[Array, ""],
        limit: int,
    ) -> "Buffers":
        """The buffers with step number `n` of at most `limit`: its `end`, the state `y` there, and
        what is recorded of the `step`.

        A step that was not `taken` writes to the row that the next one overwrites."""
        _, ends, states, recording = self
        if ends is not None:
            ends = ends.at[n].set(end)
        if states is not None:
            states = put_row(states, n, y)
        if recording is not None:
            recording = recording.add(RecordLayout.of(y, step, limit), n, step, y, taken)
        return self._replace(step_ends=ends, step_states=states, recording=recording)

    def again(self, empty: "Buffers") -> "Buffers":
        """These buffers for the same run once more, with the counts of the `empty` ones: what is in
        them is overwritten."""
        return jax.tree.map(lambda new, old: old if old.ndim else new, empty, self)

    def ends_of(self, count: Int[Array, ""]) -> Array | None:
        """The ends of the `count` accepted steps; infinite beyond them."""
        ends = self.step_ends
        if ends is None:
            return None
        rows = jnp.arange(ends.shape[0]).reshape(-1, *(1,) * (ends.ndim - 1))
        return jnp.where(rows < count, ends, jnp.inf)
