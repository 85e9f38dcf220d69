"""Euler's angles: three successive turns about the moving axes.

    C_NB = R_i(a) R_j(b) R_k(c)         i, j, k: axes of the sequence; 3-1-3: psi, theta, phi; 3-2-1: yaw, pitch, roll
    omega_B = a' i + b' j + c' k        i, j, k as they stand while the turn about them happens, in body components

    symbol  meaning (3-1-3)                                         unit
    psi     precession, about the inertial axis Z                   rad
    theta   nutation, about the line of nodes                       rad
    phi     spin, about the body's axis z                           rad

Source: Thomson 3.4-5 (matrix, its transpose here: body to inertial), 3.5-1 (rates). Harrison and
Nettleton swap phi and psi. The angles are singular where the first and the last axis coincide
(3-1-3: sin(theta) = 0; 3-2-1: cos(theta) = 0): the rates are then undefined, and only a combination
of the first and the third angle has a meaning. Integrate the quaternion.
"""

import jax.numpy as jnp

from ..core import InputError, Matrix, Vector, safe_atan2, safe_sqrt, solve3
from ._quaternion import Quaternion

SEQUENCES = ("313", "321", "123", "132", "213", "231", "312", "121", "131", "212", "232", "323")


def _axes(sequence: str) -> tuple[int, int, int]:
    if sequence not in SEQUENCES:
        raise InputError(f"sequence is {sequence!r}: it must be one of {', '.join(SEQUENCES)}.")
    i, j, k = (int(c) - 1 for c in sequence)
    return i, j, k


def from_euler_angles(angles: Vector, sequence: str = "313") -> Quaternion:
    """The orientation reached by the three turns through `angles`, rad, shape (3, *runs), about the
    axes of `sequence`.

    Raises `InputError` for a sequence that is none of the twelve."""
    i, j, k = _axes(sequence)
    return (
        Quaternion.about(i, angles[0])
        .then(Quaternion.about(j, angles[1]))
        .then(Quaternion.about(k, angles[2]))
    )


def to_euler_angles(attitude: Quaternion, sequence: str = "313") -> Vector:
    """The three angles, rad, of an orientation: the outer ones within (-pi, pi], the middle one
    within [0, pi] for a sequence that repeats its first axis and within [-pi/2, pi/2] otherwise. In
    the singular position the third angle is what remains with the first put to zero.

    Raises `InputError` for a sequence that is none of the twelve."""
    i, j, k = _axes(sequence)
    n = 3 - i - j
    sign = 1.0 if (j - i) % 3 == 1 else -1.0
    c = attitude.matrix()
    if i == k:
        first = safe_atan2(c[j, i], -sign * c[n, i])
        middle = safe_atan2(safe_sqrt(c[j, i] ** 2 + c[n, i] ** 2), c[i, i])
    else:
        first = safe_atan2(-sign * c[j, k], c[k, k])
        middle = safe_atan2(sign * c[i, k], safe_sqrt(c[i, i] ** 2 + c[i, j] ** 2))
    # The first turn taken away, row j: the middle turn leaves it alone, so that it belongs to the
    # last turn also where the other rows vanish.
    row = jnp.cos(first) * c[j] + sign * jnp.sin(first) * c[n]
    return jnp.stack(
        [first, middle, safe_atan2(-sign * row[n] if i == k else sign * row[i], row[j])]
    )


def _turn_axes(angles: Vector, sequence: str) -> Matrix:
    """The axes of the three turns in body components, as columns."""
    i, j, k = _axes(sequence)
    last = Quaternion.about(k, angles[2])
    later = Quaternion.about(j, angles[1]).then(last)
    e = jnp.broadcast_to(
        jnp.eye(3, dtype=angles.dtype).reshape(3, 3, *(1,) * (angles.ndim - 1)), (3, *angles.shape)
    )
    return jnp.stack([later.rotate_back(e[i]), last.rotate_back(e[j]), e[k]], axis=1)


def omega_from_euler_rates(angles: Vector, rates: Vector, sequence: str = "313") -> Vector:
    """Angular velocity in body axes, rad/s, from the angles, rad, and their rates, rad/s (Thomson
    3.5-1)."""
    m = _turn_axes(angles, sequence)
    return m[:, 0] * rates[0] + m[:, 1] * rates[1] + m[:, 2] * rates[2]


def euler_rates_from_omega(angles: Vector, omega: Vector, sequence: str = "313") -> Vector:
    """Rates of the angles, rad/s, from the angular velocity in body axes, rad/s (the inverse of
    Thomson 3.5-1).

    Infinite in the singular position, where the rates do not exist."""
    return solve3(_turn_axes(angles, sequence), omega)
