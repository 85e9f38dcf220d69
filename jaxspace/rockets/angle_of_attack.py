"""The angle of attack: between a body's axis and its velocity relative to the air.

`rotations.tilt` computes the tilt of the axis from a fixed direction, including its plane.

Source: Thomson 7.10.
"""

__all__ = ["angle_of_attack"]

import jax.numpy as jnp

from ..core import Scalar, Vector
from ..core.formula import formula
from ..core.safe import safe_atan2
from ..core.vectors import axis, cross, dot, norm
from ..rotations import Quaternion


@formula
def angle_of_attack(attitude: Quaternion, velocity: Vector) -> Scalar:
    """The angle between the body's z axis and a velocity, rad, from 0 to pi.

    **Arguments**

    - `attitude`: body to inertial.
    - `velocity`: relative to the air, in inertial axes, m/s, (3, *runs).

    **Returns** alpha, (*runs,); zero, with a derivative of zero, where the axis points along the
    velocity, or there is none.
    """
    s = attitude.rotate(axis(2, jnp.ones_like(attitude.wxyz[0])))
    return safe_atan2(norm(cross(s, velocity)), dot(s, velocity))
