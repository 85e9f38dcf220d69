"""Buffers that the loop of an integration fills: rows of states, and the record of its steps."""

import dataclasses
from typing import NamedTuple

import diffrax
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..core import State
from ..core.barrier import barrier
from ..solvers.dense_output import evaluated
from ._record import Recording
from ._rows import nan_buffer, put_rows, rows_of


def place_in_step(t: Array, start: Array, length: Array) -> Array:
    """Position of the normalised time `t` in a step from 0 to 1, with its `start` and its
    `length`."""
    return (t - start) / jnp.where(length > 0.0, length, 1.0)


class SavedStates(NamedTuple):
    """States at the save times, times first, of which the first `count` of each run are filled in.

    `next_ts`: the next save time of each run, infinite after the last."""

    states: State
    count: Int[Array, "*runs"]
    next_ts: Float[Array, "*runs"]

    @classmethod
    def empty(
        cls, save_ts: Float[Array, "times *#runs"], y: State, runs: tuple[int, ...]
    ) -> "SavedStates":
        """The states before the first step, of runs of this shape."""
        states = nan_buffer(save_ts.shape[0], y)
        return cls(states, jnp.zeros(runs, jnp.int32), jnp.broadcast_to(save_ts[0], runs))

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
        last = save_ts.shape[0] - 1

        def append(saved: SavedStates) -> SavedStates:
            due = saved.next_ts <= reached
            place = place_in_step(saved.next_ts, start, length)
            if place.ndim:
                # Read for every component.
                place = barrier(place)
            states = put_rows(saved.states, saved.count, due, evaluated(polynomial, place))
            count = saved.count + due.astype(saved.count.dtype)
            following = rows_of(save_ts, jnp.minimum(count, last))
            return SavedStates(states, count, jnp.where(count > last, jnp.inf, following))

        # A step may pass several save times or none: most iterations save nothing and cost
        # nothing.
        return jax.lax.while_loop(lambda saved: jnp.any(saved.next_ts <= reached), append, self)


class Buffers(NamedTuple):
    """The buffers that a loop fills, each if requested.

    - `saved`: the states at the save times.
    - `step_ends`, `step_states`: ends of the accepted steps, and the states there.
    - `recording`: the steps, for derivatives."""

    saved: SavedStates | None
    step_ends: Float[Array, " steps *runs"] | None
    step_states: State | None
    recording: Recording | None

    def add(
        self,
        n: Int[Array, "*runs"],
        number: Int[Array, ""],
        end: Array | None,
        y: State,
        step: Array,
        taken: Bool[Array, "*runs"],
    ) -> "Buffers":
        """The buffers with step number `n` of each run: its `end`, and the state `y` there. The
        record has a row for each iteration in which a run moved, this one with its `number` and its
        `step`.

        A step that was not `taken` writes no row, or one that the next step overwrites."""
        _, ends, states, recording = self
        if ends is not None:
            ends = put_rows(ends, n, taken, end)
        if states is not None:
            states = put_rows(states, n, taken, y)
        if recording is not None:
            recording = recording.add(number, step, y, jnp.any(taken))
        return self._replace(step_ends=ends, step_states=states, recording=recording)

    def again(self, empty: "Buffers") -> "Buffers":
        """These buffers for the same runs once more, with the counts of the `empty` ones: the
        states and steps in them are overwritten."""
        saved, recording = empty.saved, empty.recording
        if saved is not None and self.saved is not None:
            saved = saved._replace(states=self.saved.states)
        if recording is not None and self.recording is not None:
            recording = dataclasses.replace(recording, numbers=self.recording.numbers)
        return Buffers(saved, self.step_ends, self.step_states, recording)

    def ends_of(self, count: Int[Array, "*runs"]) -> Array | None:
        """The ends of the `count` accepted steps of each run; infinite beyond them."""
        ends = self.step_ends
        if ends is None:
            return None
        # Behind the last step there may be the end of one that was rejected.
        rows = jnp.arange(ends.shape[0]).reshape(-1, *(1,) * (ends.ndim - 1))
        return jnp.where(rows < count, ends, jnp.inf)
