"""The equations of motion of one rigid body, of constant or varying mass.

    v' = a + F / m                                  centre of mass, inertial axes
    J omega' = M - omega x (J omega + h)            about the centre of mass, body axes
    q' = q (0, omega) / 2

    symbol   meaning                                             unit
    v        velocity of the centre of mass                      m/s
    a, F     acceleration by gravity, other forces               m/s^2, N
    m        remaining mass                                      kg
    J        inertia of the remaining body about its centre      kg m^2
    h        angular momentum of parts that move in the body     kg m^2/s
    M        moment about the centre of mass, minus the changes  N m
             of h and J by moving parts, in body axes

Source: Thomson 5.6 (Euler's equations), 7.1-2, 7.7-3 (varying mass), 7.11 (moving parts).

Mass that leaves carries the momentum that it has where it burns. The momentum that it gives up on
the way to the nozzle is the effect `JetDamping`. The motion of the centre of mass inside the body
does not count as a velocity of the body.
"""

__all__ = ["angular_acceleration", "linear_acceleration"]

import jax.numpy as jnp

from ..core import Matrix, Scalar, Vector
from ..core.formula import POSITIVE, formula
from ..core.shapes import with_rank
from ..core.vectors import cross, matvec, solve3
from .inertia import AbstractInertia, diagonal


@formula(mass=POSITIVE)
def linear_acceleration(
    acceleration: Vector | None, force: Vector | None, mass: Scalar | None
) -> Vector:
    """Acceleration of the centre of mass, v' = a + F / m.

    **Arguments**

    - `acceleration`: by gravity, m/s^2, (3, *runs), or `None`.
    - `force`: sum of the other forces, N, (3, *runs), or `None`; one of the two must be there.
    - `mass`: kg, (*runs,); required where there is a force.

    **Returns** v', m/s^2, (3, *runs).
    """
    # Absent terms are `None` and not zero, so that they cost no operation.
    if force is None:
        assert acceleration is not None
        return acceleration
    assert mass is not None
    by_force = force / mass
    return by_force if acceleration is None else acceleration + by_force


@formula
def angular_acceleration(
    inertia: AbstractInertia,
    omega: Vector,
    torque: Vector | None,
    added: Matrix | None = None,
    momentum: Vector | None = None,
) -> Vector:
    """Angular acceleration by Euler's equations (Thomson 5.6, 7.1-2, 7.11).

    **Arguments**

    - `inertia`: about the centre of mass, kg m^2.
    - `omega`: angular velocity in body axes, rad/s, (3, *runs).
    - `torque`: about the centre of mass, in body axes, N m, (3, *runs), or `None`.
    - `added`: to the inertia by parts that move, kg m^2, (3, 3, *runs), or `None`.
    - `momentum`: h of parts that move in the body, kg m^2/s, (3, *runs), or `None`.

    **Returns** omega', rad/s^2, (3, *runs); zero about an axis without a moment.
    """
    # h x omega and not -omega x h, which would be one operation more for each component.
    h = inertia.times(omega)
    if added is not None:
        h = h + matvec(added, omega)
    if momentum is not None:
        h = h + momentum
    total = cross(h, omega)
    if torque is not None:
        total = torque + total
    if added is None:
        return inertia.solve(total)
    tensor = inertia.matrix()
    rank = max(tensor.ndim, added.ndim, total.ndim + 1) - 2
    tensor, added = with_rank(tensor, rank, axes=2), with_rank(added, rank, axes=2)
    whole = tensor + added
    total = with_rank(total, rank)
    # Parts on the axis of a rod leave it without a moment: the rate about it is constant.
    bare = jnp.stack([whole[k, k] == 0.0 for k in range(3)])
    stand_in = jnp.where(bare, 1.0, 0.0).astype(whole.dtype)
    return solve3(whole + diagonal(stand_in), jnp.where(bare, 0.0, total))
