"""Equal steps of a second-order system by Stormer's method.

Equations and symbols: `_stormer.py`.
"""

import functools
import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PyTree

from ..core import State
from ..core.barrier import barrier
from ._nystrom import DOP853_NYSTROM, nystrom_step
from ._polynomials import stormer_weights
from .second_order import SecondOrder, Vectors

Ring = Float[Array, "k ..."]


class StormerState(NamedTuple):
    """State between two steps: position `r`, velocity `w` from one step to the next, and the `ring`
    of the last k accelerations, where that of step n is at index n modulo k."""

    r: Vectors
    w: Vectors
    ring: Ring


class StepRecord(NamedTuple):
    """Positions `r`, velocities `w` until the next step, and accelerations `a`: of one step, or of
    many with the steps on the first axis. Dense output needs them."""

    r: Vectors
    w: Vectors
    a: Vectors


@jax.custom_jvp
def _weighted(row: Float[Array, " k"], ring: Ring) -> Array:
    """sum_i row_i ring_i."""
    total = row[0] * ring[0]
    for slot in range(1, ring.shape[0]):
        total = total + row[slot] * ring[slot]
    return total


@functools.partial(_weighted.defjvp, symbolic_zeros=True)
def _weighted_jvp(
    primals: tuple[Array, Array], tangents: tuple[PyTree, PyTree]
) -> tuple[Array, Array]:
    # A sum over the axis, because reverse mode then distributes the result over the ring at once,
    # and not slot by slot. The row is one of a table of constants and has no tangent.
    row, ring = primals
    _, d_ring = tangents
    weights = row.reshape(row.shape + (1,) * (ring.ndim - 1))
    return _weighted(row, ring), jnp.sum(weights * d_ring, axis=0)


class StormerSteps(NamedTuple):
    """Equal steps in a segment.

    - `system`: the second-order system.
    - `s0`, `h`: start of the segment and length of a step, in normalised time.
    - `k`: order.
    - `steps`: their number.
    """

    system: SecondOrder
    s0: Float[Array, ""]
    h: Float[Array, ""]
    k: int
    steps: int

    def acceleration(self, n: Array | int, r: Vectors) -> Vectors:
        """The acceleration at the step `n`."""
        return self.system.acceleration(self.s0 + n * self.h, r)

    def slot(self, n: Int[Array, ""] | int) -> Int[Array, ""]:
        """Index in the ring buffer of the acceleration at step `n`."""
        return jnp.asarray(jax.lax.rem(jnp.asarray(n), self.k))

    def replace_oldest(self, a: Vectors, n: Int[Array, ""] | int, ring: Ring) -> Ring:
        """The ring with the acceleration at the step `n` in place of the oldest."""
        return jax.lax.dynamic_update_index_in_dim(ring, a, self.slot(n), 0)

    def velocity_change(
        self, weights: tuple[float, ...], n: Int[Array, ""] | int, ring: Ring
    ) -> Vectors:
        """h times the weighted sum of the accelerations up to that at the step `n`; the newest has
        the first weight."""
        # One row for each slot of the newest: the weights are rotated in place of the ring.
        slots = range(self.k)
        table = np.array([[weights[(i - slot) % self.k] for slot in slots] for i in slots])
        row = jax.lax.dynamic_index_in_dim(
            jnp.asarray(table, ring.dtype), self.slot(n), keepdims=False
        )
        return self.h.astype(ring.dtype) * _weighted(row, ring)

    def start(self) -> tuple[StormerState, StepRecord]:
        """The state at the step k - 1, and the record of the steps before it."""

        def step(y: tuple[Array, Array], n: Array) -> tuple[tuple[Array, Array], StepRecord]:
            result = nystrom_step(self.system, DOP853_NYSTROM, self.s0 + n * self.h, self.h, *y)
            return (result.r, result.v), StepRecord(y[0], result.mean_velocity, result.ks[0])

        start = (self.system.r, self.system.v)
        m = self.k - 1
        (r, v), record = jax.lax.scan(step, start, jnp.arange(m, dtype=self.h.dtype))
        ring = jnp.concatenate([record.a, self.acceleration(m, r)[None]])
        w = v - self.velocity_change(stormer_weights(self.k).velocity, m, ring)
        return StormerState(r, w, ring), record

    def step(self, state: StormerState, n: Int[Array, ""]) -> tuple[StormerState, StepRecord]:
        """The step that follows the step `n`."""
        a = self.acceleration(n.astype(self.h.dtype), state.r)
        ring = self.replace_oldest(a, n, state.ring)
        w = barrier(state.w + self.velocity_change(stormer_weights(self.k).step, n, ring))
        r = barrier(state.r + self.h.astype(a.dtype) * self.system.position_rate(w))
        return StormerState(r, w, ring), StepRecord(state.r, w, a)

    def integrate(self, state: StormerState) -> tuple[StormerState, Vectors, list[StepRecord]]:
        """The state at the last step, the largest local error of the velocity, and the records of
        the steps in between.

        In chunks: reverse mode stores the state at the start of each chunk and repeats its steps.
        The local error is estimated at the end of each chunk."""
        m = self.k - 1
        length = math.isqrt(self.steps - m)
        chunks, rest = divmod(self.steps - m - 1, length)

        def chunk(
            carry: tuple[StormerState, Vectors], first: Int[Array, ""], count: int
        ) -> tuple[tuple[StormerState, Vectors], StepRecord]:
            state, largest = carry
            state, record = jax.lax.scan(self.step, state, first + jnp.arange(count))
            difference = stormer_weights(self.k).difference
            error = jnp.abs(self.velocity_change(difference, first + count - 1, state.ring))
            return (state, jnp.maximum(largest, jax.lax.stop_gradient(error))), record

        # The first chunk takes the remainder.
        carry, first = chunk((state, jnp.zeros_like(state.w)), jnp.asarray(m), rest + 1)
        whole = jax.checkpoint(lambda carry, first: chunk(carry, first, length))
        starts = m + rest + 1 + length * jnp.arange(chunks)
        (state, error), others = jax.lax.scan(whole, carry, starts)
        others = jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), others)
        return state, error, [first, others]

    def final(self, state: StormerState) -> tuple[State, Vectors]:
        """The state of the system at the last step, and the acceleration there."""
        a = self.acceleration(self.steps, state.r)
        ring = self.replace_oldest(a, self.steps, state.ring)
        change = self.velocity_change(stormer_weights(self.k).velocity, self.steps, ring)
        return self.system.state(state.r, state.w + change), a
