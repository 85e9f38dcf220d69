"""Gyro with one gimbal: the rate gyro with a spring, the integrating gyro without one.

    A theta'' + c theta' + K theta = H (1 + s) w_i - H w_s theta + M
    M = M_0 + U_s f_i - U_i f_s + k f_i f_s

    symbol    meaning                                                        unit
    theta     angle of the gimbal (float) about the output axis              rad
    A, c, K   inertia, damping, spring of the gimbal                         kg m^2, N m s, N m
    H         spin momentum of the rotor                                     kg m^2/s
    w_i, w_s  angular rates about the input and the spin axis                rad/s
    s, M_0    error of the scale factor, torque of the bias                  1, N m
    U_i, U_s  mass unbalances: mass times offset along both axes             kg m
    k         anisoelastic coefficient: compliance along spin less input     kg m s^2
    f_i, f_s  specific forces along both axes                                m/s^2

A rate gyro shows theta = H w_i / K; an integrating gyro theta = H / c times the angle turned.

Source: Thomson 6.6, 6.7; Savet, Gyroscopes: Theory and Design (errors).
Valid for small angles of the gimbal: a run with more than `SMALL_ANGLE` has the status
`OUTSIDE_MODEL`.
"""

from collections.abc import Sequence
from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Complex, Float

from ..core import AbstractSystem, NumberField, Scalar, quantity
from ..core.limits import Limit
from ..core.printing import printed
from ..core.safe import phi2
from ..core.square_roots import inverse_sqrt
from ..core.types import as_float
from ._linear import LinearFlow, linear_rate, rows
from ._small_angle import small_angle


@final
@printed()
class RateGyroState(eqx.Module):
    """Angle of the gimbal and its rate; also the rates of both."""

    angle: NumberField = quantity("rad", doc="theta, of the gimbal")
    angle_rate: NumberField = quantity("rad/s", doc="rate of theta")


@final
class RateGyro(AbstractSystem):
    """A rate gyro, or without `spring` an integrating gyro. State: `RateGyroState`."""

    transverse_inertia: NumberField = quantity(
        "kg m^2", positive=True, doc="A, of all that turns about the output axis"
    )
    damping: NumberField = quantity("N m s", non_negative=True, doc="c, of the gimbal")
    spin_momentum: NumberField = quantity("kg m^2/s", doc="H, of the rotor")
    spring: NumberField = quantity("N m", default=0.0, doc="K, of the gimbal")
    input_rate: NumberField = quantity("rad/s", default=0.0, doc="w_i, about the input axis")
    spin_axis_rate: NumberField = quantity("rad/s", default=0.0, doc="w_s, about the spin axis")
    scale_factor_error: NumberField = quantity("", default=0.0, doc="s")
    bias_torque: NumberField = quantity("N m", default=0.0, doc="M_0, bias torque")
    input_unbalance: NumberField = quantity(
        "kg m", default=0.0, doc="U_i, mass times offset along the input axis"
    )
    spin_unbalance: NumberField = quantity(
        "kg m", default=0.0, doc="U_s, mass times offset along the spin axis"
    )
    anisoelasticity: NumberField = quantity("kg m s^2", default=0.0, doc="k")
    input_force: NumberField = quantity(
        "m/s^2", default=0.0, doc="f_i, specific force along the input axis"
    )
    spin_force: NumberField = quantity(
        "m/s^2", default=0.0, doc="f_s, specific force along the spin axis"
    )

    def vector_field(self, t: Scalar, y: RateGyroState) -> RateGyroState:
        del t
        return linear_rate(*self._matrices(), y)

    def limits(self, t: Scalar, y: RateGyroState) -> Sequence[Limit]:
        del t
        return (small_angle("angle", y.angle),)

    def invariants(self, t: Scalar, y: RateGyroState) -> dict[str, Array]:
        """Nothing is conserved: the input does work on the gimbal."""
        del t, y
        return {}

    def closed_form(self) -> LinearFlow:
        return LinearFlow(*self._matrices())

    @property
    def natural_frequency(self) -> Scalar:
        """sqrt(K / A), rad/s."""
        return jnp.sqrt(self.spring / self.transverse_inertia)

    @property
    def damping_ratio(self) -> Scalar:
        """c / (2 sqrt(K A))."""
        return 0.5 * self.damping * inverse_sqrt(self.spring * self.transverse_inertia)

    @property
    def error_torque(self) -> Scalar:
        """M, N m, of bias, unbalance and anisoelasticity."""
        unbalance = self.spin_unbalance * self.input_force - self.input_unbalance * self.spin_force
        return (
            self.bias_torque
            + unbalance
            + self.anisoelasticity * (self.input_force * self.spin_force)
        )

    @property
    def drift_rate(self) -> Scalar:
        """The input rate, rad/s, that the error torques simulate: M / H."""
        return self.error_torque / self.spin_momentum

    @property
    def steady_angle(self) -> Scalar:
        """The equilibrium angle of the gimbal against the spring, rad."""
        torque = self.spin_momentum * (1.0 + self.scale_factor_error) * self.input_rate
        stiffness = self.spring + self.spin_momentum * self.spin_axis_rate
        return (torque + self.error_torque) / stiffness

    def step_response(self, t: Scalar) -> Scalar:
        """theta, rad, at `t`, s, after the input has begun, from rest."""
        zero = jnp.zeros_like(as_float(t))
        return self.closed_form().flow(t, RateGyroState(zero, zero)).angle

    @property
    def overshoot(self) -> Scalar:
        """Overshoot of the step response as a fraction of the steady angle; zero for damping ratios
        of one and more."""
        z = self.damping_ratio
        inside = z < 1.0
        under = jnp.where(inside, z, 0.0)
        # (1 - z) (1 + z), because 1 - z^2 loses its digits near critical damping.
        share = jnp.exp(-jnp.pi * under * inverse_sqrt((1.0 - under) * (1.0 + under)))
        return jnp.where(inside, share, 0.0)

    def integrated_angle(self, t: Scalar) -> Scalar:
        """theta, rad, of an integrating gyro, without spring, at `t`, s, from rest:
        (H w_i / c) [t - tau (1 - e^(-t / tau))], tau = A / c (Thomson 6.7)."""
        rate = self.damping / self.transverse_inertia
        torque = self.spin_momentum * self.input_rate
        # t - tau (1 - e^(-t / tau)) = t^2 phi2(-t / tau) / tau, without the difference.
        return torque / self.transverse_inertia * t * t * phi2(-rate * t)

    def frequency_response(self, frequency: Float[ArrayLike, "..."]) -> Complex[Array, "..."]:
        """theta / w_i, s, at angular frequencies, rad/s, of any shape that meets the parameters."""
        w = as_float(frequency)
        stiffness = self.spring + self.spin_momentum * self.spin_axis_rate
        real, imaginary = jnp.broadcast_arrays(
            stiffness - self.transverse_inertia * w * w, self.damping * w
        )
        size = self.spin_momentum / (real * real + imaginary * imaginary)
        return jax.lax.complex(size * real, -size * imaginary)

    def _matrices(self) -> tuple[Array, Array]:
        A = self.transverse_inertia
        stiffness = self.spring + self.spin_momentum * self.spin_axis_rate
        torque = self.spin_momentum * (1.0 + self.scale_factor_error) * self.input_rate
        matrix = rows((0.0, 1.0), (-stiffness / A, -self.damping / A))
        return matrix, rows((0.0,), ((torque + self.error_torque) / A,))[:, 0]
