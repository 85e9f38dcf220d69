"""Properties of a vector field read from its trace, once per structure of system and state."""

from typing import NamedTuple

import equinox as eqx
import jax
from jax.core import Tracer
from jax.extend.core import Jaxpr
from jaxtyping import PyTree

from ..core import AbstractSystem
from ..core.structure import once_per_structure
from ..core.tracing import count_operations


class FieldTrace(NamedTuple):
    """The trace of a vector field.

    - `rate`: the shapes of the derivative of a state.
    - `jaxpr`: its program, with the arrays of the system, the time and the state as arguments.
    - `operations`: their number.
    - `closes_over_tracers`: whether a function inside the system, such as a user's, closes over
      traced arrays."""

    rate: PyTree
    jaxpr: Jaxpr
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
    return FieldTrace(shapes, closed.jaxpr, count_operations(closed.jaxpr), hidden)
