"""Hard cases of rockets: nothing burns, everything burns, the last stage; and of optimal flight."""

import math

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
from ._case import Case


def gain(x: Array) -> Array:
    """The gain of speed from exhaust velocity and mass ratio."""
    return rocket_equation(x[0], x[1])[None]


def ratio_for(x: Array) -> Array:
    """The mass ratio for a gain of speed, from exhaust velocity and gain."""
    return mass_ratio_for(x[0], x[1])[None]


def burnout_height(x: Array) -> Array:
    """Height at burnout of a vertical ascent from its five parameters."""
    return vertical_burnout_height(*x)[None]


def coast(x: Array) -> Array:
    """Height gained after burnout from speed, height, gravity and radius."""
    return coast_height(*x)[None]


def spun_angle(x: Array) -> Array:
    """Angle turned through during a burn, rad."""
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


# Tolerances of what is computed by iteration: its last step decides on the digits.
ROOT = "the root of one equation"

CASES = (
    # ln(mu) near one: an absolute error of the ratio would be the whole result.
    Case("rockets: nothing burns", gain, (2850.0, 1.0), value=(0.0,), slopes=((0.0, 2850.0),)),
    Case(
        "rockets: gain of a grain",
        gain,
        (2850.0, 1.0 + 2.0**-40),
        single="the mass ratio rounds to 1",
    ),
    Case("rockets: no gain", ratio_for, (2850.0, 0.0), value=(1.0,), slopes=((0.0, 1.0 / 2850.0),)),
    # 1 - ln(mu)/(mu - 1) is zero over zero where nothing burns; its series takes over nearby.
    Case(
        "rockets: height, nothing burns",
        burnout_height,
        (2850.0, 1.0, 60.0, 9.81, 10.0),
        value=(600.0 - 1800.0 * 9.81,),
        slopes=((0.0, 85500.0, 10.0 - 60.0 * 9.81, -1800.0, 60.0),),
    ),
    Case(
        "rockets: height below its series",
        burnout_height,
        (2850.0, 1.249, 60.0, 0.0, 0.0),
        "a series",
    ),
    Case(
        "rockets: height above its series",
        burnout_height,
        (2850.0, 1.251, 60.0, 0.0, 0.0),
        "1 - ln(mu)/(mu - 1) is a difference",
        slope_roundings=64.0,
    ),
    # The height is infinite from the escape speed on, and its slope grows without bound before.
    Case(
        "rockets: coast of no speed",
        coast,
        (0.0, 1e5, 9.81, 6.378e6),
        value=(0.0,),
        slopes=((0.0,) * 4,),
    ),
    Case(
        "rockets: coast below escape",
        coast,
        (11180.0, 0.0, 9.81, 6.378e6),
        slope_roundings=256.0,
        single="what is missing to escape is a difference of the inputs",
    ),
    Case(
        "rockets: coast of escape",
        coast,
        (12000.0, 0.0, 9.81, 6.378e6),
        "exact",
        value=(math.inf,),
        slopes=((0.0,) * 4,),
    ),
    # A power of the mass ratio: zero to a power where everything burns.
    Case(
        "rockets: spin, nothing burns",
        spun_angle,
        (2.0, 3.0, 0.0, 0.5),
        value=(6.0,),
        slopes=((3.0, 2.0, 4.5, 0.0),),
    ),
    Case("rockets: spin through a slow burn", spun_angle, (20.0, 3.0, 1e-9, 0.5)),
    Case("rockets: spin, central nozzle", spun_angle, (20.0, 3.0, 0.04, 0.0)),
    Case(
        "rockets: spin to the last grain",
        spun_angle,
        (20.0, 3.0, 0.0499999, 0.5),
        "the mass left is a difference: 2e-6 of the first",
        slope_roundings=1e6,
    ),
    # The exponent vanishes at l = k, and the base at the last grain.
    Case(
        "rockets: damping, everything burns",
        damping,
        (0.0, 1.5),
        "exact",
        value=(0.0,),
        slopes=((0.0, 0.0),),
    ),
    Case(
        "rockets: damping, nothing burns", damping, (1.0, 1.5), value=(1.0,), slopes=((1.25, 0.0),)
    ),
    Case("rockets: damping, l = k", damping, (0.3, 1.0)),
    Case("rockets: spin of a ring", spin_left, (1e-12, 0.9), slope_roundings=64.0),
    # Far below the normal numbers of single precision.
    Case(
        "rockets: air a hundred scales up",
        density,
        (7e5, 1.2, 0.0, 7e3),
        "exp of 100",
        8.0,
        512.0,
        single="e^-100 is below the normal numbers of float32",
    ),
    # The multiplier is the root of one equation; a useless stage makes it a branch.
    Case(
        "optimization: equal stages",
        two_stages,
        (3000.0, 3000.0, 0.1, 0.1, 6000.0),
        ROOT,
        64.0,
        256.0,
    ),
    Case(
        "optimization: a stage left out",
        two_stages,
        (4500.0, 2000.0, 0.1, 0.3, 1500.0),
        ROOT,
        64.0,
        256.0,
    ),
    Case(
        "optimization: hardly any payload",
        two_stages,
        (3000.0, 4000.0, 0.1, 0.1, 16118.0),
        ROOT,
        64.0,
        1e6,
    ),
    # A climb of nothing makes the angle zero, where its equation is flat.
    Case("optimization: quickest, level", quickest, (20.0, 0.0, 7000.0), ROOT, 16.0, 64.0),
    Case(
        "optimization: quickest, hardly a climb", quickest, (20.0, 1e-3, 7000.0), ROOT, 16.0, 64.0
    ),
    Case("optimization: quickest, steep", quickest, (20.0, 2e8, 300.0), ROOT, 64.0, 256.0),
)
