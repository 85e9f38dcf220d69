"""The error that each run makes in a step, in units of the tolerance.

For each run

    e = max over the blocks of  |error| / (atol + rtol max(|y0|, |y1|))          | |: length

A block of the state is a vector (a position, a quaternion) or a scalar (a mass), measured by its
length. The error thus does not depend on the axes, and a component that passes through zero does
not need small steps.
"""

import functools
from collections.abc import Callable
from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, PyTree

from ..core import Scalar, State
from ..core.barrier import barrier


@final
class Tolerance(eqx.Module):
    """The allowed error of a step: `rtol` times the length of each block of the state, plus `atol`;
    one for all runs or each run its own, (*runs,).

    - `run_axes`: how many trailing axes carry runs.
    - `blocks`: for a state packed into one vector, the sizes of its blocks; empty where each array
      of the state is a block."""

    rtol: Scalar
    atol: Scalar
    run_axes: int = eqx.field(static=True)
    blocks: tuple[int, ...] = eqx.field(static=True, default=())

    def length(self, block: Float[Array, "..."]) -> Float[Array, "*of_blocks_and_runs"]:
        """The length of a block for each run, (*runs); of blocks in a vector, (blocks, *runs).

        It has no derivative, because no result depends on it."""
        return self._larger(block)

    def _larger(self, *blocks: Float[Array, "..."]) -> Float[Array, "*runs"]:
        """The largest of the lengths of some blocks for each run."""
        # At zero the root has no derivative.
        blocks = jax.lax.stop_gradient(blocks)
        if self.blocks:
            return jnp.sqrt(functools.reduce(jnp.maximum, map(self._squares, blocks)))
        if blocks[0].ndim <= self.run_axes:
            return functools.reduce(jnp.maximum, map(jnp.abs, blocks))
        squares = [self._reduce(jnp.sum, jnp.add, b * b) for b in blocks]
        return jnp.sqrt(functools.reduce(jnp.maximum, squares))

    def _squares(self, vector: Float[Array, "components *#runs"]) -> Float[Array, "blocks *#runs"]:
        """The squares of the lengths of the blocks in a vector."""
        # A number that is not finite makes all blocks of the product not finite, and the run fails,
        # as it should.
        members = np.repeat(np.eye(len(self.blocks)), self.blocks, axis=1)
        return jnp.tensordot(members.astype(vector.dtype), vector * vector, 1)

    def _reduce(
        self,
        whole: Callable[..., Array],
        pair: Callable[[Array, Array], Array],
        block: Array,
    ) -> Array:
        """A reduction over all axes but those of the runs."""
        # In a reduction the compiler for CPUs processes one run after the other. Written by
        # components it processes many runs at once, which is faster for the few components of a
        # vector.
        if self.run_axes and block.ndim - self.run_axes == 1 and 0 < block.shape[0] <= 4:
            return functools.reduce(pair, block)
        return whole(block, axis=tuple(range(block.ndim - self.run_axes)))

    def largest(self, blocks: State, scale: PyTree[Float[Array, "..."]]) -> Float[Array, "*runs"]:
        """The largest length of the blocks in units of the tolerance, for each run.

        `scale` holds the length of each block of the state."""

        def ratio(b: Array, s: Array) -> Array:
            return self.length(b) / (self.atol + self.rtol * s)

        return self._worst_block(jax.tree.map(ratio, blocks, scale))

    def worst(
        self, lengths: PyTree[Float[Array, "..."]], scale: PyTree[Float[Array, "..."]]
    ) -> Float[Array, "*runs"]:
        """`largest` of blocks of which the `lengths` are known."""
        return self._worst_block(
            jax.tree.map(lambda x, s: x / (self.atol + self.rtol * s), lengths, scale)
        )

    def _worst_block(self, ratios: PyTree[Float[Array, "..."]]) -> Float[Array, "*runs"]:
        leaves = jax.tree.leaves(ratios)
        if self.blocks:
            return jnp.max(leaves[0], axis=0)
        return functools.reduce(jnp.maximum, leaves)

    def error(self, y0: State, y1: State, error: State) -> Float[Array, "*runs"]:
        """The local error of each run in units of the tolerance; infinite where it is not finite.

        **Arguments**

        - `y0`, `y1`: the states before and after the step.
        - `error`: the estimate of the error of `y1`.
        """
        e = self.largest(error, jax.tree.map(self._larger, y0, y1))
        e = jnp.where(jnp.isfinite(e), e, jnp.inf)
        # Many operations read it, with each of which the compiler would compute it again.
        return barrier(e) if self.run_axes else e

    def alive(self, y: State) -> Bool[Array, "*runs"]:
        """Whether all numbers in the state of each run are finite."""
        leaves = jax.tree.leaves(y)
        flags = [self._reduce(jnp.all, jnp.logical_and, jnp.isfinite(b)) for b in leaves]
        result = functools.reduce(jnp.logical_and, flags)
        return barrier(result) if self.run_axes else result
