"""Closed forms of stages and landers: legs, swivelling engines, slosh, dynamic pressure."""

import jax.numpy as jnp
import twins

from jaxspace import mechanics as m
from jaxspace import orbits as o
from jaxspace import rockets as k
from jaxspace import vehicles as v
from jaxspace.bodies import BodyState, ExponentialAtmosphere
from jaxspace.rotations import Quaternion

from .form import Form
from .mechanics import numbers


def legs(x):
    """Moment, energies and touchdown of a lander: 6 numbers, damping, angle, its rate and speed."""
    one = m.LandingLegs(*x[:6], damping=x[6])
    q, rate = x[7][None], x[8][None]
    lost = one.dissipation(0.0, q, rate), one.touchdown_loss(x[9])
    energies = one.moment(x[7]), one.potential(x[7]), one.lagrangian(0.0, q, rate)
    return numbers(*energies, *lost, one.touchdown(x[9]).rates[0], one.state(*x[7:9]).rates[0])


def spread(x):
    """The greatest spread and its time, from 6 numbers and the speed."""
    one = m.LandingLegs(*x[:6])
    return numbers(one.greatest_spread(x[6]), one.spreading_time(x[6]))


def pulled(x):
    """Acceleration of a missile across its axis, and the moments of its body: 5 numbers, thrust,
    engine, two bends, slosh, its rate, moment of roll."""
    body = m.FlexibleMissile(*x[:5], x[5], actuator_stiffness=3e6, modes=2)
    loop = m.missile_loop.MissileLoop(body, 1.0, 0.1, 2.0, 1500.0, 2.5, 0.01, 4.0)
    still = 0.0 * x[0]
    y = m.MissileState(x[6], x[7:9], still, still, jnp.stack([still, still]), still)
    whole = v.FlexibleStage(loop).body(x[11])
    inertia = whole.inertia(x[0]).matrix()
    state = m.missile_loop.MissileLoopState(y, x[9], x[10])
    return numbers(loop.sideways(state), loop.mean_turn(state), *jnp.diag(inertia))


def leaning(x):
    """Lean of a flexible stage, its rate and the angle of its engine: attitude, rate, engine."""
    body = m.FlexibleMissile(*MISSILE[:6], actuator_stiffness=3e6, modes=2)
    stage = v.FlexibleStage(m.missile_loop.MissileLoop(body, 1.0, 0.1, 2.0, 1500.0, 2.5, 0.01, 4.0))
    y = BodyState(attitude=Quaternion(x[:4]), omega=x[4:7], parts={stage.part: {"engine": x[7:9]}})
    return jnp.stack([stage.lean(y), stage.lean_rate(y), stage.engine_angle(y)])


def swivelled(x):
    """Tangents of a nozzle, and its motor: thrust, impulse, propellant, gain, damping, limit, time,
    mass, attitude, rate and direction."""
    gimbal = k.Gimbal(k.steering.FixedDirection(x[15:18]), *x[3:6])
    engine = k.GimballedThrust.of_propellant(gimbal, *x[:3], -2.0, burnout_mass=0.5 * x[0])
    place = 0.0 * x[:3]
    y = BodyState(place, place, Quaternion(x[8:12]), x[12:15], x[7])
    same = k.GimballedThrust.of_thrust(engine.motor(), gimbal, -2.0)
    burning = engine.burnout(), engine.motor().thrust(x[6], x[7]), same.motor().mass_rate(*x[6:8])
    # Without the margin of the event, which is in units in the last place of the precision.
    left = engine.propellant_left(y) + 2048.0 * jnp.finfo(x.dtype).eps * x[0]
    return jnp.stack(gimbal.tangents(x[6], y)), *numbers(*burning, left)


def pressures(x):
    """Dynamic pressure in the air of a planet, and about an airframe: position, velocity, rate of
    the air, density, scale height, radius; height."""
    air = ExponentialAtmosphere(x[7], 0.0, x[8])
    orbit = o.Drag(50.0, air, x[9], x[6]).dynamic_pressure(BodyState(x[:3], x[3:6]))
    wind = v.Wind([0.0, 1e4], [3.0, 8.0], [-2.0, 1.0])
    table = v.coefficient.MachTable([0.0, 1.0], [0.4, 0.6])
    frame = v.Aerodynamics(0.0127, table, air=v.local_air.LocalAir(air, wind=wind))
    place = jnp.stack([0.0 * x[10], 0.0 * x[10], x[10]])
    return numbers(orbit, frame.dynamic_pressure(BodyState(place, x[3:6])))


LANDER = (900.0, 12.0, 2.0, 0.6, 4e3, 1.62)
MISSILE = (2e4, 20.0, 2e8, 1.5, 1e5, 4e5)
TURNED = (0.6, -0.3, 0.7, 0.2)
MOTOR = (2.5e4, 290.0, 500.0)

FORMS = (
    Form(
        legs,
        tuple(
            f"mechanics.LandingLegs.{name}"
            for name in ("moment", "potential", "lagrangian", "dissipation", "touchdown")
        )
        + ("mechanics.LandingLegs.touchdown_loss",),
        [
            (*LANDER, 30.0, 0.8, 0.5, 2.0),
            (900.0, 0.0, 2.0, 0.6, 4e3, 0.0, 0.0, 0.6, 0.0, 2.0),
            (900.0, 12.0, 2.0, 1e-6, 4e3, 1.62, 30.0, 0.0, 0.5, 1e-3),
        ],
    ),
    Form(
        spread,
        ("mechanics.LandingLegs.greatest_spread", "mechanics.LandingLegs.spreading_time"),
        [
            (*LANDER, 2.0),
            (*LANDER, 1e-3),
            (900.0, 12.0, 2.0, 1.2, 4e4, 0.0, 2.0),
        ],
        exact=twins.spread,
    ),
    Form(
        pulled,
        (
            "mechanics.MissileLoop.sideways",
            "mechanics.MissileLoop.mean_turn",
            "mechanics.FlexibleMissile.mean_turn",
            "vehicles.FlexibleStage.body",
        ),
        [
            (*MISSILE, 0.03, 0.02, -0.01, 0.1, -0.2, 5e3),
            (*MISSILE, 0.0, 0.0, 1e-9, 0.0, 0.0, 5e3),
        ],
    ),
    Form(
        leaning,
        tuple(f"vehicles.FlexibleStage.{name}" for name in ("lean", "lean_rate", "engine_angle")),
        [
            (0.9, 0.1, -0.3, 0.2, 0.02, -0.01, 0.5, 0.03, -0.01),
            (1.0, 1e-9, 2e-9, 0.3, 1e-8, 0.0, 0.1, 1e-7, 0.0),
        ],
    ),
    Form(
        swivelled,
        (
            "rockets.Gimbal.tangents",
            *(f"rockets.GimballedThrust.{name}" for name in ("burnout", "motor", "of_propellant")),
            "rockets.GimballedThrust.of_thrust",
            "rockets.GimballedThrust.propellant_left",
        ),
        [
            (*MOTOR, 2.0, 1.5, 0.1, 10.0, 1.7e4, *TURNED, 0.1, -0.2, 0.3, 0.0, 0.6, 0.8),
            (*MOTOR, 2.0, 1.5, 0.1, 10.0, 1.7e4, 1.0, *(0.0,) * 8, 1.0),
            (*MOTOR, 9.0, 0.0, 1e-3, 0.0, 1.7e4, *TURNED, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0),
        ],
    ),
    Form(
        pressures,
        ("orbits.Drag.dynamic_pressure", "vehicles.Aerodynamics.dynamic_pressure"),
        [
            (6.6e6, 4e5, -3e5, -300.0, 6900.0, 3600.0, 7.29e-5, 1.2, 7e4, 6378137.0, 800.0),
            (6.4e6, 0.0, 0.0, 0.0, 466.56, 0.0, 7.29e-5, 1.2, 7e3, 6378137.0, 0.0),
        ],
    ),
)
