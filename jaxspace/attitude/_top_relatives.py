"""Relatives of the top: bodies whose spin axis is turned, held by springs, a shaft or a string.

    A theta'' = [(A - C) Omega^2 cos(theta) - W l] sin(theta)       body pinned to a turning shaft
    Omega_c^2 = W l/(A - C),   cos(theta) = (Omega_c/Omega)^2       where it stands out beyond that
    A^2 w^4 - [A (K1 + K2) + H^2] w^2 + K1 K2 = 0                   flywheel on springs
    F = W sin(theta) + psi'^2/2 [(C/R)(1 - cos 2 theta) + (A/l) sin 2 theta]        ore crusher
    tan(2 theta) = -A R/(C l)                                       its greatest gyroscopic part
    T cos(b) = m g,   T sin(b) = m Omega^2 (l1 sin b + l2 sin theta)                gyro on a string
    C n Omega sin(theta) - A Omega^2 sin(theta) cos(theta) = T l2 sin(theta + b)

    symbol     meaning                                                       unit
    A, C       moments of inertia: across and along the axis of the body,    kg m^2
               about the pin, the fixed point or, on a string, the centre
    theta      angle of the axis: with the downward vertical on a shaft,     rad
               with the upward vertical in a crusher and on a string
    Omega      rate of the shaft; psi' of the crusher; of the whole figure   rad/s
    H, K1, K2  spin momentum; stiffness about two axes                       kg m^2/s, N m
    W, l, R    weight; distance of the wheel's centre; its radius            N, m, m
    b, T       angle and tension of the string                               rad, N
    l1, l2     its length; from its end to the centre of mass                m

Source: Thomson Problems 5.14-12 (shaft), -13 (springs), -14 to -17 (crusher), -20 (string).
"""

from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import (
    AbstractSystem,
    Scalar,
    argument,
    as_float,
    complete_elliptic,
    constructor,
    end_sqrt,
    quantity,
)


@final
class TiltState(eqx.Module):
    """The angle of a pinned body, and its rate; also the rates of both."""

    tilt: Float[Array, "*#runs"] = quantity("rad", doc="theta, from the downward vertical")
    tilt_rate: Float[Array, "*#runs"] = quantity("rad/s", doc="theta'")


@final
class ShaftPendulum(AbstractSystem):
    """A body of revolution that is pinned to a vertical shaft which turns at a constant rate, such
    as a disk on a stem. At the rate zero it is the plane pendulum. State: `TiltState`."""

    transverse_inertia: Float[Array, "*#runs"] = quantity(
        "kg m^2", positive=True, doc="A, about the pin"
    )
    axial_inertia: Float[Array, "*#runs"] = quantity(
        "kg m^2", non_negative=True, doc="C, about the stem"
    )
    weight_moment: Float[Array, "*#runs"] = quantity(
        "N m", positive=True, doc="W l, weight times distance of the mass centre from the pin"
    )
    shaft_rate: Float[Array, "*#runs"] = quantity("rad/s", default=0.0, doc="Omega, of the shaft")

    def vector_field(self, t: Scalar, y: TiltState) -> TiltState:
        del t
        A, C, Wl, Omega = self._letters()
        pull = (A - C) * Omega * Omega * jnp.cos(y.tilt) - Wl
        return TiltState(y.tilt_rate, pull * jnp.sin(y.tilt) / A)

    def invariants(self, t: Scalar, y: TiltState) -> dict[str, Array]:
        del t
        A, C, Wl, Omega = self._letters()
        s, c = jnp.sin(y.tilt), jnp.cos(y.tilt)
        turning = (A - C) * Omega * Omega * s * s
        # Jacobi's integral: the motor of the shaft does work.
        return {"jacobi_integral": 0.5 * (A * y.tilt_rate * y.tilt_rate - turning) - Wl * c}

    @staticmethod
    @constructor(
        tilt=argument("rad", doc="theta, from the downward vertical"),
        tilt_rate=argument("rad/s", default=0.0, doc="theta'"),
    )
    def state(tilt: Scalar, tilt_rate: Scalar = 0.0) -> TiltState:
        """The state from the angle `tilt`, rad, and its rate, rad/s."""
        tilt, tilt_rate = jnp.broadcast_arrays(as_float(tilt), as_float(tilt_rate))
        return TiltState(tilt, tilt_rate)

    def critical_rate(self) -> Scalar:
        """Omega_c, rad/s, beyond which it stands out from the shaft; NaN for A <= C, which always
        hangs."""
        A, C, Wl, _ = self._letters()
        return jnp.sqrt(Wl / (A - C))

    def equilibrium(self) -> Scalar:
        """The stable angle, rad: zero below the critical rate. At that rate its slope is infinite
        (the rule of ends in `core/_safe.py`)."""
        A, C, Wl, Omega = self._letters()

        def sine_of_half_squared(A, C, Wl, Omega):
            turning = (A - C) * Omega * Omega
            out = turning > Wl
            return 0.5 * jnp.where(out, turning - Wl, 0.0) / jnp.where(out, turning, 1.0)

        letters = jnp.broadcast_arrays(A, C, Wl, Omega)
        return 2.0 * jnp.arcsin(end_sqrt(sine_of_half_squared, *letters))

    def frequency(self, tilt: Scalar) -> Scalar:
        """Angular frequency, rad/s, of small oscillations about an equilibrium at `tilt`, rad; NaN
        where it is unstable."""
        A, C, Wl, Omega = self._letters()
        turning = (A - C) * Omega * Omega
        return jnp.sqrt((Wl * jnp.cos(tilt) - turning * jnp.cos(2.0 * tilt)) / A)

    def plane_period(self, amplitude: Scalar) -> Scalar:
        """Period, s, of the swing through `amplitude`, rad, on both sides of a shaft at rest
        (Thomson 5.12-P7)."""
        A, _, Wl, _ = self._letters()
        return 4.0 * jnp.sqrt(A / Wl) * complete_elliptic(jnp.cos(0.5 * as_float(amplitude)) ** 2)

    def _letters(self) -> tuple[Scalar, Scalar, Scalar, Scalar]:
        return self.transverse_inertia, self.axial_inertia, self.weight_moment, self.shaft_rate


def sprung_flywheel_frequencies(
    inertia: Scalar, momentum: Scalar, first: Scalar, second: Scalar
) -> tuple[Scalar, Scalar]:
    """The slow and the fast frequency of a flywheel whose axis two springs hold: A theta'' + H psi'
    + K1 theta = 0, A psi'' - H theta' + K2 psi = 0 (Thomson 5.14-P13).

    **Arguments**

    - `inertia`: A, across the axis, kg m^2.
    - `momentum`: H, of the spin, kg m^2/s.
    - `first`, `second`: K1 and K2, N m, not negative.

    **Returns** both, rad/s.
    """
    total = inertia * (first + second) + momentum * momentum
    # (K1 - K2)^2 and H as sums: nothing cancels where both frequencies are equal.
    apart = (inertia * (first - second)) ** 2 + momentum * momentum * (
        momentum * momentum + 2.0 * inertia * (first + second)
    )
    fast = 0.5 * (total + jnp.sqrt(apart)) / inertia**2
    return jnp.sqrt(first * second / (inertia * inertia * fast)), jnp.sqrt(fast)


def crusher_force(
    theta: Scalar,
    precession: Scalar,
    weight: Scalar,
    radius: Scalar,
    arm: Scalar,
    transverse_inertia: Scalar,
    axial_inertia: Scalar,
) -> Scalar:
    """Force of a wheel on the wall of the pan in which it rolls (Thomson 5.14-P15).

    **Arguments**

    - `theta`: angle of the axle with the upward vertical, rad.
    - `precession`: psi', of the shaft, rad/s.
    - `weight`: W, N.
    - `radius`, `arm`: R of the wheel, l from the fixed point to its centre, m.
    - `transverse_inertia`, `axial_inertia`: A and C about the fixed point, kg m^2.

    **Returns** F, N.
    """
    wheel, axle = axial_inertia / radius, transverse_inertia / arm
    sine = jnp.sin(theta)
    # sin^2 for (1 - cos 2 theta)/2, which keeps no digit of a small angle.
    gyroscopic = wheel * sine * sine + 0.5 * axle * jnp.sin(2.0 * theta)
    return weight * sine + precession * precession * gyroscopic


def crusher_spin(theta: Scalar, precession: Scalar, radius: Scalar, arm: Scalar) -> Scalar:
    """phi', rad/s, of the wheel about its axle; arguments as in `crusher_force`."""
    return -(arm * jnp.sin(theta) + radius * jnp.cos(theta)) * precession / radius


def best_crusher_tilt(
    precession: Scalar,
    weight: Scalar,
    radius: Scalar,
    arm: Scalar,
    transverse_inertia: Scalar,
    axial_inertia: Scalar,
) -> Scalar:
    """The theta, rad, of the greatest force, with the weight; with the weight zero, of the greatest
    gyroscopic force (Thomson 5.14-P16). Arguments as in `crusher_force`."""

    def slope(theta):
        def force(theta):
            return crusher_force(
                theta, precession, weight, radius, arm, transverse_inertia, axial_inertia
            )

        return jax.jvp(force, (theta,), (jnp.ones_like(theta),))[1]

    def newton(theta):
        value, bend = jax.jvp(slope, (theta,), (jnp.ones_like(theta),))
        return theta - value / bend

    # In the second quarter of 2 theta; between it and a right angle lies the one with weight.
    theta = 0.5 * jnp.arctan2(transverse_inertia * radius, -axial_inertia * arm + 0.0 * weight)
    theta = jax.lax.fori_loop(0, 8, lambda _, x: newton(x), jax.lax.stop_gradient(theta))
    # One step more carries the derivatives.
    return newton(jax.lax.stop_gradient(theta))


def gyro_on_a_string(
    theta: Scalar,
    rate: Scalar,
    mass: Scalar,
    transverse_inertia: Scalar,
    axial_inertia: Scalar,
    string: Scalar,
    arm: Scalar,
    gravity: Scalar,
) -> tuple[Scalar, Scalar, Scalar]:
    """The steady motion of a gyro that hangs by one end of its axle on a string (Thomson 5.14-P20).

    **Arguments**

    - `theta`: angle of the axle with the upward vertical, rad, not 0 or pi.
    - `rate`: Omega, of the whole figure about the vertical, rad/s, below sqrt(g/l1).
    - `mass`: m, kg.
    - `transverse_inertia`, `axial_inertia`: A and C about the centre of mass, kg m^2.
    - `string`, `arm`: l1 and l2, m.
    - `gravity`: g, m/s^2.

    **Returns** b, rad, T, N, and the spin n, rad/s, that they take.
    """

    def newton(b):
        s, c = jnp.sin(b), jnp.cos(b)
        reach = string * s + arm * jnp.sin(theta)
        value = gravity * s - rate * rate * reach * c
        slope = gravity * c - rate * rate * (string * c * c - reach * s)
        return b - value / slope

    # The string hangs nearly straight: g tan(b) = Omega^2 (l1 sin b + l2 sin theta) to first order.
    slow = rate * rate / gravity
    b = jnp.arctan(slow * arm * jnp.sin(theta) / (1.0 - slow * string) + 0.0 * mass)
    b = jax.lax.fori_loop(0, 12, lambda _, x: newton(x), jax.lax.stop_gradient(b))
    b = newton(jax.lax.stop_gradient(b))
    tension = mass * gravity / jnp.cos(b)
    moment = tension * arm * jnp.sin(theta + b)
    s, c = jnp.sin(theta), jnp.cos(theta)
    spin = (moment / s + transverse_inertia * rate * rate * c) / (axial_inertia * rate)
    return b, tension, spin
