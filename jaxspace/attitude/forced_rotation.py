"""The torque required for a prescribed rotation, and the reactions of the bearings.

    M = J [omega'] + Omega x J omega                               axes that turn with Omega
    F = m (alpha x c + omega x (omega x c))                        body on a shaft through O
    a R_a + b R_b = M_O x s,   R_a + R_b = F                       reactions at the stations a, b
    tan(bank) = V^2 / (R g)                                        level turn

    symbol      meaning                                                        unit
    J           inertia, constant in the axes of the components                kg m^2
    omega, [']  angular velocity of the body; rate of its components           rad/s, rad/s^2
    Omega       angular velocity of the axes: omega for body axes, less the    rad/s
                spin for node axes of a body of revolution
    M, M_O      torque about the centre of mass; about the point O             N m
    alpha       rate of the angular velocity                                   rad/s^2
    c           from O to the centre of mass                                   m
    s           direction of the shaft, a unit vector                          1
    V, R, g     speed, radius of the turn, acceleration of free fall           m/s, m, m/s^2

Source: Thomson 5.6-4 (body axes), 5.7 (node axes) and Problems 5.9-8 to 5.9-13; Harrison and
Nettleton 4.81. In Problem 5.9-10 the printed moment, (C - A)/2 V^2/R^2 sin(2 bank), is valid for x
as the lateral axis.
"""

__all__ = ["BearingReactions", "bank_angle", "bearing_reactions", "required_torque"]

from typing import NamedTuple

import jax.numpy as jnp

from ..bodies.inertia import AbstractInertia, parallel_axes
from ..core import Scalar, Vector
from ..core.formula import NOT_NEGATIVE, POSITIVE, formula
from ..core.printing import printed
from ..core.safe import safe_atan2
from ..core.shapes import with_rank
from ..core.vectors import cross, dot, scale, unit


@formula
def required_torque(
    inertia: AbstractInertia,
    omega: Vector,
    omega_rate: Vector | None = None,
    axes_rate: Vector | None = None,
) -> Vector:
    """The torque required for a prescribed rotation (Thomson 5.6-4, 5.7).

    **Arguments**

    - `inertia`: about the centre of mass or a fixed point, kg m^2; its components must be constant
      in the axes of the vectors: body axes, or for a body of revolution any that turn about its
      axis.
    - `omega`: angular velocity of the body, rad/s, (3, *runs).
    - `omega_rate`: rate of its components, rad/s^2, (3, *runs); zero where it is left out.
    - `axes_rate`: angular velocity of the axes, rad/s, (3, *runs); that of the body where it is
      left out.

    **Returns** M about the same point, N m, in the same axes, (3, *runs).
    """
    torque = cross(omega if axes_rate is None else axes_rate, inertia.times(omega))
    return torque if omega_rate is None else torque + inertia.times(omega_rate)


@printed(first="N", second="N", drive="N m")
class BearingReactions(NamedTuple):
    """Forces on a body that rotates on a shaft, in its axes; gravity is not included.

    - `first`, `second`: at the two bearings, across the shaft, N, (3, *runs).
    - `drive`: torque about the shaft, N m, (*runs,)."""

    first: Vector
    second: Vector
    drive: Scalar


@formula(mass=NOT_NEGATIVE)
def bearing_reactions(
    inertia: AbstractInertia,
    mass: Scalar,
    centre: Vector,
    shaft: Vector,
    stations: tuple[Scalar, Scalar],
    rate: Scalar,
    acceleration: Scalar = 0.0,
) -> BearingReactions:
    """Bearing reactions of a body that is mounted askew or off-centre on a shaft
    (Thomson 5.9-P9, P13).

    All vectors are in body axes, from a point O of the shaft.

    **Arguments**

    - `inertia`: about the centre of mass, kg m^2.
    - `mass`: kg, (*runs,).
    - `centre`: of mass, from O, m, (3, *runs).
    - `shaft`: its direction, of non-zero length, (3, *runs).
    - `stations`: of the two bearings along the shaft from O, m, (*runs,); not the same.
    - `rate`, `acceleration`: of the turn about the shaft, rad/s, rad/s^2, (*runs,).

    **Returns** both forces on the body and the torque that drives it.
    """
    shaft = unit(shaft)
    rank = max(shaft.ndim - 1, centre.ndim - 1, *(jnp.ndim(x) for x in (rate, acceleration)))
    shaft, centre = with_rank(shaft, rank), with_rank(centre, rank)
    omega, alpha = scale(rate, shaft), scale(acceleration, shaft)
    force = scale(mass, cross(alpha, centre) + cross(omega, cross(omega, centre)))
    about_O = parallel_axes(inertia, mass, centre)
    moment = required_torque(about_O, omega, alpha)
    first, second = stations
    # The forces are perpendicular to the shaft, so that their moment, s x (a R_a + b R_b), gives
    # the sum.
    lever = cross(moment, shaft)
    on_second = scale(1.0 / (second - first), lever - scale(first, force))
    # The moment required for the rotation is perpendicular to the shaft, to rounding.
    drive = dot(about_O.times(alpha), shaft)
    return BearingReactions(force - on_second, on_second, drive)


@formula(speed=NOT_NEGATIVE, radius=POSITIVE, gravity=NOT_NEGATIVE)
def bank_angle(speed: Scalar, radius: Scalar, gravity: Scalar) -> Scalar:
    """Bank of an airplane in a level turn without side force (Thomson 5.9-P10).

    **Arguments**

    - `speed`: m/s, (*runs,).
    - `radius`: of the turn, m, (*runs,).
    - `gravity`: acceleration of free fall, m/s^2, (*runs,).

    **Returns** the angle, rad, (*runs,).
    """
    return safe_atan2(speed * speed, radius * gravity)
