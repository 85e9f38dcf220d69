"""Closed forms of rockets and of optimal flight."""

import jax.numpy as jnp
import twins

from jaxspace.optimization import SteeredFlight, SteeringProfile
from jaxspace.optimization.ascent import Ascent, ConstantMassFlow, FlightState, apex, burnout_state
from jaxspace.optimization.staging import stationary_mass_ratio
from jaxspace.optimization.steering import (
    LinearTangentSteering,
    linear_tangent_steering,
    minimum_time_steering,
)
from jaxspace.rockets import ThrottleTable, Thrust, ThrustProfile
from jaxspace.rockets.rocket_equation import propulsive_efficiency, vertical_burnout_velocity

from .form import Form


def burnout_speed(x):
    """Of a vertical ascent from its five parameters."""
    return vertical_burnout_velocity(*x)[None]


def efficiency(x):
    return propulsive_efficiency(x[0], x[1])[None]


def burning_motor(x):
    """Thrust and mass rate from mean thrust, exhaust velocity, burn time, time and mass."""
    profile = ThrustProfile([0.0, 0.1, 0.6, 1.0], [0.0, 1.2, 1.1, 0.825])
    motor = Thrust(x[0], x[1], x[2], profile)
    return motor.thrust(x[3], x[4])[None], motor.mass_rate(x[3], x[4])[None], motor.burnout()[None]


def given_motor(x):
    """Thrust and exhaust velocity from total impulse, burn time, propellant; and from thrust,
    specific impulse."""
    one, other = Thrust.of_motor(x[0], x[1], x[2]), Thrust.of_specific_impulse(x[3], x[4], x[1])
    found = one.mean_thrust, one.exhaust_velocity, other.exhaust_velocity
    return tuple(f[None] for f in found)


def best_ratio(x):
    """From multiplier, exhaust velocity and structural factor."""
    return stationary_mass_ratio(x[0], x[1], x[2])[None]


def ascent(x):
    """From exhaust velocity, time to burn all, burn time, release speed and height, apex, g."""
    return Ascent(ConstantMassFlow(x[0], x[1]), x[2], x[3], x[4], x[5], x[6])


def steered_burnout(x):
    """State at burnout and apex of a linear-tangent law, from the seven numbers of an ascent, the
    first angle and the time at which it vanishes."""
    given = ascent(x)
    law = LinearTangentSteering(x[7], x[8], x[8], jnp.asarray(True))
    end = burnout_state(given, x[7], law.angle)
    places, rates = jnp.stack([end.x, end.y]), jnp.stack([end.u, end.w])
    return places, rates, *(f[None] for f in apex(given, end))


def steepest(x):
    """Angle, time and velocity of the best steering, from the seven numbers of an ascent."""
    best = linear_tangent_steering(ascent(x))
    found = best.initial_angle, best.vanishing_time, best.final_velocity
    return tuple(jnp.where(best.reached, f, jnp.nan)[None] for f in found)


def quick_angle(x):
    """Along the quickest flight, from acceleration, height, speed and time."""
    best = minimum_time_steering(x[0], x[1], x[2])
    return best.angle(x[3])[None]


def steered(x):
    """Rates of a steered flight from exhaust velocity, time to burn all, four angles, time and
    velocities."""
    profile = SteeringProfile([0.0, 10.0, 30.0, 60.0], x[2:6])
    flight = SteeredFlight(ConstantMassFlow(x[0], x[1]), profile, jnp.asarray(9.81))
    rate = flight.vector_field(x[6], FlightState(0.0 * x[0], 0.0 * x[0], x[7], x[8]))
    return jnp.stack([rate.x, rate.y]), jnp.stack([rate.u, rate.w])


def throttled(x):
    """The throttle of a table at a time, from its four values."""
    return ThrottleTable([0.0, 10.0, 30.0, 60.0], x[1:5]).at(x[0])[None]


ASCENT = (3000.0, 100.0, 60.0, 100.0, 0.0, 6e4, 9.81)

FORMS = (
    Form(burnout_speed, ("rockets.vertical_burnout_velocity",),
         [(2850.0, 3.0, 60.0, 9.81, 10.0), (2850.0, 1.0, 60.0, 9.81, 0.0),
          (2850.0, 1.2294, 60.0, 9.81, 0.0)]),
    Form(efficiency, ("rockets.propulsive_efficiency",),
         [(1500.0, 2850.0), (2850.0, 2850.0), (0.0, 2850.0)]),
    Form(
        burning_motor,
        ("rockets.Thrust.thrust", "rockets.Thrust.mass_rate", "rockets.Thrust.burnout",
         "rockets.ThrustProfile.at"),
        [(6e4, 2850.0, 10.0, 3.0, 1500.0), (6e4, 2850.0, 10.0, 9.999999999, 1500.0),
         (6e4, 2850.0, 10.0, 1e-9, 1500.0), (6e4, 2850.0, 10.0, 6.0, 1500.0)],
    ),
    Form(throttled, ("rockets.ThrottleTable.at",),
         [(7.0, 0.9, 1.0, 0.4, 0.5), (30.0, 0.9, 1.0, 0.4, 0.5), (1e-9, 0.9, 1.0, 0.4, 0.5),
          (70.0, 0.9, 1.0, 0.4, 0.5)]),
    Form(given_motor, ("rockets.Thrust.of_motor", "rockets.Thrust.of_specific_impulse"),
         [(6e5, 10.0, 210.0, 6e4, 290.0)]),
    Form(best_ratio, ("optimization.stationary_mass_ratio",),
         [(-1e-3, 3000.0, 0.1), (-3.3333334e-4, 3000.0, 0.1)]),
    Form(
        steered_burnout,
        ("optimization.burnout_state", "optimization.apex",
         "optimization.LinearTangentSteering.angle",
         "optimization.ConstantMassFlow"),
        [(*ASCENT, 0.9, 150.0), (*ASCENT, 1.5707963267948966, 150.0), (*ASCENT, 0.6, 60.0)],
    ),
    Form(
        steepest,
        ("optimization.linear_tangent_steering",),
        [ASCENT, (3000.0, 100.0, 60.0, 1e-9, 0.0, 5e4, 9.81)],
        exact=twins.steepest,
    ),
    Form(
        quick_angle,
        ("optimization.minimum_time_steering",),
        [(20.0, 1e5, 7000.0, 10.0), (20.0, 0.0, 7000.0, 10.0), (20.0, 1e-3, 7000.0, 175.0)],
        exact=twins.quick_angle,
    ),
    Form(
        steered,
        ("optimization.SteeredFlight.vector_field", "optimization.SteeringProfile"),
        [(3000.0, 100.0, 1.5, 1.2, 0.9, 0.4, 20.0, 100.0, 300.0),
         (3000.0, 100.0, 1.5, 1.5, 0.9, 0.4, 30.0, 100.0, 300.0)],
    ),
)  # fmt: skip
