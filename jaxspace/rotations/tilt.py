"""The tilt of a body's axis from a fixed direction, as a complex number.

    theta_XY = theta e^(i psi) = (theta/sin theta) (-s_Y + i s_X)      inertial axes
    theta_12 = theta e^(-i phi) = theta_XY e^(-i int n dt)             body axes (7.3)

    symbol           meaning                                               unit
    psi, theta, phi  Euler's angles Z-X-Z of the body                      rad
    s                spin axis, the body's z axis, in inertial components  1
    n                spin                                                  rad/s

theta_XY is the small rotation, along the line of nodes; the tip of the axis is at -i theta_XY. A
complex number is an array (2, *runs) of real and imaginary part. Euler's angles are singular at
theta = 0, the place where a missile works: nothing here uses them.

Source: Thomson 7.3, who calls it the complex angle of attack: it is one where the velocity relative
to the air points along the inertial Z.
"""

__all__ = ["complex_tilt", "tilt_of_axis"]

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import InputError, Vector
from ..core.formula import formula
from ..core.square_roots import sqrt
from ..core.vectors import axis
from ._quaternion import Quaternion

AXES = ("inertial", "body")


def check_axes(axes: str) -> None:
    """Raises `InputError` where `axes` is none of `AXES`."""
    if axes not in AXES:
        raise InputError(f"axes is {axes!r}: it must be one of {', '.join(AXES)}.")


def complex_tilt(attitude: Quaternion, axes: str = "inertial") -> Float[Array, "2 *#runs"]:
    """theta_XY in inertial axes, or theta_12 in body axes, rad (Thomson 7.3).

    **Arguments**

    - `attitude`: body to inertial.
    - `axes`: "inertial" or "body".

    **Returns** real and imaginary part, (2, *runs), smooth at theta = 0; at theta = pi, where the
    line of nodes is not defined, zero.

    **Raises** `InputError` for other axes.
    """
    check_axes(axes)
    inertial = axes == "inertial"
    # In body axes the Euler angles of the inertial axes are (pi - phi, theta, pi - psi).
    seen = attitude if inertial else attitude.inverse()
    sign = 1.0 if inertial else -1.0
    return sign * tilt_of_axis(seen.rotate(axis(2, jnp.ones_like(attitude.wxyz[0]))))


@formula
def tilt_of_axis(s: Vector) -> Float[Array, "2 *#runs"]:
    """The rotation vector, rad, (2, *runs), from z to the unit vector `s`; its z component
    is zero.

    Smooth where `s` is z; zero at -z, where the direction of the turn is not defined."""
    h2 = s[0] * s[0] + s[1] * s[1]
    # On the side of z only: near -z the sine is small as well, and the angle near pi.
    small = (h2 < 1e-3) & (s[2] > 0.0)
    x = jnp.where(small, h2, 0.0)
    # arcsin(h)/h: the next term is 1e-18, and below rounding in slopes.
    series = 1.0
    for k in range(6, 0, -1):
        series = 1.0 + series * x * (2 * k - 1) ** 2 / (2 * k * (2 * k + 1))
    # A harmless argument where the series counts: the slope of the root at zero is infinite.
    h = sqrt(jnp.where(small | (h2 == 0.0), 1.0, h2))
    ratio = jnp.arctan2(jnp.where(h2 == 0.0, 0.0, h), s[2]) / h
    ratio = jnp.where(small, series, jnp.where(h2 == 0.0, 0.0, ratio))
    return ratio * jnp.stack([-s[1], s[0]])
