"""Functions of the edge cases of orbits: every conic, its elements, and transfers. Units with
mu = 1.

Each maps the inputs of a case, (inputs,), to its outputs, (outputs,)."""

import jax.numpy as jnp
from jaxtyping import Array

from ..orbits import ClassicalElements
from ..orbits.elements import (
    apoapsis_radius,
    elements_from_state,
    inclination,
    periapsis_radius,
    semi_major_axis,
    state_from_elements,
)
from ..orbits.kepler import kepler_flow
from ..orbits.lambert import lambert, least_duration
from ..orbits.oblateness import oblateness


def kepler(x: Array) -> Array:
    """Position and velocity from position, velocity, duration and mu."""
    return jnp.concatenate(kepler_flow(x[:3], x[3:6], x[6], x[7]))


def elements(x: Array) -> Array:
    """p, e, i, node, argument and anomaly from position, velocity and mu."""
    result = elements_from_state(x[:3], x[3:6], x[6])
    angles = (result.inclination, result.node, result.argument_of_periapsis, result.true_anomaly)
    return jnp.stack([result.semi_latus_rectum, result.eccentricity, *angles])


def state(x: Array) -> Array:
    """Position and velocity from p, e, i, node, argument, anomaly and mu."""
    return jnp.concatenate(state_from_elements(ClassicalElements(*x[:6]), x[6]))


def radii(x: Array) -> Array:
    """Radius of periapsis from position, velocity and mu."""
    # Apart from `sizes`: on a parabola it is a number, and they are infinite.
    return periapsis_radius(x[:3], x[3:6], x[6])[None]


def sizes(x: Array) -> Array:
    """Semi-major axis and radius of apoapsis from position, velocity and mu."""
    given = x[:3], x[3:6], x[6]
    return jnp.stack([semi_major_axis(*given), apoapsis_radius(*given)])


def tilt(x: Array) -> Array:
    """Inclination from position and velocity."""
    # Separate from `elements`: it is accurate near zero, where the node has lost its digits.
    return inclination(x[:3], x[3:6])[None]


def transfer(x: Array) -> Array:
    """Velocities at both ends from both positions, duration and mu; the short way."""
    normal = jnp.cross(x[:3], x[3:6])
    # The normal of both places, so that every case is the short way, whichever plane it has.
    return jnp.concatenate(lambert(x[:3], x[3:6], x[6], x[7], normal=normal))


def late_transfer(x: Array) -> Array:
    """The same transfer after one whole revolution."""
    normal = jnp.cross(x[:3], x[3:6])
    return jnp.concatenate(lambert(x[:3], x[3:6], x[6], x[7], normal=normal, revolutions=1))


def shortest(x: Array) -> Array:
    """The least duration with one revolution from both places and mu."""
    return least_duration(x[:3], x[3:6], x[6], 1, normal=jnp.cross(x[:3], x[3:6]))[None]


def bulge(x: Array) -> Array:
    """The acceleration by J2 from position, mu, J2 and radius."""
    return oblateness(x[:3], x[3], x[4], x[5])
