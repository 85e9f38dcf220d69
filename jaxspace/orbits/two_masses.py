"""Two bodies that attract each other as the motion of one: relative motion and barycentre.

    r_c = (m_1 r_1 + m_2 r_2) / (m_1 + m_2)        moves uniformly without external forces
    r = r_2 - r_1,  m r'' = F                      m = m_1 m_2 / (m_1 + m_2), F: force on body 2
    r_1 = r_c - m_2 / (m_1 + m_2) r,  r_2 = r_c + m_1 / (m_1 + m_2) r
    radius of the sphere of influence = D (m_2 / m_1)^(2/5)

    symbol     meaning                                           unit
    m_1, m_2   masses, or gravitational parameters               kg, or m^3/s^2
    r_c, r     barycentre, separation                            m
    m          reduced mass                                      kg, or m^3/s^2
    D          distance of the smaller body m_2 from m_1         m

Source: Thomson 4.6-1 to -4; Harrison and Nettleton 5.3; Battin, An Introduction to the Mathematics
and Methods of Astrodynamics, 8.5 (sphere of influence).
Under gravity r moves as about a fixed centre of mu = G (m_1 + m_2): see `TwoBody`.
"""

__all__ = ["from_relative", "reduced_mass", "sphere_of_influence", "to_relative"]

import jax.numpy as jnp

from ..core import Scalar, Vector
from ..core.formula import NOT_NEGATIVE, POSITIVE, formula
from ..core.squares import quotient
from ..core.vectors import scale


@formula(m1=NOT_NEGATIVE, m2=NOT_NEGATIVE)
def reduced_mass(m1: Scalar, m2: Scalar) -> Scalar:
    """m_1 m_2 / (m_1 + m_2), kg: the inertia of the relative motion (Thomson 4.6-3).

    **Arguments**

    - `m1`, `m2`: kg, (*runs,)."""
    # In this order, because the product of two masses of planets leaves the range of float32.
    return m1 * quotient(m2, m1 + m2)


@formula(m1=NOT_NEGATIVE, m2=NOT_NEGATIVE)
def to_relative(m1: Scalar, m2: Scalar, first: Vector, second: Vector) -> tuple[Vector, Vector]:
    """The barycentre and the separation of two bodies.

    **Arguments**

    - `m1`, `m2`: masses, or gravitational parameters, (*runs,).
    - `first`, `second`: positions, or velocities, or accelerations of the bodies, (3, *runs).

    **Returns** that of the barycentre, and that of the second body relative to the first,
    (3, *runs).
    """
    separation = second - first
    # Not as a mean weighted by the masses, whose products leave the range of float32.
    return first + scale(quotient(m2, m1 + m2), separation), separation


@formula(m1=NOT_NEGATIVE, m2=NOT_NEGATIVE)
def from_relative(
    m1: Scalar, m2: Scalar, barycentre: Vector, separation: Vector
) -> tuple[Vector, Vector]:
    """The two bodies, from the result of `to_relative`.

    **Arguments**

    - `m1`, `m2`: as in `to_relative`.
    - `barycentre`, `separation`: positions, or velocities, or accelerations, (3, *runs).

    **Returns** those of the first and the second body, (3, *runs).
    """
    total = m1 + m2
    return (
        barycentre - scale(quotient(m2, total), separation),
        barycentre + scale(quotient(m1, total), separation),
    )


@formula(distance=POSITIVE, mu=POSITIVE, mu_central=POSITIVE)
def sphere_of_influence(distance: Scalar, mu: Scalar, mu_central: Scalar) -> Scalar:
    """Radius within which a body counts as the centre, and the body that it orbits as a
    perturbation.

    **Arguments**, each (*runs,)

    - `distance`: between the two, m.
    - `mu`, `mu_central`: gravitational parameters of the body and of the one that it orbits,
      m^3/s^2, or their masses.

    **Returns** the radius, m, (*runs,), of Laplace; its derivative is infinite at mu = 0.
    """
    return distance * jnp.power(quotient(mu, mu_central), 0.4)
