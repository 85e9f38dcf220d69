"""Steering laws, thrust along them, and control of the attitude."""

import dataclasses
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxspace
from jaxspace import BodyState, Scene, simulate, simulate_mission
from jaxspace.bodies import Load, RigidBody
from jaxspace.core import InputError
from jaxspace.core.vectors import axis
from jaxspace.io import SceneError
from jaxspace.optimization.ascent import Ascent, ConstantMassFlow, burnout_state
from jaxspace.optimization.steering import LinearTangentSteering
from jaxspace.orbits import PointGravity, UniformGravity
from jaxspace.rockets import (
    AttitudeControl,
    BackPressure,
    GravityTurn,
    GravityTurnState,
    PitchKick,
    Separation,
    SteeredThrust,
    ThrottleTable,
    Thrust,
    ThrustProfile,
)
from jaxspace.rockets.steering import (
    AlongVelocity,
    FixedDirection,
    FlightPlane,
    PitchPolynomial,
    PitchTable,
    TangentSteering,
    UserSteering,
)
from jaxspace.rotations import Quaternion
from jaxspace.scene import Custom
from jaxspace.simulation import Accuracy, Mission, Phase
from jaxspace.solvers import Tsit5

FLAT = FlightPlane(up=jnp.array([0.0, 0.0, 1.0]))
Y = BodyState(jnp.array([0.0, 300.0, 6.4e6]), jnp.array([40.0, 0.0, 30.0]), mass=jnp.array(1000.0))


def pitch_of(law, t, y=Y):
    d = law.direction(jnp.asarray(t), y)
    np.testing.assert_allclose(np.linalg.norm(d), 1.0, rtol=1e-14)
    np.testing.assert_allclose(d[1], 0.0, atol=1e-14)
    return float(np.arctan2(d[2], d[0]))


def test_pitch_laws():
    table = PitchTable([0.0, 10.0, 30.0], [1.5, 1.0, 0.2], FLAT)
    found = [pitch_of(table, t) for t in (-1.0, 5.0, 20.0, 40.0)]
    np.testing.assert_allclose(found, [1.5, 1.25, 0.6, 0.2], rtol=1e-13)
    np.testing.assert_array_equal(table.breaks(), [0.0, 10.0, 30.0])
    polynomial = PitchPolynomial([1.5, -0.1, 1e-3], 2.0, FLAT)
    np.testing.assert_allclose(pitch_of(polynomial, 7.0), 1.5 - 0.5 + 0.025, rtol=1e-13)
    linear = TangentSteering(0.8, -0.01, plane=FLAT)
    np.testing.assert_allclose(np.tan(pitch_of(linear, 30.0)), 0.5, rtol=1e-13)
    bilinear = TangentSteering(0.8, -0.01, 0.02, 10.0, FLAT)
    np.testing.assert_allclose(np.tan(pitch_of(bilinear, 30.0)), 0.6 / 1.4, rtol=1e-13)


def test_directions_by_the_state():
    # Up along the position, which is not the z axis here.
    local = TangentSteering(0.0, 0.0).direction(jnp.zeros(()), Y)
    np.testing.assert_allclose(np.dot(local, Y.position), 0.0, atol=1e-9)
    np.testing.assert_allclose(local[0], 1.0, rtol=1e-8)
    np.testing.assert_allclose(AlongVelocity().direction(0.0, Y), [0.8, 0.0, 0.6], rtol=1e-14)
    found = AlongVelocity(sense=-1.0).direction(0.0, Y)
    np.testing.assert_allclose(found, [-0.8, 0.0, -0.6], rtol=1e-14)
    # The wind of air that turns about z: -Omega y along x.
    against = AlongVelocity(0.1).direction(0.0, Y)
    np.testing.assert_allclose(against, [70.0 / np.hypot(70, 30), 0, 30 / np.hypot(70, 30)])
    fixed = FixedDirection([0.0, 0.0, 5.0]).direction(0.0, Y)
    np.testing.assert_allclose(fixed, [0.0, 0.0, 1.0])
    user = UserSteering(lambda t, y: y.velocity + t * axis(1, t)).direction(jnp.array(50.0), Y)
    np.testing.assert_allclose(user, np.array([40.0, 50.0, 30.0]) / np.sqrt(5000.0))
    # At rest there is no direction, and no NaN.
    rest = BodyState(Y.position, jnp.zeros(3), mass=Y.mass)
    np.testing.assert_array_equal(AlongVelocity().direction(0.0, rest), np.zeros(3))


def test_a_pitch_kick_turns_the_velocity_in_the_air():
    """By its angle, in the plane of the flight, of two runs at once; its speed in the air stays, a
    rocket at rest stays at rest, and the slope by the angle is the velocity across."""
    r = jnp.array([[6.4e6, 0.0], [0.0, 6.4e6], [0.0, 0.0]])
    wind = jnp.array([[0.0, -464.0], [464.0, 0.0], [0.0, 0.0]])
    up = r / 6.4e6
    y = BodyState(r, wind + 80.0 * up, mass=jnp.array([9.0, 8.0]))
    plane = FlightPlane(normal=[0.0, 0.0, 1.0])
    kick = PitchKick(jnp.array([0.1, 0.3]), 464.0 / 6.4e6, plane)
    turned = kick(0.0, y).velocity - wind
    east = jnp.stack([-up[1], up[0], up[2]])
    angle = np.array([0.1, 0.3])
    expected = 80.0 * (np.cos(angle) * up + np.sin(angle) * east)
    # The wind is larger than what is turned: some of its last digits are left.
    np.testing.assert_allclose(turned, expected, atol=1e-11)
    at_rest = BodyState(r[:, 0], jnp.zeros(3))
    np.testing.assert_array_equal(PitchKick(0.1)(0.0, at_rest).velocity, np.zeros(3))
    slope = jax.jacobian(lambda k: PitchKick(k)(0.0, Y).velocity)(0.0)
    # Without a plane the flight is in x and z, with up along the position.
    e = Y.position / np.linalg.norm(Y.position)
    about = np.array([0.0, 1.0, 0.0]) - e[1] * e
    about = about / np.linalg.norm(about)
    np.testing.assert_allclose(slope, np.cross(about, Y.velocity), rtol=1e-12, atol=1e-12)


def test_thrust_along_a_law():
    """Throttle, pressure at the ground and in vacuum, mass flow, and the same motor as a body that
    rotates has it."""
    profile = ThrustProfile.of_table([0.0, 1.0, 4.0], [1.0, 2.0, 0.0])
    air = BackPressure(0.5, 6.4e6, 1e5, 7000.0)
    law = FixedDirection([0.0, 1.0, 0.0])
    engine = SteeredThrust.of_propellant(
        law, 2e5, 300.0, 5000.0, throttle=0.8, ignition=3.0, back_pressure=air
    )
    np.testing.assert_allclose(engine.burn_time, 5000.0 * 300.0 * 9.80665 / 1.6e5, rtol=1e-14)
    ground = BodyState(jnp.array([6.4e6, 0.0, 0.0]), jnp.zeros(3), mass=jnp.array(1e4))
    load = engine.load(jnp.array(5.0), ground, RigidBody())
    np.testing.assert_allclose(load.force_N, [0.0, 1.6e5 - 5e4, 0.0], rtol=1e-13)
    np.testing.assert_allclose(load.mass_rate, -1.6e5 / (300.0 * 9.80665), rtol=1e-13)
    off = engine.load(jnp.array(1.0), ground, RigidBody())
    np.testing.assert_array_equal(off.force_N, np.zeros(3))
    high = dataclasses.replace(ground, position=jnp.array([6.4e6 + 7e5, 0.0, 0.0]))
    force = engine.load(jnp.array(5.0), high, RigidBody()).force_N[1]
    np.testing.assert_allclose(force, 1.6e5 - 5e4 * np.exp(-100.0), rtol=1e-13)

    motor = Thrust(2e5, 2900.0, 20.0, profile, ignition=2.0, burnout_mass=500.0)
    point = SteeredThrust.of_thrust(motor, PitchTable([1.0, 9.0], [1.0, 0.0]))
    for t in (1.0, 3.0, 8.0, 30.0):
        at = (jnp.array(t), jnp.array(900.0))
        assert point.thrust(*at) == motor.thrust(*at)
        assert point.mass_rate(*at) == motor.mass_rate(*at)
    np.testing.assert_allclose(point.breaks(), [2.0, 7.0, 22.0, 1.0, 9.0])
    assert point.burnout() == 22.0
    np.testing.assert_allclose(point.propellant_left(Y), 500.0, rtol=1e-9)
    assert Separation(300.0)(0.0, Y).mass == 700.0


def test_a_gravity_turn_is_a_thrust_along_the_velocity():
    """The rates of speed and angle of the scene are those of `GravityTurn`."""
    g, R, m0, flow = 9.8, 6.4e6, 1000.0, 5.0
    engine = SteeredThrust(AlongVelocity(), 1.4 * m0 * g, 1.4 * m0 * g / flow, 150.0)
    scene = Scene([PointGravity(g * R**2), engine])
    system = GravityTurn(1.4, g, flow / m0, R)
    psi, v, t, h = 0.6, 500.0, 40.0, 2e4
    y = BodyState(
        jnp.array([0.0, 0.0, R + h]),
        v * jnp.array([np.sin(psi), 0.0, np.cos(psi)]),
        mass=jnp.array(m0 - flow * t),
    )
    rate = scene.vector_field(jnp.array(t), y).velocity
    expected = system.vector_field(
        jnp.array(t), GravityTurnState(*map(jnp.array, (v, psi, 0.0, h)))
    )
    along = float(rate @ y.velocity) / v
    across = float(rate[0] * np.cos(psi) - rate[2] * np.sin(psi)) / v
    np.testing.assert_allclose(along, expected.speed, rtol=1e-12)
    # The system counts the angle from the local vertical, which turns by v sin(psi)/r.
    np.testing.assert_allclose(across - v * np.sin(psi) / (R + h), expected.angle, rtol=1e-12)


def test_a_steered_burn_is_that_of_the_quadrature():
    u, tau, tb, g = 3000.0, 200.0, 120.0, 9.8
    ascent = Ascent(ConstantMassFlow(u, tau), tb, 0.0, 0.0, 1e5, g)
    steering = LinearTangentSteering(*map(jnp.array, (0.9, 300.0, 0.0, True)))
    expected = burnout_state(ascent, jnp.zeros(()), steering.angle)
    law = TangentSteering(jnp.tan(0.9), -jnp.tan(0.9) / 300.0, plane=FLAT)
    down = Custom(
        lambda t, y, b: Load(acceleration_N=-g * axis(2, y.position[2])),
    )
    scene = Scene([down, SteeredThrust(law, u * 5.0, u, tb)])
    y0 = BodyState(jnp.zeros(3), jnp.zeros(3), mass=jnp.array(5.0 * tau))
    end = simulate(scene, y0, jnp.array([0.0, tb]), accuracy=1e-11).final
    found = [end.position[0], end.position[2], end.velocity[0], end.velocity[2], end.mass]
    assert scene.parts == ("position", "velocity", "mass")
    np.testing.assert_allclose(
        found, [expected.x, expected.y, expected.u, expected.w, 400.0], rtol=1e-9
    )


def test_a_schedule_throttles_over_the_burn():
    """By Tsiolkovsky's formula with the area of the table, in a phase that ignites after another;
    and the derivative of the mass by each throttle, which is the area of its hat."""
    u, full, delay = 3000.0, 2e4, 1.0
    times, throttles = np.array([0.0, 1.0, 4.0, 5.0]), np.array([0.5, 1.0, 0.4, 0.8])
    y0 = BodyState(jnp.zeros(3), jnp.zeros(3), mass=jnp.array(1000.0))

    def burnt(x):
        engine = SteeredThrust(
            FixedDirection([1.0, 0.0, 0.0]),
            mean_thrust=full,
            exhaust_velocity=u,
            burn_time=7.0,
            delay=delay,
            schedule=ThrottleTable(times, x),
        )
        coast = Phase(Scene([UniformGravity([0.0, 0.0, 0.0])], carry=("mass",)), 2.0, name="coast")
        mission = Mission([coast, Phase(Scene([engine]), 10.0)])
        end = simulate_mission(mission, y0, accuracy=Accuracy(1e-9, method=Tsit5())).final
        return end.mass, (end.mass, end.velocity[0])

    slope, (mass, speed) = jax.jacfwd(burnt, has_aux=True)(jnp.asarray(throttles))
    hats = np.array([0.5, 2.0, 2.0, 0.5])
    # The last throttle stays from 5 s to the end of the burn, at 7 s.
    hats[-1] += 2.0
    expected = 1000.0 - full / u * (hats @ throttles)
    np.testing.assert_allclose(mass, expected, rtol=1e-9)
    np.testing.assert_allclose(speed, u * np.log(1000.0 / expected), rtol=1e-8)
    np.testing.assert_allclose(slope, -full / u * hats, rtol=1e-9)


def test_what_is_wrong_with_a_schedule_is_said():
    for times, throttles, sentence in (
        ([0.0, 1.0], [0.5], "2 times and 1 throttles"),
        ([1.0, 0.0], [0.5, 0.5], "ThrottleTable.times"),
        ([0.0, 1.0], [0.5, 1.5], "ThrottleTable.throttles"),
    ):
        with pytest.raises(InputError, match=sentence):
            ThrottleTable(times, throttles)


def test_control_of_the_attitude():
    control = AttitudeControl(FixedDirection([1.0, 0.0, 0.0]), 50.0, 4.0)
    y = BodyState(
        Y.position,
        Y.velocity,
        Quaternion.about(1, jnp.asarray(0.5)),
        jnp.array([0.1, 0.2, -0.3]),
    )
    torque = control.load(jnp.zeros(()), y, RigidBody()).torque_B
    # The axis stands 0.5 rad from z towards x: it must turn by pi/2 - 0.5 about y.
    np.testing.assert_allclose(
        torque, 50.0 * np.sin(0.5 * np.pi - 0.5) * np.eye(3)[1] - 4.0 * np.asarray(y.omega)
    )


# ---------------------------------------------------------------- files

LAUNCH = Path(__file__).parents[2] / "examples" / "scenes" / "launch.toml"


def test_a_file_steers_two_stages(tmp_path):
    """Two effects of one class in one file; the law by the keys of its table."""
    file = jaxspace.load(LAUNCH)
    first, coast, second = file.mission.phases
    motors = [phase.system.effects[-1] for phase in (first, second)]
    assert [type(m.steering).__name__ for m in motors] == ["PitchTable", "TangentSteering"]
    np.testing.assert_allclose(first.until, 9250.0 * 311.0 * 9.80665 / 190e3, rtol=1e-12)
    assert [p.then is None for p in (first, coast, second)] == [False, False, True]
    text = LAUNCH.read_text().replace("tangent_rate = -0.0016", "tangent_rat = 1.0")
    (tmp_path / "wrong.toml").write_text(text)
    with pytest.raises(SceneError, match="effects.steered_thrust_2.steering.tangent_rat"):
        jaxspace.load(tmp_path / "wrong.toml")


def test_one_coefficient_of_a_file_is_a_constant_pitch(tmp_path):
    """A table of the pitch takes two times or more."""
    path = tmp_path / "one.toml"
    flown = LAUNCH.read_text().partition("[optimize")[0]
    law = flown.partition("steered_thrust.steering]\n")[2].partition("plane")[0]
    path.write_text(flown.replace(law, "coefficients = [0.4]\n"))
    steering = jaxspace.load(path).mission.phases[0].system.effects[-1].steering
    assert float(steering.pitch(jnp.array(7.0))) == 0.4
    path.write_text(flown.replace(law, "times = [1.0]\nangles = [0.4]\n"))
    with pytest.raises(SceneError, match="times is .1.0.: it must be a list of at least 2 entries"):
        jaxspace.load(path)
