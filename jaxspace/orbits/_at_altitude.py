"""The event of reaching an altitude: h - h_e = 0, h = |r| - R."""

from typing import ClassVar, final

from ..bodies import AbstractCondition, BodyState
from ..core import NumberField, Scalar, quantity
from .outputs import altitude


@final
class AtAltitude(AbstractCondition):
    """The height above a given altitude, m: zero where the altitude is reached, on the way up or
    down."""

    direction: ClassVar[int] = 0
    needs: ClassVar[frozenset[str]] = frozenset({"position", "velocity"})

    altitude: NumberField = quantity("m", doc="h_e, over the sphere of the radius")
    radius: NumberField = quantity(
        "m", non_negative=True, shared="planet.radius", doc="R, of the planet"
    )

    def __call__(self, t: Scalar, y: BodyState) -> Scalar:
        """h - h_e, m, in the state `y`."""
        del t
        return altitude(y.position, self.radius) - self.altitude
