"""Deviations from the nominal run in its own axes, elements as outputs, times of events."""

from types import SimpleNamespace

import jax
import numpy as np
import pytest

import jaxspace
from jaxspace.orbits import ClassicalElements
from jaxspace.orbits.deviation_outputs import (
    along_track_error,
    argument_of_periapsis,
    cross_track_error,
    eccentricity,
    node_longitude,
    radial_error,
)
from jaxspace.orbits.elements import state_from_elements

MU = 3.986e14


def test_deviations_are_components_in_the_axes_of_the_nominal_run():
    """A nominal state on an inclined ellipse, whose axes follow from its elements: R at the
    argument of latitude u, S 90 degrees ahead, W the pole of the orbit."""
    i, node, periapsis, f = 0.7, 0.4, 1.1, 0.5
    elements = ClassicalElements.from_periapsis(7e6, 0.3, i, node, periapsis, f)
    r, v = state_from_elements(elements, MU)
    u = periapsis + f
    n = np.array([np.cos(node), np.sin(node), 0.0])
    m = np.array([-np.sin(node) * np.cos(i), np.cos(node) * np.cos(i), np.sin(i)])
    axes = [np.cos(u) * n + np.sin(u) * m, -np.sin(u) * n + np.cos(u) * m, np.cross(n, m)]
    nominal = SimpleNamespace(position=r[:, None], velocity=v[:, None])
    away = np.array([3.0, -20.0, 0.5])
    position = r[:, None] + sum(a * e for a, e in zip(away, axes, strict=True))[:, None]
    found = [f(position, nominal) for f in (radial_error, along_track_error, cross_track_error)]
    # Metres as differences of 7e6: 1e-9 of rounding.
    np.testing.assert_allclose(np.concatenate(found), away, atol=1e-8)
    slope = jax.grad(lambda p: along_track_error(p, nominal)[0])(position)
    np.testing.assert_allclose(slope[:, 0], axes[1], atol=1e-12)


def test_elements_as_outputs():
    elements = ClassicalElements.from_periapsis(7e6, 0.3, 0.7, 0.4, 1.1, 0.5)
    r, v = state_from_elements(elements, MU)
    assert float(eccentricity(r, v, MU)) == pytest.approx(0.3, rel=1e-12)
    assert float(node_longitude(r, v, MU)) == pytest.approx(0.4, rel=1e-12)
    assert float(argument_of_periapsis(r, v, MU)) == pytest.approx(1.1, rel=1e-12)


SCENE = """
accuracy = 1e-9
[planet]
mu = "3.986e14 m^3/s^2"
radius = "6378 km"
[initial]
position = ["7000 km", "0 km", "0 km"]
velocity = ["0 km/s", "8 km/s", "0 km/s"]
[effects.point_gravity]
[[phase]]
name = "up"
effects = ["point_gravity"]
until = "apoapsis"
within = "3 h"
[[phase]]
name = "on"
effects = ["point_gravity"]
duration = "100 s"
[dispersion]
outputs = [{ output = "end_time", at = "up", name = "rise", unit = "s" },
  { output = "end_time", unit = "s" }, "along_track_error"]
[dispersion.inputs]
"initial.velocity.1" = { deviation = "10 m/s" }
"""


def test_times_of_events_scatter(tmp_path):
    """From the periapsis to the apoapsis is half a period, pi sqrt(a^3/mu) with 1/a = 2/r - v^2/mu,
    of each run; the mission ends 100 s later."""
    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    file = jaxspace.load(path)
    d = jaxspace.dispersion.disperse(file.campaign(), 32, seed=1, accuracy=1e-9)
    a = 1.0 / (2.0 / 7e6 - d.inputs["initial.velocity.1"] ** 2 / 3.986e14)
    half = np.pi * np.sqrt(a**3 / 3.986e14)
    np.testing.assert_allclose(d.outputs["rise"], half, rtol=1e-7)
    np.testing.assert_allclose(d.outputs["end_time"], half + 100.0, rtol=1e-7)
    # Later than the nominal run by the difference of the times, at the speed of the apoapsis, less
    # the way to where that apoapsis is: the sign is what is asked here.
    assert np.isfinite(d.outputs["along_track_error"]).all()
    nominal = file.nominal_outputs(file.nominal_mission())
    assert nominal["rise"][0] == pytest.approx(nominal["end_time"][0] - 100.0, rel=1e-12)
