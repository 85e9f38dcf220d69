"""Orientation for initial states: along a direction of the orbit, or by Euler's angles."""

__all__ = ["attitude_along", "attitude_from_angles"]

import math
from collections.abc import Sequence
from typing import TypeAlias

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import Choice, Scalar, Vector, argument, initial
from ..core.formula import formula
from ..core.types import as_float
from ..core.vectors import cross, unit
from ..rotations import Quaternion, from_euler_angles

Pair: TypeAlias = Float[Array, "2 *#runs"] | Sequence[Scalar]

_TILT = argument(
    "rad",
    low=-math.pi,
    high=math.pi,
    shape=(2,),
    default=(0.0, 0.0),
    doc="tilt about the body's x and then y axis, applied last",
)


@formula
@initial(
    "attitude",
    gives=("attitude",),
    along=Choice(("velocity", "position"), "direction along which the body's z axis points"),
    lead=argument("rad", default=0.0, doc="turn in the plane of the orbit, in the sense of motion"),
    tilt=_TILT,
)
def attitude_along(
    along: str,
    position: Vector,
    velocity: Vector,
    lead: Scalar = 0.0,
    tilt: Pair = (0.0, 0.0),
) -> Quaternion:
    """The orientation with the z axis along a direction of the orbit and the x axis along its
    normal.

    **Arguments**

    - `along`: "velocity" or "position".
    - `position`, m, and `velocity`, m/s: (3, *runs).
    - `lead`, rad: how far the z axis is turned ahead, in the sense of the motion.
    - `tilt`, rad, (2, *runs): a turn about the body's x axis and one about its y axis that follow.

    **Returns** the quaternion, body to inertial."""
    lead = as_float(lead)
    normal = unit(cross(position, velocity))
    axis = unit(velocity if along == "velocity" else position)
    z = jnp.cos(lead) * axis + jnp.sin(lead) * cross(normal, axis)
    straight = Quaternion.from_matrix(jnp.stack([normal, cross(z, normal), z], axis=1))
    return _tilted(straight, tilt)


@initial(
    "attitude",
    gives=("attitude",),
    angles=argument("rad", shape=(3,), doc="Euler's angles 3-1-3: precession, nutation, spin"),
    tilt=_TILT,
)
def attitude_from_angles(angles: Vector | Sequence[Scalar], tilt: Pair = (0.0, 0.0)) -> Quaternion:
    """The orientation by Euler's angles 3-1-3.

    **Arguments**

    - `angles`, rad, (3, *runs): precession, nutation, spin.
    - `tilt`, rad, (2, *runs): a turn about the body's x axis and one about its y axis that follow.

    **Returns** the quaternion, body to inertial."""
    return _tilted(from_euler_angles(as_float(angles)), tilt)


def _tilted(straight: Quaternion, tilt: Pair) -> Quaternion:
    about_x, about_y = as_float(tilt)
    return straight.then(Quaternion.about(0, about_x)).then(Quaternion.about(1, about_y))
