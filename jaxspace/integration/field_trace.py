"""Properties of a vector field read from its trace, once per structure of system and state."""

from typing import NamedTuple

import equinox as eqx
import jax
from jaxtyping import PyTree

from ..core import AbstractSystem
from ..core.structure import once_per_structure
from ..core.tracing import count_operations


class FieldTrace(NamedTuple):
    """The shapes of the derivative of a state, and how many operations it takes to compute."""

    rate: PyTree
    operations: int


@once_per_structure
def field_trace(system: AbstractSystem, t: PyTree, y: PyTree) -> FieldTrace:
    """The trace of the vector field of a system for times like `t`, states like `y`, or shapes."""
    arrays, static = eqx.partition((system, t, y), lambda x: isinstance(x, jax.ShapeDtypeStruct))

    def rate(arrays: PyTree) -> PyTree:
        system, t, y = eqx.combine(arrays, static)
        return system.vector_field(t, y)

    closed, shapes = jax.make_jaxpr(rate, return_shape=True)(arrays)
    return FieldTrace(shapes, count_operations(closed.jaxpr))
