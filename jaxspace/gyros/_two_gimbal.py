"""A free rotor in two gimbals that have mass, the axis of the outer gimbal fixed in inertial space.

    (A + A_i) theta'' = (A + B_i - C_i) psi'^2 sin(theta) cos(theta) - H psi' sin(theta) + M_xi
    h_Z' = M_Z                           h_Z = I_Z psi' + H cos(theta)
    I_Z(theta) = (A + B_i) sin^2(theta) + C_i cos^2(theta) + C_0,    H = C n constant

    symbol         meaning                                                            unit
    theta          angle of the rotor's axis from the outer gimbal's axis Z           rad
    psi            angle of the outer gimbal about Z                                  rad
    A, C           moments of inertia of the rotor, across and along its axis         kg m^2
    n              spin of the rotor about its axis, relative to inertial space       rad/s
    A_i, B_i, C_i  inner gimbal: about its own axis xi, across, along the rotor axis  kg m^2
    C_0            outer gimbal, about Z                                              kg m^2
    M_xi, M_Z      constant moments about the inner and about the outer axis          N m
    h_Z            angular momentum of everything about Z                             kg m^2/s

Source: Thomson 6.2 (massless gimbals: 6.2-1), 6.3-1 to -14 (with mass), 6.3-22 (drift). In 6.3-5
the spin is phi' + psi' cos(theta); the expansion 6.3-16 lacks
-H cos(theta_0) (theta - theta_0)^2 / 2, which changes no drift.
Valid for rigid gimbals with axes at right angles, without friction, and a rotor without motor
torque.

Gimbal lock: at theta = 0 the rotor's axis lies along Z. With gimbals without mass I_Z is then zero,
so that psi, its rate and the vector field are undefined. With C_i + C_0 > 0 nothing is singular.
"""

from typing import final

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import (
    AbstractSystem,
    Scalar,
    argument,
    as_float,
    constructor,
    end_sqrt,
    quantity,
    stumpff,
)
from ._gimbal_walk import GimbalWalk


@final
class GimbalState(eqx.Module):
    """Angles of both gimbals, rate of the inner one, momentum of the outer one; also their rates.

    The momentum takes the place of the rate of psi: it is constant or grows linearly, so that no
    error of the integration adds to the drift of the outer gimbal, which is 1e-5 of the nutation
    rates.
    """

    theta: Float[Array, "*#runs"] = quantity(
        "rad", doc="angle of the rotor's axis from the outer gimbal's axis"
    )
    psi: Float[Array, "*#runs"] = quantity("rad", doc="angle of the outer gimbal about its axis")
    theta_rate: Float[Array, "*#runs"] = quantity("rad/s", doc="rate of theta")
    angular_momentum: Float[Array, "*#runs"] = quantity(
        "kg m^2/s", doc="h_Z, of everything about the outer gimbal's axis"
    )


@final
class TwoGimbalGyro(AbstractSystem):
    """A rotor in two gimbals, which have no mass by default.

    State: `GimbalState`, best made by `TwoGimbalGyro.state`."""

    transverse_inertia: Float[Array, "*#runs"] = quantity(
        "kg m^2", positive=True, doc="A, of the rotor across its axis"
    )
    axial_inertia: Float[Array, "*#runs"] = quantity(
        "kg m^2", positive=True, doc="C, of the rotor about its axis"
    )
    spin_rate: Float[Array, "*#runs"] = quantity(
        "rad/s", doc="n, of the rotor about its axis, relative to inertial space"
    )
    inner_xi: Float[Array, "*#runs"] = quantity(
        "kg m^2", non_negative=True, default=0.0, doc="A_i, inner gimbal about its own axis"
    )
    inner_eta: Float[Array, "*#runs"] = quantity(
        "kg m^2", non_negative=True, default=0.0, doc="B_i, inner gimbal across both axes"
    )
    inner_zeta: Float[Array, "*#runs"] = quantity(
        "kg m^2", non_negative=True, default=0.0, doc="C_i, inner gimbal about the rotor's axis"
    )
    outer: Float[Array, "*#runs"] = quantity(
        "kg m^2", non_negative=True, default=0.0, doc="C_0, outer gimbal about its own axis"
    )
    moment_inner: Float[Array, "*#runs"] = quantity(
        "N m", default=0.0, doc="M_xi, constant moment about the inner axis"
    )
    moment_outer: Float[Array, "*#runs"] = quantity(
        "N m", default=0.0, doc="M_Z, constant moment about the outer axis"
    )

    def vector_field(self, t: Scalar, y: GimbalState) -> GimbalState:
        del t
        s = jnp.sin(y.theta)
        c = jnp.cos(y.theta)
        # From the momentum, whose errors do not add to the drift of psi.
        psi_rate = self.outer_rate(y)
        moment = (
            self._gimbal_difference() * psi_rate * c - self.spin_momentum()
        ) * psi_rate * s + self.moment_inner
        return GimbalState(
            theta=y.theta_rate,
            psi=psi_rate,
            theta_rate=moment / self.inner_inertia(),
            # A moment that all runs share has the shape of the runs in a rate.
            angular_momentum=self.moment_outer + jnp.zeros_like(y.angular_momentum),
        )

    def invariants(self, t: Scalar, y: GimbalState) -> dict[str, Array]:
        """The energy less the work of the moments, J, and the momentum about Z less the impulse of
        M_Z, kg m^2/s."""
        psi_rate = self.outer_rate(y)
        kinetic = self.inner_inertia() * y.theta_rate**2 + self.outer_inertia(y.theta) * psi_rate**2
        spin = self.axial_inertia * self.spin_rate**2
        # Constant moments have potentials: the angles times the moments.
        work = self.moment_inner * y.theta + self.moment_outer * y.psi
        return {
            "energy": 0.5 * (kinetic + spin) - work,
            "angular_momentum": y.angular_momentum - self.moment_outer * t,
        }

    @constructor(
        theta=argument(
            "rad", default=0.0, doc="angle of the rotor's axis from the outer gimbal's axis"
        ),
        psi=argument("rad", default=0.0, doc="angle of the outer gimbal about its axis"),
        theta_rate=argument("rad/s", default=0.0, doc="rate of theta"),
        psi_rate=argument("rad/s", default=0.0, doc="rate of psi"),
    )
    def state(
        self, theta: Scalar, psi: Scalar, theta_rate: Scalar, psi_rate: Scalar
    ) -> GimbalState:
        """The state from the angles, rad, and the rates, rad/s, of the gimbals."""
        h = self.outer_inertia(theta) * psi_rate + self.spin_momentum() * jnp.cos(theta)
        return GimbalState(theta, psi, theta_rate, h)

    def outer_rate(self, y: GimbalState) -> Scalar:
        """Rate psi' = (h_Z - H cos(theta)) / I_Z, rad/s (Thomson 6.3-14); not finite in gimbal
        lock."""
        momentum = y.angular_momentum - self.spin_momentum() * jnp.cos(y.theta)
        return momentum / self.outer_inertia(y.theta)

    def spin_momentum(self) -> Scalar:
        """Spin momentum H = C n, kg m^2/s."""
        return self.axial_inertia * self.spin_rate

    def inner_inertia(self) -> Scalar:
        """Inertia A + A_i of all that turns about the inner axis, kg m^2."""
        return self.transverse_inertia + self.inner_xi

    def outer_inertia(self, theta: Scalar) -> Scalar:
        """Inertia I_Z of all that turns about Z, without the spin, kg m^2, with the rotor's axis at
        `theta`, rad (Thomson 6.3-10)."""
        # Across the rotor's axis the inner gimbal turns with the rotor, along it alone.
        s = jnp.sin(theta)
        c = jnp.cos(theta)
        return (
            (self.transverse_inertia + self.inner_eta) * s * s
            + self.inner_zeta * c * c
            + self.outer
        )

    def nutation_frequency(self, theta: Scalar) -> Scalar:
        """Angular frequency, rad/s, of small oscillations about rest at `theta`, rad (Thomson
        6.3-17).

        It is w = H sin(theta) / sqrt(I_Z (A + A_i)), and C n / A for gimbals without mass."""
        return (
            self.spin_momentum()
            * jnp.sin(theta)
            / jnp.sqrt(self.outer_inertia(theta) * self.inner_inertia())
        )

    def walk(self, theta: Scalar, theta_rate: Scalar) -> GimbalWalk:
        """The free nutation from `theta`, rad, and `theta_rate`, rad/s, with the outer gimbal at
        rest."""
        return GimbalWalk(
            theta=as_float(theta),
            theta_rate=as_float(theta_rate),
            spin_momentum=self.spin_momentum(),
            inner_inertia=self.inner_inertia(),
            outer_inertia_upright=self.inner_zeta + self.outer,
            outer_inertia_across=self.transverse_inertia + self.inner_eta + self.outer,
        )

    def impulse_response(self, t: Scalar, impulse: Scalar) -> tuple[Scalar, Scalar]:
        """Deviations of theta and psi after an impulse about the inner axis (Thomson 6.2-7, -8).

        Valid for gimbals without mass, at rest at theta = 90 deg, to first order in the impulse.

        **Arguments**

        - `t`: time since the impulse, s.
        - `impulse`: N m s.

        **Returns** both deviations, rad.
        """
        p = self.spin_momentum() / self.transverse_inertia
        # Without mass of the gimbals the nutation is a circle of this size.
        size = impulse / self.spin_momentum()
        return size * jnp.sin(p * t), 2.0 * size * jnp.sin(0.5 * p * t) ** 2

    def step_response(self, t: Scalar) -> tuple[Scalar, Scalar]:
        """Deviations of theta and psi, rad, after `t`, s, under the moment M_xi (Thomson 6.2,
        problem 1).

        Valid for gimbals without mass, from rest at theta = 90 deg, to first order in the moment.
        """
        p = self.spin_momentum() / self.transverse_inertia
        # The nutation starts from rest, so that it is a cycloid about a steady precession.
        size = self.moment_inner / self.spin_momentum()
        return 2.0 * size / p * jnp.sin(0.5 * p * t) ** 2, size / p * _less_sine(p * t)

    def swing(self, t: Scalar, theta: Scalar) -> Scalar:
        """The angle theta under the moment M_Z (Thomson 6.2, problems 3 and 4).

        Valid for a momentum H so large that the nutation is negligible: H sin(theta) theta' = -M_Z.

        **Arguments**

        - `t`: time, s.
        - `theta`: the angle at t = 0, rad.

        **Returns** theta, rad; NaN once the axis has reached Z.
        """
        change = 0.5 * self.moment_outer * t / self.spin_momentum()
        # Of half the angle: the cosine itself has no digits of a small one.
        sine = end_sqrt(lambda c, a: jnp.sin(0.5 * a) ** 2 - c, change, as_float(theta))
        cosine = end_sqrt(lambda c, a: jnp.cos(0.5 * a) ** 2 + c, change, as_float(theta))
        return 2.0 * jnp.arctan2(sine, cosine)

    def swing_time(self, theta: Scalar, theta_end: Scalar) -> Scalar:
        """Time, s, in which the moment M_Z swings the axis from `theta` to `theta_end`, rad."""
        # The inverse of `swing`; the difference of the cosines as a product.
        fall = 2.0 * jnp.sin(0.5 * (theta + theta_end)) * jnp.sin(0.5 * (theta - theta_end))
        return self.spin_momentum() * fall / self.moment_outer

    def _gimbal_difference(self) -> Scalar:
        """A + B_i - C_i, kg m^2."""
        return self.transverse_inertia + self.inner_eta - self.inner_zeta


def _less_sine(x: Scalar) -> Scalar:
    """x - sin(x), right to rounding also for a small x."""
    small = jnp.abs(x) < 1.0
    near = jnp.where(small, x, 0.0)
    return jnp.where(small, near**3 * stumpff(near * near)[1], x - jnp.sin(x))
