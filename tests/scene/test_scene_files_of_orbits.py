"""The orbits of `examples/scenes`, flown: precession and decay, apsides at rest, a long way out."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from jaxspace import load
from jaxspace.io import SceneError
from jaxspace.orbits.elements import elements_from_state
from jaxspace.orbits.secular_rates import secular_rates

SCENES = Path(__file__).parents[2] / "examples" / "scenes"
MU, RADIUS, J2 = 3.986004418e14, 6378137.0, 1.08262668e-3


def elements(run):
    return elements_from_state(run.states.position, run.states.velocity, MU)


@pytest.mark.slow
def test_explorer_7_precesses_and_decays():
    """A month: node and periapsis at their mean rates, to the second order in J2 and to the mean of
    the osculating axis over samples an hour apart; the axis falls by some hundred metres."""
    run = load(SCENES / "explorer_7.toml").simulate()
    found = elements(run)
    e = np.asarray(found.eccentricity)
    a = np.asarray(found.semi_latus_rectum) / (1.0 - e**2)
    args = (a.mean(), e.mean(), float(jnp.mean(found.inclination)), MU, J2, RADIUS)
    rates = secular_rates(*args)
    for angle, rate, rtol in (
        (found.node, rates.node, 3e-3),
        (found.argument_of_periapsis, rates.argument_of_periapsis, 2e-2),
    ):
        slope = np.polyfit(np.asarray(run.ts), np.unwrap(np.asarray(angle)), 1)[0]
        assert slope == pytest.approx(float(rate), rel=rtol)
    first, last = a[:240].mean(), a[-240:].mean()
    assert 50.0 < first - last < 5e3


def test_the_apsides_of_the_molniya_orbit_stay():
    """Within two degrees in a month, while the node goes back by four; the apogee stays north."""
    run = load(SCENES / "molniya.toml").simulate()
    found = elements(run)
    w, node = (
        np.degrees(np.unwrap(np.asarray(x))) for x in (found.argument_of_periapsis, found.node)
    )
    assert np.abs((w - w[0] + 180.0) % 360.0 - 180.0).max() < 2.0
    assert -6.0 < node[-1] - node[0] < -3.0
    far = np.asarray(jnp.linalg.norm(run.states.position, axis=0)) > 4e7
    assert np.all(np.asarray(run.states.position)[2, far] > 0.0)


@pytest.mark.sweep
def test_the_transfer_reaches_the_distance_of_the_moon():
    """Five days after the impulse, within the pull of the moon of the distance meant."""
    result = load(SCENES / "lunar_distance.toml").simulate()
    assert 3.7e8 < float(jnp.linalg.norm(result.final.position)) < 4.1e8
    assert 4.5 * 86400.0 < float(result.end) < 5.7 * 86400.0


TWO = """
[planet]
mu = "398600.4418 km^3/s^2"
radius = "6378.137 km"

[effects.point_gravity]

[effects.third_body] # the moon
mu = "4902.8 km^3/s^2"
path = { distance = "384400 km", rate = "13.2 deg/day" }

[effects.third_body_2] # the sun
mu = "1.327e11 km^3/s^2"
path = { distance = "149.6e6 km", rate = "0.9856 deg/day" }

[initial.orbit]
periapsis_altitude = "600 km"

[times]
end = "1 h"

[dispersion]
runs = 2
outputs = ["semi_major_axis"]

[dispersion.inputs]
"effects.third_body_2.mu" = { deviation = "1 %" }
"""


def test_two_effects_of_one_kind(tmp_path):
    path = tmp_path / "two.toml"
    path.write_text(TWO)
    file = load(path)
    assert [float(e.mu) for e in file.system.effects[1:]] == [4902.8e9, 1.327e20]
    mission, _ = file.campaign().build({"effects.third_body_2.mu": jnp.array([1.0, 2.0])})
    moon, sun = mission.phases[0].system.effects[1:]
    assert sun.mu.tolist() == [1.0, 2.0] and float(moon.mu) == 4902.8e9


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("third_body_2", "third_body_sun", "third_body_sun is not a known key: a second"),
        ("[effects.third_body]", "[[effects.third_body]]", "third_body is a list of tables: it"),
        ("third_body_2", "drag_2", "effects.drag_2.ballistic_coefficient is missing"),
        ("third_body_2", "moon_2", "effects.moon_2 is not a known key: it must be one of"),
    ],
)
def test_a_second_effect_that_is_refused(tmp_path, old, new, sentence):
    path = tmp_path / "two.toml"
    path.write_text(TWO.replace(old, new))
    with pytest.raises(SceneError) as error:
        load(path)
    assert sentence in str(error.value)
    if "third_body" in new:
        assert "a second third_body is [effects.third_body_2]." in str(error.value)
