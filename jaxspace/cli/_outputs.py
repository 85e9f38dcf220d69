"""The outputs that a dispersion may ask for, in an analyst's units. A new one takes one line in
`OUTPUTS`."""

import math

import jax.numpy as jnp

from ..bodies import BurningBody
from ..core import Scalar, Vector, axis, cross, dot, norm, safe_atan2
from ..io import End, OutputEntry
from ..orbits import apoapsis_radius, inclination, periapsis_radius

DEGREE = math.pi / 180.0
RPM = math.pi / 30.0
KM = 1000.0


def angular_momentum_B(end: End) -> Vector:
    """The final angular momentum about the centre of mass, kg m^2/s, in body axes."""
    mass = end.final.mass
    if isinstance(end.body, BurningBody):
        # A yo-yo that was let go takes mass off the dry body, and leaves no propellant behind that
        # were negative.
        mass = jnp.maximum(end.body.dry_mass if mass is None else mass, end.body.dry_mass)
    return end.body.inertia(mass).times(end.final.omega)


def angle_between(a: Vector, b: Vector) -> Scalar:
    """The angle between two vectors, rad, without loss of digits near zero."""
    return safe_atan2(norm(cross(a, b)), dot(a, b))


def perigee_altitude(end: End) -> Scalar:
    """Least height of the final orbit, km."""
    radius = periapsis_radius(end.final.position, end.final.velocity, end.values["planet"]["mu"])
    return (radius - end.values["planet"]["radius"]) / KM


def apogee_altitude(end: End) -> Scalar:
    """Greatest height of the final orbit, km; infinite when it is not closed."""
    radius = apoapsis_radius(end.final.position, end.final.velocity, end.values["planet"]["mu"])
    return (radius - end.values["planet"]["radius"]) / KM


def inclination_deg(end: End) -> Scalar:
    """Inclination of the final orbit, deg."""
    return inclination(end.final.position, end.final.velocity) / DEGREE


def speed_error(end: End) -> Scalar:
    """Speed at burnout less that of the nominal run, m/s."""
    speed = norm(end.burnout.velocity)
    return speed - (speed if end.nominal is None else norm(end.nominal.burnout.velocity))


def velocity_error(end: End) -> Scalar:
    """Length of the difference of the velocity at burnout from that of the nominal run, m/s."""
    v = end.burnout.velocity
    return norm(v - (v if end.nominal is None else end.nominal.burnout.velocity))


def pointing(end: End) -> Scalar:
    """Angle between the final angular momentum and the spin axis that was intended, deg."""
    h = angular_momentum_B(end)
    axis_N = end.intended.attitude.rotate(axis(2, end.intended.omega[2]))
    return angle_between(end.final.attitude.rotate(h), axis_N) / DEGREE


def spin_rate(end: End) -> Scalar:
    """Final rate about the body's z axis, rpm."""
    return end.final.omega[2] / RPM


def cone_angle(end: End) -> Scalar:
    """Angle between the body's z axis and the final angular momentum, deg."""
    h = angular_momentum_B(end)
    return angle_between(h, axis(2, h[2])) / DEGREE


def final_mass(end: End) -> Scalar:
    """Final mass, kg."""
    return end.final.mass


ORBIT = ("position", "velocity", "planet.mu")
TURNS = ("attitude", "omega")
OUTPUTS = {
    "perigee_altitude": OutputEntry("km", perigee_altitude, (*ORBIT, "planet.radius")),
    "apogee_altitude": OutputEntry("km", apogee_altitude, (*ORBIT, "planet.radius")),
    "inclination": OutputEntry("deg", inclination_deg, ("position", "velocity")),
    "speed_error": OutputEntry("m/s", speed_error, ("velocity",)),
    "velocity_error": OutputEntry("m/s", velocity_error, ("velocity",)),
    "pointing": OutputEntry("deg", pointing, TURNS),
    "spin_rate": OutputEntry("rpm", spin_rate, TURNS),
    "cone_angle": OutputEntry("deg", cone_angle, TURNS),
    "final_mass": OutputEntry("kg", final_mass, ("effects.thrust",)),
}
