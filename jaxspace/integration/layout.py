"""Order of the axes of a state: components, then times, then runs.

Times lead inside the loop of an integration, where a state is one row of a buffer; results have the
components first, then the times, then the runs.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PyTree

from ..core import AbstractSystem, Scalar, State
from .field_trace import field_trace


def broadcast_state(system: AbstractSystem, t: Scalar, y: State) -> State:
    """The state with every block broadcast to the runs that the system or another block carries."""
    # Runs may reach a block only by way of the derivative of another one: three passes are enough
    # for every system, and one for most.
    for _ in range(3):
        shape = field_trace(system, t, y).rate
        before = jax.tree.map(jnp.shape, y)
        y = jax.tree.map(
            lambda a, b: jnp.broadcast_to(a, jnp.broadcast_shapes(a.shape, b.shape)), y, shape
        )
        if jax.tree.map(jnp.shape, y) == before:
            break
    return y


def times_behind_components(states: State, run_axes: int) -> State:
    """States with the times first, as a loop stores them, in the layout of results."""
    return jax.tree.map(lambda x: jnp.moveaxis(x, 0, x.ndim - 1 - run_axes), states)


def times_first(states: State, run_axes: int) -> State:
    """States in the layout of results, with the times first."""
    return jax.tree.map(lambda x: jnp.moveaxis(x, x.ndim - 1 - run_axes, 0), states)


def state_at(states: State, index: int, run_axes: int) -> State:
    """The state at one of the times, in the layout of results."""
    return jax.tree.map(
        lambda x: x[..., index] if run_axes == 0 else x[(..., index, *(slice(None),) * run_axes)],
        states,
    )


def runs_of(y: PyTree, run_axes: int) -> tuple[int, ...]:
    """The shape of the runs of a state, or of its shapes."""
    leaf = jax.tree.leaves(y)[0]
    return leaf.shape[leaf.ndim - run_axes :]


def with_start(y0: State, states: State, run_axes: int) -> State:
    """The state `y0` and then the `states`, along the axis of times."""

    def leaf(a: Array, b: Array) -> Array:
        axis = a.ndim - run_axes
        return jnp.concatenate([jnp.expand_dims(a, axis), b], axis=axis)

    return jax.tree.map(leaf, y0, states)


def replace_state(states: State, index: int, y: State, run_axes: int) -> State:
    """The states with the one at one of the times replaced."""

    def leaf(xs: Array, x: Array) -> Array:
        return xs.at[(..., index, *(slice(None),) * run_axes)].set(x)

    return jax.tree.map(leaf, states, y)


def of_each(fractions: Float[Array, "times *#runs"], duration: Array) -> Array:
    """The fractions, shared or of each run, as fractions of each duration, (times, *runs)."""
    return fractions * duration if fractions.ndim > 1 else jnp.multiply.outer(fractions, duration)
