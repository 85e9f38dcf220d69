"""The interface of a block of a state on a Lie group, for Lie-group integrators."""

from abc import abstractmethod
from typing import TypeAlias, TypeGuard

import jax
from jaxtyping import Array, Float, PyTree

from .structure import HashedModule
from .types import State

Local: TypeAlias = Float[Array, "n *#runs"]


class AbstractGroupElement(HashedModule):
    """An element of a Lie group, with local coordinates that are zero at the element itself.

    The rate of an element has the type of the element."""

    @abstractmethod
    def coordinates(self) -> Local:
        """The coordinates of the element about itself: zeros, (n, *runs)."""

    # `PyTree` represents the type of the concrete class: beartype cannot check `Self` here.
    @abstractmethod
    def moved(self, local: Local) -> PyTree:
        """The element at the coordinates `local` about this one, on the group to rounding."""

    def projected(self) -> PyTree:
        """The element on the group nearest to this one, which is off it by an error of rounding or
        of a step."""
        return self.moved(self.coordinates())

    @abstractmethod
    def coordinate_rate(self, local: Local, rate: PyTree) -> Local:
        """The rate of change, 1/s, of the coordinates of this element about another one.

        **Arguments**

        - `local`: the coordinates of this element about the other one.
        - `rate`: the rate of change of this element, 1/s.
        """


def on_group(x: PyTree) -> TypeGuard[AbstractGroupElement]:
    """Whether a block of a state is on a group."""
    return isinstance(x, AbstractGroupElement)


def project(y: State) -> State:
    """The state with every block on a group projected onto it; other blocks are unchanged, at no
    cost."""
    # An element is one leaf: projection needs all of its arrays together.
    return jax.tree.map(lambda x: x.projected() if on_group(x) else x, y, is_leaf=on_group)
