"""The state of Stormer's method: equal steps of a second-order system, with the accelerations at
the last ones kept in a ring.

Equations and symbols: `_stormer.py`.
"""

import functools
import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..core import barrier
from ._nystrom import DOP853_NYSTROM, nystrom_step
from ._polynomials import weights_of
from ._second_order import SecondOrder


class Kept(NamedTuple):
    """Positions, velocities until the next step, and accelerations at steps, one after the
    other."""

    r: Array
    w: Array
    a: Array


class Past(NamedTuple):
    """Position, velocity between the steps, and the last accelerations: that of the step n in the
    slot n modulo k."""

    r: Array
    w: Array
    ring: Array


@jax.custom_jvp
def _weighted(row: Array, ring: Array) -> Array:
    """sum_i row_i ring_i."""
    total = row[0] * ring[0]
    for slot in range(1, ring.shape[0]):
        total = total + row[slot] * ring[slot]
    return total


@functools.partial(_weighted.defjvp, symbolic_zeros=True)
def _weighted_rule(given: tuple[Array, Array], change: tuple[Any, Any]) -> tuple[Array, Array]:
    # As a sum over the axis, because reverse mode then spreads the result over the ring in one go,
    # not slot by slot. The row is one of a table of constants.
    (row, ring), (_, d_ring) = given, change
    return _weighted(row, ring), jnp.sum(
        row.reshape(row.shape + (1,) * (ring.ndim - 1)) * d_ring, axis=0
    )


class StormerState(NamedTuple):
    """The equal steps `h` of order `k` of a system from the clock time `s0` on."""

    system: SecondOrder
    s0: Array
    h: Array
    k: int
    steps: int

    def acceleration(self, n: Any, r: Array) -> Array:
        """The acceleration at the step n."""
        return self.system.acceleration(self.s0 + n * self.h, r)

    def slot(self, n: Any) -> Array:
        """Where the acceleration at the step n is kept."""
        return jnp.asarray(jax.lax.rem(jnp.asarray(n), self.k))

    def put(self, a: Array, n: Any, ring: Array) -> Array:
        """The accelerations with that at the step n in place of the oldest."""
        return jax.lax.dynamic_update_index_in_dim(ring, a, self.slot(n), 0)

    def turned(self, weights: tuple[float, ...], n: Any, ring: Array) -> Array:
        """h times the sum of the accelerations up to that of the step n, weighted; the newest has
        the first weight."""
        table = np.array(
            [[weights[(i - slot) % self.k] for slot in range(self.k)] for i in range(self.k)]
        )
        row = jax.lax.dynamic_index_in_dim(
            jnp.asarray(table, ring.dtype), self.slot(n), keepdims=False
        )
        return self.h.astype(ring.dtype) * _weighted(row, ring)

    def begin(self) -> tuple[Past, Kept]:
        """The past of the step k - 1, and what came before."""

        def one(y: tuple[Array, Array], n: Array) -> tuple[tuple[Array, Array], Kept]:
            r, v, w, ks = nystrom_step(
                self.system, DOP853_NYSTROM, self.s0 + n * self.h, self.h, *y
            )
            return (r, v), Kept(y[0], w, ks[0])

        y0, m = self.system.y0, self.k - 1
        (r, v), kept = jax.lax.scan(
            one, (y0.position, y0.velocity), jnp.arange(m, dtype=self.h.dtype)
        )
        ring = jnp.concatenate([kept.a, self.acceleration(m, r)[None]])
        return Past(r, v - self.turned(weights_of(self.k).now, m, ring), ring), kept

    def one(self, past: Past, n: Array) -> tuple[Past, Kept]:
        """The step that follows the step n."""
        a = self.acceleration(n.astype(self.h.dtype), past.r)
        ring = self.put(a, n, past.ring)
        w = barrier(past.w + self.turned(weights_of(self.k).next, n, ring))
        r = barrier(past.r + self.h.astype(a.dtype) * self.system.travel(w))
        return Past(r, w, ring), Kept(past.r, w, a)

    def go_on(self, past: Past) -> tuple[Past, Array, list[Kept]]:
        """The past of the last step, the largest local error of the velocity, and what came before.

        In stretches, so that reverse mode keeps the past at the start of each and takes its steps
        once more."""
        m = self.k - 1
        length = math.isqrt(self.steps - m)
        stretches, rest = divmod(self.steps - m - 1, length)

        def stretch(
            carry: tuple[Past, Array], first: Array, count: int
        ) -> tuple[tuple[Past, Array], Kept]:
            past, kept = jax.lax.scan(self.one, carry[0], first + jnp.arange(count))
            error = jnp.abs(self.turned(weights_of(self.k).change, first + count - 1, past.ring))
            return (past, jnp.maximum(carry[1], jax.lax.stop_gradient(error))), kept

        carry, begun = stretch((past, jnp.zeros_like(past.w)), jnp.asarray(m), rest + 1)
        again = jax.checkpoint(lambda c, first: stretch(c, first, length))
        carry, kept = jax.lax.scan(again, carry, m + rest + 1 + length * jnp.arange(stretches))
        return *carry, [begun, jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), kept)]

    def finish(self, past: Past) -> tuple[Any, Array]:
        """The state at the last step, and the acceleration there."""
        a = self.acceleration(self.steps, past.r)
        ring = self.put(a, self.steps, past.ring)
        return self.system.state(
            past.r, past.w + self.turned(weights_of(self.k).now, self.steps, ring)
        ), a
