"""The order of the runs of a batch: runs of similar rates share a block, and its steps."""

import functools

import jax
import jax.numpy as jnp
from jaxtyping import Array, PyTree

from ..core import AbstractSystem, State
from ..core.safe import safe_divide
from ..integration.config import IntegrationConfig
from ..integration.layout import broadcast_state
from ..solvers.tolerances import Tolerance
from .batch_layout import cut_batch
from .blocks import Blocks, Order

# Quotient of the fastest rate and the slowest up to which the runs of a batch are not sorted.
UNIFORM = 1.25


def order_of(
    batched: PyTree, shared: PyTree, config: IntegrationConfig, blocks: Blocks
) -> Order | None:
    """The order of the runs by their initial rates, if these differ.

    Runs of similar rates need similar steps, and the runs of a block share their steps. `None`
    where the steps do not depend on the runs."""
    # In a single block, and with fixed steps, the order has no effect.
    runs = jax.tree.leaves(batched)[0].shape[-1]
    if runs == blocks.size or config.method == "closed_form" or config.fixed_step:
        return None
    system, y0, ts = cut_batch(batched, shared)
    rate = _relative_rate(system, y0, ts[0])
    # Negated, so that rates that are NaN count as different.
    differ = ~(jnp.max(rate) <= UNIFORM * jnp.min(rate))
    return jax.lax.cond(differ, _sorted, _unsorted, rate)


def _sorted(rate: Array) -> Order:
    order = jnp.argsort(rate)
    return Order(order, jnp.argsort(order))


def _unsorted(rate: Array) -> Order:
    order = jnp.arange(rate.size)
    return Order(order, order)


def _relative_rate(system: AbstractSystem, y0: State, t: Array) -> Array:
    """max |dy/dt| / |y| over the blocks of each state, 1/s."""
    # The order changes no result, and therefore no derivative.
    y = jax.lax.stop_gradient(broadcast_state(system, t, y0))
    length = Tolerance(0.0, 0.0, 1).length
    rates = jax.tree.map(
        lambda k, b: safe_divide(length(k), length(b)), system.vector_field(t, y), y
    )
    return jax.lax.stop_gradient(functools.reduce(jnp.maximum, jax.tree.leaves(rates)))
