"""Where the compiler has to stop joining operations, on processors only."""

import jax
from jaxtyping import PyTree


@jax.jit
def barrier(tree: PyTree) -> PyTree:
    """The tree, behind a barrier on CPUs: its leaves are computed once, together.

    There the compiler writes one loop for each array that is needed later, and computes again in
    each what they share."""
    return jax.lax.platform_dependent(tree, cpu=jax.lax.optimization_barrier, default=lambda x: x)
