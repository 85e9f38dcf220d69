"""What a block of a state offers that lies on a group, so that an integrator need not know
which."""

from abc import abstractmethod
from typing import Any

import equinox as eqx
from jaxtyping import Array, Float

Local = Float[Array, "n *#runs"]


class AbstractGroupElement(eqx.Module):
    """An element of a Lie group, with coordinates about itself that are zero there.

    The rate of an element has the type of the element."""

    @abstractmethod
    def coordinates(self) -> Local:
        """The coordinates of the element about itself: zeros."""

    @abstractmethod
    def moved(self, local: Local) -> Any:
        """The element at the coordinates `local` about this one; on the group to rounding."""

    @abstractmethod
    def coordinate_rate(self, local: Local, rate: Any) -> Local:
        """The rate, 1/s, of the coordinates about another element, `local` for this one, when this
        one changes at the `rate`."""
