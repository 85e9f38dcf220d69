"""Functions of the edge cases of rockets, and of optimal flight.

Each maps the inputs of a case, (inputs,), to its outputs, (outputs,)."""

import jax.numpy as jnp
from jaxtyping import Array

from ..bodies.atmosphere import exponential_density
from ..optimization import optimal_staging
from ..optimization.steering import minimum_time_steering
from ..rockets import spin_angle
from ..rockets.jet_damping import jet_damping_ratio, spin_ratio
from ..rockets.rocket_equation import (
    coast_height,
    mass_ratio_for,
    rocket_equation,
    vertical_burnout_height,
)


def gain(x: Array) -> Array:
    """The gain of speed from exhaust velocity and mass ratio."""
    return rocket_equation(x[0], x[1])[None]


def ratio_for(x: Array) -> Array:
    """The mass ratio for a gain of speed, from exhaust velocity and gain."""
    return mass_ratio_for(x[0], x[1])[None]


def burnout_height(x: Array) -> Array:
    """Height at burnout of a vertical ascent from its five parameters."""
    # Near a mass ratio of one it is a difference, which a series replaces: there are cases on both
    # sides of its start.
    return vertical_burnout_height(*x)[None]


def coast(x: Array) -> Array:
    """Height gained after burnout from speed, height, gravity and radius."""
    return coast_height(*x)[None]


def spun_angle(x: Array) -> Array:
    """Angle turned through during a burn, rad."""
    # By all parameters, because without burning it is a limit of their quotients.
    return spin_angle(*x)[None]


def damping(x: Array) -> Array:
    """The rate left by jet damping without spin, from mass ratio and l/k."""
    return jet_damping_ratio(*x)[None]


def spin_left(x: Array) -> Array:
    """The spin left by jet damping, from mass ratio and rho/k_z."""
    return spin_ratio(*x)[None]


def density(x: Array) -> Array:
    """Density from its parameters: the exponential atmosphere."""
    return exponential_density(*x)[None]


def two_stages(x: Array) -> Array:
    """Mass ratios, initial mass and multiplier from two exhaust velocities, two structural factors
    and the velocity."""
    best = optimal_staging(x[:2], x[2:4], x[4])
    return jnp.concatenate([best.mass_ratio, jnp.stack([best.initial_mass, best.multiplier])])


def quickest(x: Array) -> Array:
    """Angle and duration from acceleration, height and speed."""
    best = minimum_time_steering(x[0], x[1], x[2])
    return jnp.stack([best.initial_angle, best.duration])
