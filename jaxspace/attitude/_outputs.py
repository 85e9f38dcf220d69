"""Numbers of interest of a body that spins."""

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..bodies import AbstractBody, BodyState, BurningBody
from ..core import InputError, Scalar, Vector, axis, cross, dot, norm, output, safe_atan2
from ..rotations import Quaternion, to_euler_angles


@output("rad/s")
def spin_rate(omega: Vector) -> Scalar:
    """Rate about the body's z axis, rad/s."""
    return omega[2]


@output("rad")
def cone_angle(omega: Vector, mass: Scalar | None, body: AbstractBody) -> Scalar:
    """Angle between the body's z axis and its angular momentum, rad."""
    h = _angular_momentum_B(omega, mass, body)
    return _angle_between(h, axis(2, h[2]))


@output("rad")
def pointing(
    attitude: Quaternion, omega: Vector, mass: Scalar | None, body: AbstractBody, initial: Any
) -> Scalar:
    """Angle between the angular momentum and the z axis of the `initial` state that was intended,
    rad."""
    h = _angular_momentum_B(omega, mass, body)
    intended = initial.attitude.rotate(axis(2, initial.omega[2]))
    return _angle_between(attitude.rotate(h), intended)


def continuous_precession(states: BodyState) -> Float[Array, "times *#runs"]:
    """The precession angle psi, rad, along a trajectory, without jumps of whole turns.

    `continuous_precession(run.states)` is (times, *runs). Between two times psi must change by less
    than half a turn; where the axis passes close to the vertical this requires dense samples.

    Raises `InputError` for states without attitude."""
    if states.attitude is None:
        raise InputError("The states hold no attitude: a precession angle requires one.")
    # The times are the first axis that is left when the angle has been taken.
    return jnp.unwrap(to_euler_angles(states.attitude)[0], axis=0)


def _angular_momentum_B(omega: Vector, mass: Scalar | None, body: AbstractBody) -> Vector:
    """Angular momentum about the centre of mass, kg m^2/s, in body axes."""
    if isinstance(body, BurningBody):
        # What was let go may leave less than the dry mass, but no propellant of negative mass.
        mass = body.dry_mass if mass is None else jnp.maximum(mass, body.dry_mass)
    return body.inertia(mass).times(omega)


def _angle_between(a: Vector, b: Vector) -> Scalar:
    """The angle between two vectors, rad, without loss of digits near zero."""
    return safe_atan2(norm(cross(a, b)), dot(a, b))
