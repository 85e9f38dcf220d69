"""The interface of a block of a state that lies on a Lie group, for integrators on groups."""

from abc import abstractmethod
from typing import Any, TypeAlias

import equinox as eqx
from jaxtyping import Array, Float

Local: TypeAlias = Float[Array, "n *#runs"]


class AbstractGroupElement(eqx.Module):
    """An element of a Lie group, with local coordinates that are zero at the element itself.

    The rate of an element has the type of the element."""

    @abstractmethod
    def coordinates(self) -> Local:
        """The coordinates of the element about itself: zeros, (n, *runs)."""

    # `Any` stands for the type of the concrete class: beartype cannot check `Self` here.
    @abstractmethod
    def moved(self, local: Local) -> Any:
        """The element at the coordinates `local` about this one, on the group to rounding."""

    @abstractmethod
    def coordinate_rate(self, local: Local, rate: Any) -> Local:
        """The rate of change, 1/s, of the coordinates of this element about another one.

        **Arguments**

        - `local`: the coordinates of this element about the other one.
        - `rate`: the rate of change of this element, 1/s.
        """
