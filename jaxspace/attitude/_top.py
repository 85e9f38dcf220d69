"""The heavy symmetric top: a body of revolution that rotates about a fixed point under its weight.

    A omega' = [(A - C) n omega + W l Z] x z       Euler's equations about the fixed point,
                                                   body axes; n' = 0
    q' = q (0, omega) / 2

The quaternion and omega are integrated, because they are not singular at the vertical. In Euler's
angles the same motion is

    A theta'' = W l sin(theta) - C n psi' sin(theta) + A psi'^2 sin(theta) cos(theta)
    h_Z = A psi' sin^2(theta) + C n cos(theta)
    n = phi' + psi' cos(theta)
    T + V = A (theta'^2 + psi'^2 sin^2(theta)) / 2 + C n^2 / 2 + W l cos(theta)

where h_Z, n and T + V are constant.

    symbol  meaning                                                      unit
    A, C    moments of inertia about the fixed point: across, along z    kg m^2
    W l     weight times distance of the mass centre up the axis         N m
    z, Z    the top's axis; the upward vertical                          1
    psi     precession: angle about Z                                    rad
    theta   nutation: angle from Z to z                                  rad
    phi     spin: angle about z                                          rad
    omega   angular velocity in body axes; n, its part along z           rad/s
    h_Z     angular momentum about Z                                     kg m^2/s

Source: Thomson 5.13 (the second of 5.13-4 with A theta''), 5.14 (steady precession), 6.1 (small
nutation); Harrison and Nettleton 4.11, with phi and psi interchanged.
Valid for a tip that does not move, without friction. W l < 0 is a hanging top (a spinning
pendulum), W l = 0 is the free symmetric body.

The functions and methods take `theta`, rad, and the rates, rad/s, as scalars or (*runs,), vectors
as (3, *runs).
"""

from collections.abc import Sequence
from typing import final

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..bodies import BodyState
from ..core import (
    AbstractSplit,
    AbstractSystem,
    NumberField,
    Scalar,
    Vector,
    argument,
    constructor,
    quantity,
)
from ..core.safe import safe_divide, safe_sqrt
from ..core.types import as_float
from ..core.vectors import axis, cross
from ..rotations import from_euler_angles, to_euler_angles
from ..rotations.euler_angles import omega_from_euler_rates
from ._state import attitude_and_omega, vertical
from ._steady_precession import (
    least_spin,
    nutation_frequency,
    pseudo_potential,
    pseudo_potential_minimum,
    rates_from_momentum,
    sleeping_growth_rate,
    steady_rates,
)
from .nutation import Nutation, nutation_through
from .top_motion import TopMotion
from .torque_free import symmetric_flow


def angular_acceleration(omega: Vector, Z: Vector, A: Scalar, C: Scalar, Wl: Scalar) -> Vector:
    """Angular acceleration omega', rad/s^2, in body axes, (3, *runs) (Thomson 5.13).

    **Arguments**

    - `omega`: angular velocity in body axes, rad/s, (3, *runs).
    - `Z`: the upward vertical in body axes, (3, *runs).
    - `A`, `C`: transverse and axial moment of inertia, kg m^2.
    - `Wl`: weight times distance of the mass centre from the fixed point, N m.
    """
    # The product of a moment with z: its part along z is exactly zero, and the spin constant.
    across, along = (A - C) / A * omega[2] * omega[:2] + Wl / A * Z[:2]
    return jnp.stack([along, -across, jnp.zeros_like(along)])


def energy(omega: Vector, Z: Vector, A: Scalar, C: Scalar, Wl: Scalar) -> Scalar:
    """Energy T + V, J, with V = 0 at the height of the fixed point (Thomson 5.13-9).

    Arguments as in `angular_acceleration`."""
    return (
        0.5 * A * (omega[0] * omega[0] + omega[1] * omega[1])
        + 0.5 * C * omega[2] * omega[2]
        + Wl * Z[2]
    )


def vertical_angular_momentum(omega: Vector, Z: Vector, A: Scalar, C: Scalar) -> Scalar:
    """Angular momentum about the vertical h_Z = h . Z, kg m^2/s (Thomson 5.13-7); arguments as in
    `angular_acceleration`."""
    return A * (omega[0] * Z[0] + omega[1] * Z[1]) + C * omega[2] * Z[2]


@final
class TopSplit(AbstractSplit):
    """The free rotation of a top as the drift, and the moment of its weight as the kick."""

    transverse_inertia: Float[Array, "*#runs"]
    axial_inertia: Float[Array, "*#runs"]
    weight_moment: Float[Array, "*#runs"]

    def drift(self, duration: Scalar, y: BodyState) -> BodyState:
        return symmetric_flow(duration, y, self.transverse_inertia, self.axial_inertia)

    def kick(self, t: Scalar, duration: Scalar, y: BodyState) -> BodyState:
        del t
        attitude, omega = attitude_and_omega(y)
        # Exact, because the moment has no part along z and the kick does not turn the top.
        Z = vertical(attitude)
        angular_acceleration = self.weight_moment / self.transverse_inertia
        change = duration * angular_acceleration * cross(Z, axis(2, Z[2]))
        return BodyState(attitude=attitude, omega=omega + change)


@final
class Top(AbstractSystem):
    """A heavy symmetric top on a fixed point. State: `BodyState` with attitude and omega only,
    preferably created with `Top.state`."""

    transverse_inertia: NumberField = quantity(
        "kg m^2", positive=True, doc="A, about the fixed point, across the axis of the top"
    )
    axial_inertia: NumberField = quantity(
        "kg m^2", positive=True, doc="C, about the axis of the top"
    )
    weight_moment: NumberField = quantity(
        "N m", doc="W l, weight times distance of the mass centre up the axis"
    )

    def vector_field(self, t: Scalar, y: BodyState) -> BodyState:
        del t
        attitude, omega = attitude_and_omega(y)
        A, C, Wl = self._letters()
        return BodyState(
            attitude=attitude.rate(omega),
            omega=angular_acceleration(omega, vertical(attitude), A, C, Wl),
        )

    def closed_form(self) -> TopMotion:
        return TopMotion(*self._letters())

    def split(self) -> TopSplit:
        return TopSplit(*self._letters())

    def invariants(self, t: Scalar, y: BodyState) -> dict[str, Array]:
        del t
        attitude, omega = attitude_and_omega(y)
        A, C, Wl = self._letters()
        Z = vertical(attitude)
        return {
            "energy": energy(omega, Z, A, C, Wl),
            "vertical_angular_momentum": vertical_angular_momentum(omega, Z, A, C),
            "axial_angular_momentum": C * omega[2],
            "quaternion_norm": jnp.sqrt(attitude.norm_squared),
        }

    @staticmethod
    @constructor(
        angles=argument(
            "rad",
            shape=(3,),
            default=(0.0, 0.0, 0.0),
            doc="Euler's angles 3-1-3 (psi, theta, phi): precession, nutation, spin",
        ),
        rates=argument("rad/s", shape=(3,), doc="their rates"),
    )
    def state(angles: Vector | Sequence[Scalar], rates: Vector | Sequence[Scalar]) -> BodyState:
        """The state from Euler's angles and their rates.

        **Arguments**

        - `angles`: (psi, theta, phi), rad, (3, *runs).
        - `rates`: (psi', theta', phi'), rad/s, (3, *runs).
        """
        a = as_float(angles)
        a_dot = as_float(rates)
        return BodyState(attitude=from_euler_angles(a), omega=omega_from_euler_rates(a, a_dot))

    @staticmethod
    def angles(y: BodyState) -> Vector:
        """Euler's angles (psi, theta, phi) of a state, rad, (3, *runs).

        Precession and spin are within (-pi, pi], nutation within [0, pi]. With the axis vertical
        only psi + phi is defined: psi is then zero."""
        attitude, _ = attitude_and_omega(y)
        return to_euler_angles(attitude)

    @staticmethod
    def rates(y: BodyState) -> Vector:
        """Rates (psi', theta', phi') of a state, rad/s, (3, *runs) (Thomson 3.5-1).

        With the axis vertical only psi' + phi' is defined: psi' is then zero. Near the vertical
        psi' grows as 1/sin(theta)."""
        attitude, omega = attitude_and_omega(y)
        _, theta, phi = Top.angles(y)
        across = omega[0] * jnp.sin(phi) + omega[1] * jnp.cos(phi)
        # sin(theta) from the parts of the attitude: from an angle close to pi it would lose its
        # digits.
        a, b, c, d = attitude.wxyz
        sine = 2.0 * safe_sqrt((b * b + c * c) * (a * a + d * d)) / attitude.norm_squared
        # Zero at the vertical, where the line of nodes is undefined.
        precession = safe_divide(across, sine)
        nutation = omega[0] * jnp.cos(phi) - omega[1] * jnp.sin(phi)
        return jnp.stack([precession, nutation, omega[2] - precession * jnp.cos(theta)])

    def steady_precession_rates(self, theta: Scalar, n: Scalar) -> tuple[Scalar, Scalar]:
        """The slow and the fast steady precession psi', rad/s (Thomson 5.14-4).

        **Arguments**

        - `theta`: the constant nutation angle, rad.
        - `n`: the spin, rad/s.

        **Returns** the two roots of A cos(theta) psi'^2 - C n psi' + W l = 0. NaN where there is
        none (`least_spin`); the fast one is infinite at the horizontal. At theta = 0 they are the
        two frequencies of a sleeping top. Exactly at `least_spin` both coincide, with infinite
        slopes (endpoint derivative convention of `core/safe.py`).
        """
        return steady_rates(*self._letters(), as_float(theta), as_float(n))

    def precession_rates_from_momentum(self, theta: Scalar, h_Z: Scalar) -> tuple[Scalar, Scalar]:
        """The slow and the fast steady precession psi', rad/s, of a given angular momentum about
        the vertical (Thomson 5.14, problem 5).

        **Arguments**

        - `theta`: the constant nutation angle, rad.
        - `h_Z`: angular momentum about the vertical, kg m^2/s.

        **Returns** the two roots of A psi'^2 - h_Z psi' + W l cos(theta) = 0; NaN where there is
        none. At the least momentum, 2 sqrt(A W l cos(theta)), both coincide, with infinite slopes
        (endpoint derivative convention of `core/safe.py`).
        """
        A, _, Wl = self._letters()
        return rates_from_momentum(A, Wl, as_float(theta), as_float(h_Z))

    def least_spin(self, theta: Scalar) -> Scalar:
        """The least spin n, rad/s, with a steady precession at `theta`, rad (Thomson 5.14-4).

        Zero below the horizontal. At theta = 0 a sleeping top is stable above it (Harrison and
        Nettleton 4.11). Where it becomes zero its slope is infinite (endpoint derivative convention
        of `core/safe.py`)."""
        return least_spin(*self._letters(), as_float(theta))

    def sleeping_growth_rate(self, n: Scalar) -> Scalar:
        """Growth rate, 1/s, of a small tilt of the upright top with the spin `n`, rad/s.

        Zero where it is stable. At the critical spin, `least_spin` at theta = 0, its slope is
        infinite (endpoint derivative convention of `core/safe.py`)."""
        return sleeping_growth_rate(*self._letters(), as_float(n))

    def pseudo_potential(self, theta: Scalar, h_Z: Scalar, n: Scalar) -> Scalar:
        """The pseudo-potential V', J: the axis moves as a point of inertia A in this potential, and
        is confined to where V' is below T + V - C n^2 / 2 (Harrison and Nettleton 4.11).

        **Arguments**

        - `theta`: nutation angle, rad.
        - `h_Z`: angular momentum about the vertical, kg m^2/s.
        - `n`: spin, rad/s.

        **Returns** (h_Z - C n cos(theta))^2 / (2 A sin^2(theta)) + W l cos(theta); infinite at a
        vertical that the axis cannot pass with these momenta.
        """
        return pseudo_potential(*self._letters(), as_float(theta), as_float(h_Z), as_float(n))

    def pseudo_potential_minimum(self, h_Z: Scalar, n: Scalar) -> Scalar:
        """The nutation angle, rad, at the only minimum of the pseudo-potential: that of the steady
        precession with these momenta, and of small nutations about it (Harrison and Nettleton
        4.11).

        **Arguments**

        - `h_Z`: angular momentum about the vertical, kg m^2/s.
        - `n`: spin about the axis of the top, rad/s.

        **Returns** the angle theta from the upward vertical, rad: zero, with zero derivatives, for
        the upright top at and above its critical spin, and pi for a hanging top."""
        return pseudo_potential_minimum(*self._letters(), as_float(h_Z), as_float(n))

    def precession_moment(self, theta: Scalar, precession: Scalar, n: Scalar) -> Scalar:
        """The moment about the line of nodes, N m, that a steady precession requires (Thomson
        5.14-3).

        **Arguments**

        - `theta`: nutation angle, rad.
        - `precession`: psi', rad/s.
        - `n`: spin, rad/s.
        """
        A, C, _ = self._letters()
        return (C * n - A * precession * jnp.cos(theta)) * precession * jnp.sin(theta)

    def momentum_angle(self, theta: Scalar, precession: Scalar, n: Scalar) -> Scalar:
        """The angle, rad, between the axis and the angular momentum in steady precession (Thomson
        5.14-7, -8); arguments as in `precession_moment`."""
        A, C, _ = self._letters()
        # By an arctangent, which has no singular place for a top that does not spin.
        return jnp.arctan2(A * precession * jnp.sin(theta), C * n)

    def nutation_frequency(self, theta: Scalar, precession: Scalar, n: Scalar) -> Scalar:
        """Angular frequency, rad/s, of a small nutation about a steady precession (Thomson 6.1-5);
        arguments as in `precession_moment`.

        NaN where the precession is unstable. Where the frequency becomes zero its slope is infinite
        (endpoint derivative convention of `core/safe.py`)."""
        return nutation_frequency(
            *self._letters(), as_float(theta), as_float(precession), as_float(n)
        )

    def precession_per_nutation(self, theta: Scalar, precession: Scalar, n: Scalar) -> Scalar:
        """Amplitude of psi' over the amplitude of theta, 1/s, in a small nutation about a steady
        precession (Thomson 6.1-8); arguments as in `precession_moment`."""
        A, C, _ = self._letters()
        return (C * n - 2.0 * A * precession * jnp.cos(theta)) / (A * jnp.sin(theta))

    def nutation(self, y: BodyState) -> Nutation:
        """The large nutation through the state `y`, with turning points, period and precession
        (Thomson 5.13-18 to -21)."""
        attitude, omega = attitude_and_omega(y)
        A, C, Wl = self._letters()
        return nutation_through(attitude, omega, vertical(attitude), C * omega[2] / A, 2.0 * Wl / A)

    def _letters(self) -> tuple[Scalar, Scalar, Scalar]:
        return self.transverse_inertia, self.axial_inertia, self.weight_moment
