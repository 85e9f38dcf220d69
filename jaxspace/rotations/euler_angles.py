"""Euler's angles: three successive turns about the moving axes.

    C_NB = R_i(a) R_j(b) R_k(c)         i, j, k: axes of the sequence;
                                        3-1-3: psi, theta, phi; 3-2-1: yaw, pitch, roll
    omega_B = a' i + b' j + c' k        i, j, k: the axes during the turn about them,
                                        in body components

    symbol  meaning (3-1-3)                                         unit
    psi     precession, about the inertial axis Z                   rad
    theta   nutation, about the line of nodes                       rad
    phi     spin, about the body's axis z                           rad

Source: Thomson 3.4-5 (matrix, its transpose here: body to inertial), 3.5-1 (rates). Harrison and
Nettleton swap phi and psi.

The angles are singular where the first and the last axis coincide (3-1-3: sin(theta) = 0; 3-2-1:
cos(theta) = 0). The outer rates are then undefined, and only a combination of them has a meaning.
Integrate the quaternion instead.
"""

__all__ = ["SEQUENCES", "euler_rates_from_omega", "omega_from_euler_rates"]

import jax.numpy as jnp

from ..core import InputError, Matrix, Vector
from ..core.formula import formula
from ..core.safe import safe_atan2, safe_sqrt
from ..core.shapes import check_components, with_rank
from ..core.vectors import cross, dot, identity, matvec, norm
from ._quaternion import Quaternion

SEQUENCES = ("313", "321", "123", "132", "213", "231", "312", "121", "131", "212", "232", "323")


def _axes(sequence: str) -> tuple[int, int, int]:
    if sequence not in SEQUENCES:
        raise InputError(f"sequence is {sequence!r}: it must be one of {', '.join(SEQUENCES)}.")
    i, j, k = (int(c) - 1 for c in sequence)
    return i, j, k


@formula
def from_euler_angles(angles: Vector, sequence: str = "313") -> Quaternion:
    """The orientation after three rotations about the moving axes.

    **Arguments**

    - `angles`: rad, (3, *runs), in the order of the rotations.
    - `sequence`: the axes, one of `SEQUENCES`.

    **Raises** `InputError` for a sequence other than the twelve, and for angles whose first axis
    does not have three entries.
    """
    check_components("from_euler_angles: angles", angles, 3)
    i, j, k = _axes(sequence)
    return (
        Quaternion.about(i, angles[0])
        .then(Quaternion.about(j, angles[1]))
        .then(Quaternion.about(k, angles[2]))
    )


def to_euler_angles(attitude: Quaternion, sequence: str = "313") -> Vector:
    """The three angles of an orientation.

    **Arguments**

    - `attitude`: the orientation, body to inertial.
    - `sequence`: the axes, one of `SEQUENCES`.

    **Returns** the angles, rad, (3, *runs): the outer ones within (-pi, pi], the middle one within
    [0, pi] for a sequence that repeats its first axis and within [-pi/2, pi/2] otherwise. In the
    singular position the first angle is zero, and the third one is the remaining rotation. At a
    distance d, rad, from it the outer angles have errors of 1e-16/d, and of 1e-16/d^2 their
    derivatives; the orientation reconstructed from them is accurate.

    **Raises** `InputError` for a sequence that is none of the twelve.
    """
    i, j, k = _axes(sequence)
    # The axis that is neither of the first two, and the sign of the permutation.
    n = 3 - i - j
    sign = 1.0 if (j - i) % 3 == 1 else -1.0
    c = attitude.matrix()
    if i == k:
        first = safe_atan2(c[j, i], -sign * c[n, i])
        # From both of its sides: an arc cosine loses half of the digits near the singular position.
        middle = safe_atan2(safe_sqrt(c[j, i] ** 2 + c[n, i] ** 2), c[i, i])
    else:
        first = safe_atan2(-sign * c[j, k], c[k, k])
        middle = safe_atan2(sign * c[i, k], safe_sqrt(c[i, i] ** 2 + c[i, j] ** 2))
    # Row j of the matrix without the first turn. The middle turn does not change this row, so that
    # it gives the last angle also in the singular position, where the other rows vanish.
    row = jnp.cos(first) * c[j] + sign * jnp.sin(first) * c[n]
    last = safe_atan2(-sign * row[n] if i == k else sign * row[i], row[j])
    return jnp.stack([first, middle, last])


def _turn_axes(angles: Vector, sequence: str) -> Matrix:
    """The axes of the three turns in body components, as columns, (3, 3, *runs)."""
    i, j, k = _axes(sequence)
    # The axis of a turn is fixed in the body for the turns before it; later turns move it.
    last = Quaternion.about(k, angles[2])
    later = Quaternion.about(j, angles[1]).then(last)
    e = jnp.broadcast_to(identity(angles.ndim - 1), (3, *angles.shape)).astype(angles.dtype)
    return jnp.stack([later.rotate_back(e[i]), last.rotate_back(e[j]), e[k]], axis=1)


@formula
def omega_from_euler_rates(angles: Vector, rates: Vector, sequence: str = "313") -> Vector:
    """Angular velocity from the rates of Euler's angles (Thomson 3.5-1).

    **Arguments**

    - `angles`, rad, and `rates`, rad/s: (3, *runs), in the order of the rotations.
    - `sequence`: the axes, one of `SEQUENCES`.

    **Returns** omega, rad/s, in body axes, (3, *runs).

    **Raises** `InputError` for a sequence that is none of the twelve, and for a wrong first axis.
    """
    check_components("omega_from_euler_rates: angles", angles, 3)
    check_components("omega_from_euler_rates: rates", rates, 3)
    return matvec(_turn_axes(angles, sequence), rates)


@formula
def euler_rates_from_omega(angles: Vector, omega: Vector, sequence: str = "313") -> Vector:
    """Rates of Euler's angles from the angular velocity (the inverse of Thomson 3.5-1).

    **Arguments**

    - `angles`: rad, (3, *runs), in the order of the rotations.
    - `omega`: angular velocity in body axes, rad/s, (3, *runs).
    - `sequence`: the axes, one of `SEQUENCES`.

    **Returns** the rates, rad/s, (3, *runs). In the singular position the outer angles have the
    same axis. Where the body rotates about it and the middle axis only, the first rate is zero and
    the third one is the whole rotation, as `to_euler_angles` counts the angles; otherwise both are
    infinite.

    **Raises** `InputError` for a sequence that is none of the twelve, and for a wrong first axis.
    """
    check_components("euler_rates_from_omega: angles", angles, 3)
    check_components("euler_rates_from_omega: omega", omega, 3)
    turns = _turn_axes(angles, sequence)
    rank = max(angles.ndim, omega.ndim) - 1
    turns, omega = with_rank(turns, rank, axes=2), with_rank(omega, rank)
    first, middle, last = turns[:, 0], turns[:, 1], turns[:, 2]
    # The middle axis is normal to both outer ones, so that its rate exists at any angle; `across`
    # completes it and the last axis to a frame.
    across = cross(middle, last)
    sine = dot(first, across)
    rate = dot(omega, across)
    # In the singular position a rate of zero, to rounding, leaves the whole turn alone determined.
    noise = 4.0 * float(jnp.finfo(rate.dtype).eps) * norm(omega)
    still = (sine == 0.0) & (jnp.abs(rate) <= noise)
    outer = jnp.where(still, 0.0, rate / jnp.where(still, 1.0, sine))
    return jnp.stack([outer, dot(omega, middle), dot(omega, last) - dot(first, last) * outer])
