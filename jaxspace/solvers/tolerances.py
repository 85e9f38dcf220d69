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
from .embedded_errors import EmbeddedErrors, blended_square, is_in_parts


@final
class Tolerance(eqx.Module):
    """The allowed error of a step: `rtol` times the length of each block of the state, plus `atol`;
    common to all runs or individual, (*runs,).

    - `run_axes`: number of trailing axes carry runs.
    - `blocks`: for a state packed into one vector, the sizes of its blocks; empty where each array
      of the state is a block."""

    rtol: Scalar
    atol: Scalar
    run_axes: int = eqx.field(static=True)
    blocks: tuple[int, ...] = eqx.field(static=True, default=())

    def length(
        self, block: Float[Array, "..."] | EmbeddedErrors
    ) -> Float[Array, "*of_blocks_and_runs"]:
        """The length of a block, or of its error, for each run, (*runs); of blocks in a vector,
        (blocks, *runs).

        It is not differentiated, because no result depends on it."""
        if isinstance(block, EmbeddedErrors):
            # One root for the block, where its components would need one each.
            return jnp.sqrt(self._sums(blended_square(*jax.lax.stop_gradient(block))))
        return self._larger(block)

    def _larger(self, *blocks: Float[Array, "..."]) -> Float[Array, "*runs"]:
        """The largest of the lengths of some blocks for each run."""
        # At zero the root has no derivative.
        blocks = jax.lax.stop_gradient(blocks)
        if not self.blocks and blocks[0].ndim <= self.run_axes:
            return functools.reduce(jnp.maximum, map(jnp.abs, blocks))
        return jnp.sqrt(functools.reduce(jnp.maximum, [self._sums(b * b) for b in blocks]))

    def _sums(self, squares: Float[Array, "..."]) -> Float[Array, "*of_blocks_and_runs"]:
        """The sum of the squares of the components of a block, or of each block in a vector."""
        if not self.blocks:
            return self._reduce(jnp.sum, jnp.add, squares)
        # A number that is not finite makes all blocks of the product not finite, and the run fails,
        # as it should.
        members = np.repeat(np.eye(len(self.blocks)), self.blocks, axis=1)
        return jnp.tensordot(members.astype(squares.dtype), squares, 1)

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

    def worst(
        self, lengths: PyTree[Float[Array, "..."]], scale: PyTree[Float[Array, "..."]]
    ) -> Float[Array, "*runs"]:
        """The largest of the `lengths` of some blocks in units of the tolerance, for each run.

        `scale` contains the length of each block of the state."""
        leaves = jax.tree.leaves(
            jax.tree.map(lambda x, s: x / (self.atol + self.rtol * s), lengths, scale)
        )
        if self.blocks:
            return jnp.max(leaves[0], axis=0)
        return functools.reduce(jnp.maximum, leaves)

    def error(self, y0: State, y1: State, error: PyTree) -> Float[Array, "*runs"]:
        """The local error of each run in units of the tolerance; infinite where it is not finite.

        **Arguments**

        - `y0`, `y1`: the states before and after the step.
        - `error`: the estimate of the error of `y1`, which may be in parts.
        """
        lengths = jax.tree.map(self.length, error, is_leaf=is_in_parts)
        e = self.worst(lengths, jax.tree.map(self._larger, y0, y1))
        e = jnp.where(jnp.isfinite(e), e, jnp.inf)
        # Many operations read it, with each of which the compiler would compute it again.
        return barrier(e) if self.run_axes else e

    def moved(self, y0: State, y1: State, part: float) -> Bool[Array, "*runs"]:
        """Whether every block of the state of each run has moved by this part of its length."""

        def of(a: Array, b: Array) -> Array:
            size = self.length(b)
            return (self.length(b - a) >= part * size) & (size > 0.0)

        leaves = jax.tree.leaves(jax.tree.map(of, y0, y1))
        if self.blocks:
            return jnp.all(leaves[0], axis=0)
        return functools.reduce(jnp.logical_and, leaves)

    def alive(self, y: State) -> Bool[Array, "*runs"]:
        """Whether all numbers in the state of each run are finite."""
        leaves = jax.tree.leaves(y)
        flags = [self._reduce(jnp.all, jnp.logical_and, jnp.isfinite(b)) for b in leaves]
        result = functools.reduce(jnp.logical_and, flags)
        return barrier(result) if self.run_axes else result
