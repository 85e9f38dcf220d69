"""The event of reaching an altitude: h - h_e = 0, h = |r| - R."""

from typing import ClassVar, final

from jaxtyping import Array, Float

from ..bodies import AbstractCondition, BodyState
from ..core import Scalar, quantity
from ._outputs import altitude


@final
class AtAltitude(AbstractCondition):
    """An altitude is reached, on the way up or down: the height above it, m, is zero."""

    direction: ClassVar[int] = 0
    needs: ClassVar[frozenset[str]] = frozenset({"position", "velocity"})

    altitude: Float[Array, "*#runs"] = quantity("m", doc="h_e, over the sphere of the radius")
    radius: Float[Array, "*#runs"] = quantity(
        "m", non_negative=True, shared="planet.radius", doc="R, of the planet"
    )

    def __call__(self, t: Scalar, y: BodyState) -> Scalar:
        """h - h_e, m, in the state `y`."""
        del t
        return altitude(y.position, self.radius) - self.altitude
