"""Whether values are concrete, or traced by a transformation of jax."""

import jax
import jax.numpy as jnp
from jax.core import Tracer
from jaxtyping import Array, PyTree


@jax.jit
def _probe() -> Array:
    return jnp.zeros(())


def is_traced(tree: PyTree) -> bool:
    """Whether an array of the `tree` is traced, or the code that calls this function."""
    # Inside of `jit` the result of a jitted call is a tracer, even when no argument is one.
    if isinstance(_probe(), Tracer):
        return True
    return any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(tree))
