"""The exact motion of a body on which no torque acts, as the closed form that systems offer."""

from typing import final

from ..core import AbstractClosedForm, Scalar
from ..rotations import Quaternion
from ._inertia import AbstractInertia
from ._principal_frame import free_turn
from ._state import BodyState


@final
class FreeRotation(AbstractClosedForm):
    """Rotation without torque of a body of this `inertia`, kg m^2, for every inertia and spin."""

    inertia: AbstractInertia

    def flow(self, duration: Scalar, y: BodyState) -> BodyState:
        assert y.attitude is not None and y.omega is not None
        turn, omega = free_turn(duration, self.inertia, y.omega)
        # Where the body carries runs that the state does not, the attitude follows the turn.
        wxyz = y.attitude.wxyz
        wxyz = wxyz.reshape(4, *(1,) * (omega.ndim - wxyz.ndim), *wxyz.shape[1:])
        return BodyState(attitude=Quaternion(wxyz).then(turn), omega=omega)
