"""Stable platform about one axis: an integrating gyro whose signal drives a servo motor.

    J phi'' = T - h theta' - (K_p theta + K_d theta' + K_i int theta dt)
    I theta'' = h phi' - c theta'

    symbol          meaning                                                   unit
    phi             angle of the platform in inertial space                   rad
    theta           angle of the gyro about its output axis                   rad
    J, I            inertia of the platform; of the gyro's gimbal             kg m^2
    h, c            spin momentum; damping of the gyro's gimbal               kg m^2/s, N m s
    T               disturbing torque                                         N m
    K_p, K_d, K_i   gains of the servo                                        N m, N m s, N m/s

Without servo the platform nutates at h / sqrt(J I), and a steady torque makes the gyro precess,
theta = T t / h in the mean. With proportional gain K_p only, the loop is unstable for every gain:
it requires the lead K_d or the damping c.

Source: Thomson 6.8-1 to -5, 6.11 problems 5 and 6; 6.9 (signals onto the gimbals).
Valid for small angles of the gyro: a run with more than `SMALL_ANGLE` has the status
`OUTSIDE_MODEL`.
"""

__all__ = ["gimbal_lock_margin", "resolve_signals"]

from collections.abc import Sequence
from typing import final

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from ..core import AbstractSystem, NumberField, Scalar, Vector, quantity
from ..core.formula import formula
from ..core.limits import Limit
from ..core.printing import printed
from ..core.shapes import check_components
from ..core.square_roots import inverse_sqrt
from ..core.types import as_float
from ._linear import LinearFlow, linear_rate, rows
from ._small_angle import small_angle


@final
@printed()
class PlatformState(eqx.Module):
    """Angles of gyro and platform, their rates, the integral of the gyro's angle; also the rates of
    all."""

    gyro_angle: NumberField = quantity("rad", doc="theta, about the output axis")
    platform_angle: NumberField = quantity("rad", doc="phi, in inertial space")
    gyro_rate: NumberField = quantity("rad/s", doc="rate of theta")
    platform_rate: NumberField = quantity("rad/s", doc="rate of phi")
    integral: NumberField = quantity("rad s", doc="of theta over time")


@final
class PlatformAxis(AbstractSystem):
    """One axis of a stable platform, without servo by default. State: `PlatformState`; `at_rest`
    makes the state in which everything is zero."""

    platform_inertia: NumberField = quantity("kg m^2", positive=True, doc="J")
    gyro_inertia: NumberField = quantity("kg m^2", positive=True, doc="I")
    spin_momentum: NumberField = quantity("kg m^2/s", positive=True, doc="h")
    torque: NumberField = quantity("N m", default=0.0, doc="T, disturbing torque")
    gain: NumberField = quantity("N m", default=0.0, doc="K_p, of the servo")
    rate_gain: NumberField = quantity("N m s", default=0.0, doc="K_d, of the servo")
    integral_gain: NumberField = quantity("N m/s", default=0.0, doc="K_i, of the servo")
    gyro_damping: NumberField = quantity("N m s", default=0.0, doc="c")

    def vector_field(self, t: Scalar, y: PlatformState) -> PlatformState:
        del t
        return linear_rate(*self._matrices(), y)

    def limits(self, t: Scalar, y: PlatformState) -> Sequence[Limit]:
        del t
        return (small_angle("gyro_angle", y.gyro_angle),)

    def invariants(self, t: Scalar, y: PlatformState) -> dict[str, Array]:
        """Nothing is conserved with a servo on."""
        del t, y
        return {}

    def closed_form(self) -> LinearFlow:
        return LinearFlow(*self._matrices())

    @property
    def at_rest(self) -> PlatformState:
        """The state in which all angles and rates are zero."""
        return PlatformState(*(as_float(0.0) for _ in range(5)))

    @property
    def nutation_frequency(self) -> Scalar:
        """h / sqrt(J I), rad/s, without servo and damping (Thomson 6.8-4)."""
        return self.spin_momentum * inverse_sqrt(self.platform_inertia * self.gyro_inertia)

    def first_angle(self, t: Scalar) -> Scalar:
        """theta, rad, at a time `t`, s, much shorter than a nutation: T h t^3 / (6 I J) (Thomson
        6.8-5)."""
        inertias = self.platform_inertia * self.gyro_inertia
        return self.torque * self.spin_momentum * t**3 / (6.0 * inertias)

    def _matrices(self) -> tuple[Array, Array]:
        J, I, h = self.platform_inertia, self.gyro_inertia, self.spin_momentum
        matrix = rows(
            (0.0, 0.0, 1.0, 0.0, 0.0),
            (0.0, 0.0, 0.0, 1.0, 0.0),
            (0.0, 0.0, -self.gyro_damping / I, h / I, 0.0),
            (-self.gain / J, 0.0, -(h + self.rate_gain) / J, 0.0, -self.integral_gain / J),
            (1.0, 0.0, 0.0, 0.0, 0.0),
        )
        return matrix, rows((0.0,), (0.0,), (0.0,), (self.torque / J,), (0.0,))[:, 0]


@formula
def resolve_signals(signals: Vector, pitch: Scalar, yaw: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    """The signals of three gyros on a platform resolved onto its gimbals (Thomson 6.9).

    **Arguments**

    - `signals`: about the platform's axes x, y, z, (3, *runs), in any unit.
    - `pitch`, `yaw`: angles of the inner two gimbals, Phi_y and Phi_z, rad, in the order of the
      book: roll outside, yaw, pitch inside.

    **Returns** the signals of roll, pitch and yaw. They are infinite in gimbal lock, at a yaw of 90
    deg: see `gimbal_lock_margin`.
    """
    check_components("resolve_signals: signals", signals, 3)
    s, c = jnp.sin(pitch), jnp.cos(pitch)
    # Along roll's axis and across it, in the plane that pitch turns.
    along, across = signals[0] * c - signals[2] * s, signals[2] * c + signals[0] * s
    roll = along / jnp.cos(yaw)
    return roll, signals[1] - along * jnp.tan(yaw), across


@formula
def gimbal_lock_margin(yaw: Scalar) -> Scalar:
    """Margin of a yaw, rad, to gimbal lock, where two gimbals turn about one axis: |cos(yaw)|,
    zero at 90 deg. As the condition of an event it falls through a least margin."""
    return jnp.abs(jnp.cos(yaw))
