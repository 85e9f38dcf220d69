"""Derivatives of statistics by the runs that have a weight in them.

    dS_k/dx = sum_i w_ki dy_i/dx,   w_ki = dS_k/dy_i

    symbol  meaning                            unit
    S_k     objective, and margins of limits   that of the output
    y_i     output of run i                    that of the output
    x       unknowns of the design             their own
    w_ki    weight, exactly zero for most runs 1

All runs are computed block by block. Then those with a weight are computed again, with their
derivatives. Of a quantile, of the mean beyond it and of the greatest value these are a few percent,
and the gradient is cheap compared with the runs. Both are sweeps of one loop, whose program
contains the runs once and compiles faster than with one for each. The number of blocks is
determined only while the program runs, so that one program is sufficient for every design.
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

# The outputs that count of the runs at these places, for flat unknowns; and the runs.
RunsAt = Callable[[Array, Array], tuple[Float[Array, "outputs block"], PyTree]]
# The contribution of a block of runs to the Jacobian, for a group of rows and their weights.
Slopes = Callable[[Int[Array, ""], Float[Array, "own block"]], Float[Array, "rows n"]]


@runtime_checkable
class Differentiated(Protocol):
    """The differentiated tree: arrays and objects without arrays, because its functions must not
    contain a traced array."""

    @property
    def count(self) -> int:
        """The number of runs."""
        ...

    def numbers(self, x: PyTree) -> tuple[Float[Array, " rows"], PyTree]:
        """The objective and the margins of the limits, and the runs."""
        ...

    def weighted(self, runs: PyTree) -> tuple[Float[Array, " rows"], Float[Array, "rows runs"]]:
        """The numbers, and the derivatives of each with respect to its output of every run."""
        ...

    def places_of_outputs(self) -> tuple[int, ...]:
        """The place of the output of each of the numbers among all that count."""
        ...

    def runs_at(
        self, x: PyTree, places: Int[Array, " block"]
    ) -> tuple[Float[Array, "outputs block"], PyTree]:
        """The outputs that count of the runs at these places, and the runs."""
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
    # Along an unknown that is not moved.
    still = lambda dx, x: jnp.zeros_like(x) if dx is None else dx  # noqa: E731
    dx = jax.tree.map(still, tangents[0], x, is_leaf=lambda dx: dx is None)
    values, jacobian, runs = _with_jacobian(problem, x, forward)
    change = jacobian @ ravel_pytree(dx)[0]
    return (values, runs), (change, jax.tree.map(lambda _: None, runs))


class _Chosen(NamedTuple):
    """Runs with a weight in the rows of a group, for each group of rows.

    - `places`: of the runs, those with a weight in front; `weights`: theirs in these rows.
    - `ends`: the number of the blocks of this group and of those before it."""

    places: Int[Array, "groups filled"]
    weights: Float[Array, "groups own filled"]
    ends: Int[Array, " groups"]

    def block(self, k: Array, size: int) -> tuple[Array, Array, Array]:
        """The group of block k, its places and its weights."""
        group = jnp.searchsorted(self.ends, k, side="right")
        first = jnp.where(group > 0, self.ends[group - 1], 0)
        start = (k - first) * size
        cut = lambda x: lax.dynamic_slice_in_dim(x[group], start, size, axis=-1)  # noqa: E731
        return group, cut(self.places), cut(self.weights)


class _Sweep(NamedTuple):
    """The buffers of the two sweeps: first the `runs`, followed by a block for recomputed ones,
    with the `numbers` and the `chosen` runs; then the `jacobian`."""

    runs: PyTree
    numbers: Float[Array, " rows"]
    chosen: _Chosen
    jacobian: Float[Array, "rows n"]


def _with_jacobian(
    problem: Differentiated, x: PyTree, forward: bool
) -> tuple[Float[Array, " rows"], Float[Array, "rows n"], PyTree]:
    """The numbers, their derivatives by the flat design, and the runs."""
    flat, unravel = ravel_pytree(x)
    count = problem.count
    size = Blocks.on(jax.local_devices()[:1], count).size
    blocks = -(-count // size)
    rows = jnp.asarray(problem.places_of_outputs())
    runs_at = lambda flat, places: problem.runs_at(unravel(flat), places)  # noqa: E731

    def weighted(runs: PyTree) -> tuple[Array, _Chosen]:
        numbers, weights = problem.weighted(jax.tree.map(lambda x: x[:count], runs))
        # Forward, a run gives the slopes of all its outputs at once, whichever rows they count in.
        return numbers, _chosen(weights[None] if forward else weights[:, None], size)

    def sweep(second: Array, s: _Sweep) -> _Sweep:
        again = second > 0

        def turn(k: Array, filled: tuple[PyTree, Array]) -> tuple[PyTree, Array]:
            runs, jacobian = filled
            group, few, weights = s.chosen.block(k, size)
            each = jnp.minimum(k * size + jnp.arange(size), count - 1)
            of_block = _forwards if forward else _backwards
            found, slopes = of_block(runs_at, flat, jnp.where(again, few, each), rows)
            start = size * jnp.where(again, blocks, k)
            put = lambda into, x: lax.dynamic_update_slice(into, x, (start,))  # noqa: E731
            added = lambda: jacobian + slopes(group, weights)  # noqa: E731
            return jax.tree.map(put, runs, found), lax.cond(again, added, lambda: jacobian)

        turns = jnp.where(again, s.chosen.ends[-1], blocks)
        runs, jacobian = lax.fori_loop(0, turns, turn, (s.runs, s.jacobian))
        # Not within the turns, each of which would copy what is chosen.
        known = lambda: (s.numbers, s.chosen)  # noqa: E731
        numbers, chosen = lax.cond(again, known, lambda: weighted(runs))
        return _Sweep(runs, numbers, chosen, jacobian)

    one = jax.eval_shape(lambda: runs_at(flat, jnp.arange(size))[1])
    space = jax.tree.map(lambda x: jnp.zeros((blocks + 1) * size, x.dtype), one)
    shapes = jax.eval_shape(weighted, space)
    numbers, chosen = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), shapes)
    jacobian = jnp.zeros((rows.size, flat.size), flat.dtype)
    end = lax.fori_loop(0, 2, sweep, _Sweep(space, numbers, chosen, jacobian))
    return end.numbers, end.jacobian, jax.tree.map(lambda x: x[:count], end.runs)


def _forwards(runs_at: RunsAt, x: Array, places: Array, rows: Array) -> tuple[PyTree, Slopes]:
    """A block of runs, with its slopes for all rows at once."""
    _, push, runs = jax.linearize(lambda x: runs_at(x, places), x, has_aux=True)

    def slopes(_: Array, weights: Array) -> Array:
        # The unknowns last.
        own = jax.vmap(push, out_axes=-1)(jnp.eye(x.size, dtype=x.dtype))
        return jnp.einsum("ri,rin->rn", weights, own[rows])

    return runs, slopes


def _backwards(runs_at: RunsAt, x: Array, places: Array, rows: Array) -> tuple[PyTree, Slopes]:
    """A block of runs, with its slopes for one row by one pullback."""
    every, pullback, runs = jax.vjp(lambda x: runs_at(x, places), x, has_aux=True)

    def slopes(row: Array, weights: Array) -> Array:
        (slope,) = pullback(jnp.zeros_like(every).at[rows[row]].set(weights[0]))
        return jnp.zeros((rows.size, x.size), x.dtype).at[row].set(slope)

    return runs, slopes


def _chosen(weights: Float[Array, "groups own runs"], size: int) -> _Chosen:
    """The runs with a weight in any row of a group."""
    # NaN counts: it must reach the result.
    counts = jnp.any(weights != 0.0, axis=1)
    order = jnp.argsort(~counts, axis=1, stable=True)
    # Copies of the first one fill the last block: another run may have failed.
    first = order[:, :1]
    places = jnp.where(jnp.take_along_axis(counts, order, axis=1), order, first)
    filling = -counts.shape[1] % size
    filled = jnp.take_along_axis(weights, order[:, None], axis=2)
    return _Chosen(
        jnp.concatenate([places, jnp.broadcast_to(first, (len(first), filling))], axis=1),
        jnp.pad(filled, ((0, 0), (0, 0), (0, filling))),
        # In sequence, so that the program has one derivative of a block.
        jnp.cumsum(-(-jnp.sum(counts, axis=1) // size)),
    )
