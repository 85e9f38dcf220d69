"""Angular momentum and moment about a moving point.

    h_0 = sum r_i x m_i r_i'                    r_i: particles as seen from the point
    M_0 = sum r_i x F_i = h_0' + r_c x M R_0''  R_0: the point in inertial space
    h_0 = h_c + r_c x M r_c'                    h_c: about the centre of mass

    symbol      meaning                                                           unit
    m_i, M      masses of the particles, of all                                   kg
    r_c         centre of mass as seen from the point                             m
    h_0, M_0    angular momentum of the motion relative to the point; moment of   kg m^2/s, N m
                all forces about it

Source: Thomson 4.4-3 to -5. M_0 = h_0' is valid about a point at rest or in uniform motion, about
the centre of mass, and about one whose acceleration points to the centre of mass or away from it:
in cases c and d it is the second derivative of R_0 that is parallel to r, not the first.
"""

__all__ = ["moment_about_moving_point", "momentum_about"]

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import Scalar, Vector
from ..core.formula import NOT_NEGATIVE, formula
from ..core.vectors import cross, scale


@formula
def momentum_about(
    masses: Float[Array, "particles *#runs"],
    positions: Float[Array, "3 particles *#runs"],
    velocities: Float[Array, "3 particles *#runs"],
    point: Vector,
    point_velocity: Vector,
) -> Vector:
    """h_0, kg m^2/s, (3, *runs): angular momentum of particles about a point, in their motion
    relative to it.

    **Arguments**

    - `masses`: kg, (particles, *runs).
    - `positions`, `velocities`: in inertial space, m and m/s, (3, particles, *runs).
    - `point`, `point_velocity`: of the point, (3, *runs).
    """
    arms = positions - jnp.asarray(point)[:, None]
    speeds = velocities - jnp.asarray(point_velocity)[:, None]
    return jnp.sum(scale(masses, cross(arms, speeds)), axis=1)


@formula(mass=NOT_NEGATIVE)
def moment_about_moving_point(
    momentum_rate: Vector, mass: Scalar, arm: Vector, acceleration: Vector
) -> Vector:
    """M_0, N m, (3, *runs): the moment of all forces about a point that moves (Thomson 4.4-5).

    **Arguments**

    - `momentum_rate`: h_0', N m, (3, *runs), of the `momentum_about` the point.
    - `mass`: M, kg, (*runs,).
    - `arm`: r_c, centre of mass as seen from the point, m, (3, *runs).
    - `acceleration`: R_0'' of the point in inertial space, m/s^2, (3, *runs).
    """
    return momentum_rate + scale(mass, cross(arm, acceleration))
