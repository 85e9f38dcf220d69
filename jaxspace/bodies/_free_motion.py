"""The rotation of a body without torque, as the closed form of systems."""

from typing import final

from ..core import AbstractClosedForm, Scalar
from ..core.printing import printed
from .inertia import AbstractInertia
from .principal_frame import free_turn
from .state import BodyState


@final
@printed(inertia="kg m^2")
class FreeRotation(AbstractClosedForm):
    """Torque-free rotation of a body in closed form, for every inertia and spin.

    - `inertia`: of the body, kg m^2, about its centre of mass."""

    inertia: AbstractInertia

    def flow(self, duration: Scalar, y: BodyState) -> BodyState:
        assert y.attitude is not None and y.omega is not None
        turn, omega = free_turn(duration, self.inertia, y.omega)
        # `then` gives the attitude the runs of the turn, also where only the body has runs.
        return BodyState(attitude=y.attitude.then(turn), omega=omega)
