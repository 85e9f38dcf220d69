"""Properties of a vector field read from its trace, once per structure of system and state."""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer, eval_jaxpr
from jax.extend.core import Jaxpr
from jaxtyping import ArrayLike, PyTree

from ..core import AbstractSystem, Scalar, State
from ..core.structure import once_per_structure
from ..core.tracing import count_operations


class FieldTrace(NamedTuple):
    """The trace of a vector field.

    - `rate`: the shapes of the derivative of a state.
    - `jaxpr`: its program, with the arrays of the system, the time and the state as arguments.
    - `constants`: its concrete arrays.
    - `operations`: their number.
    - `closes_over_tracers`: whether a function inside the system, such as a user's, closes over
      traced arrays."""

    rate: PyTree
    jaxpr: Jaxpr
    constants: Sequence[ArrayLike]
    operations: int
    closes_over_tracers: bool


@once_per_structure
def field_trace(system: AbstractSystem, t: PyTree, y: PyTree) -> FieldTrace:
    """The trace of the vector field of a system for times like `t`, states like `y`, or shapes."""
    arrays, static = eqx.partition((system, t, y), lambda x: isinstance(x, jax.ShapeDtypeStruct))

    def rate(arrays: PyTree) -> PyTree:
        system, t, y = eqx.combine(arrays, static)
        return system.vector_field(t, y)

    closed, shapes = jax.make_jaxpr(rate, return_shape=True)(arrays)
    hidden = any(isinstance(constant, Tracer) for constant in closed.consts)
    # A tracer must not outlive its function.
    constants = () if hidden else tuple(closed.consts)
    return FieldTrace(shapes, closed.jaxpr, constants, count_operations(closed.jaxpr), hidden)


def evaluate_field(system: AbstractSystem, t: Scalar, y: State) -> State:
    """The vector field of a system in a traced function: from the existing trace, if it contains
    everything on which the field depends."""
    trace = field_trace(system, t, y)
    if trace.closes_over_tracers:
        return system.vector_field(t, y)
    leaves = jax.tree.leaves((system, t, y))
    arrays = [x for x in leaves if isinstance(x, jax.Array | np.ndarray)]
    # Parts of the rate that are constant are arrays of NumPy.
    results = map(jnp.asarray, eval_jaxpr(trace.jaxpr, trace.constants, *arrays))
    return jax.tree.unflatten(jax.tree.structure(trace.rate), results)
