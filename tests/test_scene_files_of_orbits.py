"""The orbits of `examples/scenes`, flown: precession and decay, apsides at rest, a long way out."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from jaxspace import load
from jaxspace.orbits.elements import elements_from_state
from jaxspace.orbits.secular_rates import secular_rates

SCENES = Path(__file__).parents[1] / "examples" / "scenes"
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
