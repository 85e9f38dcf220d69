"""Thrust vector control: loads by hand, the linear loop, files, and the flight as a point."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from test_rockets_steering_files import angle_of, lagging
from test_vehicles import ROCKETS, vehicle

import jaxspace
from jaxspace import BodyState, Scene, simulate
from jaxspace.bodies import RigidBody
from jaxspace.bodies.inertia import as_inertia
from jaxspace.core import InputError
from jaxspace.io import SceneError
from jaxspace.rockets import Gimbal, GimballedThrust, JetDamping
from jaxspace.rockets.steering import FixedDirection
from jaxspace.rotations import Quaternion
from jaxspace.vehicles.local_air import LocalAir

THRUST, LEVER, INERTIA = 2000.0, 1.5, 400.0
UP = FixedDirection([0.0, 0.0, 1.0])
BODY = RigidBody(100.0, as_inertia(jnp.array([INERTIA, INERTIA, 50.0])))


def state(attitude, omega):
    zero = jnp.zeros(3)
    return BodyState(zero, zero, attitude, jnp.asarray(omega), jnp.asarray(100.0))


def test_the_load_of_a_gimbal():
    """Tilted by 0.05 rad about x: the nozzle turns by the gain over it, within its limit, and the
    couple turns the axis back; slopes are finite where nothing is commanded."""
    gimbal = Gimbal(UP, gain=0.8, damping=0.3, limit=0.1)
    motor = GimballedThrust(gimbal, THRUST, 3000.0, 50.0, -LEVER)
    y = state(Quaternion.about(0, jnp.asarray(0.05)), [0.02, -0.01, 0.4])
    load = motor.load(jnp.asarray(1.0), y, BODY)
    # The direction of the law in body axes is (0, sin 0.05, cos 0.05).
    theta = np.array([-0.8 * np.sin(0.05) - 0.3 * 0.02, 0.3 * 0.01])
    s = theta / np.sqrt(1.0 + theta @ theta / np.tan(0.1) ** 2)
    force = THRUST * np.array([-s[1], s[0], 1.0]) / np.sqrt(1.0 + s @ s)
    np.testing.assert_allclose(load.force_N, y.attitude.rotate(jnp.asarray(force)), rtol=1e-13)
    couple = np.cross([0.0, 0.0, -LEVER], force)
    np.testing.assert_allclose(load.torque_B, couple, rtol=1e-13, atol=1e-12)
    assert couple[0] < 0.0  # against the tilt
    np.testing.assert_allclose(load.mass_rate, -THRUST / 3000.0, rtol=1e-14)
    far = dataclasses.replace(y, omega=jnp.array([-1e3, 0.0, 0.0]))
    turned = motor.load(jnp.asarray(1.0), far, BODY).force_N
    angle = jnp.arccos(y.attitude.rotate_back(turned)[2] / THRUST)
    np.testing.assert_allclose(angle, 0.1, rtol=1e-6)
    still = state(Quaternion.identity(), [0.0, 0.0, 0.0])
    slopes = jax.grad(lambda g: jnp.sum(motor.load(0.0, g, BODY).torque_B ** 2))(still)
    assert all(bool(jnp.all(jnp.isfinite(x))) for x in jax.tree.leaves(slopes))


def test_small_errors_obey_the_linear_loop():
    """A theta'' + F l (c theta' + k theta) = 0, from 1e-4 rad; the error is of third order, and the
    mass hardly changes."""
    gain, damping = 0.5, 0.4
    motor = GimballedThrust(Gimbal(UP, gain, damping, 0.2), THRUST, 1e12, 100.0, -LEVER)
    y0 = state(Quaternion.about(1, jnp.asarray(1e-4)), [0.0, 0.0, 0.0])
    ts = jnp.linspace(0.0, 6.0, 13)
    run = simulate(Scene([motor], BODY), y0, ts, accuracy=1e-11)
    tilt = 2.0 * np.asarray(run.states.attitude.wxyz[2])
    k, c = (THRUST * LEVER / INERTIA * x for x in (gain, damping))
    root = np.sqrt(k - 0.25 * c * c + 0j)
    ts = np.asarray(ts)
    exact = np.exp(-0.5 * c * ts) * (np.cos(root * ts) + 0.5 * c / root * np.sin(root * ts))
    np.testing.assert_allclose(tilt, 1e-4 * exact.real, atol=1e-11)


FILE = """
[planet]
mu = "398600.4418 km^3/s^2"
radius = "6378.137 km"

[body]
mass = "100 kg"
inertia = [400.0, 400.0, 50.0]

[effects.point_gravity]

[effects.gimballed_thrust]
mean_thrust = "2 kN"
specific_impulse = "250 s"
propellant_mass = "40 kg"
station = "-1.5 m"

[effects.gimballed_thrust.gimbal]
gain = 0.8
damping = "0.6 s"
limit = "5 deg"

[effects.gimballed_thrust.gimbal.steering]
times = [0.0, 5.0, 40.0]
angles = ["90 deg", "90 deg", "60 deg"]
plane = { normal = [0.0, 1.0, 0.0], up = [1.0, 0.0, 0.0] }

[initial]
position = ["6378.137 km", 0.0, 0.0]
velocity = [0.0, 0.0, "400 m/s"]
attitude = { along = "position" }
omega = [0.0, 0.0, 0.0]

[[phase]]
name = "burn"
effects = ["point_gravity", "gimballed_thrust"]
until = "burnout"
"""


def test_a_gimbal_in_a_file(tmp_path):
    """The axis follows the table of the pitch, lags by the loop, and the burn ends by its time:
    A x'' + F l (c x' + k x) = -F l c theta_c' for the lead x over the command."""
    path = tmp_path / "gimbal.toml"
    path.write_text(FILE)
    file = jaxspace.load(path)
    (phase,) = file.mission.phases
    motor = phase.system.effects[-1]
    assert isinstance(motor, GimballedThrust)
    np.testing.assert_allclose(phase.until, 40.0 * 250.0 * 9.80665 / 2000.0, rtol=1e-12)
    np.testing.assert_allclose(motor.gimbal.limit, np.radians(5.0), rtol=1e-12)
    burn = file.simulate(num_saved=99)["burn"]
    t, rate = np.asarray(burn.ts), np.radians(30.0) / 35.0
    np.testing.assert_allclose(t[-1], phase.until, rtol=1e-9)
    stiffness, damping = (THRUST * LEVER / INERTIA * x for x in (0.8, 0.6))
    # The table begins to turn at 5 s; its end at 40 s is a turn back by the same rate.
    turning = rate * np.clip(t - 5.0, 0.0, 35.0)
    for start, change in ((5.0, rate), (40.0, -rate)):
        since = np.maximum(t - start, 0.0)
        turning = turning + lagging(since, change, damping, stiffness)
    # The limit bends a command of 0.01 rad by a share of 0.01^2/(2 tan^2 5 deg), of a lag of 0.011
    # rad.
    np.testing.assert_allclose(angle_of(burn.states.attitude), turning, atol=5e-5)
    path.write_text(FILE.replace("damping =", "dampin ="))
    with pytest.raises(SceneError, match=r"effects.gimballed_thrust.gimbal.dampin"):
        jaxspace.load(path)


def test_a_vehicle_with_a_gimbal():
    """The motor of the vehicle gives way to that in the gimbal; without a nozzle it is refused."""
    rocket = vehicle(ROCKETS["Calisto"])
    gimbal = Gimbal(UP, 0.5, 0.2)
    effects = rocket.as_body(LocalAir(), control=gimbal)
    motor = effects[0]
    assert isinstance(motor, GimballedThrust) and isinstance(effects[-1], JetDamping)
    np.testing.assert_allclose(motor.mean_thrust, rocket.motor.mean_thrust, rtol=1e-14)
    bare = dataclasses.replace(rocket, exit_station=None)
    with pytest.raises(InputError, match="exit_station is None"):
        bare.as_body(LocalAir(), control=gimbal)
