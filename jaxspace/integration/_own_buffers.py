"""Buffers of a loop in which every run takes its own steps."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from ..core import State
from ..solvers.vector_field import ScaledField
from ._buffers import put_row
from ._own_state import OwnLoop, OwnState, Segment
from ._record import RecordLayout
from .loop import LoopSettings


def put_landed(rows: State, y: State, number: Array, done: Bool[Array, "*runs"]) -> State:
    """Write the state of each run that is `done` into the row of its segment.

    `rows` is (times, ..., *runs), and `number` holds the segment of each run. Rows of the other
    runs stay as they are.
    """
    runs = number.size
    row = jnp.where(done, number, jnp.inf).reshape(runs)

    def leaf(x: Array, new: Array) -> Array:
        flat = x.reshape(x.shape[0], -1, runs)
        where = jnp.where(jnp.isfinite(row), row, x.shape[0]).astype(int)
        values = new.reshape(-1, runs).T
        return flat.at[where, :, jnp.arange(runs)].set(values, mode="drop").reshape(x.shape)

    return jax.tree.map(leaf, rows, y)


def get_landed(rows: State, number: Array, done: Bool[Array, "*runs"]) -> State:
    """Read, for each run that is `done`, the row of its segment; zero for the other runs.

    `rows` is (times, ..., *runs), and `number` holds the segment of each run."""
    runs = number.size

    def leaf(x: Array) -> Array:
        flat = x.reshape(x.shape[0], -1, runs)
        where = jnp.clip(number.reshape(runs), 0, x.shape[0] - 1).astype(int)
        values = flat[where, :, jnp.arange(runs)].T.reshape(x.shape[1:])
        return jnp.where(done, values, 0.0)

    return jax.tree.map(leaf, rows)


def record_of_pass(h: Array, done: Bool[Array, "*runs"]) -> Array:
    """The record of one pass: the step of each run, and whether the run landed, (2, *runs)."""
    return jnp.stack([h, done.astype(h.dtype)])


def written(
    settings: LoopSettings,
    field: ScaledField,
    loop: OwnLoop,
    accept: Array,
    h: Array,
    done: Array,
    y: OwnState,
) -> OwnLoop:
    """Write the results of one pass into the buffers of the loop."""
    saved, ends, states, recording = loop[-5:-1]
    moved = jnp.any(accept)
    if saved is not None:
        # A loop of at most one pass, because a conditional would copy the whole buffer.
        saved, _ = jax.lax.while_loop(
            lambda carry: carry[1],
            lambda carry: (put_landed(carry[0], y, y.segment, done), jnp.array(False)),
            (saved, jnp.any(done)),
        )
    if ends is not None:
        segment = Segment.of(field, settings, y.segment)
        part = y.z[-1] / jnp.where(segment.duration == 0.0, 1.0, segment.duration)
        ends = ends.at[loop.count].set((y.segment + part).astype(ends.dtype))
    if states is not None:
        states = put_row(states, loop.count, y)
    if recording is not None:
        step = record_of_pass(h, done)
        layout = RecordLayout.of(y, step, settings.max_steps)
        recording = recording.add(layout, loop.count, step, y, moved)
    return loop._replace(
        count=loop.count + moved.astype(int),
        saved=saved,
        ends=ends,
        states=states,
        recording=recording,
    )
