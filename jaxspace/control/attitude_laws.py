"""Control laws for attitude and spin, from the attitude, the angular velocity and the wheels.

    M = -k_p sign(q_0) 2 q - k_d omega - k_i int(2 q dt)     quaternion feedback
    M = -k h                                                 momentum dumping
    M = k (n - omega . a) a                                  spin rate
    M = -k (omega - (omega . a) a)                           nutation

    symbol       meaning                                              unit
    q_0, q       error quaternion, from the target to the attitude    1
    omega        angular velocity in body axes                        rad/s
    h            momentum of the wheels in body axes                  kg m^2/s
    a, n         axis of the spin, its rate                           1, rad/s
    k_p, k_d, k_i, k  gains                                           N m, N m s, N m/s, see the law

With the inertia J along an axis, small errors obey J e'' + k_d e' + k_p e = 0: critical damping is
k_d = 2 sqrt(k_p J). The law sees 2 q, which is the angle of a small error and at most 2.

Source: Wie, Space Vehicle Dynamics and Control, 7.3 (quaternion feedback), 7.2 (nutation); Hughes,
Spacecraft Attitude Dynamics, 6 (wheels); Astrom and Murray, Feedback Systems, 10.4 (anti-windup).
"""

__all__ = [
    "MomentumDumping",
    "NutationControl",
    "QuaternionFeedback",
    "SpinRateControl",
    "error_vector",
]

from typing import final

import jax.numpy as jnp
from jaxtyping import Array, Float, PyTree

from ..attitude.motors import wheel_torques
from ..core import NumberField, OptionalNumberField, Scalar, Vector, quantity
from ..core.shapes import with_rank
from ..core.vectors import dot, norm, unit
from ..rotations import Quaternion
from ._controller import AbstractController, measurement
from ._integral import Integral, integrated, integrating, unwound


def error_vector(attitude: Quaternion, target: Array) -> Vector:
    """Twice the vector part of the quaternion from the target to the attitude, in body axes: the
    rotation vector of a small error.

    **Arguments**

    - `attitude`: of the body; `target`: a quaternion, scalar first, of any length, (4, *runs).

    **Returns** (3, *runs), for the shorter of the two rotations."""
    wanted = Quaternion(with_rank(target, attitude.wxyz.ndim - 1)).normalised()
    error = wanted.inverse().then(attitude).wxyz
    # Of the two quaternions of an attitude the one nearer to the target.
    return 2.0 * jnp.where(error[0] < 0.0, -1.0, 1.0) * error[1:]


@final
class QuaternionFeedback(AbstractController):
    """Rotates a body to a target attitude and keeps it there.

    The command is a torque on the body, N m, (3, *runs); with `axes` the corresponding torques on
    wheels, (wheels, *runs). The integral is frozen while a command is saturated."""

    stiffness: NumberField = quantity(
        "N m", non_negative=True, doc="k_p, torque per radian of a small error"
    )
    damping: NumberField = quantity(
        "N m s", non_negative=True, doc="k_d, torque per angular velocity"
    )
    target: Float[Array, "4 *#runs"] = quantity(
        "",
        direction=True,
        default=(1.0, 0.0, 0.0, 0.0),
        doc="target quaternion, scalar first",
    )
    integral: OptionalNumberField = quantity(
        "N m/s", non_negative=True, optional=True, doc="k_i, torque per error and time"
    )
    axes: Float[Array, "3 wheels *#runs"] | None = quantity(
        "", direction=True, optional=True, doc="of wheels as columns: x of all, y, z"
    )

    def start(self, measured: PyTree) -> Integral | None:
        like = measurement(measured, "omega")
        return None if self.integral is None else integrating(like)

    def act(
        self, t: Scalar, memory: Integral | None, measured: PyTree
    ) -> tuple[Array, Integral | None]:
        attitude, omega = measurement(measured, "attitude"), measurement(measured, "omega")
        error = error_vector(attitude, self.target)
        torque = -self.stiffness * error - self.damping * omega
        if memory is not None and self.integral is not None:
            memory = integrated(memory, t, error)
            torque = torque - self.integral * memory.total
        if self.axes is None:
            return torque, memory
        axes = with_rank(unit(self.axes), omega.ndim - 1, axes=2)
        # The torque on the wheels rotates the body in the opposite direction.
        return -wheel_torques(axes, torque), memory

    def settle(self, memory: Integral | None, asked: Array, applied: Array) -> Integral | None:
        if memory is None:
            return None
        # If wheels share a torque, one saturated wheel changes all of its components.
        return unwound(memory, jnp.any(asked != applied, axis=0))


@final
class MomentumDumping(AbstractController):
    """Removes the momentum of wheels from the body with an external torque, such as that of
    thrusters.

    The command is that torque, N m, (3, *runs). While it acts, the attitude controller decelerates
    the wheels. Reads "wheels", the momenta about the axes."""

    gain: NumberField = quantity(
        "1/s", positive=True, doc="k, torque over momentum: the inverse of the time constant"
    )
    axes: Float[Array, "3 wheels *#runs"] = quantity(
        "", direction=True, doc="of the wheels as columns: x of all, y, z"
    )
    dead_band: NumberField = quantity(
        "kg m^2/s", non_negative=True, default=0.0, doc="momentum that remains in the wheels"
    )

    def act(self, t: Scalar, memory: None, measured: PyTree) -> tuple[Array, None]:
        del t
        momenta = measurement(measured, "wheels")
        axes = with_rank(unit(self.axes), momenta.ndim - 1, axes=2)
        momentum = jnp.sum(axes * momenta, axis=1)
        # By the length, not by components: a band for each would dump along axes that depend on the
        # frame.
        on = jnp.where(norm(momentum) > self.dead_band, self.gain, 0.0)
        return -on * momentum, memory


@final
class SpinRateControl(AbstractController):
    """Brings a body to a given rate about an axis, without a transverse torque."""

    gain: NumberField = quantity("N m s", positive=True, doc="k, torque over rate")
    rate: NumberField = quantity("rad/s", doc="n, target rate about the axis")
    axis: Float[Array, "3 *#runs"] = quantity(
        "", direction=True, default=(0.0, 0.0, 1.0), doc="of the spin, of non-zero length"
    )

    def act(self, t: Scalar, memory: None, measured: PyTree) -> tuple[Array, None]:
        del t
        omega = measurement(measured, "omega")
        axis = with_rank(unit(self.axis), omega.ndim - 1)
        return self.gain * (self.rate - dot(omega, axis)) * axis, memory


@final
class NutationControl(AbstractController):
    """Damps the rate transverse to an axis, without a torque about it."""

    gain: NumberField = quantity("N m s", positive=True, doc="k, torque over rate")
    axis: Float[Array, "3 *#runs"] = quantity(
        "", direction=True, default=(0.0, 0.0, 1.0), doc="of the spin, of non-zero length"
    )
    dead_band: NumberField = quantity(
        "rad/s", non_negative=True, default=0.0, doc="transverse rate below which no torque acts"
    )

    def act(self, t: Scalar, memory: None, measured: PyTree) -> tuple[Array, None]:
        del t
        omega = measurement(measured, "omega")
        axis = with_rank(unit(self.axis), omega.ndim - 1)
        across = omega - dot(omega, axis) * axis
        on = jnp.where(norm(across) > self.dead_band, self.gain, 0.0)
        return -on * across, memory
