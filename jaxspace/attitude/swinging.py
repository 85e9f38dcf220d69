"""Masses that swing out from a spinning body: on unwound cords hinged to the drum, or on arms that
are initially along the spin axis.

    (I + m R^2) w' + m R l cos(g) q' = m R l q^2 sin(g)            cords, q = w + g'
    R cos(g) w' + l q' = -R w^2 sin(g)
    F = m (l q^2 + R w^2 cos(g) - R w' sin(g))                     tension of all cords
    w_r/w_0 = (P - m a sqrt(P (a^2 - R^2)/I))/(m a^2 + I)          let go at g = 0
    l_0 = sqrt(R^2 + I/m) - R                                      cord for no spin, let go there

    theta'' = w^2 (r_0 + l sin(theta)) cos(theta)/l                arms
    w = w_0 J_0/J,   m l^2 theta'^2 = J_0 w_0^2 (1 - J_0/J),   J = I + m (r_0 + l sin(theta))^2

    symbol      meaning                                                       unit
    I, m        axial inertia of the body, all masses together                kg m^2, kg
    R, r_0, l   radius of the drum, of the hinges; length of cord or arm      m
    w, w_0      spin of the body, at first                                    rad/s
    g           angle of a cord from the outward radius, -90 degrees when it  rad
                is just unwound
    P, a        I + m R^2, R + l                                              kg m^2, m
    theta       angle of an arm from the axis                                 rad

Source: Thomson 7.5 (tangential release), Problems 3 and 4 of 7.6; for the radial release the
conservation of energy and angular momentum between the start and g = 0.
Valid for light cords and arms without friction, in the plane of the mass centre. Cords must pull,
and swing between both tangents of the drum: a run with slack cords, or with cords that meet the
drum again beyond g = 90 degrees, has the status `OUTSIDE_MODEL`.
"""

__all__ = [
    "SwingOutArms",
    "SwingState",
    "SwingingCords",
    "radial_release_spin",
    "zero_spin_radial_cord",
]

import math
from collections.abc import Sequence
from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..core import AbstractSystem, NumberField, Scalar, argument, constructor, quantity
from ..core.formula import NOT_NEGATIVE, POSITIVE, formula
from ..core.limits import Limit
from ..core.printing import printed
from ..core.safe import end_sqrt, safe_sqrt
from ..core.types import as_float, precision_of

_PLACES, _WEIGHTS = np.polynomial.legendre.leggauss(48)


@formula(cord=NOT_NEGATIVE, I=POSITIVE, R=POSITIVE, m=POSITIVE)
def radial_release_spin(
    w0: Scalar,
    cord: Scalar,
    I: Scalar,  # noqa: E741
    R: Scalar,
    m: Scalar,
) -> Scalar:
    """Spin, rad/s, after masses have unwound, swung out and were let go at the radius.

    **Arguments**, each (*runs,)

    - `w0`: initial spin, rad/s.
    - `cord`: l, m, positive.
    - `I`, `R`, `m`: axial inertia, kg m^2, radius of the drum, m, all masses, kg.

    **Returns** the spin: zero for the cord of `zero_spin_radial_cord`, whatever the initial spin.
    """
    whole, reach = I + m * R * R, R + cord
    out = safe_sqrt(whole * cord * (cord + 2.0 * R) / I)
    return w0 * (whole - m * reach * out) / (m * reach * reach + I)


@formula(I=POSITIVE, R=POSITIVE, m=POSITIVE)
def zero_spin_radial_cord(I: Scalar, R: Scalar, m: Scalar) -> Scalar:  # noqa: E741
    """The cord l_0, m, that stops the spin when its mass is let go at the radius: shorter by R than
    that of the tangential release.

    **Arguments**

    - `I`, `R`, `m`: as in `radial_release_spin`, (*runs,)."""
    # As a quotient, because both lengths may be large compared with their difference.
    ratio = I / m
    return ratio / (jnp.sqrt(R * R + ratio) + R)


@final
@printed()
class SwingState(eqx.Module):
    """Spin of the body, and angle of its cords or arms; also the rates of these."""

    spin: NumberField = quantity("rad/s", doc="w, of the body")
    angle: NumberField = quantity("rad", doc="g of a cord, theta of an arm")
    angle_rate: NumberField = quantity("rad/s", doc="of the angle")


@final
class SwingingCords(AbstractSystem):
    """Masses on unwound cords that are hinged to the drum. State: `SwingState`, preferably created
    with `state`."""

    axial_inertia: NumberField = quantity(
        "kg m^2", positive=True, doc="I, of the body without the masses"
    )
    radius: NumberField = quantity("m", positive=True, doc="R, of the drum")
    mass: NumberField = quantity("kg", positive=True, doc="m, of all masses together")
    cord_length: NumberField = quantity("m", positive=True, doc="l, of one cord")

    @staticmethod
    @constructor(
        spin=argument("rad/s", doc="w at the end of the unwinding"),
        angle_rate=argument("rad/s", doc="of a cord relative to the body, as it was unwound"),
    )
    def state(spin: Scalar, angle_rate: Scalar) -> SwingState:
        """The state at the end of the unwinding, with the cords along the tangent.

        **Arguments**

        - `spin`, `angle_rate`: of the `CordState` there, rad/s, (*runs,)."""
        spin = as_float(spin)
        return SwingState(spin, -0.5 * math.pi + 0.0 * spin, as_float(angle_rate))

    def vector_field(self, t: Scalar, y: SwingState) -> SwingState:
        del t
        spin_rate, turning = self._accelerations(y)
        return SwingState(spin_rate, y.angle_rate, turning - spin_rate)

    def invariants(self, t: Scalar, y: SwingState) -> dict[str, Array]:
        del t
        I, R, m, l = self.axial_inertia, self.radius, self.mass, self.cord_length  # noqa: E741
        w = y.spin
        q = y.spin + y.angle_rate
        product = m * R * l * jnp.cos(y.angle)
        whole = I + m * R * R
        return {
            "energy": 0.5 * (whole * w * w + m * l * l * q * q) + product * w * q,
            "angular_momentum": whole * w + m * l * l * q + product * (w + q),
        }

    def limits(self, t: Scalar, y: SwingState) -> Sequence[Limit]:
        del t
        # Relative to the tension due to the rates, with a margin above the error of a state.
        q = y.spin + y.angle_rate
        pull = self.mass * (self.cord_length * q * q + self.radius * y.spin * y.spin)
        return (
            Limit("the tension of the cords", "N", self.tension(y), 0.0, margin=1e-4 * pull),
            Limit("the size of angle", "rad", jnp.abs(y.angle), high=0.5 * math.pi, margin=1e-4),
        )

    def tension(self, y: SwingState) -> Scalar:
        """F, N, of all cords together in the state `y`."""
        spin_rate, _ = self._accelerations(y)
        q = y.spin + y.angle_rate
        R = self.radius
        pull = self.cord_length * q * q + R * y.spin**2 * jnp.cos(y.angle)
        return self.mass * (pull - R * spin_rate * jnp.sin(y.angle))

    def _accelerations(self, y: SwingState) -> tuple[Scalar, Scalar]:
        """w' and q', rad/s^2."""
        R, m, l = self.radius, self.mass, self.cord_length  # noqa: E741
        s, c = jnp.sin(y.angle), jnp.cos(y.angle)
        q = y.spin + y.angle_rate
        w = y.spin
        # I + m R^2 sin^2 is never zero.
        push = m * R * s * (l * q * q + R * w * w * c)
        spin_rate = push / (self.axial_inertia + m * (R * s) ** 2)
        return spin_rate, -R / l * (w * w * s + c * spin_rate)


@final
class SwingOutArms(AbstractSystem):
    """Masses on hinged arms that swing out from along the spin axis. State: `SwingState`,
    preferably created with `state`. Unlike a yo-yo they slow the spin by a share that does not
    depend on it, and cannot stop it."""

    axial_inertia: NumberField = quantity(
        "kg m^2", positive=True, doc="I, of the body without the masses"
    )
    mass: NumberField = quantity("kg", positive=True, doc="m, of all masses together")
    hinge_radius: NumberField = quantity("m", positive=True, doc="r_0, of the hinges from the axis")
    arm_length: NumberField = quantity("m", positive=True, doc="l, of an arm")

    @staticmethod
    @constructor(spin=argument("rad/s", doc="w_0, with the arms along the axis"))
    def state(spin: Scalar) -> SwingState:
        """The state with the arms at rest along the axis and the `spin` w_0, rad/s."""
        spin = as_float(spin)
        return SwingState(spin, 0.0 * spin, 0.0 * spin)

    def moment(self, theta: Scalar) -> Scalar:
        """J, kg m^2, with the arms at `theta`, rad."""
        return self.axial_inertia + self.mass * self._reach(theta) ** 2

    def spin_rate(self, theta: Scalar, w0: Scalar) -> Scalar:
        """w, rad/s, with the arms at `theta`, rad, from the initial spin `w0`, rad/s."""
        return w0 * self.moment(0.0 * theta) / self.moment(theta)

    def angle_rate(self, theta: Scalar, w0: Scalar) -> Scalar:
        """theta', rad/s, with the arms at `theta`, rad, from rest at the initial spin `w0`,
        rad/s."""
        first, now = self.moment(0.0 * theta), self.moment(theta)
        # J - J_0 as a product: of small angles both are equal to many digits.
        reach = self._reach(theta) + self.hinge_radius
        change = self.mass * self.arm_length * jnp.sin(theta) * reach
        square = first * change / (now * self.mass)
        return w0 / self.arm_length * safe_sqrt(square)

    def swing_time(self, theta: Scalar, w0: Scalar) -> Scalar:
        """Time, s, from the axis to `theta`, rad, (*runs,), up to a right angle, by Gauss
        quadrature with 48 points; from the initial spin `w0`, rad/s. At the axis its slope is
        infinite (endpoint derivative convention of `core/safe.py`)."""
        theta = jnp.asarray(theta)
        kind = precision_of(self, theta, w0)
        # Several bodies, or several first spins, may share an angle.
        rank = max(jnp.ndim(x) for x in (theta, w0, *jax.tree.leaves(self)))
        places = jnp.asarray(0.5 + 0.5 * _PLACES, kind).reshape(-1, *(1,) * rank)
        weights = jnp.asarray(0.5 * _WEIGHTS, kind).reshape(places.shape)
        # theta = u^2: the rate starts as the root of the angle.
        start = theta == 0.0
        # At rest on the axis nothing moves: the mean has a factor of zero, and the angle is
        # arbitrary.
        u = places * jnp.sqrt(jnp.where(start, 1.0, theta))
        mean = jnp.sum(weights * 2.0 * u / self.angle_rate(u * u, w0), axis=0)
        return end_sqrt(lambda x: x, theta) * mean

    def outward_acceleration(self, y: SwingState) -> Scalar:
        """Acceleration of a mass along the radius, m/s^2, in the state `y`."""
        # l (cos(theta) theta'' - sin(theta) theta'^2) - w^2 (r_0 + l sin(theta)), with the theta''
        # of the motion put in: of a small angle the rest is a small difference.
        s = jnp.sin(y.angle)
        turning = y.spin**2 * self._reach(y.angle) * s
        return -s * (turning + self.arm_length * y.angle_rate**2)

    def vector_field(self, t: Scalar, y: SwingState) -> SwingState:
        del t
        s, c = jnp.sin(y.angle), jnp.cos(y.angle)
        reach = self.hinge_radius + self.arm_length * s
        moment = self.axial_inertia + self.mass * reach * reach
        slowing = 2.0 * self.mass * reach * self.arm_length * c * y.angle_rate / moment
        turning = y.spin * y.spin * reach * c / self.arm_length
        return SwingState(-slowing * y.spin, y.angle_rate, turning)

    def invariants(self, t: Scalar, y: SwingState) -> dict[str, Array]:
        del t
        moment = self.moment(y.angle)
        swing = self.mass * (self.arm_length * y.angle_rate) ** 2
        return {
            "energy": 0.5 * (moment * y.spin**2 + swing),
            "angular_momentum": moment * y.spin,
        }

    def _reach(self, theta: Scalar) -> Scalar:
        """Distance of the masses from the axis, m."""
        return self.hinge_radius + self.arm_length * jnp.sin(theta)
