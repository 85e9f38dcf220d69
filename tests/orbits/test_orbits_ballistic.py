"""Ballistic flight: against the motion itself, the textbook, and the limit of a flat ground."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxspace.orbits.ballistic import (
    ballistic_angles,
    ballistic_flight,
    ballistic_impact,
    least_energy_launch,
    longest_range,
)
from jaxspace.orbits.kepler import kepler_flow

fly = jax.jit(ballistic_flight)
aim = jax.jit(ballistic_angles)
land = jax.jit(ballistic_impact)
flow = jax.jit(kepler_flow)


def launch(v, beta):
    return jnp.array([1.0, 0, 0]), v * jnp.array([jnp.sin(beta), jnp.cos(beta), 0.0])


@pytest.mark.parametrize(
    ("lam", "beta"),
    [(0.7, 0.6), (0.1, 1.5), (0.9, 0.05), (1.0, 0.3), (1.3, 0.2), (1.9, 1.1), (1e-3, 0.7)],
)
def test_the_flight_comes_down(lam, beta):
    v = np.sqrt(lam)
    found = fly(1.0, v, beta, 1.0)
    # The rounding of the speed moves the time by its share in 2 - lambda, and by the period.
    allowed = 1e-13 * max(1.0, (2.0 - lam) ** -2.5)
    r, w = flow(*launch(v, beta), found.duration, 1.0)
    assert float(jnp.linalg.norm(r)) == pytest.approx(1.0, abs=allowed)
    angle = float(np.arctan2(r[1], r[0]) % (2 * np.pi))
    assert angle == pytest.approx(float(found.range_angle), abs=allowed)
    assert float(r @ w) < 0.0
    top, _ = flow(*launch(v, beta), 0.5 * found.duration, 1.0)
    assert float(jnp.linalg.norm(top)) - 1.0 == pytest.approx(float(found.height), abs=allowed)


def test_special_flights():
    """Flat ground for small speeds: 2 v s c/g, v^2 s^2/(2 g), 2 v s/g; straight up; no way back."""
    v, beta = 1e-7, 0.7
    s, c = np.sin(beta), np.cos(beta)
    flat = [2 * v * v * s * c, 0.5 * v * v * s * s, 2 * v * s]
    np.testing.assert_allclose(fly(1.0, v, beta, 1.0), flat, rtol=1e-13)
    up = fly(1.0, 1.0, 0.5 * np.pi, 1.0)
    assert float(up.range_angle) < 1e-15
    assert float(up.height) == pytest.approx(1.0, rel=1e-15)
    assert float(up.duration) == pytest.approx(np.pi + 2.0, rel=1e-15)
    assert np.isnan(fly(1.0, 1.5, 0.3, 1.0)).all()
    circle = fly(1.0, 1.0, 0.0, 1.0)
    assert float(circle.height) == 0.0


def test_slopes_of_the_flight():
    """Against differences, whose truncation is 1e-10."""
    f = jax.jit(jax.jacfwd(lambda x: jnp.stack(ballistic_flight(*x))))
    for x in ([1.0, 0.84, 0.6, 1.0], [1.0, 1.1, 1.2, 1.3]):
        x = np.array(x)
        for i in range(4):
            d = 1e-5 * np.eye(4)[i]
            up, down = (np.array(fly(*(x + k * d))) for k in (1, -1))
            np.testing.assert_allclose(f(jnp.asarray(x))[:, i], (up - down) / 2e-5, rtol=1e-7)


@pytest.mark.parametrize(
    ("lam", "phi"), [(0.7, 0.9), (0.7, 1e-6), (0.3, 0.2), (1.0, 2.0), (1.4, 2.0), (1.4, 4.5)]
)
def test_both_arcs_of_a_range(lam, phi):
    v = np.sqrt(lam)
    low, high = aim(1.0, v, phi, 1.0)
    assert float(fly(1.0, v, high, 1.0).range_angle) == pytest.approx(phi, abs=1e-14)
    if lam < 1.0:
        assert 0.0 <= low < high
        assert float(fly(1.0, v, low, 1.0).range_angle) == pytest.approx(phi, rel=1e-12)
    elif lam > 1.01:
        assert np.isnan(low)


def test_the_longest_range():  # T4.17-P2
    phi, beta = longest_range(1.0, np.sqrt(0.6), 1.0)
    assert float(phi) == pytest.approx(0.8858220881472779, rel=1e-14)
    assert float(beta) == pytest.approx(0.5639426413606289, rel=1e-14)
    v, again = least_energy_launch(1.0, phi, 1.0)
    assert float(v) == pytest.approx(np.sqrt(0.6), rel=1e-14)
    assert float(again) == pytest.approx(float(beta), rel=1e-14)
    slope = jax.grad(lambda b: ballistic_flight(1.0, v, b, 1.0).range_angle)(again)
    assert abs(float(slope)) < 1e-13
    assert np.isnan(aim(1.0, v, 1.0001 * phi, 1.0)).all()
    half, level = longest_range(1.0, 1.0, 1.0)
    assert float(half) == np.pi and float(level) == 0.0
    assert jax.grad(lambda v: longest_range(1.0, v, 1.0)[0])(1.0) == np.inf
    assert np.isnan(longest_range(1.0, 1.1, 1.0)[0])


def test_launch_from_the_equator():  # T4.17-P7, in feet
    K, R, rate = 1.407e16, 3960.0 * 5280.0, 7.29e-5
    for sign, ground, time in (
        (1, 55.2154566215754, 1464.9149109804155),
        (-1, 45.56226954744208, 1111.6322224894934),
    ):
        found = land(R, 20000.0, np.radians(30.0), sign * np.pi / 2, 0.0, K, rate)
        assert float(found.duration) == pytest.approx(time, rel=1e-12)
        assert np.degrees(found.range_angle) == pytest.approx(ground, rel=1e-12)
        assert np.degrees(found.longitude) == pytest.approx(sign * ground, rel=1e-12)
        assert abs(float(found.latitude)) < 1e-15


def test_impact_on_a_rotating_sphere():
    """Against the motion in inertial space, and the range without rotation."""
    v, beta, azimuth, latitude, rate = 0.8, 0.6, 2.1, 0.7, 0.06
    found = land(1.0, v, beta, azimuth, latitude, 1.0, rate)
    c, s = np.cos(latitude), np.sin(latitude)
    up, east, north = np.array([c, 0, s]), np.array([0, 1, 0]), np.array([-s, 0, c])
    level = np.cos(azimuth) * north + np.sin(azimuth) * east
    w = v * (np.sin(beta) * up + np.cos(beta) * level) + rate * np.cross([0, 0, 1], up)
    r = np.array(flow(jnp.asarray(up), jnp.asarray(w), found.duration, 1.0)[0])
    assert np.linalg.norm(r) == pytest.approx(1.0, abs=1e-13)
    assert float(found.latitude) == pytest.approx(np.arcsin(r[2]), abs=1e-13)
    east_of = np.arctan2(r[1], r[0]) - rate * found.duration
    assert float(found.longitude) == pytest.approx(float(east_of), abs=1e-13)
    still, plain = land(1.0, v, beta, azimuth, latitude, 1.0, 0.0), fly(1.0, v, beta, 1.0)
    assert float(still.range_angle) == pytest.approx(float(plain.range_angle), rel=1e-13)


def test_batches_and_single_precision():
    beta = jnp.linspace(0.1, 1.4, 5, dtype=jnp.float32)
    found = fly(jnp.float32(6.37e6), jnp.float32(6e3), beta, jnp.float32(3.98e14))
    exact = fly(6.37e6, 6e3, np.asarray(beta, float), 3.98e14)
    for a, b in zip(found, exact, strict=True):
        assert a.dtype == jnp.float32 and a.shape == (5,)
        np.testing.assert_allclose(a, b, rtol=1e-5)


def test_dispersion_of_the_impact_by_derivatives_and_by_monte_carlo():
    """The covariance J P J^T of latitude and longitude at the impact, over the rotating Earth, from
    that of speed, angles and latitude at burnout, beside 100 000 samples of the flight itself."""
    earth, speed, mu, rate = 6.378137e6, 6.5e3, 3.986004418e14, 7.292115e-5
    mean = jnp.array([speed, 0.6, 0.8, 0.785])  # speed, path angle, azimuth, latitude
    spread = np.array([0.6, 1e-4, 1.5e-4, 1e-5])
    mixed = np.eye(4)
    mixed[0, 1] = mixed[1, 0] = 0.5  # a fast burnout is a steep one
    covariance = spread[:, None] * mixed * spread

    def place(x):
        found = ballistic_impact(earth, *x, mu, rate)
        return jnp.stack([found.latitude, found.longitude])

    jacobian = jax.jit(jax.jacfwd(place))(mean)
    by_derivatives = np.asarray(jacobian @ covariance @ jacobian.T)
    draws = np.random.default_rng(7).multivariate_normal(mean, covariance, 100_000).T
    places = np.asarray(jax.jit(place)(jnp.asarray(draws)))
    by_samples = np.cov(places)
    # The sampling of a variance is 0.0045 of it, and of 0.9 of the correlation less; the bend of
    # the flight is of second order in the spread, 1e-4.
    np.testing.assert_allclose(by_samples, by_derivatives, rtol=0.02)
    np.testing.assert_allclose(
        places.mean(axis=1), place(mean), atol=3e-3 * by_samples.max() ** 0.5
    )
    major = np.sqrt(np.linalg.eigvalsh(by_derivatives)[-1]) * earth
    assert 1e3 < major < 1e4  # an ellipse of kilometres
