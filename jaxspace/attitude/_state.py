"""The rotating part of the state of a body."""

import jax.numpy as jnp

from ..bodies import BodyState
from ..core import InputError, Vector
from ..rotations import Quaternion


def attitude_and_omega(y: BodyState) -> tuple[Quaternion, Vector]:
    """Orientation and angular velocity in body axes, rad/s, (3, *runs), of the state `y`.

    Raises `InputError` when the state does not have one of them."""
    if y.attitude is None or y.omega is None:
        present = ", ".join(y.present) or "nothing"
        raise InputError(f"The state has {present}: it must have attitude and omega.")
    return y.attitude, y.omega


def vertical(attitude: Quaternion) -> Vector:
    """The upward vertical Z in body axes, (3, *runs): (sin(theta) sin(phi), sin(theta) cos(phi),
    cos(theta))."""
    # Written out, because the compiler does not remove the products with the zeros of a general
    # vector.
    w, x, y, z = attitude.wxyz
    s = 2.0 / attitude.norm_squared
    return jnp.stack([s * (x * z - w * y), s * (y * z + w * x), 1.0 - s * (x * x + y * y)])
