"""A system whose state is one vector, for the program of one run with rolled stages.

In addition to the vector field, each operation of a step (weighted sums of stages, norms,
selections) acts on every block of the state: position, velocity, attitude. On one vector of all
blocks it is a single operation instead of five or six, and the program of a large field compiles
faster. The vector field receives its state, which is sliced from the vector at negligible cost. For
many runs these copies would be as expensive as the field.
"""

import dataclasses
import math
from collections.abc import Callable
from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import AbstractSystem, Flag, Scalar, State
from ..core.groups import project
from ._loop_settings import LoopSettings
from .events import Event
from .field_trace import evaluate_field
from .normalised_time import ScaledVectorField


@final
class Packing(eqx.Module):
    """Layout of the blocks of a state in one vector."""

    structure: jax.tree_util.PyTreeDef = eqx.field(static=True)
    shapes: tuple[tuple[int, ...], ...] = eqx.field(static=True)

    @classmethod
    def of(cls, y: State) -> "Packing":
        """The layout for states like `y`."""
        leaves, structure = jax.tree.flatten(y)
        return cls(structure, tuple(x.shape for x in leaves))

    @property
    def sizes(self) -> tuple[int, ...]:
        """Number of components of each block."""
        return tuple(map(math.prod, self.shapes))

    def vector(self, y: State) -> Float[Array, "components *#rest"]:
        """The state as a vector."""
        leaves = zip(jax.tree.leaves(y), self.shapes, self.sizes, strict=True)
        return jnp.concatenate([x.reshape(size, *x.shape[len(s) :]) for x, s, size in leaves])

    def state(self, v: Float[Array, "components *#rest"]) -> State:
        """The state of a vector; further axes stay behind the components."""
        leaves = []
        first = 0
        for shape, size in zip(self.shapes, self.sizes, strict=True):
            leaf = jax.lax.slice_in_dim(v, first, first + size)
            leaves.append(leaf.reshape(*shape, *v.shape[1:]))
            first += size
        return jax.tree.unflatten(self.structure, leaves)

    def packed(self, event: Event) -> Event:
        """The event as a function of the vector."""
        return eqx.tree_at(lambda e: e.condition, event, _PackedCondition(self, event.condition))


@final
class _PackedCondition(eqx.Module):
    packing: Packing
    condition: Callable[[Scalar, State], Scalar]

    def __call__(self, t: Scalar, v: State) -> Scalar:
        return self.condition(t, self.packing.state(v))


@final
class PackedSystem(AbstractSystem):
    """A system whose state is a vector, with the capabilities that steps need."""

    packing: Packing
    system: AbstractSystem

    def vector_field(self, t: Scalar, y: State) -> State:
        state = self.packing.state(y)
        rate = evaluate_field(self.system, t, state)
        # A constant of double precision in a user's effect must not change the precision of the
        # run.
        return self.packing.vector(
            jax.tree.map(
                lambda k, x: jnp.broadcast_to(jnp.asarray(k, x.dtype), x.shape), rate, state
            )
        )

    def invariants(self, t: Scalar, y: State) -> dict[str, Array]:
        return self.system.invariants(t, self.packing.state(y))

    def breaks(self) -> Float[Array, "times *#runs"] | None:
        return self.system.breaks()

    def projected(self, t: Scalar, y: State) -> State | None:
        state = project(self.packing.state(y))
        constrained = self.system.projected(t, state)
        return self.packing.vector(state if constrained is None else constrained)

    def outside(self, t: Scalar, y: State) -> Flag | None:
        return self.system.outside(t, self.packing.state(y))


def packed(
    packing: Packing, field: ScaledVectorField, y0: State, settings: LoopSettings
) -> tuple[ScaledVectorField, Float[Array, " components"], LoopSettings]:
    """Field, initial state and settings of a loop for one run whose state is a vector."""
    # The error is still judged block by block: in one norm, metres would hide an error of a
    # quaternion.
    tolerance = dataclasses.replace(settings.tolerance, blocks=packing.sizes)
    terminal = settings.terminal
    if terminal is not None:
        terminal = dataclasses.replace(terminal, events=tuple(map(packing.packed, terminal.events)))
    settings = dataclasses.replace(settings, tolerance=tolerance, terminal=terminal)
    system = PackedSystem(packing, field.system)
    return ScaledVectorField(system, field.segments), packing.vector(y0), settings
