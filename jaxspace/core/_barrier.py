"""A barrier for the compiler, on CPUs only."""

import jax
from jaxtyping import PyTree


# Jitted, so that a call outside of `jit` does not trace the branches again.
@jax.jit
def barrier(tree: PyTree) -> PyTree:
    """The same tree behind a barrier: on a CPU its leaves are computed once and together.

    Without it the compiler writes one loop for each array that is needed later, and computes what
    they share in each of them again. Elsewhere it is the identity."""
    return jax.lax.platform_dependent(tree, cpu=jax.lax.optimization_barrier, default=lambda x: x)
