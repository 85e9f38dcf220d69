"""Whether values are known, or traced by a transformation of jax."""

from typing import Any

import jax
import jax.numpy as jnp
from jax.core import Tracer
from jaxtyping import Array


@jax.jit
def _probe() -> Array:
    return jnp.zeros(())


def is_traced(tree: Any) -> bool:
    """Whether anything is traced: an array of the `tree`, or the code that asks."""
    if isinstance(_probe(), Tracer):
        return True
    return any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(tree))
