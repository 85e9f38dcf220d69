"""States saved by runs that each have their own time: a log in their order, sorted into rows.

A run reaches its save times in passes of its own. To write each state to its row at once is a
scatter, which on a CPU takes longer than a step of the method. A log instead gets whole rows, of
all runs:

    log row j: the states of all runs at their next save times, and how many each had after it

Run i has saved its state number k in the first row j whose count exceeds k, which a binary search
finds for all rows at once, when the log is full or the runs have ended.
"""

from typing import NamedTuple

import diffrax
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..core import State
from ..solvers.dense_output import evaluated
from ._buffers import nan_buffer, next_save, put_row

# Rows of the log beyond the number of save times.
SPARE = 128


class SaveLog(NamedTuple):
    """States at the save times of each run, times first, and the log of those not yet among them.

    - `states`: `base` of each run are filled in.
    - `rows`, `after`: of the log, of which the first `used` hold states; how many states each run
      had saved after each of them.
    - `count`: how many each run has saved."""

    states: State
    base: Int[Array, "*runs"]
    rows: State
    after: Int[Array, "capacity *#runs"]
    used: Int[Array, ""]
    count: Int[Array, "*runs"]

    @classmethod
    def empty(cls, times: int, y: State, runs: tuple[int, ...]) -> "SaveLog":
        """The log of so many save times before the first step."""
        none = jnp.zeros(runs, jnp.int32)
        size = times + SPARE
        rows = jax.tree.map(lambda x: jnp.zeros((size, *x.shape), x.dtype), y)
        after = jnp.full((size, *runs), jnp.iinfo(jnp.int32).max, jnp.int32)
        return cls(nan_buffer(times, y), none, rows, after, jnp.zeros((), jnp.int32), none)

    def following(self, save_ts: Float[Array, "times *#runs"]) -> Float[Array, "*runs"]:
        """The next save time of each run, the last one after it."""
        return next_save(save_ts, self.count)

    def record(
        self,
        polynomial: diffrax.AbstractLocalInterpolation,
        save_ts: Float[Array, "times *#runs"],
        start: Float[Array, "*runs"],
        length: Float[Array, "*runs"],
        reached: Float[Array, "*runs"],
    ) -> "SaveLog":
        """As of `SavedStates`."""
        size = save_ts.shape[0]

        def due(log: SaveLog) -> Bool[Array, "*runs"]:
            return (log.count < size) & (log.following(save_ts) <= reached)

        def append(log: SaveLog) -> SaveLog:
            # A loop of at most one pass, because a conditional would copy the whole buffer.
            log = jax.lax.while_loop(
                lambda log: log.used >= log.after.shape[0], lambda log: log.sorted(), log
            )
            place = (log.following(save_ts) - start) / jnp.where(length > 0.0, length, 1.0)
            count = log.count + due(log).astype(jnp.int32)
            rows = put_row(log.rows, log.used, evaluated(polynomial, place))
            after = log.after.at[log.used].set(count)
            return log._replace(rows=rows, after=after, used=log.used + 1, count=count)

        return jax.lax.while_loop(lambda log: jnp.any(due(log)), append, self)

    def sorted(self) -> "SaveLog":
        """With all states in their rows, and an empty log."""
        runs = self.count.size
        size = self.after.shape[0]
        times = jax.tree.leaves(self.states)[0].shape[0]
        number = jnp.arange(times, dtype=jnp.int32)[:, None]
        # Behind the rows in use no count is exceeded: they hold those of an earlier filling.
        after = self.after.reshape(size, runs)
        used = jnp.arange(size, dtype=jnp.int32)[:, None] < self.used
        after = jnp.where(used, after, jnp.iinfo(jnp.int32).max)
        place = jnp.zeros((times, runs), jnp.int32)
        bit = 1 << (size.bit_length() - 1)
        while bit:
            # The rows before `place` have counts of at most `number`.
            ahead = place + bit
            there = jnp.take_along_axis(
                after, jnp.minimum(ahead, size) - 1, axis=0, mode="promise_in_bounds"
            )
            place = jnp.where((ahead <= size) & (there <= number), ahead, place)
            bit >>= 1
        new = (number >= self.base.reshape(runs)) & (number < self.count.reshape(runs))
        place = jnp.minimum(place, size - 1)

        def leaf(states: Array, rows: Array) -> Array:
            parts = rows.reshape(size, -1, runs)
            found = jnp.take_along_axis(parts, place[:, None], axis=0, mode="promise_in_bounds")
            old = states.reshape(times, -1, runs)
            return jnp.where(new[:, None], found, old).reshape(states.shape)

        states = jax.tree.map(leaf, self.states, self.rows)
        return self._replace(states=states, base=self.count, used=jnp.zeros_like(self.used))
