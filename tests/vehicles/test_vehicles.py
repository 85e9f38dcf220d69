"""Rockets in air: parts of the airframe, wind, rail, drag by Mach number, one vehicle as a point
and as a body, and three rockets of RocketPy from the rail to the ground."""

import dataclasses
import json
import sys
from pathlib import Path

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads

from jaxspace import (
    Accuracy,
    Mission,
    Phase,
    Scene,
    load,
    simulate,
    simulate_mission,
    simulate_mission_batch,
)
from jaxspace.bodies import BodyState, ExponentialAtmosphere, RigidBody, StandardAtmosphere
from jaxspace.bodies.standard_atmosphere import standard_atmosphere
from jaxspace.core import InputError
from jaxspace.rockets import BackPressure, Gimbal, Separation, Thrust
from jaxspace.rockets.steering import AlongVelocity, FixedDirection
from jaxspace.rotations import Quaternion, from_euler_angles
from jaxspace.simulation import Status
from jaxspace.solvers import Tsit5
from jaxspace.vehicles import (
    Aerodynamics,
    AirDrag,
    FinSet,
    LaunchSite,
    NoseCone,
    Parachute,
    RadiusChange,
    Rail,
    Recovery,
    Vehicle,
    Wind,
    sounding_flight,
)
from jaxspace.vehicles.air_drag import descent_rate
from jaxspace.vehicles.along_air import AlongAir
from jaxspace.vehicles.coefficient import MachTable
from jaxspace.vehicles.ground_gravity import STANDARD_GRAVITY, GroundGravity, normal_gravity
from jaxspace.vehicles.local_air import LocalAir

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "examples" / "model_rockets"))
from rockets import ROCKETS, recovery, site, stacked, vehicle

FINS = FinSet(4, 0.100, 0.120, 0.040, 0.080, 0.0635, -1.168)
NOSE = NoseCone.of_shape(0.0635, 1.160, 0.55829, "von_karman")
TAIL = RadiusChange(0.0635, 0.0435, 0.060, -1.313)


def test_slopes_and_centres_of_calisto_are_those_of_rocketpy():
    """RocketPy 1.13: `surface.clalpha(mach) * rocket.area` and the centre of pressure in the
    builder's axes, of its class `Rocket`, to all digits: the same formulas of Barrowman."""
    dry_centre = -0.1180124376577797
    expected = (
        (NOSE, 0.02533537395487489, 0.02533537395487489, 0.9988674376577797),
        (FINS, 0.06530407530244049, 0.06879617794235343, -1.10498756234222),
        (TAIL, -0.01344601655736432, -0.01344601655736432, -1.2231184034637155),
    )
    for part, slow, fast, centre in expected:
        found = [part.slope(jnp.asarray(m)) for m in (0.1, 0.5)]
        np.testing.assert_allclose(found, [slow, fast], rtol=1e-13)
        np.testing.assert_allclose(part.centre() - dry_centre, centre, rtol=1e-13)


def test_a_model_rocket_of_many_masses_is_that_of_each():
    """Mass and centre of the rocket carry runs, as in a dispersion, through body and stations."""
    rocket = ROCKETS["Calisto"]
    masses = rocket["mass"] * np.array([0.95, 1.0, 1.2])
    centres = rocket["centre"] + np.array([-0.02, 0.0, 0.03])
    many = vehicle(dict(rocket, mass=jnp.asarray(masses), centre=jnp.asarray(centres)))
    for k, (mass, centre) in enumerate(zip(masses, centres, strict=True)):
        one = vehicle(dict(rocket, mass=mass, centre=centre))
        for of in (
            lambda v: v.body.dry_inertia.moments,
            lambda v: v.body.dry_mass,
            lambda v: v.fins.leading_edge,
            lambda v: v.exit_station,
        ):
            np.testing.assert_allclose(of(many)[..., k], of(one), rtol=1e-15)


def test_noses_have_the_centre_of_their_volume():
    """L - V/(pi r^2) behind the tip, the volume by quadrature of the outline."""
    r, length = 0.05, 0.4
    x = np.linspace(0.0, length, 200_001)
    rho = (r * r + length * length) / (2.0 * r)
    outlines = {
        "conical": r * x / length,
        "ogive": np.sqrt(rho**2 - (length - x) ** 2) + r - rho,
        "parabolic": r * np.sqrt(x / length),
        "ellipsoid": r * np.sqrt(1.0 - (1.0 - x / length) ** 2),
    }
    theta = np.arccos(1.0 - 2.0 * x / length)
    outlines["von_karman"] = r / np.sqrt(np.pi) * np.sqrt(theta - 0.5 * np.sin(2.0 * theta))
    for shape, y in outlines.items():
        volume = np.trapezoid(y * y, x) / r**2
        nose = NoseCone.of_shape(r, 0.0, length, shape)
        # The trapezoids err by 1e-9 where the outline starts upright.
        np.testing.assert_allclose(nose.centre_behind, length - volume, rtol=1e-6)


def test_the_forces_of_the_air_on_a_turning_rocket():
    """Against the sum over the parts of the force at each centre of pressure, with the flow there,
    for any attitude and rate."""
    air = LocalAir(
        ExponentialAtmosphere(1.2, 0.0, 7000.0), wind=Wind([0.0, 1e4], [3.0, 8.0], [-2.0, 1.0])
    )
    effect = Aerodynamics(0.0127, MachTable([0.0, 1.0], [0.4, 0.6]), NOSE, FINS, TAIL, air)
    y = BodyState(
        jnp.array([10.0, -20.0, 800.0]),
        jnp.array([20.0, -15.0, 180.0]),
        from_euler_angles(jnp.array([0.4, 0.2, -0.9])),
        jnp.array([0.3, -0.2, 0.7]),
    )
    load = effect.load(0.0, y, RigidBody(16.0, [8.0, 8.0, 0.04]))
    state, moving = air.at(y.position)
    np.testing.assert_allclose(moving[:2], [3.0 + 5.0 * 0.08, -2.0 + 3.0 * 0.08], rtol=1e-12)
    w = np.asarray(y.attitude.rotate_back(y.velocity - moving))
    speed = np.linalg.norm(w)
    mach = speed / state.sound_speed
    push = 0.5 * state.density * speed
    force = np.array([0.0, 0.0, -push * 0.0127 * (0.4 + 0.2 * mach) * w[2]])
    moment = np.array([0.0, 0.0, -push * FINS.roll_damping(mach) * y.omega[2]])
    for part in (NOSE, FINS, TAIL):
        r = np.array([0.0, 0.0, part.centre()])
        flow = w + np.cross(y.omega, r)
        here = -push * part.slope(mach) * np.array([flow[0], flow[1], 0.0])
        force, moment = force + here, moment + np.cross(r, here)
    np.testing.assert_allclose(y.attitude.rotate_back(load.force_N), force, rtol=1e-11)
    np.testing.assert_allclose(load.torque_B, moment, rtol=1e-10)


def test_no_flow_no_force_and_finite_slopes():
    """At rest in calm air every force vanishes, and so does its derivative."""
    body = RigidBody(16.0, [8.0, 8.0, 0.04])

    def force(v):
        y = BodyState(jnp.zeros(3), v, Quaternion.identity(), jnp.zeros(3))
        loads = [
            e.load(0.0, y, body).force_N
            for e in (
                Aerodynamics(0.0127, 0.4, NOSE, FINS),
                AirDrag(0.0127, 0.4),
                Parachute(1.0),
            )
        ]
        return sum(loads)

    assert np.all(np.asarray(force(jnp.zeros(3))) == 0.0)
    assert np.all(np.asarray(jax.jacfwd(force)(jnp.zeros(3))) == 0.0)
    check_grads(force, (jnp.array([3.0, -2.0, 60.0]),), 1, atol=1e-6, rtol=1e-6)


def test_a_canted_fin_set_spins_up_to_where_forcing_and_damping_agree():
    fins = dataclasses.replace(FINS, cant=jnp.asarray(0.01))
    steady = 100.0 * fins.roll_forcing(0.3) / fins.roll_damping(0.3)
    effect = Aerodynamics(0.0127, 0.0, NOSE, fins)
    at = BodyState(
        jnp.zeros(3), jnp.array([0.0, 0.0, 100.0]), Quaternion.identity(), jnp.array([0, 0, steady])
    )
    # The Mach number of 100 m/s is not 0.3, which both follow: by a hundredth of the moment.
    load = effect.load(0.0, at, RigidBody(16.0, [8.0, 8.0, 0.04]))
    full = 0.5 * 1.225 * 1e4 * fins.roll_forcing(0.3)
    assert abs(load.torque_B[2]) < 0.02 * full
    assert full > 0.0


def test_wind_over_a_planet_blows_east_and_north():
    air = LocalAir(radius=6.4e6, air_rate=7e-5, wind=Wind([0.0, 1e4], [10.0, 10.0], [4.0, 4.0]))
    _, moving = air.at(jnp.array([6.4e6 + 10.0, 0.0, 0.0]))
    np.testing.assert_allclose(moving, [0.0, 7e-5 * (6.4e6 + 10.0) + 10.0, 4.0], atol=1e-12)
    _, pole = air.at(jnp.array([0.0, 0.0, 6.4e6]))
    assert np.all(np.asarray(pole) == 0.0)
    slope = jax.jacfwd(lambda r: air.at(r)[1])(jnp.array([0.0, 0.0, 6.4e6]))
    assert np.all(np.isfinite(slope))


def test_air_of_both_atmospheres():
    """The standard one is `standard_atmosphere`; the exponential one is isothermal air in
    equilibrium: dp/dh = -rho g."""
    height = jnp.asarray(5000.0)
    assert LocalAir().at(jnp.array([0.0, 0.0, 5000.0]))[0] == standard_atmosphere(height)
    air = ExponentialAtmosphere(1.2, 0.0, 7000.0)
    slope = jax.grad(lambda h: air.air_at(h).pressure)(height)
    found = air.air_at(height)
    np.testing.assert_allclose(slope, -9.80665 * found.density, rtol=1e-12)
    np.testing.assert_allclose(found.sound_speed**2, 1.4 * found.pressure / found.density)


def test_two_specific_impulses_give_the_exit_of_the_nozzle():
    """At the ground the thrust over the mass flow is the impulse at sea level; at 10 km the loss is
    the standard's pressure there (US-1976, table I: 26499.9 Pa) on the exit."""
    exits = BackPressure.of_impulses(190e3, 311.0, 265.0, 6.4e6, StandardAtmosphere())
    at = lambda h: BodyState(jnp.array([6.4e6 + h, 0.0, 0.0]), jnp.zeros(3))  # noqa: E731
    ratio = 1.0 - exits.loss(at(0.0)) / 190e3
    np.testing.assert_allclose(ratio, 265.0 / 311.0, rtol=1e-8)
    np.testing.assert_allclose(exits.loss(at(1e4)), exits.exit_area * 26499.9, rtol=1e-5)


def test_the_file_from_pad_to_orbit_holds_what_flies():
    file = load(Path(__file__).resolve().parents[2] / "examples" / "scenes" / "pad_to_orbit.toml")
    drag, engine = (file.system.phases[0].system.effects[k] for k in (1, 2))
    np.testing.assert_allclose(drag.coefficient(jnp.asarray(1.1)), 0.55)
    np.testing.assert_allclose(drag.air.wind.at(jnp.asarray(11e3)), [30.0, 5.0])
    np.testing.assert_allclose(engine.back_pressure.exit_area, 190e3 * (46 / 311) / 101325.0)


def test_wrong_tables_are_refused():
    with pytest.raises(InputError, match=r"MachTable\.mach .* ascending"):
        MachTable([0.0, 0.0], [0.3, 0.4])
    with pytest.raises(InputError, match=r"Wind\.north has 1 nodes, and heights has 2"):
        Wind([0.0, 1.0], [1.0, 2.0], [1.0])


def test_gravity_by_latitude():
    """WGS 84 at the equator, at 45 degrees and at the pole (TR8350.2, table 3.4), m/s^2."""
    found = normal_gravity(jnp.array([0.0, 0.25 * jnp.pi, 0.5 * jnp.pi]))
    np.testing.assert_allclose(found, [9.7803253359, 9.8061977694, 9.8321849378], rtol=1e-10)


def test_a_projectile_keeps_its_energy_over_flat_ground():
    scene = Scene([GroundGravity.of_latitude(0.7)])
    y0 = BodyState(jnp.zeros(3), jnp.array([200.0, 0.0, 1500.0]))
    run = simulate(scene, y0, jnp.array([0.0, 200.0]), accuracy=1e-11)
    assert run.drift()["energy"].max() < 1e-10


def test_the_rail_holds_guides_and_lets_go():
    """A push below the weight moves nothing; one above it moves along the rail alone."""
    direction = jnp.array([0.0, 0.3, 0.9])
    d = direction / jnp.linalg.norm(direction)
    rail = Rail(direction, 5.0)
    scene = Scene([GroundGravity(9.81), rail])
    at = BodyState(jnp.zeros(3), jnp.zeros(3))
    held = scene.vector_field(0.0, at)
    assert np.all(np.asarray(held.velocity) == 0.0)
    moving = BodyState(2.0 * d, 10.0 * d)
    rate = scene.vector_field(0.0, moving)
    np.testing.assert_allclose(rate.velocity, -9.81 * d[2] * d, rtol=1e-12)
    np.testing.assert_allclose(rail.rail_exit(0.0, moving), -3.0, rtol=1e-12)


def test_the_point_carries_no_rotation():
    """One vehicle: as a point its scene integrates position, velocity and mass, and a flight along
    the flow without wind is the flight of the body."""
    rocket = vehicle(ROCKETS["Calisto"])
    air = LocalAir(elevation=1400.0)
    gravity = GroundGravity(9.79)
    point = Scene((gravity, *rocket.as_point(air, AlongVelocity())), rocket.body)
    body = Scene((gravity, *rocket.as_body(air)), rocket.body)
    assert point.parts == ("position", "velocity", "mass")
    assert set(body.parts) == {"position", "velocity", "attitude", "omega", "mass"}
    y0 = BodyState(jnp.zeros(3), jnp.array([0.0, 0.0, 30.0]), mass=rocket.body.loaded_mass())
    turning = dataclasses.replace(y0, attitude=Quaternion.identity(), omega=jnp.zeros(3))
    a, b = point.vector_field(1.0, y0), body.vector_field(1.0, turning)
    np.testing.assert_allclose(a.velocity, b.velocity, rtol=1e-12)
    np.testing.assert_allclose(a.mass, b.mass, rtol=1e-12)
    assert np.all(np.asarray(b.omega) == 0.0)


def test_an_engine_is_the_same_for_the_point_and_the_body():
    """A throttled engine with two specific impulses: straight up from the ground, where the loss
    is that of sea level, as a point, as a body and in a gimbal."""
    full, impulse = 2.0e3, 250.0
    exits = BackPressure.of_impulses(full, impulse, 200.0)
    engine = Thrust.of_specific_impulse(full, impulse, 30.0, throttle=0.7, back_pressure=exits)
    rocket = dataclasses.replace(vehicle(ROCKETS["Calisto"]), motor=engine)
    air, mass = LocalAir(), rocket.body.loaded_mass()
    y0 = BodyState(jnp.zeros(3), jnp.zeros(3), mass=mass)
    turning = dataclasses.replace(y0, attitude=Quaternion.identity(), omega=jnp.zeros(3))
    up = FixedDirection([0.0, 0.0, 1.0])
    point = Scene(rocket.as_point(air, up), rocket.body)
    fixed = Scene(rocket.as_body(air), rocket.body)
    turned = Scene(rocket.as_body(air, control=Gimbal(up, 0.5, 0.2)), rocket.body)
    expected = full * (0.7 - (1.0 - 200.0 / impulse)) / mass
    for scene, y in ((point, y0), (fixed, turning), (turned, turning)):
        rate = scene.vector_field(1.0, y)
        np.testing.assert_allclose(rate.velocity, [0.0, 0.0, expected], rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(rate.mass, -0.7 * full / (9.80665 * impulse), rtol=1e-12)
    # Off, it has no pressure thrust either; and a throttle that is left out costs nothing.
    assert np.all(np.asarray(point.vector_field(31.0, y0).velocity) == 0.0)
    bare = Thrust.of_specific_impulse(full, impulse, 30.0)
    assert bare.throttle is None and bare.back_pressure is None

    @jax.jit
    def speed(throttle):
        motor = dataclasses.replace(engine, throttle=throttle)
        scene = Scene((GroundGravity(9.8), motor), rocket.body)
        return simulate(scene, turning, jnp.array([0.0, 5.0]), accuracy=1e-10).final.velocity[2]

    slope = (speed(0.701) - speed(0.699)) / 2e-3
    # The differences carry the tolerance over their step, and its square.
    np.testing.assert_allclose(jax.grad(speed)(0.7), slope, rtol=1e-5)


def test_a_thrust_along_the_air_meets_no_flow_from_the_side(tmp_path):
    """Over a turning planet in a wind: the drag is against the thrust, in Python and in a file."""
    wind = Wind([0.0, 1e4], [30.0, 30.0], [5.0, -5.0])
    air = LocalAir(radius=6378137.0, air_rate=7.292e-5, wind=wind)
    y = BodyState(jnp.array([6378237.0, 0.0, 2e4]), jnp.array([50.0, 465.0, 3.0]), mass=100.0)
    law = AlongAir(air)
    drag = AirDrag(0.1, 0.5, air).load(0.0, y, RigidBody(100.0)).force_N
    np.testing.assert_allclose(law.direction(0.0, y), -drag / np.linalg.norm(drag), rtol=1e-13)
    np.testing.assert_allclose(AlongAir(air, -1.0).direction(0.0, y), -law.direction(0.0, y))
    beside = AlongVelocity(7.292e-5).direction(0.0, y) @ law.direction(0.0, y)
    assert np.degrees(np.arccos(beside)) > 20.0
    # At rest in the air there is no direction, and a finite slope.
    rest = dataclasses.replace(y, velocity=air.velocity(y.position))
    assert np.all(np.asarray(law.direction(0.0, rest)) == 0.0)
    slopes = jax.jacfwd(lambda v: law.direction(0.0, dataclasses.replace(y, velocity=v)))
    assert np.all(np.isfinite(slopes(rest.velocity)))
    path = tmp_path / "wind.toml"
    path.write_text(ALONG_AIR)
    steering = load(path).mission.phases[0].system.effects[-1].steering
    assert isinstance(steering, AlongAir)
    np.testing.assert_allclose(steering.direction(0.0, y), law.direction(0.0, y), rtol=1e-12)


ALONG_AIR = """
[planet]
mu = "398600.4418 km^3/s^2"
radius = "6378.137 km"

[body]
mass = "100 kg"

[effects.steered_thrust]
mean_thrust = "2 kN"
specific_impulse = "250 s"
propellant_mass = "40 kg"

[effects.steered_thrust.steering.air]
radius = "6378.137 km"
air_rate = "7.292e-5 rad/s"
wind = { heights = ["0 m", "10 km"], east = ["30 m/s", "30 m/s"], north = ["5 m/s", "-5 m/s"] }

[initial]
position = ["6378.237 km", "0 m", "0 m"]
velocity = ["50 m/s", "465 m/s", "0 m/s"]

[[phase]]
name = "burn"
effects = ["point_gravity", "steered_thrust"]
until = "burnout"
"""


def test_more_mass_is_dropped_than_there_is():
    """The phase after such a separation is outside of the model."""
    burn = Scene((GroundGravity(9.8), AirDrag(0.1, 0.5, LocalAir())), carry=("mass",))
    y0 = BodyState(jnp.zeros(3), jnp.array([0.0, 0.0, 30.0]), mass=jnp.asarray(500.0))
    drop = Phase(burn, 1.0, Separation(600.0), name="drop")
    run = simulate_mission(Mission([drop, Phase(burn, 1.0, name="fall")]), y0, throw=False)
    assert run.status == Status.OUTSIDE_MODEL
    drop = Phase(burn, 1.0, Separation(400.0), name="drop")
    run = simulate_mission(Mission([drop, Phase(burn, 1.0, name="fall")]), y0)
    np.testing.assert_allclose(run.final.mass, 100.0)


def climbing(rocket, speed):
    """Valetudo straight up, as a point and as a body, and as one whose drag does not change."""
    air, gravity = LocalAir(elevation=668.0), GroundGravity(9.79)
    y0 = BodyState(jnp.zeros(3), jnp.array([0.0, 0.0, speed]), mass=rocket.body.loaded_mass())
    turning = dataclasses.replace(y0, attitude=Quaternion.identity(), omega=jnp.zeros(3))
    lasting = dataclasses.replace(rocket, coasting_drag=None)
    effects = (
        rocket.as_point(air, AlongVelocity()),
        rocket.as_body(air),
        lasting.as_point(air, AlongVelocity()),
    )
    scenes = (Scene((gravity, *e), rocket.body) for e in effects)
    return zip(scenes, (y0, turning, y0), strict=True)


def test_point_and_body_have_the_same_drag():
    """Valetudo, which has another drag without its flame, at 200 m/s before and after burnout."""
    rocket = vehicle(ROCKETS["Valetudo"])
    assert rocket.coasting_drag is not None and 5.0 < rocket.motor.burnout() < 6.0

    @jax.jit
    def rates(t):
        return [scene.vector_field(t, y).velocity[2] for scene, y in climbing(rocket, 200.0)]

    for t, same in ((5.0, True), (7.0, False)):
        point, body, lasting = rates(t)
        np.testing.assert_allclose(point, body, rtol=1e-12)
        # The two curves of its drag differ by a few percent.
        assert (abs(lasting - point) < 1e-12 * abs(point)) == same
        assert abs(lasting - point) < 0.1 * abs(point)


# The forces of this flight are compared above.
@pytest.mark.sweep
def test_point_and_body_coast_with_the_same_drag():
    """Valetudo, which has another drag without its flame, straight up through its burnout."""
    rocket = vehicle(ROCKETS["Valetudo"])
    t = jnp.array([0.0, 5.0, 9.0])
    point, body, other = (
        np.asarray(simulate(scene, start, t, accuracy=1e-9).states.position[2])
        for scene, start in climbing(rocket, 30.0)
    )
    # The same equations: a hundred times the tolerance of both integrations.
    np.testing.assert_allclose(point, body, rtol=1e-7)
    np.testing.assert_allclose(other[1], point[1], rtol=1e-7)
    # The two curves of its drag differ by a few percent: again a hundred times as much.
    assert abs(other[2] - point[2]) > 0.01


def test_a_parachute_descends_at_its_steady_rate():
    air = LocalAir(ExponentialAtmosphere(1.2, 0.0, 1e9))
    scene = Scene([GroundGravity(9.81), Parachute(2.0, air=air)], RigidBody(16.0))
    y0 = BodyState(jnp.array([0.0, 0.0, 1000.0]), jnp.array([5.0, 0.0, 0.0]))
    run = simulate(scene, y0, jnp.array([0.0, 30.0]), accuracy=1e-8)
    expected = descent_rate(16.0, 2.0, 1.2, 9.81)
    np.testing.assert_allclose(-run.final.velocity[2], expected, rtol=1e-5)


def test_a_parachute_without_an_opening_is_open_all_the_time():
    """As one that opened long ago, but without the ends of steps at its opening."""
    y = BodyState(jnp.array([0.0, 0.0, 900.0]), jnp.array([4.0, -1.0, -30.0]))
    body, t = RigidBody(16.0), jnp.asarray(-3.0)
    still, filled = Parachute(2.0), Parachute(2.0, -9.0, 2.0)
    for a, b in zip(
        *(jax.tree.leaves(chute.load(t, y, body)) for chute in (still, filled)), strict=True
    ):
        np.testing.assert_array_equal(a, b)
    assert still.breaks() is None
    np.testing.assert_array_equal(Parachute(2.0, 5.0).breaks(), [5.0])
    np.testing.assert_array_equal(filled.breaks(), [-9.0, -7.0])
    assert np.all(Parachute(2.0, 5.0).load(t, y, body).force_N == 0.0)
    with pytest.raises(InputError, match="Parachute.inflation_time is given without an opening"):
        Parachute(2.0, inflation_time=1.0)


@pytest.mark.sweep
def test_a_bare_tube_goes_straight_up_in_calm_air_and_comes_down_at_its_rail(tmp_path):
    """Without fins, nose and drag up to the closed form of a rocket in uniform gravity (Thomson
    8.1), and down at the steady rate of its parachute."""
    (tmp_path / "motor.csv").write_text("0,500\n2,500\n")
    rocket = Vehicle.model_rocket(
        tmp_path / "motor.csv",
        propellant_mass=0.5,
        radius=0.05,
        mass=4.0,
        inertia=[1.0, 1.0, 0.01],
        centre=0.0,
        case_mass=0.5,
        case_station=-0.5,
        propellant_station=-0.5,
        grain=(0.02, 0.01, 0.2),
        exit_station=-0.7,
        exit_radius=0.01,
        drag=0.0,
    )
    at = LaunchSite(5.0, 0.5 * jnp.pi)
    mission, y0 = sounding_flight(rocket, at, [Recovery(2.0)], ascent_within=60.0)
    accuracy = Accuracy(rtol=1e-8, method=Tsit5())
    run = simulate_mission(mission, y0, accuracy=accuracy)
    u, tau, ratio, g = 500.0 * 2.0 / 0.5, 2.0, 5.0 / 4.5, STANDARD_GRAVITY
    speed = u * np.log(ratio) - g * tau
    burnt_out = u * tau * (1.0 - np.log(ratio) / (ratio - 1.0)) - 0.5 * g * tau**2
    top = run["ascent"].final.position
    np.testing.assert_allclose(top[2], burnt_out + speed**2 / (2.0 * g), rtol=1e-6)
    down = run.final.position, run.final.velocity
    # The cosine of a right angle is 6e-17.
    assert np.all(np.abs(top[:2]) < 1e-10) and np.all(np.abs(down[0]) < 1e-6)
    density = float(standard_atmosphere(0.0).density)
    # Air of 10 km lags behind by v^2/(2 g 10 km), 1e-4.
    np.testing.assert_allclose(-down[1][2], descent_rate(4.5, 2.0, density, g), rtol=1e-3)


def test_the_attitude_on_the_rail_points_along_it():
    for inclination, heading in ((85.0, 0.0), (80.0, 53.0), (90.0, 181.0)):
        at = LaunchSite(5.0, np.radians(inclination), np.radians(heading))
        axis = at.attitude.rotate(jnp.array([0.0, 0.0, 1.0]))
        np.testing.assert_allclose(axis, at.direction, atol=1e-15)


# Of `python benchmarks/_rocketpy.py` with RocketPy 1.13.0: apogee above the ground, m, its time, s,
# speed at the end of the rail, m/s, time of the landing, s, and its place to the east and north, m.
CORRECTED = {
    "Calisto": (3292.3909, 25.8203, 30.4710, 297.5417, 1342.3594, 518.7124),
    "NDRT 2020": (1318.1497, 16.8164, 19.5493, 88.9451, 138.6691, -141.7750),
    "Valetudo": (813.2419, 13.9589, 26.3102, 60.4523, 294.8413, 145.4656),
}
AS_SHIPPED = {
    "Calisto": (3287.7924, 25.7986, 30.4710, 297.3249, 1253.4396, 505.6732),
    "NDRT 2020": (1317.4023, 16.8151, 19.5493, 88.9697, 121.0738, -152.1571),
    "Valetudo": (815.0535, 13.9724, 26.3102, 60.5587, 282.9710, 141.4757),
}


def mirrored(rocket):
    """The rocket as RocketPy 1.13 flies it: with its propellant and its nozzle ahead of the centre
    of dry mass."""
    places = lambda v: (v.body.propellant_station, v.exit_station)  # noqa: E731
    return eqx.tree_at(places, rocket, tuple(-x for x in places(rocket)))


@pytest.fixture
def quickly_compiled():
    """Without the compiler's optimisations, which here cost minutes and save seconds."""
    before = jax.config.read("jax_disable_most_optimizations")
    jax.config.update("jax_disable_most_optimizations", True)
    yield
    jax.config.update("jax_disable_most_optimizations", before)


@pytest.mark.sweep
def test_three_rockets_fly_as_in_rocketpy(quickly_compiled):
    """Apogee, landing and drift within one percent, of the rockets as they are against RocketPy
    with its centre of mass on the right side, and of mirrored ones against RocketPy as shipped.

    Both sides take the same tables; what is left are an added mass of the parachutes, the force of
    Coriolis of the gas within the motor, the sine of the angle of attack in place of the angle,
    and for RocketPy as shipped a quarter of the square of the nozzle's lever in the jet damping."""
    given = list(ROCKETS.values())
    rockets = [vehicle(r, 37) for r in given]
    batch = stacked(rockets + [mirrored(r) for r in rockets])
    sites = stacked([site(r) for r in given] * 2)
    chutes = [stacked([recovery(r)[k] for r in given] * 2) for k in (0, 1)]
    mission, y0 = sounding_flight(batch, sites, chutes, ascent_within=60.0, descent_within=200.0)
    accuracy = Accuracy(rtol=1e-6, method=diffrax.Tsit5())
    run = simulate_mission_batch(mission, y0, 0.0, accuracy=accuracy)
    expected = np.array([*CORRECTED.values(), *AS_SHIPPED.values()]).T
    phases = dict(zip(run.names, run.phases, strict=True))
    apogee = phases["ascent"].states.position[2, -1]
    np.testing.assert_allclose(apogee, expected[0], rtol=2e-3)
    np.testing.assert_allclose(phases["ascent"].ts[-1], expected[1], rtol=2e-3)
    speed = np.linalg.norm(phases["rail"].states.velocity[:, -1], axis=0)
    np.testing.assert_allclose(speed, expected[2], rtol=2e-4)
    np.testing.assert_allclose(run.end, expected[3], rtol=1e-2)
    landing = np.asarray(run.final.position[:2])
    drift, wanted = np.linalg.norm(landing, axis=0), np.linalg.norm(expected[4:], axis=0)
    np.testing.assert_allclose(drift, wanted, rtol=1e-2)
    apart = np.linalg.norm(landing - expected[4:], axis=0) / wanted
    assert np.all(apart[:3] < 1e-2) and np.all(apart[3:] < 2e-2)


def test_stored_numbers_show_the_sign_that_rocketpy_takes():
    """The drift of Calisto differs by seven percent between the two: what the batch above tells
    apart."""
    drifts = [np.linalg.norm(table["Calisto"][4:]) for table in (CORRECTED, AS_SHIPPED)]
    assert drifts[0] > 1.05 * drifts[1]


def test_the_campaigns_of_both_land_about_the_same_place():
    """Means and deviations of the stored campaigns, which both draw for themselves, within four
    sampling errors: RocketPy as shipped lands five of them further west."""
    stored = (
        Path(__file__).parents[2] / "benchmarks" / "results" / "avx512" / "rocket_campaign.json"
    )
    ours, theirs = json.loads(stored.read_text())["rows"].values()
    names = [name for name in theirs if name.startswith(("mean", "deviation"))]
    assert len(names) == 6
    for name in names:
        (a, error), (b, other) = (map(float, row[name].split(" ± ")) for row in (ours, theirs))
        assert abs(a - b) < 4.0 * np.hypot(error, other), name
