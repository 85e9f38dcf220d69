"""Steady motions are steady: each is fed back into the vector field of its own system."""

import importlib
import inspect
import re

import jax
import jax.numpy as jnp
import pytest
from numpy.testing import assert_allclose

from jaxspace import BodyState
from jaxspace.attitude import RollingDisk, ShaftPendulum, SphericalPendulum, Top
from jaxspace.core.modules import public_names
from jaxspace.core.vectors import axis, cross, dot
from jaxspace.gyros import Gyrocompass, PlatformAxis, RateGyro, RateGyroState, StablePlatform
from jaxspace.mechanics import ArmPendulum, ArmState, BarOnSpring, RotatingHoop
from jaxspace.orbits import TwoBody
from jaxspace.orbits.burnout import circular_speed
from jaxspace.orbits.radial_motion import circular_rate

COMPASS = Gyrocompass(339.0, 0.2, 0.25, 8.5, 0.8, damping_moment=0.17, speed=8.0, course=0.3)
SOUTHERN = Gyrocompass(339.0, 0.2, 0.2, 8.5, -0.8)
GYRO = RateGyro(1e-4, 0.004, 0.05, spring=0.2, input_rate=0.1, spin_axis_rate=0.7, bias_torque=1e-4)
DISK = RollingDisk.hoop(1.0, 0.3, 9.8)
TOP = Top(0.002, 0.0008, 0.3)
PENDULUM = SphericalPendulum(0.8, 9.8)
HOOP = RotatingHoop(0.2, 0.5, 6.0, 9.8)
BAR = BarOnSpring(1.5, 40.0, 0.6, 0.3, 9.8)
ARM = ArmPendulum(3.0, 0.1, 1.2, 0.4)
SERVO = PlatformAxis(0.4, 2e-4, 0.05, gain=2.0, gyro_damping=0.01)
PLATFORM = StablePlatform((0.3, 0.4, 0.5), 0.02, 2e-4, 0.05, vehicle_rate=(0.1, -0.2, 0.3))


def whole(y):
    """All of a state: nothing of it moves."""
    return jnp.concatenate([jnp.ravel(x) for x in jax.tree.leaves(y)])


def about_the_vertical(y):
    """What a body that precesses keeps: its tilt, and its rates along the axis z, the vertical Z
    and the line of nodes, along which the tilt moves."""
    z = axis(2, jnp.ones(()))
    Z = y.attitude.rotate_back(z)
    return jnp.stack([Z[2], *(dot(y.omega, x) for x in (z, Z, cross(Z, z)))])


def on_a_cone(y):
    """Height of a pendulum and its rate, and its speed squared."""
    return jnp.stack([y.direction[2], y.direction_rate[2], dot(y.direction_rate, y.direction_rate)])


def on_a_circle(y):
    """Radius, speed along it and speed, each squared where it has a root."""
    r, v = y.position, y.velocity
    return jnp.stack([dot(r, r), dot(r, v), dot(v, v)])


def precessing(theta, rate, spin):
    """Angles and rates of a body of that spin n = phi' + psi' cos(theta)."""
    return jnp.array([0.3, theta, 0.2]), jnp.stack([rate, 0.0, spin - rate * jnp.cos(theta)])


def on_circles(theta, rate):
    return DISK.state(*precessing(theta, rate, DISK.steady_spin(theta, rate)))


def on_a_disk_of_spin(theta, spin, which):
    return DISK.state(*precessing(theta, DISK.steady_precession_rates(theta, spin)[which], spin))


def top_of_spin(theta, spin, which):
    return TOP.state(*precessing(theta, TOP.steady_precession_rates(theta, spin)[which], spin))


def top_of_momentum(theta, h_Z, which):
    rate = TOP.precession_rates_from_momentum(theta, h_Z)[which]
    spin = (h_Z - 0.002 * rate * jnp.sin(theta) ** 2) / (0.0008 * jnp.cos(theta))
    return TOP.state(*precessing(theta, rate, spin))


def circling(speed):
    return BodyState(jnp.array([2.0, 0.0, 0.0]), jnp.stack([0.0, speed, 0.0]))


def at_rest(compass):
    return compass.state(compass.rest_tilt, compass.rest_azimuth)


SHAFT = ShaftPendulum(0.1, 0.02, 2.0, 8.0)

# By the name: the system, the state, what it keeps, and the size of a rate that is no rounding.
STEADY = {
    # The moments of the inertias leave the earth's rate squared.
    "gyros.Gyrocompass.rest_tilt": (COMPASS, lambda: at_rest(COMPASS), whole, 1e-8),
    "gyros.Gyrocompass.rest_azimuth": (SOUTHERN, lambda: at_rest(SOUTHERN), whole, 1e-8),
    "gyros.RateGyro.steady_angle": (
        *(GYRO, lambda: RateGyroState(GYRO.steady_angle, jnp.zeros(())), whole),
        1e-12,
    ),
    "gyros.PlatformAxis.at_rest": (SERVO, lambda: SERVO.at_rest, whole, 0.0),
    "attitude.RollingDisk.steady_spin": (
        *(DISK, lambda: on_circles(1.2, 2.0), about_the_vertical),
        1e-12,
    ),
    "attitude.RollingDisk.steady_precession_rates": (
        *(DISK, lambda: on_a_disk_of_spin(0.7, 9.0, 0), about_the_vertical),
        1e-12,
    ),
    "attitude.RollingDisk.steady_precession_rates, fast": (
        *(DISK, lambda: on_a_disk_of_spin(2.0, 9.0, 1), about_the_vertical),
        1e-10,
    ),
    "attitude.Top.steady_precession_rates": (
        *(TOP, lambda: top_of_spin(0.7, 150.0, 0), about_the_vertical),
        1e-10,
    ),
    "attitude.Top.steady_precession_rates, fast": (
        *(TOP, lambda: top_of_spin(0.7, 150.0, 1), about_the_vertical),
        1e-10,
    ),
    "attitude.Top.precession_rates_from_momentum": (
        *(TOP, lambda: top_of_momentum(0.7, 0.1, 0), about_the_vertical),
        1e-10,
    ),
    "attitude.ShaftPendulum.equilibrium": (
        *(SHAFT, lambda: SHAFT.state(SHAFT.equilibrium), whole),
        1e-13,
    ),
    "attitude.SphericalPendulum.conical_rate": (
        *(PENDULUM, lambda: PENDULUM.state(0.6, 0.2, 0.0, PENDULUM.conical_rate(0.6)), on_a_cone),
        1e-13,
    ),
    "mechanics.RotatingHoop.rest_angle": (
        HOOP,
        lambda: HOOP.state(HOOP.rest_angle),
        whole,
        1e-13,
    ),
    "mechanics.BarOnSpring.rest_length": (
        *(BAR, lambda: BAR.state(BAR.rest_length, 0.0, 0.0), whole),
        1e-13,
    ),
    "mechanics.ArmPendulum.rest": (
        *(ARM, lambda: ArmState(jnp.stack([ARM.rest, 0.0]), jnp.zeros(2)), whole),
        1e-14,
    ),
    "orbits.circular_speed": (
        TwoBody(3.0),
        lambda: circling(circular_speed(2.0, 3.0)),
        on_a_circle,
        1e-14,
    ),
    "orbits.circular_rate": (
        TwoBody(3.0),
        lambda: circling(2.0 * circular_rate(lambda r: -3.0 / r, 2.0)),
        *(on_a_circle, 1e-14),
    ),
    # The platform and its gyros rest, while the gimbals turn about them.
    "gyros.StablePlatform.held": (
        *(PLATFORM, lambda: PLATFORM.state(0.3, -0.2, 0.5)),
        lambda y: jnp.concatenate([y.attitude.wxyz, y.gyro_angles, y.gyro_rates, y.integrals]),
        1e-13,
    ),
}

# Names that sound like one, and why nothing is fed back.
OTHERS = {
    "attitude.SpringTorque.rest": "a parameter",
    "bodies.conical_shell": "a shape",
    "gyros.BearingFriction.slip_at_rest": "tests/gyros/test_gyros_friction.py",
    "mechanics.hanging_chain": "no system",
    "orbits.circular_decay_rate": "not steady",
    "vehicles.descent_rate": "flown in tests/vehicles/test_vehicles.py",
}


@pytest.mark.parametrize("name", STEADY)
def test_a_steady_motion_is_steady(name):
    system, state, kept, size = STEADY[name]

    def rate():
        y = state()
        field = system.vector_field(jnp.zeros(()), y)
        return jax.jvp(kept, (y,), (field,))[1]

    found = jax.jit(rate)()
    assert_allclose(found, 0.0, atol=size)


def test_every_steady_motion_is_fed_back():
    word = re.compile(
        r"(^|_)(steady|rest|equilibrium|conical|circular|held|descent|hanging)(_|$)"
        r"|precession_rates"
    )
    names = set()
    for package in "attitude bodies control gyros mechanics orbits rockets vehicles".split():
        module = importlib.import_module(f"jaxspace.{package}")
        for name, found in public_names(module).items():
            members = vars(found) if inspect.isclass(found) else ()
            full = [f"{package}.{name}", *(f"{package}.{name}.{member}" for member in members)]
            names.update(x for x in full if word.search(x.rpartition(".")[2]))
            names = {x for x in names if "._" not in x}
    assert names == {name.split(",")[0] for name in STEADY} | set(OTHERS)
