"""Outputs of a rotating body: its spin, its cone angle, its error of attitude.

    q = q_0 q_e,   phi = e theta,   theta = 2 atan2(|u_e|, |w_e|)       q_e = (w_e, u_e)

symbol  meaning                                                            unit
q, q_0  attitude, and that of the nominal run                              1
q_e     turn from the nominal attitude to that of the run                  1
phi     its rotation vector, in the body's axes: axis e times angle theta  rad

Source: Thomson 5.1 (Euler's theorem: every displacement with a fixed point is one turn).
"""

__all__ = [
    "attitude_error",
    "attitude_error_x",
    "attitude_error_y",
    "attitude_error_z",
    "cone_angle",
    "continuous_precession",
    "pointing",
    "spin_rate",
]


import jax.numpy as jnp
from jaxtyping import Array, Float

from ..bodies import AbstractBody, BodyState, BurningBody
from ..core import InputError, Scalar, State, Vector, output
from ..core.formula import POSITIVE, formula
from ..core.safe import safe_atan2
from ..core.vectors import axis, cross, dot, norm
from ..rotations import Quaternion, to_euler_angles


@formula
@output("rad/s")
def spin_rate(omega: Vector) -> Scalar:
    """Rate about the body's z axis, rad/s."""
    return omega[2]


@formula(mass=POSITIVE)
@output("rad")
def cone_angle(omega: Vector, mass: Scalar | None, body: AbstractBody) -> Scalar:
    """Angle between the body's z axis and its angular momentum, rad.

    **Arguments**

    - `omega`: in body axes, rad/s, (3, *runs).
    - `mass`: kg, of a body whose inertia depends on it; else `None`.
    - `body`: gives the inertia."""
    h = _angular_momentum_B(omega, mass, body)
    return _angle_between(h, axis(2, h[2]))


@formula(mass=POSITIVE)
@output("rad")
def pointing(
    attitude: Quaternion, omega: Vector, mass: Scalar | None, body: AbstractBody, initial: State
) -> Scalar:
    """Angle between the angular momentum and the z axis of the `initial` state that was intended,
    rad.

    **Arguments**

    - `attitude`: of the body, from its axes to the inertial ones.
    - `omega`, `mass`, `body`: as of `cone_angle`.
    - `initial`: the state that was intended."""
    h = _angular_momentum_B(omega, mass, body)
    intended = initial.attitude.rotate(axis(2, initial.omega[2]))
    return _angle_between(attitude.rotate(h), intended)


@output("rad")
def attitude_error(attitude: Quaternion, nominal: State) -> Scalar:
    """Angle of the turn from the attitude of the `nominal` state to this one, rad, within [0, pi].

    Without a turn it has a corner, where its derivative is finite but meaningless; the components
    of the turn are smooth there.

    **Arguments**

    - `attitude`: body to inertial.
    - `nominal`: the state of the nominal run."""
    return _turn_from(nominal, attitude).axis_angle()[1]


@output("rad")
def attitude_error_x(attitude: Quaternion, nominal: State) -> Scalar:
    """First component of the rotation vector from the attitude of the `nominal` state to this one,
    rad, in the body's axes: about its x axis. At half a turn the vector changes its sign.

    **Arguments**

    - `attitude`: body to inertial.
    - `nominal`: the state of the nominal run."""
    return _turn_from(nominal, attitude).rotation_vector()[0]


@output("rad")
def attitude_error_y(attitude: Quaternion, nominal: State) -> Scalar:
    """Second component, as of `attitude_error_x`: about the body's y axis.

    **Arguments**

    - `attitude`: body to inertial.
    - `nominal`: the state of the nominal run."""
    return _turn_from(nominal, attitude).rotation_vector()[1]


@output("rad")
def attitude_error_z(attitude: Quaternion, nominal: State) -> Scalar:
    """Third component, as of `attitude_error_x`: about the body's z axis.

    **Arguments**

    - `attitude`: body to inertial.
    - `nominal`: the state of the nominal run."""
    return _turn_from(nominal, attitude).rotation_vector()[2]


def continuous_precession(states: BodyState) -> Float[Array, "times *#runs"]:
    """The precession angle psi, rad, along a trajectory, without jumps of whole turns.

    `continuous_precession(run.states)` is (times, *runs). Between two times psi must change by less
    than half a turn; where the axis passes close to the vertical this requires dense samples.

    Raises `InputError` for states without attitude."""
    if states.attitude is None:
        raise InputError("The states have no attitude, which a precession angle requires.")
    # The times are the first axis that is left when the angle has been taken.
    return jnp.unwrap(to_euler_angles(states.attitude)[0], axis=0)


def _turn_from(nominal: State, attitude: Quaternion) -> Quaternion:
    """The turn in body axes; its components are the same before and after it."""
    return nominal.attitude.inverse().then(attitude)


def _angular_momentum_B(omega: Vector, mass: Scalar | None, body: AbstractBody) -> Vector:
    """Angular momentum about the centre of mass, kg m^2/s, in body axes."""
    if isinstance(body, BurningBody):
        # Less than the dry mass may remain after a release, but never a negative mass of
        # propellant.
        mass = body.dry_mass if mass is None else jnp.maximum(mass, body.dry_mass)
    return body.inertia(mass).times(omega)


def _angle_between(a: Vector, b: Vector) -> Scalar:
    """The angle between two vectors, rad, without loss of digits near zero."""
    return safe_atan2(norm(cross(a, b)), dot(a, b))
