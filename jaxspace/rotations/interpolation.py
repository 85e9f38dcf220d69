"""Orientations between two given ones.

    q(s) = q_0 exp(s theta_1 / 2),   theta_1 = 2 log(q_0^-1 q_1)                  slerp, 0 <= s <= 1

    q(t) = q_0 exp(theta(t) / 2),    s = t / T                                    cubic
    theta = s^2 (3 - 2 s) theta_1 + T s (1 - s)^2 omega_0 - T s^2 (1 - s) theta_1'

    symbol    meaning                                                     unit
    theta_1   turn from the first to the second orientation               rad
    theta_1'  its rate for omega_1, the angular velocity at the end       rad/s
    omega_0   angular velocity at the start, in body axes                 rad/s
    T         time between the two                                        s

Source: Shoemake (1985), Computer Graphics 19, 245 (slerp); Hermite's cubic of the rotation vector,
whose rate at no turn is omega (Thomson 1.5).

Both follow the shorter path, and are smooth where the two orientations are equal. At half a turn
between them two ways are equally short, one of which is taken.
"""

__all__ = ["interpolate_attitude", "slerp"]

import jax.numpy as jnp

from ..core import Scalar, Vector
from ..core.formula import formula
from ..core.shapes import check_components, with_rank
from ..core.vectors import scale
from ._quaternion import Quaternion
from .rotation_vector import omega_from_rotation_vector_rate, rotation_vector_rate


@formula
def slerp(start: Quaternion, end: Quaternion, share: Scalar) -> Quaternion:
    """The orientation on the way of steady rate about a fixed axis.

    **Arguments**

    - `start`, `end`: the orientations at both ends, (4, *runs).
    - `share`: fraction of the path, 0 at the start and 1 at the end, (*runs,) or (times, *runs);
      beyond them the rotation continues.

    **Returns** the orientation, of unit length.
    """
    way = start.inverse().then(end).rotation_vector()
    return _after(start, scale(share, way))


@formula
def interpolate_attitude(
    t: Scalar,
    duration: Scalar,
    start: Quaternion,
    omega_start: Vector,
    end: Quaternion,
    omega_end: Vector,
) -> tuple[Quaternion, Vector]:
    """Orientation and angular velocity between two given ones with their rates, with an error of
    fourth order in the duration.

    **Arguments**

    - `t`: time after the start, s, (*runs,) or (times, *runs).
    - `duration`: from start to end, s, (*runs,), so short that the body turns by less than half a
      turn.
    - `start`, `end`: the orientations, (4, *runs).
    - `omega_start`, `omega_end`: angular velocities in body axes, rad/s, (3, *runs).

    **Returns** the orientation, of unit length, and its angular velocity, rad/s, in body axes.
    """
    check_components("interpolate_attitude: omega_start", omega_start, 3)
    check_components("interpolate_attitude: omega_end", omega_end, 3)
    way = start.inverse().then(end).rotation_vector()
    # At the start, where the rotation vector is zero, its rate is omega; at the end it is not.
    last_rate = rotation_vector_rate(way, omega_end)
    s = t / duration
    rank = max(way.ndim - 1, last_rate.ndim - 1, omega_start.ndim - 1, jnp.ndim(s))
    way, first, last = (with_rank(x, rank) for x in (way, omega_start, last_rate))
    r = 1.0 - s
    turn = s * s * (3.0 - 2.0 * s) * way + duration * s * r * (r * first - s * last)
    rate = 6.0 * s * r / duration * way + r * (1.0 - 3.0 * s) * first + s * (3.0 * s - 2.0) * last
    return _after(start, turn), omega_from_rotation_vector_rate(turn, rate)


def _after(start: Quaternion, turn: Vector) -> Quaternion:
    # Orientations of an integration have the error of a step in their length, which ends here.
    return start.then(Quaternion.from_rotation_vector(turn)).normalised()
