"""The heavy top as a free rotation and a moment. Equations, symbols and units in `_top.py`."""

from typing import final

from jaxtyping import Array, Float

from ..bodies import BodyState
from ..core import AbstractSplit, Scalar
from ..core.vectors import axis, cross
from ._state import attitude_and_omega, vertical
from .torque_free import symmetric_flow


@final
class TopSplit(AbstractSplit):
    """The free rotation of a top as the drift, and the moment of its weight as the kick."""

    transverse_inertia: Float[Array, "*#runs"]
    axial_inertia: Float[Array, "*#runs"]
    weight_moment: Float[Array, "*#runs"]

    def drift(self, duration: Scalar, y: BodyState) -> BodyState:
        return symmetric_flow(duration, y, self.transverse_inertia, self.axial_inertia)

    def kick(self, t: Scalar, duration: Scalar, y: BodyState) -> BodyState:
        del t
        attitude, omega = attitude_and_omega(y)
        # Exact, because the moment has no part along z and the kick does not turn the top.
        Z = vertical(attitude)
        angular_acceleration = self.weight_moment / self.transverse_inertia
        change = duration * angular_acceleration * cross(Z, axis(2, Z[2]))
        return BodyState(attitude=attitude, omega=omega + change)
