"""Derivatives of statistics by the runs that have a weight in them.

    dS_k/dx = sum_i w_ki dy_i/dx,   w_ki = dS_k/dy_i

    symbol  meaning                            unit
    S_k     objective, and margins of limits   that of the output
    y_i     output of run i                    that of the output
    x       unknowns of the design             their own
    w_ki    weight, exactly zero for most runs 1

The outputs of all runs are computed without derivatives. Then only runs with a weight are computed
again, block by block, with theirs. Of a quantile, of the mean beyond it and of the greatest value
these are a few percent, and the gradient costs little beside the runs. A number of blocks that is
known only while the program runs changes no shape, so that one program serves every design.
"""

from collections.abc import Callable
from typing import NamedTuple, Protocol, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, Int, PyTree

from ..simulation.blocks import Blocks

# The outputs that count, one above the other, of the runs at these places, for flat unknowns.
OutputsOf = Callable[[Float[Array, " n"], Int[Array, " block"]], Float[Array, "outputs block"]]


@runtime_checkable
class Differentiated(Protocol):
    """What is differentiated: a tree of arrays and of what holds none, as a traced array must not
    be in its functions."""

    def numbers(self, x: PyTree) -> tuple[Float[Array, " rows"], PyTree]:
        """The objective and the margins of the limits, and the runs."""
        ...

    def weights(self, runs: PyTree) -> Float[Array, "rows runs"]:
        """The derivatives of the numbers, each by its own output of every run."""
        ...

    def places_of_outputs(self) -> tuple[int, ...]:
        """The place of the output of each of the numbers among all that count."""
        ...

    def outputs_at(self, x: PyTree, places: Int[Array, " block"]) -> Float[Array, "outputs block"]:
        """The outputs that count, of the runs at these places."""
        ...


def by_few_runs(
    problem: Differentiated, x: PyTree, forward: bool
) -> tuple[Float[Array, " rows"], PyTree]:
    """The numbers of the problem at `x`, differentiable by the runs that have a weight, and the
    runs, which count as constant.

    - `forward`: whether by forward mode."""
    # By name: what is passed so has no derivative.
    return _numbers(x, problem, forward=forward)


@eqx.filter_custom_jvp
def _numbers(
    x: PyTree, problem: Differentiated, *, forward: bool
) -> tuple[Float[Array, " rows"], PyTree]:
    del forward
    return problem.numbers(x)


@_numbers.def_jvp
def _numbers_jvp(
    primals: tuple[PyTree, Differentiated], tangents: tuple[PyTree, PyTree], *, forward: bool
) -> tuple[PyTree, PyTree]:
    x, problem = primals
    values, runs = problem.numbers(x)
    # Along an unknown that is not moved.
    still = lambda dx, x: jnp.zeros_like(x) if dx is None else dx  # noqa: E731
    dx = jax.tree.map(still, tangents[0], x, is_leaf=lambda dx: dx is None)
    change = _jacobian(problem, x, problem.weights(runs), forward) @ ravel_pytree(dx)[0]
    return (values, runs), (change, jax.tree.map(lambda _: None, runs))


def _jacobian(
    problem: Differentiated, x: PyTree, weights: Float[Array, "rows runs"], forward: bool
) -> Float[Array, "rows n"]:
    """The derivatives of the numbers by the flat design."""
    flat, unravel = ravel_pytree(x)
    size = Blocks.on(jax.local_devices()[:1], weights.shape[1]).size
    outputs = lambda flat, places: problem.outputs_at(unravel(flat), places)  # noqa: E731
    rows = jnp.asarray(problem.places_of_outputs())
    return (_forwards if forward else _backwards)(outputs, flat, weights, rows, size)


def _forwards(
    outputs: OutputsOf, x: Array, weights: Array, rows: Array, size: int
) -> Float[Array, "rows n"]:
    """By the derivatives of each run that has a weight in any row."""
    chosen = _chosen(weights, size)

    def add(k: Array, jacobian: Array) -> Array:
        places, weight = chosen.block(k, size)
        # A run gives the slopes of all its outputs at once, whichever rows they count in.
        slopes = jax.jacfwd(outputs)(x, places)
        return jacobian + jnp.einsum("ri,rin->rn", weight, slopes[rows])

    return lax.fori_loop(0, chosen.blocks, add, _zeros(weights, x))


def _backwards(
    outputs: OutputsOf, x: Array, weights: Array, rows: Array, size: int
) -> Float[Array, "rows n"]:
    """By one pullback of each block, row by row."""
    chosen = jax.vmap(lambda w: _chosen(w[None], size))(weights)
    # The blocks of all rows in sequence, so that the program has one pullback.
    ends = jnp.cumsum(chosen.blocks)

    def add(k: Array, jacobian: Array) -> Array:
        row = jnp.searchsorted(ends, k, side="right")
        own = jax.tree.map(lambda of_rows: of_rows[row], chosen)
        places, weight = own.block(k - ends[row] + own.blocks, size)
        every, pullback = jax.vjp(lambda x: outputs(x, places), x)
        (slope,) = pullback(jnp.zeros_like(every).at[rows[row]].set(weight[0]))
        return jacobian.at[row].add(slope)

    return lax.fori_loop(0, ends[-1], add, _zeros(weights, x))


class _Chosen(NamedTuple):
    """Runs with a weight in front: their places, their weights, and how many blocks they fill."""

    places: Int[Array, " filled"]
    weights: Float[Array, "rows filled"]
    blocks: Int[Array, ""]

    def block(self, k: Array, size: int) -> tuple[Array, Array]:
        """Places and weights of block k."""
        cut = lambda x: lax.dynamic_slice_in_dim(x, k * size, size, axis=-1)  # noqa: E731
        return cut(self.places), cut(self.weights)


def _chosen(weights: Float[Array, "rows runs"], size: int) -> _Chosen:
    """The runs with a weight in any of these rows."""
    # What is no number counts: it must reach the result.
    counts = jnp.any(weights != 0.0, axis=0)
    order = jnp.argsort(~counts, stable=True)
    # Copies of the first one fill the last block: another run may have failed.
    places = jnp.where(counts[order], order, order[0])
    filling = (0, -counts.size % size)
    filled = jnp.pad(weights[:, order], ((0, 0), filling))
    blocks = -(-jnp.sum(counts) // size)
    return _Chosen(jnp.concatenate([places, jnp.full(filling[1], order[0])]), filled, blocks)


def _zeros(weights: Array, x: Array) -> Float[Array, "rows n"]:
    return jnp.zeros((len(weights), x.size), x.dtype)
