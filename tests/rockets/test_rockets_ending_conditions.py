"""Phases that end at a velocity to be gained, at an altitude, and at the end of the propellant."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxspace import Scene, load, simulate_mission, simulate_mission_batch
from jaxspace.bodies import BodyState
from jaxspace.core import InputError
from jaxspace.io import SceneError
from jaxspace.orbits import AtAltitude, LowThrust, PointGravity, VelocityToBeGained
from jaxspace.orbits.elements import semi_major_axis
from jaxspace.simulation import Accuracy, Event, Mission, Phase

MU = 398600.4418e9
RADIUS = 6778e3
SPEED = (MU / RADIUS) ** 0.5
THRUST = 1.5  # m/s^2
WANTED = 8.2e6  # m
Y0 = BodyState(jnp.array([RADIUS, 0.0, 0.0]), jnp.array([0.0, SPEED, 0.0]))


@jax.jit
def cut_off(a, acceleration):
    """End of a burn along the velocity, from a circle into an orbit of semi-major axis `a`: time,
    position and velocity."""
    scene = Scene([PointGravity(MU), LowThrust(acceleration)])
    until = Event(VelocityToBeGained(a, MU), within=2e3)
    run = simulate_mission(Mission([Phase(scene, until)]), Y0, accuracy=Accuracy(rtol=1e-12))
    return run.end, run.final.position, run.final.velocity


def test_velocity_to_be_gained_is_required_speed_less_speed():
    r, v = np.array([7e6, -2e6, 1e6]), np.array([3e3, 5e3, -1e3])
    y = BodyState(jnp.asarray(r), jnp.asarray(v))
    distance, speed = np.linalg.norm(r), np.linalg.norm(v)
    # An ellipse beyond and one short of this one, and a hyperbola.
    for a in (1e7, 5e6, -2e7):
        required = np.sqrt(MU * (2.0 / distance - 1.0 / a))
        # v_g is a tenth of the speeds, of whose squares it is the difference.
        found = VelocityToBeGained(a, MU)(0.0, y)
        np.testing.assert_allclose(found, required - speed, rtol=1e-13)


def test_velocity_to_be_gained_keeps_sign_and_slopes_where_no_speed_is_on_the_orbit():
    def gained(distance, speed):
        zero = 0.0 * distance
        y = BodyState(jnp.stack([distance, zero, zero]), jnp.stack([zero, speed, zero]))
        return VelocityToBeGained(1.0, 1.0)(0.0, y)

    # Beyond r = 2 a, there with and without a speed, and at rest within.
    for place in ((3.0, 0.5), (3.0, 0.0), (2.0, 0.5), (2.0, 0.0), (1.0, 0.0)):
        value, slopes = jax.value_and_grad(gained, (0, 1))(*map(jnp.asarray, place))
        assert np.isfinite([value, *slopes]).all(), place
        assert np.sign(value) == np.sign(2.0 / place[0] - 1.0 - place[1] ** 2), place
    w = np.sqrt(1.0 / 3.0)
    np.testing.assert_allclose(
        gained(jnp.asarray(3.0), jnp.asarray(0.5)), -(w * w + 0.25) / (w + 0.5), rtol=1e-15
    )


def test_burn_until_the_velocity_is_gained_leads_to_the_orbit():
    """Thrust along the velocity raises the energy by f |v| a second: dE = mu/(2 a^2) da moves the
    cut-off by dt = mu da/(2 a^2 f |v|), of the speed there."""
    end, r, v = cut_off(WANTED, THRUST)
    assert end > 100.0
    np.testing.assert_allclose(semi_major_axis(r, v, MU), WANTED, rtol=1e-9)
    expected = MU / (2.0 * WANTED**2 * THRUST * np.linalg.norm(v))
    # By the thrust the path moves too: differences of order four.
    h = 1e-3 * THRUST
    times = [cut_off(WANTED, THRUST + k * h)[0] for k in (-2, -1, 1, 2)]
    difference = (times[0] - 8.0 * times[1] + 8.0 * times[2] - times[3]) / (12.0 * h)
    for mode in (jax.jacfwd, jax.grad):
        slopes = jax.jit(mode(lambda x: cut_off(x[0], x[1])[0]))(jnp.array([WANTED, THRUST]))
        # The velocity at cut-off is integrated to 1e-12 a step.
        np.testing.assert_allclose(slopes[0], expected, rtol=1e-10)
        # Times to 1e-11 over steps of 1e-3; the truncation is a thirtieth of (1e-3)^4.
        np.testing.assert_allclose(slopes[1], difference, rtol=1e-8)


def test_conditions_refuse_what_they_cannot_use():
    with pytest.raises(InputError, match=r"VelocityToBeGained.semi_major_axis is 0.*than zero"):
        VelocityToBeGained(0.0, MU)
    with pytest.raises(InputError, match=r"AtAltitude.radius is -1"):
        AtAltitude(1e5, -1.0)


FILE = """
accuracy = 1e-11

[planet]
mu = "398600.4418 km^3/s^2"
radius = "6378 km"

[body]
mass = "1000 kg"

[effects.low_thrust]
acceleration = "1.5 m/s^2"

[effects.steered_thrust]
mean_thrust = "1 kN"
exhaust_velocity = "3 km/s"
burn_time = "5000 s"
burnout_mass = "950 kg"

[effects.steered_thrust.steering]
along = [0.0, 0.0, 1.0]

[initial.orbit]
periapsis_altitude = "400 km"

[[phase]]
name = "raise"
effects = ["point_gravity", "low_thrust"]
until = { velocity_to_be_gained = { semi_major_axis = "8200 km" } }
within = "2000 s"

[[phase]]
name = "climb"
effects = ["point_gravity"]
until = { at_altitude = { altitude = "1000 km" } }
within = "2 h"

[[phase]]
name = "burn"
effects = ["point_gravity", "steered_thrust"]
until = "propellant_depletion"
within = "1000 s"

[dispersion]
outputs = [{ output = "altitude", at = "climb" }]

[dispersion.inputs]
"phase.1.until.at_altitude.altitude" = { deviation = "50 km" }
"""


def written(tmp_path, *changes):
    text = FILE
    for old, new in changes:
        assert text.count(old) == 1
        text = text.replace(old, new)
    path = tmp_path / "raise.toml"
    path.write_text(text)
    return load(path)


@pytest.mark.sweep
def test_files_end_phases_at_events_with_parameters(tmp_path):
    file = written(tmp_path)
    run = file.simulate()
    first, climb, burn = run["raise"], run["climb"], run["burn"]
    end = cut_off(WANTED, THRUST)
    # To the accuracy of the file.
    np.testing.assert_allclose(first.ts[-1], end[0], rtol=1e-9)
    at = (first.states.position[:, -1], first.states.velocity[:, -1])
    np.testing.assert_allclose(semi_major_axis(*at, MU), WANTED, rtol=1e-9)
    height = np.linalg.norm(climb.states.position[:, -1]) - 6378e3
    np.testing.assert_allclose(height, 1e6, rtol=1e-9)
    # 50 kg at 1 kN over 3 km/s; the event lies 4096 units in the last place of 950 kg before.
    np.testing.assert_allclose(burn.ts[-1] - burn.ts[0], 150.0, rtol=1e-9)
    np.testing.assert_allclose(burn.states.mass[-1], 950.0, rtol=1e-11)


def test_parameters_of_events_scatter(tmp_path):
    """Each run of a campaign ends at its own altitude."""
    file = written(tmp_path)
    campaign = file.campaign()
    mission, y0 = campaign.build({"phase.1.until.at_altitude.altitude": jnp.array([9e5, 1e6])})
    climbed = simulate_mission_batch(Mission(mission.phases[:2]), y0, accuracy=file.accuracy)
    height = np.linalg.norm(climbed.final.position, axis=0) - 6378e3
    np.testing.assert_allclose(height, [9e5, 1e6], rtol=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "parts"),
    [
        ('{ at_altitude = { altitude = "1000 km" } }', '"at_altitude"', ["altitude is missing"]),
        ('{ altitude = "1000 km" }', '{ altitude = "9 s" }', ["phase.1.until.at_altitude"]),
        ('{ at_altitude = { altitude = "1000 km" } }', "{}", ["phase.1.until", "at_altitude"]),
        ('"8200 km"', "0", ["phase.0.until.velocity_to_be_gained", "other than zero"]),
        ('"steered_thrust"]', '"low_thrust"]', ["propellant_depletion", "propellant left"]),
        ('within = "2 h"', "", ["phase.1.within", "event"]),
    ],
)
def test_files_say_what_an_event_lacks(tmp_path, old, new, parts):
    with pytest.raises(SceneError) as error:
        written(tmp_path, (old, new))
    for part in parts:
        assert part in str(error.value)
