"""Motors of the wheels of a body: constant torques, and a control that points the body."""

__all__ = ["AbstractMotor", "ConstantTorque", "PointingControl", "wheel_torques"]

from abc import abstractmethod
from typing import final

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..bodies import BodyState
from ..core import AbstractParameters, NumberField, OptionalNumberField, Scalar, Vector, quantity
from ..core.formula import formula
from ..core.shapes import with_rank
from ..core.vectors import solve3
from ..rotations import Quaternion


class AbstractMotor(AbstractParameters):
    """Motors of the wheels of a body. A concrete class is final."""

    @abstractmethod
    def torque(self, t: Scalar, y: BodyState, axes: Array, speed: Array) -> Array:
        """The torque on each wheel, N m, (wheels, *runs).

        **Arguments**

        - `t`: s; `y`: state of the body.
        - `axes`: of the wheels, (3, wheels, *runs).
        - `speed`: relative to the body, rad/s, (wheels, *runs)."""


@final
class ConstantTorque(AbstractMotor):
    """Equal torques on all wheels until a given time."""

    drive: NumberField = quantity("N m", key="torque", doc="on every wheel")
    until: OptionalNumberField = quantity(
        "s", optional=True, doc="time at which the motor stops; never by default"
    )

    def torque(self, t: Scalar, y: BodyState, axes: Array, speed: Array) -> Array:
        del y, axes
        on = 1.0 if self.until is None else jnp.where(t < self.until, 1.0, 0.0)
        # Plus zero, for a torque on each wheel of each run.
        return on * self.drive + 0.0 * speed


@final
class PointingControl(AbstractMotor):
    """Turns the body to a target by a torque that is linear in the error and in the rate.

    At least three wheels whose axes span space share the torque with the least sum of squares."""

    target: Float[Array, "4 *#runs"] = quantity(
        "",
        direction=True,
        doc="target quaternion, scalar first",
    )
    stiffness: NumberField = quantity(
        "N m", positive=True, doc="torque per radian of a small error"
    )
    damping: NumberField = quantity("N m s", non_negative=True, doc="torque per rate of the body")

    def torque(self, t: Scalar, y: BodyState, axes: Array, speed: Array) -> Array:
        del t, speed
        target = Quaternion(with_rank(self.target, y.omega.ndim - 1)).normalised()
        error = target.inverse().then(y.attitude).wxyz
        # Of the two quaternions of an attitude the nearer one, so that the body turns the short
        # way.
        sign = jnp.where(error[0] < 0.0, -1.0, 1.0)
        demand = -2.0 * self.stiffness * sign * error[1:] - self.damping * y.omega
        return -wheel_torques(axes, demand)


@formula
def wheel_torques(axes: Array, torque: Vector) -> Array:
    """The torques along the axes of wheels with the least sum of squares that add up to a torque.

    **Arguments**

    - `axes`: of three wheels or more, of length one, as columns, (3, wheels, *runs).
    - `torque`: N m, in body axes, (3, *runs).

    **Returns** the torques, N m, (wheels, *runs). The torques on the body are opposite to those on
    the wheels."""
    gram = jnp.sum(axes[:, None] * axes[None, :], axis=2)
    return along_axes(axes, solve3(gram, with_rank(torque, gram.ndim - 2)))


def along_axes(axes: Array, vector: Vector) -> Array:
    """a_i . vector of every wheel, (wheels, *runs)."""
    return axes[0] * vector[0] + axes[1] * vector[1] + axes[2] * vector[2]
