"""Whether values are concrete, or traced by a transformation of jax."""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
from jax.core import Tracer
from jax.extend.core import Jaxpr, Literal, Var, subjaxprs
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


def depending_on(jaxpr: Jaxpr, variables: Sequence[Var]) -> set[Var]:
    """The variables of a traced function that some operation leads to from these `variables`.

    Forward propagation through the operations: results computed from one of them may depend on
    it."""
    moved = set(variables)
    for operation in jaxpr.eqns:
        if any(x in moved for x in operation.invars if not isinstance(x, Literal)):
            moved.update(operation.outvars)
    return moved


def count_operations(jaxpr: Jaxpr) -> int:
    """Number of operations of a traced function, including those of the functions that it calls."""
    return len(jaxpr.eqns) + sum(map(count_operations, subjaxprs(jaxpr)))
