"""Relatives of the top: spinning bodies whose axis turns, held by springs, an arm or a string. The
body on a shaft is in `_shaft_pendulum.py`.

    A^2 w^4 - [A (K1 + K2) + H^2] w^2 + K1 K2 = 0                   flywheel on springs
    F = W sin(theta) + psi'^2/2 [(C/R)(1 - cos 2 theta) + (A/l) sin 2 theta]        ore crusher
    tan(2 theta) = -A R/(C l)                                       its greatest gyroscopic part
    T cos(b) = m g,   T sin(b) = m Omega^2 (l1 sin b + l2 sin theta)                gyro on a string
    C n Omega sin(theta) - A Omega^2 sin(theta) cos(theta) = T l2 sin(theta + b)

    symbol     meaning                                                       unit
    A, C       moments of inertia: across and along the axis of the body,    kg m^2
               about the fixed point or, on a string, the centre
    theta      angle of the axis with the upward vertical                    rad
    Omega      psi' of the crusher; rate of the whole figure                 rad/s
    H, K1, K2  spin momentum; stiffness about two axes                       kg m^2/s, N m
    W, l, R    weight; distance of the wheel's centre; its radius            N, m, m
    b, T       angle and tension of the string                               rad, N
    l1, l2     its length; from its end to the centre of mass                m

Source: Thomson Problems 5.14-13 (springs), -14 to -17 (crusher), -20 (string).
"""

__all__ = [
    "best_crusher_tilt",
    "crusher_force",
    "crusher_spin",
    "gyro_on_a_string",
    "sprung_flywheel_frequencies",
]

import jax
import jax.numpy as jnp

from ..core import Scalar
from ..core.formula import NOT_NEGATIVE, POSITIVE, formula
from ..core.roots import increasing_root
from ..core.types import as_float


@formula(inertia=POSITIVE, first=NOT_NEGATIVE, second=NOT_NEGATIVE)
def sprung_flywheel_frequencies(
    inertia: Scalar, momentum: Scalar, first: Scalar, second: Scalar
) -> tuple[Scalar, Scalar]:
    """The slow and the fast frequency of a flywheel whose axis is supported by two springs: A
    theta'' + H psi' + K1 theta = 0, A psi'' - H theta' + K2 psi = 0 (Thomson 5.14-P13).

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


@formula(
    weight=NOT_NEGATIVE,
    radius=POSITIVE,
    arm=POSITIVE,
    transverse_inertia=POSITIVE,
    axial_inertia=POSITIVE,
)
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
    # sin^2 for (1 - cos 2 theta)/2, which loses all digits for a small angle.
    gyroscopic = wheel * sine * sine + 0.5 * axle * jnp.sin(2.0 * theta)
    return weight * sine + precession * precession * gyroscopic


@formula(radius=POSITIVE, arm=POSITIVE)
def crusher_spin(theta: Scalar, precession: Scalar, radius: Scalar, arm: Scalar) -> Scalar:
    """phi', rad/s, of the wheel about its axle.

    **Arguments**

    - `theta`, `precession`, `radius`, `arm`: as in `crusher_force`, (*runs,)."""
    return -(arm * jnp.sin(theta) + radius * jnp.cos(theta)) * precession / radius


@formula(
    weight=NOT_NEGATIVE,
    radius=POSITIVE,
    arm=POSITIVE,
    transverse_inertia=POSITIVE,
    axial_inertia=POSITIVE,
)
def best_crusher_tilt(
    precession: Scalar,
    weight: Scalar,
    radius: Scalar,
    arm: Scalar,
    transverse_inertia: Scalar,
    axial_inertia: Scalar,
) -> Scalar:
    """The theta, rad, of the greatest force, with the weight; with the weight zero, of the greatest
    gyroscopic force (Thomson 5.14-P16).

    **Arguments**

    - `precession`, `weight`, `radius`, `arm`, `transverse_inertia`, `axial_inertia`: as in
      `crusher_force`, (*runs,)."""

    def slope(theta):
        def force(theta):
            return crusher_force(
                theta, precession, weight, radius, arm, transverse_inertia, axial_inertia
            )

        return jax.jvp(force, (theta,), (jnp.ones_like(theta),))[1]

    def newton(theta):
        value, bend = jax.jvp(slope, (theta,), (jnp.ones_like(theta),))
        return theta - value / bend

    # This root is in the second quarter of 2 theta; the one with the weight is between it and a
    # right angle.
    theta = 0.5 * jnp.arctan2(transverse_inertia * radius, -axial_inertia * arm + 0.0 * weight)
    theta = jax.lax.fori_loop(0, 8, lambda _, x: newton(x), jax.lax.stop_gradient(theta))
    # A step more carries the first derivatives, two the second ones.
    return newton(newton(jax.lax.stop_gradient(theta)))


@formula(
    mass=POSITIVE,
    transverse_inertia=POSITIVE,
    axial_inertia=POSITIVE,
    string=POSITIVE,
    arm=POSITIVE,
    gravity=POSITIVE,
)
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

    - `theta`: angle of the axle with the upward vertical, rad, between 0 and pi.
    - `rate`: Omega, of the whole figure about the vertical, rad/s.
    - `mass`: m, kg.
    - `transverse_inertia`, `axial_inertia`: A and C about the centre of mass, kg m^2.
    - `string`, `arm`: l1 and l2, m.
    - `gravity`: g, m/s^2.

    **Returns** b, rad, T, N, and the required spin n, rad/s.
    """

    def lack(b):
        """g sin(b) - Omega^2 (l1 sin b + l2 sin theta) cos(b), of one sign change up to pi/2."""
        reach = string * jnp.sin(b) + arm * jnp.sin(theta)
        # The zero carries the runs of the mass, on which the root itself does not depend.
        return gravity * jnp.sin(b) - rate * rate * reach * jnp.cos(b) + 0.0 * mass

    def newton(b):
        value, slope = jax.jvp(lack, (b,), (jnp.ones_like(b),))
        return b - value / slope

    # Zero with the runs of all arguments together, for the loop of the search.
    zero = 0.0 * lack(0.0 * as_float(theta))
    b = jax.lax.stop_gradient(increasing_root(lack, zero, 0.5 * jnp.pi + zero))
    # Of a string that hangs nearly straight the halvings leave few digits, which Newton's steps
    # complete; two of them carry derivatives of the second order.
    b = newton(newton(b))
    tension = mass * gravity / jnp.cos(b)
    moment = tension * arm * jnp.sin(theta + b)
    s, c = jnp.sin(theta), jnp.cos(theta)
    spin = (moment / s + transverse_inertia * rate * rate * c) / (axial_inertia * rate)
    return b, tension, spin
