"""Impulses at the start, at the end or split, against the textbook's numbers and a search over the
time of flight; steering to the greatest velocity; equal stages."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxspace.core import InputError
from jaxspace.optimization import (
    equal_stages_payload,
    maximum_velocity_steering,
    minimum_time_steering,
    propellant_use,
)

G = 32.2


def released(speed, angle):
    return jnp.array([speed * np.cos(np.radians(angle)), speed * np.sin(np.radians(angle))])


def test_textbook_impulses():
    """T8.4-split-up-low, T8.4-split-down, T8.4-P8 and T8.4-P5."""
    up = propellant_use(released(3000.0, 30.0), 4e5, 15000.0, G)
    found = (up.final_velocity, up.first_angle, up.duration, up.first, up.last)
    expected = (17165.72163017579, 0.24067895642322526, 157.62208124782012, 15000.0, 0.0)
    np.testing.assert_allclose(found, expected, rtol=1e-11)
    assert up.corner and not up.degenerate and up.sentence() == "All propellant at the start."

    down = propellant_use(released(3000.0, 20.0), -3e5, 15000.0, G)
    found = (down.final_velocity, down.last_angle, down.duration, down.first, down.last)
    expected = (17123.87426056051, 0.30564490647498105, 172.03988359983938, 0.0, 15000.0)
    np.testing.assert_allclose(found, expected, rtol=1e-11)
    assert down.corner and down.sentence() == "All propellant at the end."

    split = propellant_use(released(3000.0, 30.0), 4e5, 15000.0, G, 120.0)
    found = (split.first, split.last, split.first_angle, split.last_angle, split.final_velocity)
    expected = (10931.612903225807, 4068.387096774193, 0.351646953029878, -0.3516469530298779)
    np.testing.assert_allclose(found, (*expected, 16680.17674911243), rtol=1e-11)
    assert not split.corner and split.sentence().startswith("72.9% of the propellant at the start")

    rest = propellant_use(jnp.zeros(2), 300.0 * 5280.0, 24207.635159180667, G)
    found = (rest.duration, np.degrees(rest.first_angle), rest.final_velocity)
    np.testing.assert_allclose(found, (313.66398130435994, 24.65938247810715, 22000.0), rtol=1e-11)


def test_no_time_of_flight_is_better():
    """Against all times on a grid, for climbs and descents, rising and sinking releases."""
    climbs, speeds = (x.ravel() for x in np.meshgrid([-3e5, -1e3, 0.0, 1e3, 2e5], [-900.0, 1500.0]))
    velocity = jnp.stack([jnp.full(climbs.size, 1000.0), jnp.asarray(speeds)])
    best = propellant_use(velocity, jnp.asarray(climbs), 15000.0, G)
    times = np.geomspace(0.05, 400.0, 4000)[:, None]
    tried = propellant_use(
        velocity[:, None], jnp.asarray(climbs), 15000.0, G, jnp.asarray(times) + 0.0 * climbs
    )
    reached = np.where(tried.feasible, tried.final_velocity, -np.inf).max(axis=0)
    assert np.all(best.feasible) and np.all(best.final_velocity >= reached - 1e-9)
    # The grid comes near every optimum: that of Y = y_0 in free fall lies at T = 0.
    np.testing.assert_allclose(best.final_velocity, reached, rtol=2e-4)
    np.testing.assert_array_equal(best.degenerate, (climbs == 0.0) & (speeds > 0.0))


def test_degenerate_and_infeasible_cases_are_reported():
    same = propellant_use(released(3000.0, 30.0), 0.0, 15000.0, G)
    assert same.degenerate and "Every split" in same.sentence()
    shorter = propellant_use(released(3000.0, 30.0), 0.0, 15000.0, G, 40.0)
    assert shorter.degenerate
    np.testing.assert_allclose(shorter.final_velocity, same.final_velocity, rtol=1e-14)
    poor = propellant_use(released(100.0, 30.0), 4e5, 1000.0, G)
    # (50 + 1000)^2 / 64.4 = 17119.6; sqrt(64.4 4e5) - 50 = 5025.43.
    assert not poor.feasible and "too little" in poor.sentence()
    assert "gives 1000 m/s, where 5025.43 m/s are needed; the nearest" in poor.sentence()
    assert "17119.6 m above" in poor.sentence()
    sinking = propellant_use(jnp.array([500.0, -2000.0]), 4e5, 1000.0, G)
    assert sinking.sentence().endswith("it reaches no height so.")
    with pytest.raises(InputError, match="gravity is 0"):
        propellant_use(jnp.ones(2), 1.0, 1.0, 0.0)
    slopes = jax.grad(
        lambda x: propellant_use(x[:2], x[2], x[3], G).final_velocity, allow_int=False
    )
    for climb, gain in ((0.0, 15000.0), (4e5, 1000.0), (4e5, 15000.0), (-1.0, 0.0)):
        assert np.all(np.isfinite(slopes(jnp.array([2000.0, 1500.0, climb, gain]))))


@pytest.mark.parametrize("duration", [None, 30.0])
def test_what_too_little_propellant_reaches(duration):
    """The least gain just suffices and a thousandth less does not; and so with the nearest climb
    and one a little farther. Climbs and descents of rising and sinking releases."""
    grid = np.meshgrid([-3e5, -2e4, -1e3, 1e3, 3e4, 3e5], [-1200.0, 400.0, 1500.0], [700.0, 1300.0])
    climbs, speeds, gains = (jnp.asarray(x.ravel()) for x in grid)
    velocity = jnp.stack([0.0 * speeds, speeds])

    def feasible(climb, gain):
        return propellant_use(velocity, climb, gain, G, duration).feasible

    found = propellant_use(velocity, climbs, gains, G, duration)
    assert np.all(feasible(climbs, found.least_gain * (1.0 + 1e-12)))
    assert not np.any(feasible(climbs, found.least_gain * (1.0 - 1e-3)))
    nearest, reached = found.nearest_climb, jnp.isfinite(found.nearest_climb)
    np.testing.assert_array_equal(nearest[found.feasible], climbs[found.feasible])
    # Off the edge of what is reached by the rounding of a square root.
    inside, outside = (nearest + share * (climbs - nearest) for share in (-1e-9, 1e-3))
    missed = reached & ~found.feasible
    assert jnp.any(missed) and np.all(feasible(inside, gains)[missed])
    assert not np.any(feasible(outside, gains)[missed])
    every = jnp.linspace(-4e5, 4e5, 2001)[:, None] + 0.0 * gains
    tried = propellant_use(velocity[:, None], every, gains, G, duration)
    np.testing.assert_array_equal(jnp.any(tried.feasible, axis=0), reached)


def test_greatest_velocity_is_the_least_time_seen_from_the_other_side():
    least = minimum_time_steering(100.0, jnp.array([5.0, 0.0, -3.0]), 45.0)
    best = maximum_velocity_steering(100.0, jnp.array([5.0, 0.0, -3.0]), least.duration)
    np.testing.assert_allclose(best.final_velocity, 45.0, rtol=1e-13)
    np.testing.assert_allclose(best.initial_angle, least.initial_angle, rtol=1e-11, atol=1e-15)
    slope = jax.grad(lambda h: maximum_velocity_steering(100.0, h, 0.5).initial_angle)(0.0)
    np.testing.assert_allclose(slope, 6.0 / (100.0 * 0.25), rtol=1e-12)  # theta_0 = 6 h/(a T^2)
    with pytest.raises(InputError, match="height is 7"):
        maximum_velocity_steering(100.0, 7.0, 0.5)


def test_equal_stages_and_their_limit():
    """T8.2-P1."""
    N = jnp.array([1.0, 2.0, 3.0, 4.0, 6.0, 10.0, 1e9, jnp.inf])
    found = equal_stages_payload(26000.0, 9660.0, 0.12, N)
    expected = [0.0, 0.025434049470903525, 0.03495182077357057, 0.03867122038984796]
    expected += [0.04185542436001801, 0.04407773192010848, 0.04695640470304318, 0.04695640470304318]
    # A billion stages differ from the limit by 1e-9 of it.
    np.testing.assert_allclose(found, expected, rtol=2e-9)
    slopes = jax.grad(lambda v: jnp.sum(equal_stages_payload(v, 9660.0, 0.12, N)))(26000.0)
    assert np.isfinite(slopes)
