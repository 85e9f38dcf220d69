"""Two-body motion as a closed form that systems and effects offer: `kepler_flow` of a state."""

from typing import final

from ..bodies import BodyState
from ..core import AbstractClosedForm, Scalar
from ._kepler import kepler_flow


@final
class KeplerMotion(AbstractClosedForm):
    """Motion about a fixed point mass of gravitational parameter `mu`, m^3/s^2, on every conic."""

    mu: Scalar

    def flow(self, duration: Scalar, y: BodyState) -> BodyState:
        assert y.position is not None and y.velocity is not None
        position, velocity = kepler_flow(y.position, y.velocity, duration, self.mu)
        return BodyState(position=position, velocity=velocity)
