"""A thin disk that rolls on a horizontal plane without slip: a thrown hoop, a spinning coin.

The triad of the disk: xi horizontal along the tangent at the contact, eta in the disk up from the
contact, zeta = z the normal. Components of omega along it, with K = C + m R^2, J = A + m R^2:

    J omega_xi'   = (A - C) omega_eta omega_zeta - (m R^2 omega_eta psi' + m g R) cos(theta)
    A omega_eta'  = (C - A) omega_zeta omega_xi + T cos(theta)
    K omega_zeta' = m R^2 omega_eta omega_xi - T sin(theta)
    v = R (omega_xi zeta - omega_zeta xi),     psi' = omega_eta / sin(theta)
    T sin(theta) = c phi' + mu m g R sgn(phi'),   phi' = omega_zeta - psi' cos(theta)
    E = m v^2/2 + [A (omega_xi^2 + omega_eta^2) + C omega_zeta^2]/2 + m g R sin(theta)

With the spin n = omega_zeta = phi' + psi' cos(theta), as of a top, and negative where the disk
rolls towards xi, the motion near a steady circle has

    [A psi' cos(theta) - K n] psi' sin(theta) = m g R cos(theta)           steady circle
    theta~'' + kappa theta~ = 0,   kappa = -(dG/dtheta)/J along psi'(theta), n(theta)
    G = A psi'^2 sin cos - K n psi' sin - m g R cos
    n^2 > m g A R / (C K)   rolls upright,     psi'^2 > m g R / J   spins upright on its rim

    symbol          meaning                                                         unit
    A, C            moments of inertia about the centre: a diameter, the normal     kg m^2
    m, R, g         mass, radius, acceleration of free fall                         kg, m, m/s^2
    theta           angle of the normal with the upward vertical; pi/2 is upright   rad
    psi, phi        precession of the tangent xi; turn about the normal             rad
    c, mu           viscous and dry resistance of the contour, along which the      N m s, 1
                    contact runs: it dissipates the power c phi'^2 + mu m g R |phi'|

Source: Thomson 5.16 (with the missing Eqs. 5.16-1..13 derived again, -n for its omega_zeta, and the
term C omega_zeta psi' theta that 5.16-36 and -43 leave out); Leine (2009), Arch. Appl. Mech. 79,
1063 (resistance of the contour). Valid without slip, while the contact force pushes and until the
disk is flat: a run that lifts off or passes through the plane has the status `OUTSIDE_MODEL`. Slip
depends on a coefficient of friction, which the model does not have. The quaternion and omega are
integrated: only a flat disk is singular, because it has no point of contact.
"""

import math
from collections.abc import Sequence
from typing import final

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..bodies import BodyState
from ..core import (
    AbstractSystem,
    InputError,
    NumberField,
    OptionalNumberField,
    Scalar,
    Vector,
    argument,
    constructor,
    quantity,
)
from ..core.checks import is_concrete
from ..core.limits import Limit
from ..core.types import as_float, precision_of
from ..core.vectors import axis, dot
from ..rotations import from_euler_angles
from ..rotations.euler_angles import omega_from_euler_rates
from . import _disk_circles
from ._state import attitude_and_omega
from .disk_tilt import disk_triad

PULL = 1e-4
"""The pull of the plane over the weight from which a run has left the model: above the error of a
state, because an event may end a run where the disk lifts off."""


@final
class RollingDisk(AbstractSystem):
    """A disk that rolls on the plane z = 0. State: `BodyState` with the position of its centre,
    attitude and omega, preferably created with `state`; the velocity follows from them."""

    mass: NumberField = quantity("kg", positive=True, doc="m, of the disk")
    radius: NumberField = quantity("m", positive=True, doc="R, of the rim")
    transverse_inertia: NumberField = quantity(
        "kg m^2", positive=True, doc="A, about a diameter: m R^2/4 for a disk, m R^2/2 for a hoop"
    )
    axial_inertia: NumberField = quantity(
        "kg m^2", positive=True, doc="C, about the normal: m R^2/2 for a disk, m R^2 for a hoop"
    )
    gravity: NumberField = quantity("m/s^2", positive=True, doc="g, downwards")
    contour_damping: OptionalNumberField = quantity(
        "N m s", non_negative=True, optional=True, doc="c, viscous resistance of the contour"
    )
    contour_friction: OptionalNumberField = quantity(
        "", non_negative=True, optional=True, doc="mu, dry resistance of the contour"
    )

    @classmethod
    def uniform(cls, mass: Scalar, radius: Scalar, gravity: Scalar) -> "RollingDisk":
        """A uniform disk of the `mass`, kg, and `radius`, m, under `gravity`, m/s^2."""
        # Of a thin body the moment about a diameter is half of that about the normal.
        axial = 0.5 * mass * radius * radius
        return cls(mass, radius, 0.5 * axial, axial, gravity)

    @classmethod
    def hoop(cls, mass: Scalar, radius: Scalar, gravity: Scalar) -> "RollingDisk":
        """A hoop of the `mass`, kg, and `radius`, m, under `gravity`, m/s^2."""
        axial = mass * radius * radius
        return cls(mass, radius, 0.5 * axial, axial, gravity)

    def vector_field(self, t: Scalar, y: BodyState) -> BodyState:
        del t
        attitude, omega = attitude_and_omega(y)
        xi, eta, s, c = _triad(y)
        w1 = dot(omega, xi)
        w2 = dot(omega, eta)
        w3 = omega[2]
        A, C, mRR, mgR = self._letters()
        precession = w2 / s
        rolling = w3 - precession * c
        resistance = self._resistance(rolling)
        first = (A - C) * w2 * w3 - (mRR * w2 * precession + mgR) * c
        second = (C - A) * w3 * w1 + resistance * c / s
        third = mRR * w2 * w1 - resistance
        rate = (first / (A + mRR)) * xi + (second / A) * eta + (third / (C + mRR)) * axis(2, third)
        return BodyState(position=self.velocity(y), attitude=attitude.rate(omega), omega=rate)

    def invariants(self, t: Scalar, y: BodyState) -> dict[str, Array]:
        del t
        attitude, _ = attitude_and_omega(y)
        _, _, s, _ = _triad(y)
        conserved = {
            # One, because the rim stays on the plane.
            "height_over_tilt": y.position[2] / (self.radius * s),
            "quaternion_norm": jnp.sqrt(attitude.norm_squared),
        }
        if self.contour_damping is None and self.contour_friction is None:
            return {"energy": self.energy(y)} | conserved
        return conserved

    def limits(self, t: Scalar, y: BodyState) -> Sequence[Limit]:
        del t
        normal = self.contact_force(y)[2]
        pull = PULL * self.mass * self.gravity
        # A part in a million of the radius: a coin settles towards flat.
        sunk = 1e-6 * self.radius
        return (
            Limit("the normal force of the plane", "N", normal, 0.0, margin=pull),
            Limit("the height of the centre", "m", y.position[2], 0.0, margin=sunk),
        )

    @constructor(
        angles=argument(
            "rad",
            shape=(3,),
            doc="Euler's angles 3-1-3 (psi, theta, phi): precession, tilt of the normal, spin",
        ),
        rates=argument("rad/s", shape=(3,), doc="their rates"),
        centre=argument("m", shape=(2,), default=(0.0, 0.0), doc="horizontal place of the centre"),
    )
    def state(
        self,
        angles: Vector | Sequence[Scalar],
        rates: Vector | Sequence[Scalar],
        centre: Array | Sequence[Scalar] = (0.0, 0.0),
    ) -> BodyState:
        """The state from Euler's angles and their rates.

        **Arguments**

        - `angles`: (psi, theta, phi), rad, (3, *runs), theta within (0, pi).
        - `rates`: (psi', theta', phi'), rad/s, (3, *runs).
        - `centre`: x and y of the centre, m, (2, *runs).
        """
        given = angles, rates, centre
        kind = precision_of(self, *given)
        a, a_dot, place = (as_float(x).astype(kind) for x in given)
        # In a batch only the run that lies flat is NaN.
        theta = float(np.asarray(a)[1]) if is_concrete(a) and a.ndim == 1 else 1.0
        if abs(math.sin(theta)) < 1e-12:
            raise InputError(
                f"RollingDisk.state: theta, the second angle, is {theta:.6g} rad, where the "
                "disk lies flat: it must be above 0 and below pi, where the rim has one lowest "
                "point."
            )
        height = self.radius * jnp.sin(a[1])
        x, y, z = jnp.broadcast_arrays(place[0], place[1], height)
        return BodyState(
            position=jnp.stack([x, y, z]),
            attitude=from_euler_angles(a),
            omega=omega_from_euler_rates(a, a_dot),
        )

    def energy(self, y: BodyState) -> Scalar:
        """E, J, with zero height of the centre in the plane."""
        _, omega = attitude_and_omega(y)
        _, _, s, _ = _triad(y)
        A, C, mRR, mgR = self._letters()
        across = omega[0] * omega[0] + omega[1] * omega[1]
        turning = A * across + C * omega[2] * omega[2]
        v = self.velocity(y)
        return 0.5 * (turning + self.mass * dot(v, v)) + mgR * s

    def velocity(self, y: BodyState) -> Vector:
        """Velocity of the centre, in inertial axes, m/s, (3, *runs), where the contact rests."""
        attitude, omega = attitude_and_omega(y)
        xi, _, _, _ = _triad(y)
        return attitude.rotate(self.radius * (dot(omega, xi) * axis(2, omega[2]) - omega[2] * xi))

    def contact(self, y: BodyState) -> Vector:
        """The lowest point of the rim, in inertial axes, m, (3, *runs)."""
        attitude, _ = attitude_and_omega(y)
        return y.position - attitude.rotate(self.radius * _triad(y)[1])

    def contact_force(self, y: BodyState) -> Vector:
        """Force of the plane on the disk, in inertial axes, N, (3, *runs).

        The disk lifts off where the normal component z is negative, and slips where the tangential
        force exceeds the coefficient of friction times z."""

        def velocity(y: BodyState) -> Vector:
            return self.velocity(y)

        # The derivative of the velocity along the motion, in place of a second formula that would
        # have to agree with it.
        _, acceleration = jax.jvp(velocity, (y,), (self.vector_field(jnp.zeros(()), y),))
        return self.mass * (acceleration + self.gravity * axis(2, acceleration[2]))

    def tilt_acceleration(self, theta: Scalar, precession: Scalar, spin: Scalar) -> Scalar:
        """theta'' without resistance, rad/s^2.

        **Arguments**

        - `theta`: tilt of the normal, rad.
        - `precession`: psi', rad/s.
        - `spin`: n = phi' + psi' cos(theta), rad/s.
        """
        return _disk_circles.tilt_acceleration(
            self._letters(), as_float(theta), as_float(precession), as_float(spin)
        )

    def steady_spin(self, theta: Scalar, precession: Scalar) -> Scalar:
        """The spin n, rad/s, of the steady circle with the tilt `theta`, rad, and the `precession`
        psi', rad/s: the motion of `state` with the rates (psi', 0, n - psi' cos(theta)). The radius
        of the centre's circle is R |n/psi'|."""
        return _disk_circles.steady_spin(self._letters(), as_float(theta), as_float(precession))

    def steady_precession_rates(self, theta: Scalar, spin: Scalar) -> tuple[Scalar, Scalar]:
        """The precession rates psi', rad/s, of the steady circles with the tilt `theta`, rad, and
        the `spin` n, rad/s: the slow one, and the fast one, which is infinite upright. For theta <
        pi/2 the slow one has the other sign than n, and the fast one its sign."""
        return _disk_circles.steady_precession_rates(
            self._letters(), as_float(theta), as_float(spin)
        )

    def tilt_stiffness(self, theta: Scalar, precession: Scalar, spin: Scalar) -> Scalar:
        """kappa, 1/s^2: the squared frequency of small oscillations about a steady circle, negative
        where they grow; arguments as in `tilt_acceleration`.

        The disk that rolls upright has psi' = 0, the one that spins upright n = 0."""
        return _disk_circles.tilt_stiffness(
            self._letters(), as_float(theta), as_float(precession), as_float(spin)
        )

    @property
    def least_rolling_spin(self) -> Scalar:
        """The |n|, rad/s, above which the disk rolls upright on a straight line (Thomson 5.16)."""
        A, C, mRR, mgR = self._letters()
        return jnp.sqrt(mgR * A / (C * (C + mRR)))

    @property
    def least_standing_spin(self) -> Scalar:
        """The psi', rad/s, above which the disk spins upright in place (Thomson 5.16-33)."""
        A, _, mRR, mgR = self._letters()
        return jnp.sqrt(mgR / (A + mRR))

    def growth_rate(self, theta: Scalar, precession: Scalar, spin: Scalar) -> Scalar:
        """Growth rate of small oscillations, 1/s, zero where they are stable (endpoint derivative
        convention of `end_sqrt`); arguments as in `tilt_acceleration`."""
        return _disk_circles.growth_rate(
            self._letters(), as_float(theta), as_float(precession), as_float(spin)
        )

    def settling_time(self, theta: Scalar) -> Scalar:
        """Time, s, in which a coin without spin, n = 0, settles from a small tilt `theta`, rad, to
        flat (Leine): 3 A theta^2/(4 c), or theta^(3/2) sqrt(A/(m g R))/mu without c; infinite
        without both."""
        A, _, _, mgR = self._letters()
        if self.contour_damping is not None:
            return 0.75 * A * theta * theta / self.contour_damping
        if self.contour_friction is None:
            return jnp.full_like(as_float(theta), jnp.inf)
        return theta * jnp.sqrt(theta) * jnp.sqrt(A / mgR) / self.contour_friction

    def _resistance(self, rolling: Scalar) -> Scalar:
        """T sin(theta), N m, at the rate phi', rad/s."""
        _, _, _, mgR = self._letters()
        viscous = 0.0 if self.contour_damping is None else self.contour_damping * rolling
        if self.contour_friction is None:
            # Plus zero, for the batch shape without resistance.
            return viscous + 0.0 * rolling
        return viscous + self.contour_friction * mgR * jnp.sign(rolling)

    def _letters(self) -> tuple[Scalar, Scalar, Scalar, Scalar]:
        """A, C, m R^2 and m g R."""
        mR = self.mass * self.radius
        return self.transverse_inertia, self.axial_inertia, mR * self.radius, mR * self.gravity


def _triad(y: BodyState) -> tuple[Vector, Vector, Scalar, Scalar]:
    """xi and eta in body axes, (3, *runs), and sine and cosine of theta.

    Theta continues below zero with the height of the centre: the motion through the plane is
    smooth, so that no step fails at a change of the contact, and `outside` reports it."""
    attitude, _ = attitude_and_omega(y)
    xi, eta, s, c = disk_triad(attitude)
    side = jnp.where(y.position[2] < 0.0, -1.0, 1.0).astype(s.dtype)
    return side * xi, side * eta, side * s, c
