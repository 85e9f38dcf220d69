"""The central force under which a given curve is an orbit: Binet's equation.

    F(r) = -h^2 u^2 (d^2u/dtheta^2 + u),  u = 1/r

    symbol   meaning                                                unit
    r        distance as a function of the polar angle theta        m
    h        angular momentum per unit mass                         m^2/s
    F        acceleration outwards                                  m/s^2

Source: Thomson 4.5-6..10; Harrison and Nettleton 5.24.
"""

__all__ = ["force_of_orbit"]

from collections.abc import Callable

import jax
import jax.numpy as jnp

from ..core import Scalar
from ..core.formula import formula


@formula
def force_of_orbit(
    orbit: Callable[[Scalar], Scalar], angle: Scalar, angular_momentum: Scalar
) -> Scalar:
    """The central acceleration that a body needs to move along a curve.

    **Arguments**

    - `orbit`: the distance from the centre, m, as a function of the polar angle, rad, that acts
      elementwise on the runs.
    - `angle`: polar angle on the curve, rad, (*runs,).
    - `angular_momentum`: per unit mass, m^2/s, (*runs,).

    **Returns** the acceleration outwards, m/s^2, (*runs,): negative for an attraction.
    """
    angle = jnp.asarray(angle)
    one = jnp.ones_like(angle)

    def inverse(theta: Scalar) -> Scalar:
        return 1.0 / orbit(theta)

    def slope(theta: Scalar) -> Scalar:
        return jax.jvp(inverse, (theta,), (one,))[1]

    # Forward mode twice: a function of one number gains nothing from reverse mode.
    bend = jax.jvp(slope, (angle,), (one,))[1]
    u = inverse(angle)
    return -angular_momentum * angular_momentum * u * u * (bend + u)
