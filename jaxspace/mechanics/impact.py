"""Impact with restitution, and a landing on a pad that crushes.

    e = -(speed of separation) / (speed of approach)       along the normal of the contact
    J = (1 + e) m u,  1/m = sum of the inverse masses of both bodies at the contact
    1/m_i = 1/M + n . ((I^-1 (r x n)) x r)                 of one body
    energy loss = (1 - e^2) m u^2 / 2
    pad: A = M g (1 + k) / sigma,  s = h / k,  t = sqrt(2 g h) / (k g)

    symbol    meaning                                                  unit
    e         coefficient of restitution                               1
    u, n      speed of approach, normal of the contact                 m/s, 1
    J, m      impulse along the normal, effective mass                 N s, kg
    M, I      mass, tensor of inertia about the centre of mass         kg, kg m^2
    r         contact from the centre of mass                          m
    k, sigma  deceleration over g, strength of the pad                 1, Pa
    h, s      height of the fall, depth of the crushing                m
    A, t      area of the pad, duration of the crushing                m^2, s

Source: Thomson 4.2-2, example 4.2-1 (pad), 4.4 (dumbbell).
The contact is frictionless: there is no impulse along its plane. The velocity changes by J n / M
and the angular velocity by I^-1 (r x J n); the other body has the opposite impulse.
"""

__all__ = ["contact_impulse", "contact_inverse_mass", "crushable_pad", "impact_energy_loss"]

import jax.numpy as jnp

from ..core import Matrix, Scalar, Vector
from ..core.formula import NOT_NEGATIVE, POSITIVE, UP_TO_ONE, formula
from ..core.vectors import cross, dot, solve3


@formula(mass=POSITIVE)
def contact_inverse_mass(mass: Scalar, inertia: Matrix, arm: Vector, normal: Vector) -> Scalar:
    """Inverse of the mass that a free rigid body has at a contact (Thomson 4.4).

    **Arguments**

    - `mass`: M, kg, (*runs,).
    - `inertia`: I, kg m^2, (3, 3, *runs), about the centre of mass; regular.
    - `arm`: r, m, (3, *runs).
    - `normal`: n, of length one, (3, *runs).

    **Returns** 1/m, 1/kg, (*runs,). For a point, or an arm along the normal, it is 1/M; for a body
    that cannot move it is zero.
    """
    turned = solve3(inertia, cross(arm, normal))
    return 1.0 / mass + dot(normal, cross(turned, arm))


@formula(inverse_mass=POSITIVE, restitution=UP_TO_ONE)
def contact_impulse(approach: Scalar, inverse_mass: Scalar, restitution: Scalar) -> Scalar:
    """Impulse of an impact along the normal (Thomson 4.2-2).

    **Arguments**, each (*runs,)

    - `approach`: speed of approach u of the points of contact along the normal, m/s.
    - `inverse_mass`: sum of the inverse masses of both bodies at the contact, 1/kg.
    - `restitution`: e, from 0, where both stay together, to 1, where no energy is lost.

    **Returns** J, N s, (*runs,): zero where the bodies already separate.
    """
    # Clipped, because bodies that part exchange nothing, even if they still touch.
    return (1.0 + restitution) * jnp.maximum(approach, 0.0) / inverse_mass


@formula(inverse_mass=POSITIVE, restitution=UP_TO_ONE)
def impact_energy_loss(approach: Scalar, inverse_mass: Scalar, restitution: Scalar) -> Scalar:
    """Energy, J, (*runs,), dissipated by the impact of `contact_impulse`.

    **Arguments**

    - `approach`, `inverse_mass`, `restitution`: as in `contact_impulse`."""
    u = jnp.maximum(approach, 0.0)
    # As a product: 1 - e^2 would lose its digits in an impact that is almost elastic.
    return 0.5 * (1.0 - restitution) * (1.0 + restitution) * u * u / inverse_mass


@formula(
    weight=POSITIVE, height=NOT_NEGATIVE, deceleration=POSITIVE, strength=POSITIVE, gravity=POSITIVE
)
def crushable_pad(
    weight: Scalar, height: Scalar, deceleration: Scalar, strength: Scalar, gravity: Scalar
) -> tuple[Scalar, Scalar, Scalar]:
    """A pad that stops a fall at a constant deceleration (Thomson, example 4.2-1).

    **Arguments**, each (*runs,)

    - `weight`: M g, N.
    - `height`: h of the fall before the contact, m.
    - `deceleration`: k, in units of gravity.
    - `strength`: sigma, at which the pad crushes, Pa.
    - `gravity`: g, m/s^2.

    **Returns** the area, m^2, the depth of the crushing, m, and its duration, s, each (*runs,).
    """
    area = weight * (1.0 + deceleration) / strength
    return area, height / deceleration, jnp.sqrt(2.0 * height / gravity) / deceleration
