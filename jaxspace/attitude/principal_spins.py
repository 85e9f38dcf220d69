"""Steady spins about the principal axes of a free body, the cones of its axes about the angular
momentum, and the plane on which Poinsot's ellipsoid rolls.

    w_i'' + p_k^2 w_i = 0,   p_k^2 = (I_k - I_i)(I_k - I_j) w_0^2 / (I_i I_j)   spin w_0 about k
    cos(theta_i) = I_i w_i / h                                                   cone of the axis i
    n = h / |h|,   d = w . n = 2T / h,   rho = w - d n                           herpolhode

    symbol    meaning                                                          unit
    I_i       principal moments of inertia                                     kg m^2
    w_i       components of the angular velocity                               rad/s
    p_k^2     squared rate of small departures from the spin about the axis    1/s^2
              k; negative where they grow
    theta_i   angle of the axis i with h                                       rad
    n, d      normal of the invariable plane; its distance from the centre     1, rad/s
    rho       tip of omega from the foot of the normal                         rad/s

Source: Thomson 5.10 (Poinsot), 5.12 and Problem 5.12-8.
"""

__all__ = ["InvariablePlane", "cone_bounds", "invariable_plane", "spin_modes", "spin_stiffness"]

from typing import NamedTuple

import jax.numpy as jnp

from ..bodies import BodyState
from ..bodies.inertia import AbstractInertia
from ..core import Scalar, Vector
from ..core.formula import POSITIVE, formula
from ..core.printing import printed
from ..core.safe import end_sqrt, safe_atan2
from ..core.shapes import check_components, with_rank
from ..core.squares import safe_hypot
from ..core.vectors import cross, dot, unit
from ._state import attitude_and_omega
from .polhode import Polhode


@formula(moments=POSITIVE)
def spin_stiffness(moments: Vector, rate: Scalar) -> Vector:
    """p_k^2 of the steady spins about each of the three axes (Thomson 5.12-2).

    **Arguments**

    - `moments`: principal moments, kg m^2, (3, *runs).
    - `rate`: of the spin, rad/s, (*runs,).

    **Returns** p_k^2, 1/s^2, (3, *runs), in the order of the axes: positive about those of the
    least and the greatest moment, negative about the third one, and zero where its moment equals
    another; smooth everywhere.
    """
    check_components("spin_stiffness: moments", moments, 3)
    a, b, c = moments
    # Products of quotients: no power of a moment leaves the range of single precision.
    turning = jnp.stack(
        [(a - b) / b * (a - c) / c, (b - c) / c * (b - a) / a, (c - a) / a * (c - b) / b]
    )
    return turning * rate * rate


@formula(moments=POSITIVE)
def spin_modes(moments: Vector, rate: Scalar) -> tuple[Vector, Vector]:
    """Frequency and growth rate of small departures from the spins about the three axes.

    **Arguments** as in `spin_stiffness`.

    **Returns** the frequencies, rad/s, with which stable spins wobble in the body, and the rates,
    1/s, with which departures from an unstable spin grow, both (3, *runs); zero for the other kind.
    Where p_k^2 is zero their slopes follow the endpoint derivative convention of `end_sqrt`.
    """

    # Arguments and no closure, because the endpoint derivative convention uses the slopes of the
    # arguments.
    def stable(*x):
        return jnp.maximum(spin_stiffness(jnp.stack(x[:3]), x[3]), 0.0)

    def growing(*x):
        return jnp.maximum(-spin_stiffness(jnp.stack(x[:3]), x[3]), 0.0)

    a, b, c, w = jnp.broadcast_arrays(*moments, jnp.asarray(rate, moments.dtype))
    return end_sqrt(stable, a, b, c, w), end_sqrt(growing, a, b, c, w)


@formula(moments=POSITIVE)
def cone_bounds(moments: Vector, omega: Vector) -> tuple[Vector, Vector]:
    """Least and greatest angle of each principal axis with h (Thomson 5.12-P8).

    **Arguments**

    - `moments`: principal moments, kg m^2, (3, *runs), in any order.
    - `omega`: at any time of the motion, rad/s, (3, *runs).

    **Returns** both angles, rad, (3, *runs). The axis that the polhode circles stays on its side;
    the other two swing from one side of h to the other. On the separatrix the bounds are those of
    the adjacent polhodes. Derivatives are valid where all three axes move; at a steady spin, where
    a tilt of either sign widens the cone, they are zero.
    """
    check_components("cone_bounds: moments", moments, 3)
    check_components("cone_bounds: omega", omega, 3)
    rank = max(moments.ndim, omega.ndim) - 1
    moments, omega = with_rank(moments, rank), with_rank(omega, rank)
    # The squares of the components of h are on a straight line, so that each one has its least and
    # its greatest value at the vertices.
    h = [moments * vertex for vertex in Polhode.of(moments, omega).vertices]
    near, far = (_angles(v) for v in h)
    # Angles next to a right one may be equal after rounding, and so may components of small angles.
    nearer = jnp.where(near < 1.0, near <= far, h[0] >= h[1])
    least, greatest = jnp.where(nearer, near, far), jnp.where(nearer, far, near)
    # An axis that passes through the plane across h has a vertex there, with a component of zero.
    swings = (h[0] == 0.0) | (h[1] == 0.0)
    behind = ~swings & (omega < 0.0)
    return (
        jnp.where(behind, jnp.pi - greatest, least),
        jnp.where(swings, jnp.pi - least, jnp.where(behind, jnp.pi - least, greatest)),
    )


def _angles(h: Vector) -> Vector:
    """The angles of h, whose components are not negative, with the three axes."""
    across = [safe_hypot(h[k - 2], h[k - 1]) for k in range(3)]
    return safe_atan2(jnp.stack(across), h)


@printed(distance="rad/s", herpolhode="rad/s")
class InvariablePlane(NamedTuple):
    """The plane on which Poinsot's ellipsoid rolls without slip.

    - `normal`: direction of h in inertial axes, (3, *runs).
    - `distance`: 2T/h, of the plane from the centre of the body, rad/s, (*runs,).
    - `herpolhode`: point of contact, the tip of omega, from the foot of the normal, in inertial
      axes, rad/s, (3, *runs)."""

    normal: Vector
    distance: Scalar
    herpolhode: Vector


def invariable_plane(inertia: AbstractInertia, y: BodyState) -> InvariablePlane:
    """Plane and point of contact in Poinsot's construction (Thomson 5.10).

    **Arguments**

    - `inertia`: about the centre of mass, kg m^2.
    - `y`: the state, with attitude and omega; along a trajectory the points are the herpolhode.

    **Returns** normal, distance and point; all zero for a body at rest.
    """
    attitude, omega = attitude_and_omega(y)
    normal_B = unit(inertia.times(omega))
    distance = dot(omega, normal_B)
    # As products, in body axes: near a principal axis the difference would lose its digits.
    contact = attitude.rotate(cross(normal_B, cross(omega, normal_B)))
    return InvariablePlane(attitude.rotate(normal_B), distance, contact)
