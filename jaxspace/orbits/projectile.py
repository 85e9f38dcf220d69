"""Flight in uniform gravity: over a plane at rest, and over a rotating planet to first order.

    y = v^2/(2g) - g x^2/(2 v^2)                                         envelope of all flights
    tan(a) = (v^2 +- sqrt(v^4 - g (g x^2 + 2 y v^2))) / (g x)            both angles to (x, y)
    r = v t + g t^2/2 - W x (v t^2 + g t^3/3)                            on the planet

    symbol   meaning                                                      unit
    x, y     horizontal distance, height of the target                    m
    v, g     speed (velocity) of the launch, gravity (its vector)         m/s, m/s^2
    a        angle above the horizontal                                   rad
    W        angular velocity of the planet, in the axes of the place     rad/s

Source: Thomson 2.3 (problem 6 for the envelope), 2.6-4: of a body dropped from rest the eastward
deflection is W g cos(lat) t^3/3.

The last line is of first order in W t; gravity is that of a plumb line.
"""

__all__ = ["projectile_angles", "projectile_envelope", "projectile_position"]

import jax.numpy as jnp

from ..core import Scalar, Vector
from ..core.formula import POSITIVE, formula
from ..core.shapes import with_rank
from ..core.types import as_float
from ..core.vectors import cross


@formula(speed=POSITIVE, gravity=POSITIVE)
def projectile_envelope(distance: Scalar, speed: Scalar, gravity: Scalar) -> Scalar:
    """The greatest height, m, that a launch with this speed reaches at a horizontal distance.

    **Arguments**

    - `distance`: horizontal, m, (*runs,).
    - `speed`: of the launch, m/s, (*runs,).
    - `gravity`: m/s^2, (*runs,)."""
    square = as_float(speed) * speed
    return 0.5 * square / gravity - 0.5 * gravity * distance * distance / square


@formula(speed=POSITIVE, gravity=POSITIVE)
def projectile_angles(
    distance: Scalar, height: Scalar, speed: Scalar, gravity: Scalar
) -> tuple[Scalar, Scalar]:
    """Both launch angles that reach a target.

    **Arguments**, each (*runs,)

    - `distance`, `height`: of the target, m.
    - `speed`: m/s; `gravity`: m/s^2.

    **Returns** the lower and the higher angle above the horizontal, rad; NaN outside of the
    envelope, equal on it, where their derivatives are infinite.
    """
    square = as_float(speed) * speed
    push = gravity * distance
    root = jnp.sqrt(square * square - push * push - 2.0 * gravity * height * square)
    steep = square + root
    # The product of both tangents is known: the smaller one is not formed as a difference.
    low = jnp.arctan2(push * distance + 2.0 * height * square, distance * steep)
    return low, jnp.arctan2(steep, push)


@formula
def projectile_position(velocity: Vector, t: Scalar, gravity: Vector, omega: Vector) -> Vector:
    """Position of a body after a launch from the origin of axes that turn with a planet, to first
    order in the turning.

    **Arguments**

    - `velocity`: at the launch, m/s, (3, *runs); `t`: s, (*runs,).
    - `gravity`: along the plumb line, m/s^2, (3, *runs).
    - `omega`: of the planet in these axes, rad/s, (3, *runs), as `local_frame(...).omega`.

    **Returns** the position, m, (3, *runs).
    """
    t = as_float(t)
    rank = max(velocity.ndim - 1, gravity.ndim - 1, omega.ndim - 1, t.ndim)
    v, g, w = (with_rank(x, rank) for x in (velocity, gravity, omega))
    return v * t + 0.5 * g * t * t - cross(w, v * (t * t) + g * (t * t * t / 3.0))
