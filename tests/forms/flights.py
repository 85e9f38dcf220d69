"""Closed forms of flights in air and of steered rockets, and laws of control."""

import jax.numpy as jnp

from jaxspace import control as c
from jaxspace import rockets as k
from jaxspace import vehicles as v
from jaxspace.bodies import BodyState
from jaxspace.bodies.atmosphere import dry_air, isothermal_ratio
from jaxspace.optimization.staging import equal_stages_payload
from jaxspace.rotations import Quaternion

from .form import Form
from .mechanics import numbers


def steering(x):
    """Pitch by a polynomial, a table and tangents at a time; directions from a state."""
    plane = k.steering.FlightPlane(up=[0.0, 0.0, 1.0])
    laws = (
        k.steering.PitchPolynomial(x[:3], x[3], plane),
        k.steering.PitchTable([0.0, 1.0, 3.0], x[:3], plane),
        k.steering.TangentSteering(x[0], x[1], x[2], x[3], plane),
    )
    y = BodyState(position=x[5:8], velocity=x[8:11])
    ways = (
        k.steering.AlongVelocity(x[4]).direction(x[4], y),
        k.steering.FixedDirection(x[5:8]).direction(x[4], y),
    )
    ways += (
        v.along_air.AlongAir(v.local_air.LocalAir(radius=6.378e6, air_rate=x[4])).direction(
            x[4], y
        ),
    )
    along = k.steering.FlightPlane().along(x[0], y), laws[2].direction(x[4], y)
    polynomial, table, tangents = (law.pitch(x[4]) for law in laws)
    # A table is right to a rounding of its largest value.
    return *numbers(polynomial, tangents), jnp.append(x[:3], table), *ways, *along


def engines(x):
    """Thrust, rate, burnout, loss and what it leaves: thrust, impulse, propellant, time, mass and
    place."""
    law = k.steering.FixedDirection([0.0, 0.0, 1.0])
    engine = k.SteeredThrust.of_propellant(law, x[0], x[1], x[2])
    y = BodyState(position=x[5:8], velocity=x[5:8], mass=x[4])
    air = k.BackPressure.of_impulses(x[0], x[1], 0.9 * x[1], 6.4e6)
    thrust = engine.thrust(x[3], x[4])
    rates = thrust, engine.mass_rate(x[3], x[4]), engine.burnout()
    return numbers(*rates, air.loss(y), air.net(thrust, y))


def streams(x):
    """Acceleration by two streams of mass: mass, velocity, force, rates and their velocities."""
    return k.variable_mass.variable_mass_acceleration(
        x[0], x[1:4], x[4:7], x[7:9], x[9:15].reshape(3, 2)
    )


def attack_angles(x):
    """The angle of attack of a spinning rocket: spin, burn, three lengths, time and rate."""
    rocket = k.SpinningRocket.of_lengths(x[0], x[1], x[2], x[3], x[4])
    return (rocket.complex_tilt(x[5], x[6:8]),)


def surfaces(x):
    """Slopes and centres of nose, fins and tail: 9 lengths and the Mach number."""
    fins = v.FinSet(4, x[0], x[1], x[2], x[3], x[4], -1.168, cant=0.01)
    nose = v.NoseCone.of_shape(x[4], 1.16, x[5], "von_karman")
    tail = v.RadiusChange(x[4], x[6], x[7], -1.3)
    mach = x[8]
    table = v.coefficient.MachTable([0.0, 0.5, 1.0], [0.4, 0.5, 0.6])
    one = v.Aerodynamics(0.0127, table, nose, fins, tail)
    slopes = nose.slope(mach), fins.slope(mach), tail.slope(mach), fins.single_slope(mach)
    places = nose.centre(), fins.centre(), tail.centre()
    whole = *one.moments_of_slope(mach), one.axial_coefficient(0.0, mach), table(mach)
    roll = fins.roll_damping(mach), fins.roll_forcing(mach)
    return numbers(*slopes, *places, *whole, *roll, v.airframe.prandtl_factor(mach))


def airs_at(x):
    """Air, wind and drag at a place: place, velocity; latitude, height; mass, area and density."""
    air = v.local_air.LocalAir(wind=v.Wind([0.0, 1e4], [3.0, 8.0], [-2.0, 1.0]))
    state, moving = air.at(x[:3])
    drag = v.AirDrag(0.02, 0.5, air=air)
    y = BodyState(position=x[:3], velocity=x[3:6])
    figures = state.density, air.height(x[:3]), drag.dynamic_pressure(y)
    ground = (
        v.ground_gravity.normal_gravity(x[6], x[7]),
        v.ground_gravity.GroundGravity.of_latitude(x[6], x[7]).gravity,
    )
    rates = v.air_drag.descent_rate(*x[8:11], 9.8 + 0.0 * x[0])
    site = v.LaunchSite(5.0, 1.4, 0.3 + x[6], x[6])
    placed = site.direction, site.attitude.wxyz
    force = v.air_drag.drag_force(x[3:6], x[10], x[9])
    dry, left = dry_air(280.0 + x[9], 9e4 + x[8]), isothermal_ratio(x[2], 280.0 + x[9])
    rest = numbers(*figures, *ground, rates, *air.wind.at(x[2]), *dry, left)
    return moving, air.velocity(x[:3]), force, *placed, *rest


def stages(x):
    """The payload of equal stages: velocity, exhaust velocity, structure and their number."""
    return numbers(equal_stages_payload(*x))


def attitude_laws(x):
    """The error of an attitude, and the torque against it: attitude and rate."""
    target = jnp.array([0.6, -0.3, 0.7, 0.2], x.dtype)
    return (c.attitude_laws.error_vector(Quaternion(x[:4]), target),)


def of(kind, *methods):
    """ "kind.method" for each."""
    return tuple(f"{kind}.{method}" for method in methods)


STATE = (6.4e6, 1e5, -2e5, 80.0, 10.0, 200.0)

FORMS = (
    Form(
        steering,
        (
            *of("rockets.PitchPolynomial", "pitch"),
            *of("rockets.PitchTable", "pitch"),
            *of("rockets.TangentSteering", "pitch"),
            *of("rockets.AlongVelocity", "direction"),
            *of("vehicles.AlongAir", "direction"),
            *of("rockets.FixedDirection", "direction"),
            *of("rockets.FlightPlane", "along"),
            *of("rockets.AbstractSteering", "direction"),
        ),
        [
            (1.5, -0.1, 1e-3, 0.2, 1.4, *STATE),
            (1.5, -0.1, 0.0, 0.0, 0.0, 6.4e6, 0.0, 0.0, 0.0, 0.0, 200.0),
        ],
        vectors=(1, 1, 1, 1, 1, 3, 3),
    ),
    Form(
        engines,
        (
            *of("rockets.SteeredThrust", "of_propellant", "thrust", "mass_rate", "burnout"),
            *of("rockets.BackPressure", "of_impulses", "loss", "net"),
        ),
        [(2.5e4, 290.0, 500.0, 10.0, 1700.0, 6.41e6, 1e5, 0.0)],
    ),
    Form(
        streams,
        ("rockets.variable_mass_acceleration",),
        [(1e3, 1.0, 2.0, 3.0, 10.0, 20.0, 30.0, -2.0, 1.5, 5.0, 6.0, -7.0, 8.0, 9.0, 1.0)],
    ),
    Form(
        attack_angles,
        of("rockets.SpinningRocket", "complex_tilt", "of_lengths"),
        [(10.0, 8e-3, 1.0, 0.5, 2.0, 20.0, 0.1, 0.02), (10.0, 8e-3, 1.0, 0.5, 2.0, 0.0, 0.1, 0.02)],
    ),
    Form(
        surfaces,
        (
            *of(
                "vehicles.FinSet", "centre", "roll_damping", "roll_forcing", "single_slope", "slope"
            ),
            *of("vehicles.NoseCone", "centre", "of_shape", "slope"),
            "vehicles.MachTable",
            *of("vehicles.RadiusChange", "centre", "slope"),
            "vehicles.prandtl_factor",
            *of("vehicles.Aerodynamics", "axial_coefficient", "moments_of_slope"),
        ),
        [
            (0.1, 0.12, 0.04, 0.08, 0.0635, 0.558, 0.0435, 0.06, 0.3),
            (0.1, 0.12, 0.04, 0.0, 0.0635, 0.558, 0.0635, 0.06, 0.0),
            (0.1, 0.12, 0.04, 0.08, 0.0635, 0.558, 0.0435, 0.06, 1.5),
        ],
    ),
    Form(
        airs_at,
        (
            *of("vehicles.LocalAir", "at", "height", "velocity"),
            *of("vehicles.LaunchSite", "direction", "attitude"),
            *of("vehicles.AirDrag", "dynamic_pressure"),
            *of("vehicles.GroundGravity", "of_latitude"),
            "vehicles.Wind.at",
            "bodies.dry_air",
            "bodies.isothermal_ratio",
            "vehicles.descent_rate",
            "vehicles.drag_force",
            "vehicles.normal_gravity",
        ),
        [
            (10.0, -20.0, 800.0, 20.0, -15.0, 180.0, 0.7, 300.0, 16.0, 2.0, 1.2),
            (0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 16.0, 2.0, 1.2),
        ],
    ),
    Form(
        stages, ("optimization.equal_stages_payload",), [(9e3, 3e3, 0.1, 2.5), (9e2, 3e3, 0.1, 1.0)]
    ),
    Form(
        attitude_laws,
        ("control.error_vector",),
        [(0.5, 0.1, -0.6, 0.3), (0.6, -0.3, 0.7, 0.2), (0.3, 0.6, -0.2, 0.7)],
    ),
)
