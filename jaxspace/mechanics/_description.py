"""Description of a Lagrangian system: its coordinates, its Lagrangian, and further forces.

The equations, the constraints and the symmetries of a system follow from its description;
`AbstractLagrangian` makes a system of it.
"""

from abc import abstractmethod
from typing import TYPE_CHECKING, final

import equinox as eqx
from jaxtyping import Array, Float

from ..core import AbstractSystem, Scalar, quantity
from ..core.printing import printed


@final
@printed()
class GeneralisedState(eqx.Module):
    """Generalised coordinates and their rates; also the rates of both."""

    coordinates: Float[Array, "n *#runs"] = quantity("", doc="q, generalised coordinates")
    rates: Float[Array, "n *#runs"] = quantity("", doc="v, their rates")


class AbstractDescription(AbstractSystem):
    """A Lagrangian, its coordinates, further forces and constraints; see `AbstractLagrangian`."""

    if TYPE_CHECKING:
        # Not a field for type checkers, because it would precede those of a subclass.
        @property
        def names(self) -> tuple[str, ...]: ...
    else:
        names: eqx.AbstractVar[tuple[str, ...]]

    @abstractmethod
    def lagrangian(self, t: Scalar, q: Array, v: Array) -> Scalar:
        """L, J, (*runs,)."""

    def force(self, t: Scalar, q: Array, v: Array) -> Array | None:
        """Generalised forces Q, (n, *runs), or `None`."""
        del t, q, v
        return None

    def dissipation(self, t: Scalar, q: Array, v: Array) -> Scalar | None:
        """Rayleigh's function D, W, (*runs,), or `None`: half the power dissipated by friction."""
        del t, q, v
        return None

    def holonomic(self, t: Scalar, q: Array) -> Array | None:
        """Holonomic constraints: functions that are zero, (m, *runs), or `None`."""
        del t, q
        return None

    def nonholonomic(self, t: Scalar, q: Array, v: Array) -> Array | None:
        """Nonholonomic constraints: functions that are zero, linear in v, (m, *runs), or `None`."""
        del t, q, v
        return None

    def stabilisation(self) -> tuple[Scalar, bool]:
        """The rate k, 1/s, and whether constraints may be redundant."""
        return 1.0, False
