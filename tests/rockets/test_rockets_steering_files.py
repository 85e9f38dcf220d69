"""Every steering law that a scene file may name, flown from a file: the direction of the thrust, or
the axis of the body, against the law by hand."""

from typing import final

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float

import jaxspace
from jaxspace.core import quantity
from jaxspace.rockets.steering import AbstractSteering

UP, ALONG = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
G = np.array([[0.0], [0.0], [-9.8]])
FLAT = "plane = { up = [0.0, 0.0, 1.0] }"
POINT = """
[body]
mass = "1000 kg"

[effects.uniform_gravity]
acceleration = [0.0, 0.0, -9.8]

[effects.steered_thrust]
mean_thrust = "20 kN"
specific_impulse = "300 s"
propellant_mass = "500 kg"

[effects.steered_thrust.steering]
{law}

[initial]
position = ["7000 km", "20 km", "300 km"]
velocity = ["2 km/s", "500 m/s", "1.5 km/s"]

[times]
end = 40.0
samples = 641
"""


def pitched(angle):
    """The direction at a pitch in the plane of x and z."""
    return np.cos(angle) * ALONG[:, None] + np.sin(angle) * UP[:, None]


def unit(v):
    return v / np.linalg.norm(v, axis=0)


def local(r, v, t):
    """A pitch of 0.4 rad above the local horizontal; the normal of the flight is y."""
    across = unit(np.cross(np.array([0.0, 1.0, 0.0]), r, axisb=0).T)
    return np.cos(0.4) * across + np.sin(0.4) * unit(r)


def in_air(r, v, t):
    """Along the velocity in air that turns about z by 1e-4 rad/s."""
    return unit(v - 1e-4 * np.stack([-r[1], r[0], 0.0 * r[0]]))


def in_wind(r, v, t):
    """As above, in a wind of 100 m/s to the east."""
    east = unit(np.stack([-r[1], r[0], 0.0 * r[0]]))
    return unit(v - 1e-4 * np.stack([-r[1], r[0], 0.0 * r[0]]) - 100.0 * east)


@final
class Swinging(AbstractSteering):
    """A law of a user: a pitch that swings, in the plane of x and z."""

    swing: Float[Array, "*#runs"] = quantity("rad", doc="amplitude")

    def direction(self, t, y):
        del y
        angle = self.swing * jnp.sin(0.3 * t)
        return jnp.stack([jnp.cos(angle), 0.0 * angle, jnp.sin(angle)])


LAWS = {
    "constant": (
        "along = [1.0, -2.0, 2.0]",
        lambda r, v, t: np.array([[1.0], [-2.0], [2.0]]) / 3.0 + 0.0 * t,
    ),
    "constant pitch": ("coefficients = [0.4, 0.0]", local),
    "table": (
        f'times = [0.0, 10.0, 30.0]\nangles = ["80 deg", "60 deg", "20 deg"]\n{FLAT}',
        lambda r, v, t: pitched(np.radians(np.interp(t, [0, 10, 30], [80, 60, 20]))),
    ),
    "polynomial": (
        f"coefficients = [1.5, -0.1, 1e-3]\nstart = 2.0\n{FLAT}",
        lambda r, v, t: pitched(1.5 - 0.1 * (t - 2.0) + 1e-3 * (t - 2.0) ** 2),
    ),
    "linear tangent": (
        f"tangent = 0.8\ntangent_rate = -0.03\n{FLAT}",
        lambda r, v, t: pitched(np.arctan(0.8 - 0.03 * t)),
    ),
    "bilinear tangent": (
        f"tangent = 0.8\ntangent_rate = -0.03\ndenominator_rate = 0.02\nstart = 5.0\n{FLAT}",
        lambda r, v, t: pitched(np.arctan((0.8 - 0.03 * (t - 5)) / (1.0 + 0.02 * (t - 5)))),
    ),
    "velocity": ("sense = 1.0", lambda r, v, t: unit(v)),
    "against the velocity": ("sense = -1.0", lambda r, v, t: -unit(v)),
    "user": ('swing = "20 deg"', lambda r, v, t: pitched(np.radians(20.0) * np.sin(0.3 * t))),
    "wind": (
        'air = { radius = "6378 km", air_rate = "1e-4 rad/s", wind = { heights = [0.0, 1e4], '
        "east = [100.0, 100.0], north = [0.0, 0.0] } }",
        in_wind,
    ),
    "air": ('air_rate = "1e-4 rad/s"', in_air),
}


def scene_with(text, tmp_path):
    path = tmp_path / "law.toml"
    path.write_text(POINT.format(law=text))
    return jaxspace.load(path, also=[Swinging])


def check_thrust(system, law, t, r, v, m):
    """The thrust at states whose runs are on the last axis."""
    state = jaxspace.BodyState(*(jnp.asarray(x) for x in (r, v)), mass=jnp.asarray(m))
    field = jax.jit(lambda t, y: system.vector_field(t, y).velocity)
    found = np.asarray(field(jnp.asarray(t), state))
    # A difference of gravity, and a radius of 7e6 m.
    np.testing.assert_allclose((found - G) / (20e3 / m), law(r, v, t), atol=1e-12)


@pytest.mark.parametrize("name", LAWS)
def test_a_law_in_a_file_steers(name, tmp_path):
    """Before, at and behind the nodes and the starts of the laws, along an arc."""
    text, law = LAWS[name]
    t = np.array([0.0, 2.0, 7.0, 10.0, 20.0, 35.0, 40.0])
    r = np.array([[7e6], [2e4], [3e5]]) + np.array([[2e3], [5e2], [1.5e3]]) * t + 0.5 * G * t**2
    v = np.array([[2e3], [5e2], [1.5e3]]) + G * t
    check_thrust(scene_with(text, tmp_path).system, law, t, r, v, 1000.0 - 7.0 * t)


# How the others are read, the test above shows: what flies is one program with another direction.
FLOWN = ("user",)
FLIGHTS = [n if n in FLOWN else pytest.param(n, marks=pytest.mark.sweep) for n in LAWS]


@pytest.mark.parametrize("name", FLIGHTS)
def test_a_law_in_a_file_flies(name, tmp_path):
    """The thrust at the states of the flight, and the way that it flew: gravity and thrust over the
    mass that is left, by Simpson's rule over finer samples."""
    text, law = LAWS[name]
    file = scene_with(text, tmp_path)
    run = file.simulate()
    t, y = np.asarray(run.ts), run.states
    r, v, m = (np.asarray(x) for x in (y.position, y.velocity, y.mass))
    expected = law(r, v, t)
    check_thrust(file.system, law, *(x[..., ::160] for x in (t, r, v, m)))
    np.testing.assert_allclose(m, 1000.0 - 20e3 / (300.0 * 9.80665) * t, rtol=1e-9)
    push = 20e3 / m * expected + G
    weights = np.full(641, 2.0)
    weights[1::2], weights[[0, -1]] = 4.0, 1.0
    gained = push @ weights * (t[1] - t[0]) / 3.0
    # Simpson's rule with steps of 1/16 s, and the tolerance of the file's default, 1e-8.
    np.testing.assert_allclose(v[:, -1] - v[:, 0], gained, rtol=1e-6, atol=1e-5)


BODY = """
[planet]
mu = "398600.4418 km^3/s^2"

[body]
mass = "100 kg"
inertia = [400.0, 400.0, 50.0]

[effects.point_gravity]

[effects.attitude_control]
stiffness = "2400 N m"
damping = "1800 N m s"

[effects.attitude_control.steering]
coefficients = [1.5707963267948966, -0.01]
plane = { normal = [0.0, 1.0, 0.0], up = [1.0, 0.0, 0.0] }

[initial]
position = ["7000 km", 0.0, 0.0]
velocity = [0.0, 0.0, "7.5 km/s"]
attitude = { along = "position" }
omega = [0.0, 0.0, 0.0]

[times]
end = 40.0
samples = 21
"""


def lagging(t, rate, damping, stiffness):
    """x of x'' + a x' + b x = -a rate after x = 0, x' = -rate: by what an axis with the stiffness b
    and the damping a leads a command that begins to turn at the rate."""
    a, b = damping, stiffness
    lag, w = a * rate / b, np.sqrt(b - 0.25 * a * a)
    share = (0.5 * a * lag - rate) / w
    return -lag + np.exp(-0.5 * a * t) * (lag * np.cos(w * t) + share * np.sin(w * t))


def angle_of(attitude):
    """The angle of the body's axis from x towards -z, rad."""
    axis = np.asarray(attitude.rotate(jnp.zeros_like(attitude.wxyz[:3]).at[2].set(1.0)))
    np.testing.assert_allclose(axis[1], 0.0, atol=1e-9)
    return np.arctan2(-axis[2], axis[0])


def test_a_control_of_the_attitude_in_a_file_flies(tmp_path):
    """The axis follows a pitch which falls by 0.01 rad/s, and lags by c/k times the rate."""
    path = tmp_path / "control.toml"
    path.write_text(BODY)
    run = jaxspace.load(path).simulate()
    t = np.asarray(run.ts)
    expected = 0.01 * t + lagging(t, 0.01, 1800.0 / 400.0, 2400.0 / 400.0)
    np.testing.assert_allclose(expected[-1], 0.4 - 0.0075, rtol=1e-12)
    # The torque goes by the sine of the error: 0.0075^3/6 rad, and the tolerance of 1e-8.
    np.testing.assert_allclose(angle_of(run.states.attitude), expected, atol=2e-7)
