"""The heavy symmetric top: a body of revolution that turns about a fixed point on its axis, under
its own weight.

    A omega' = [(A - C) n omega + W l Z] x z       Euler's equations about the fixed point, body axes; n' = 0
    q' = q (0, omega) / 2

Integrated are the quaternion and omega: nothing is singular at the vertical. In Euler's angles the
same motion reads

    A theta'' = W l sin(theta) - C n psi' sin(theta) + A psi'^2 sin(theta) cos(theta)
    h_Z = A psi' sin^2(theta) + C n cos(theta),    n = phi' + psi' cos(theta),
    T + V = A (theta'^2 + psi'^2 sin^2(theta)) / 2 + C n^2 / 2 + W l cos(theta),    all three constant

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
nutation); Harrison and Nettleton 4.11, who name phi and psi the other way round. Valid for a tip
that stays where it is, without friction. W l < 0 is a top that hangs (a spinning pendulum), W l = 0
is the free symmetric body.
"""

from collections.abc import Sequence
from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..bodies import BodyState
from ..core import (
    AbstractSplit,
    AbstractSystem,
    InputError,
    Scalar,
    Vector,
    as_float,
    axis,
    barrier,
    check_finite,
    check_positive,
    cross,
    end_sqrt,
    safe_divide,
    safe_sqrt,
)
from ..rotations import Quaternion, from_euler_angles, omega_from_euler_rates, to_euler_angles
from ._nutation import Nutation
from ._state import attitude_and_omega
from ._torque_free import symmetric_flow


def vertical(attitude: Quaternion) -> Vector:
    """The upward vertical Z in body axes: (sin(theta) sin(phi), sin(theta) cos(phi),
    cos(theta))."""
    return attitude.rotate_back(axis(2, attitude.wxyz[0]))


def angular_acceleration(omega: Vector, Z: Vector, A: Scalar, C: Scalar, Wl: Scalar) -> Vector:
    """omega', rad/s^2, in body axes (Thomson 5.13); its part along z is exactly zero."""
    z = axis(2, omega[2])
    return cross((A - C) / A * omega[2] * omega + Wl / A * Z, z)


def energy(omega: Vector, Z: Vector, A: Scalar, C: Scalar, Wl: Scalar) -> Scalar:
    """T + V, J, with V = 0 at the height of the fixed point (Thomson 5.13-9)."""
    return (
        0.5 * A * (omega[0] * omega[0] + omega[1] * omega[1])
        + 0.5 * C * omega[2] * omega[2]
        + Wl * Z[2]
    )


def vertical_angular_momentum(omega: Vector, Z: Vector, A: Scalar, C: Scalar) -> Scalar:
    """h_Z = h . Z, kg m^2/s (Thomson 5.13-7)."""
    return A * (omega[0] * Z[0] + omega[1] * Z[1]) + C * omega[2] * Z[2]


@final
class Top(AbstractSystem):
    """A heavy symmetric top on a fixed point.

    Fields: `transverse_inertia` A and `axial_inertia` C, kg m^2, about the fixed point;
    `weight_moment` W l, N m. State: `BodyState` with attitude and omega only, best made by
    `Top.state`. Raises `InputError` for a moment of inertia that is not positive or a weight moment
    that is not finite."""

    transverse_inertia: Float[Array, "*#runs"] = eqx.field(converter=as_float)
    axial_inertia: Float[Array, "*#runs"] = eqx.field(converter=as_float)
    weight_moment: Float[Array, "*#runs"] = eqx.field(converter=as_float)

    def __check_init__(self):
        check_positive("Top.transverse_inertia", self.transverse_inertia)
        check_positive("Top.axial_inertia", self.axial_inertia)
        check_finite("Top.weight_moment", self.weight_moment)

    def vector_field(self, t: Scalar, y: BodyState) -> BodyState:
        del t
        attitude, omega = attitude_and_omega(y)
        A, C, Wl = self._letters()
        return BodyState(
            attitude=attitude.rate(omega),
            omega=angular_acceleration(omega, vertical(attitude), A, C, Wl),
        )

    def split(self) -> "TopSplit":
        return TopSplit(self)

    def invariants(self, t: Scalar, y: BodyState) -> dict[str, Array]:
        del t
        attitude, omega = attitude_and_omega(y)
        A, C, Wl = self._letters()
        Z = vertical(attitude)
        return {
            "energy": energy(omega, Z, A, C, Wl),
            "vertical_angular_momentum": vertical_angular_momentum(omega, Z, A, C),
            "axial_angular_momentum": C * omega[2],
            "quaternion_norm": jnp.sqrt(attitude.norm_squared()),
        }

    @staticmethod
    def state(angles: Vector | Sequence[Scalar], rates: Vector | Sequence[Scalar]) -> BodyState:
        """The state from `angles` = (psi, theta, phi), rad, and their `rates`, rad/s, both of shape
        (3, *runs)."""
        a, a_dot = as_float(angles), as_float(rates)
        return BodyState(attitude=from_euler_angles(a), omega=omega_from_euler_rates(a, a_dot))

    @staticmethod
    def angles(y: BodyState) -> Vector:
        """(psi, theta, phi), rad, (3, *runs): precession and spin within (-pi, pi], nutation within
        [0, pi].

        With the axis vertical only psi + phi has a meaning: psi is then zero."""
        attitude, _ = attitude_and_omega(y)
        return to_euler_angles(attitude)

    @staticmethod
    def rates(y: BodyState) -> Vector:
        """(psi', theta', phi'), rad/s, (3, *runs): precession, nutation and spin rate (Thomson
        3.5-1).

        With the axis vertical only psi' + phi' has a meaning: psi' is then zero. Near it psi' grows
        as 1/sin(theta)."""
        _, omega = attitude_and_omega(y)
        _, theta, phi = Top.angles(y)
        across = omega[0] * jnp.sin(phi) + omega[1] * jnp.cos(phi)
        precession = safe_divide(across, jnp.sin(theta))
        nutation = omega[0] * jnp.cos(phi) - omega[1] * jnp.sin(phi)
        return jnp.stack([precession, nutation, omega[2] - precession * jnp.cos(theta)])

    def steady_precession_rates(self, theta: Scalar, n: Scalar) -> tuple[Scalar, Scalar]:
        """The slow and the fast psi', rad/s, that keep `theta`, rad, at the spin `n`, rad/s
        (Thomson 5.14-4).

        Roots of A cos(theta) psi'^2 - C n psi' + W l = 0, without cancellation for a fast top or
        near the horizontal. NaN where none exists (`least_spin`); the fast one is infinite at the
        horizontal. At theta = 0 they are the two frequencies of a sleeping top. Exactly at
        `least_spin` both are one, with infinite slopes (the rule of ends in `core/_safe.py`)."""
        least = barrier(jax.lax.stop_gradient(self.least_spin(theta)))

        def radicand(A, C, Wl, theta, n, least):
            x = (C * n) ** 2 - 4.0 * A * Wl * jnp.cos(theta)
            # The same, without the rounding of a difference of squares: zero at the least spin.
            size = jnp.abs(n)
            below = 4.0 * A * jnp.maximum(-Wl * jnp.cos(theta), 0.0)
            exact = C * C * (size - least) * (size + least) + below
            return x + jax.lax.stop_gradient(exact - x)

        A, C, Wl = self._letters()
        theta, n = as_float(theta), as_float(n)
        p = C * n
        p = p + jnp.where(p < 0.0, -1.0, 1.0) * end_sqrt(radicand, A, C, Wl, theta, n, least)
        return 2.0 * Wl / p, p / (2.0 * A * jnp.cos(theta))

    def precession_rates_from_momentum(self, theta: Scalar, h_Z: Scalar) -> tuple[Scalar, Scalar]:
        """The slow and the fast psi', rad/s, that keep `theta`, rad, with the vertical angular
        momentum `h_Z`, kg m^2/s.

        Roots of A psi'^2 - h_Z psi' + W l cos(theta) = 0 (Thomson 5.14, problem 5); NaN where none
        exists."""
        A, _, Wl = self._letters()
        weight = Wl * jnp.cos(theta)
        p = h_Z + jnp.where(h_Z < 0.0, -1.0, 1.0) * safe_sqrt(h_Z * h_Z - 4.0 * A * weight)
        return 2.0 * weight / p, p / (2.0 * A)

    def least_spin(self, theta: Scalar) -> Scalar:
        """The least n, rad/s, with a steady precession at `theta`, rad; zero below the horizontal
        (Thomson 5.14-4).

        At theta = 0 it is the spin above which a sleeping top is stable (Harrison and Nettleton
        4.11). Where it becomes zero its slope is infinite (the rule of ends in `core/_safe.py`)."""

        def radicand(A, Wl, theta):
            return jnp.maximum(A * Wl * jnp.cos(theta), 0.0)

        A, C, Wl = self._letters()
        return 2.0 / C * end_sqrt(radicand, A, Wl, as_float(theta))

    def sleeping_growth_rate(self, n: Scalar) -> Scalar:
        """Rate, 1/s, at which a small tilt of the upright top grows with the spin `n`, rad/s; zero
        when it is stable. At the critical spin, `least_spin` at theta = 0, its slope is infinite
        (the rule of ends in `core/_safe.py`)."""
        critical = barrier(jax.lax.stop_gradient(self.least_spin(jnp.zeros_like(as_float(n)))))

        def radicand(A, C, Wl, n, critical):
            x = 4.0 * A * Wl - (C * n) ** 2
            # The same, without the rounding of a difference of squares.
            size = jnp.abs(n)
            exact = C * C * (critical - size) * (critical + size)
            return jnp.maximum(x + jax.lax.stop_gradient(exact - x), 0.0)

        A, C, Wl = self._letters()
        return end_sqrt(radicand, A, C, Wl, as_float(n), critical) / (2.0 * A)

    def precession_moment(self, theta: Scalar, precession: Scalar, n: Scalar) -> Scalar:
        """The moment about the line of nodes, N m, that the steady rate `precession`, rad/s, calls
        for (Thomson 5.14-3)."""
        A, C, _ = self._letters()
        return (C * n - A * precession * jnp.cos(theta)) * precession * jnp.sin(theta)

    def momentum_angle(self, theta: Scalar, precession: Scalar, n: Scalar) -> Scalar:
        """The angle, rad, between the axis and the angular momentum in steady precession (Thomson
        5.14-7, -8)."""
        A, C, _ = self._letters()
        return jnp.arctan2(A * precession * jnp.sin(theta), C * n)

    def nutation_frequency(self, theta: Scalar, precession: Scalar, n: Scalar) -> Scalar:
        """Angular frequency, rad/s, of a small nutation about the steady `precession`, rad/s
        (Thomson 6.1-5)."""
        A, C, Wl = self._letters()
        gyroscopic = (C * n) ** 2 - 4.0 * A * Wl * jnp.cos(theta)
        return safe_sqrt(gyroscopic + (A * precession * jnp.sin(theta)) ** 2) / A

    def precession_per_nutation(self, theta: Scalar, precession: Scalar, n: Scalar) -> Scalar:
        """Deviation of psi' over the deviation of theta, 1/s, in a small nutation about
        `precession` (Thomson 6.1-8)."""
        A, C, _ = self._letters()
        return (C * n - 2.0 * A * precession * jnp.cos(theta)) / (A * jnp.sin(theta))

    def nutation(self, y: BodyState) -> Nutation:
        """The whole, large nutation through the state `y`: turning points, period, precession
        (Thomson 5.13-18..21)."""
        attitude, omega = attitude_and_omega(y)
        A, C, Wl = self._letters()
        Z = vertical(attitude)
        N, beta = C * omega[2] / A, 2.0 * Wl / A
        transverse = omega[0] * omega[0] + omega[1] * omega[1]
        around = omega[0] * Z[0] + omega[1] * Z[1]
        # sin^2 and cos^2 of half the nutation angle: near a vertical, 1 - cos(theta) has no digits.
        w, x, y_, z = attitude.wxyz
        whole = attitude.norm_squared()
        up, down = (x * x + y_ * y_) / whole, (w * w + z * z) / whole
        return Nutation(
            N=N,
            beta=beta,
            alpha_up=transverse - 2.0 * beta * up,
            alpha_down=transverse + 2.0 * beta * down,
            gamma_up=around - 2.0 * N * up,
            gamma_down=around + 2.0 * N * down,
        )

    def _letters(self) -> tuple[Scalar, Scalar, Scalar]:
        return self.transverse_inertia, self.axial_inertia, self.weight_moment


@final
class TopSplit(AbstractSplit):
    """The free rotation of a `top` as the drift, and the moment of its weight as the kick."""

    top: Top

    def drift(self, duration: Scalar, y: BodyState) -> BodyState:
        return symmetric_flow(duration, y, self.top.transverse_inertia, self.top.axial_inertia)

    def kick(self, t: Scalar, duration: Scalar, y: BodyState) -> BodyState:
        del t
        attitude, omega = attitude_and_omega(y)
        Z = vertical(attitude)
        angular_acceleration = self.top.weight_moment / self.top.transverse_inertia
        change = duration * angular_acceleration * cross(Z, axis(2, Z[2]))
        return BodyState(attitude=attitude, omega=omega + change)


def continuous_precession(states: BodyState) -> Float[Array, "*runs times"]:
    """The precession angle psi, rad, along sampled states, without jumps of whole turns.

    `states` is laid out as in a trajectory: runs, times, then components. Between samples psi must
    turn by less than half a turn; where the axis passes close to the vertical this asks for dense
    samples.

    Raises `InputError` for states without attitude."""
    if states.attitude is None:
        raise InputError("The states hold no attitude: a precession angle needs it.")
    psi = to_euler_angles(Quaternion(jnp.moveaxis(states.attitude.wxyz, -1, 0)))[0]
    return jnp.unwrap(psi, axis=-1)
