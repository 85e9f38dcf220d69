"""Mapped runs that are not a batch, as one integration.

A field that does not follow the layout of the library, such as that of a user's function, is mapped
by JAX. As one `MappedIntegration` the mapped runs remain a primitive, whose loops have both modes
of differentiation.
"""

from collections.abc import Callable
from typing import TypeAlias, Union, final

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, PyTree

from ..core import State
from ._integration import Integration, Moving, Tangents
from ._loop_settings import LoopSettings
from ._record import Record
from .result import Outcome

AnyIntegration: TypeAlias = Union[Integration, "MappedIntegration"]


@final
class MappedIntegration(eqx.Module):
    """An integration, mapped over a first axis of some of its arrays.

    - `each`: the integration, whose arrays have the axis where `axes`, one entry for each of its
      leaves, is zero; `None` for those that all runs share.
    - `size`: number of runs."""

    each: AnyIntegration
    axes: tuple[int | None, ...] = eqx.field(static=True)
    size: int = eqx.field(static=True)

    @classmethod
    def of(
        cls, run: AnyIntegration, dims: PyTree, size: int, moving: Moving | None = None
    ) -> "MappedIntegration":
        """The integration with the mapped axis of each array, `dims`, in front.

        `moving`: the arrays that get their own value in every run, even if they are not mapped."""
        own = jax.tree.map(lambda _: False, run)
        if moving is not None:
            own = eqx.combine(run.with_tangents(moving), own)
        leaves, structure = jax.tree.flatten(run)

        def placed(x: PyTree, d: int | None, is_own: bool) -> tuple[PyTree, int | None]:
            if d is not None:
                return jnp.moveaxis(x, d, 0), 0
            return (jnp.broadcast_to(x, (size, *x.shape)), 0) if is_own else (x, None)

        every = zip(leaves, structure.flatten_up_to(dims), jax.tree.leaves(own), strict=True)
        arrays, axes = zip(*(placed(*each) for each in every), strict=True)
        return cls(jax.tree.unflatten(structure, arrays), axes, size)

    def with_tangents(self, given: Tangents) -> "MappedIntegration":
        """As in `Integration`."""
        return MappedIntegration(self.each.with_tangents(given), self.axes, self.size)

    @property
    def field(self) -> PyTree:
        """The vector field."""
        return self.each.field

    @property
    def y0(self) -> PyTree:
        """The initial state, or its shapes."""
        return self.each.y0

    @property
    def settings(self) -> LoopSettings:
        """The settings of the loop."""
        return self.each.settings

    @property
    def one(self) -> AnyIntegration:
        """One of the runs, with shapes in place of its arrays."""

        def leaf(x: PyTree, axis: int | None) -> PyTree:
            # Arrays, or the shapes of arrays that are traced.
            if not hasattr(x, "shape"):
                return x
            return jax.ShapeDtypeStruct(x.shape if axis is None else x.shape[1:], x.dtype)

        leaves, structure = jax.tree.flatten(self.each)
        return jax.tree.unflatten(structure, map(leaf, leaves, self.axes))

    def run(
        self, moving: Moving | None = None, *, rolled: bool = False
    ) -> tuple[Outcome, Record | None]:
        """As in `Integration`, with the runs on the first axis."""
        return self._mapped(lambda each: each.run(moving, rolled=rolled), ())

    def forward(
        self, record: Record, given: Tangents, recorded: bool = False
    ) -> tuple[State, Array | None]:
        """As in `Integration`."""
        moving = jax.tree.map(lambda _, d: d is not None, (self.field, self.y0), given)
        axes = (eqx.if_array(0), self._axes_of(moving))
        return self._mapped(
            lambda each, record, given: each.forward(record, given, recorded), axes, record, given
        )

    def backward(self, record: Record, moving: Moving, cotangents: State) -> Tangents:
        """As in `Integration`: for an array shared by the runs, the sum of its cotangents."""

        def leaf(moves: bool, axis: int | None, x: Array | None) -> Array | None:
            return jnp.sum(x, 0) if moves and axis is None and x is not None else x

        every = self._mapped(
            lambda each, record, c: each.backward(record, moving, c),
            (eqx.if_array(0), eqx.if_array(0)),
            record,
            cotangents,
        )
        return jax.tree.map(leaf, moving, self._places, every)

    @property
    def _places(self) -> Tangents:
        """The mapped axes of field and initial state."""
        axes = jax.tree.unflatten(jax.tree.structure(self.each), self.axes)
        return axes.field, axes.y0

    def _axes_of(self, moving: Moving) -> Tangents:
        """The mapped axes of tangents of the arrays that are `moving`."""
        return jax.tree.map(lambda moves, axis: axis if moves else None, moving, self._places)

    def _mapped(self, function: Callable, axes: tuple[PyTree, ...], *args: PyTree) -> PyTree:
        own = jax.tree.unflatten(jax.tree.structure(self.each), self.axes)
        return eqx.filter_vmap(function, in_axes=(own, *axes), axis_size=self.size)(
            self.each, *args
        )
