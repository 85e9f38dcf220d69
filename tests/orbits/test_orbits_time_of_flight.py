"""Time of flight between anomalies, its inverse, and orbits from burnout data."""

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest
from both_modes import both_modes

from jaxspace.core import InputError
from jaxspace.orbits.burnout import (
    circular_speed,
    elements_from_burnout,
    escape_speed,
    orbit_from_burnout,
    vis_viva_speed,
)
from jaxspace.orbits.elements import (
    apoapsis_radius,
    elements_from_state,
    periapsis_radius,
    state_from_elements,
)
from jaxspace.orbits.time_of_flight import (
    period,
    semi_major_axis_of_period,
    time_of_flight,
    true_anomaly_after,
)

ALL = (0, 1, 2, 3, 4)
_flight = both_modes(lambda x: time_of_flight(*x))
time_between = jax.jit(time_of_flight)
after = jax.jit(lambda *x: (true_anomaly_after(*x), jax.jacfwd(true_anomaly_after, ALL)(*x)))


def flight(*x):
    return _flight(jnp.array(x))


def quadrature(start, end, p, e):
    """The time and its derivative by e: integrals of r^2/h, in thirty digits."""
    with mp.workdps(30):
        e, nodes = mp.mpf(e), mp.linspace(start, end, 9)
        time = mp.quad(lambda f: (1 + e * mp.cos(f)) ** -2, nodes)
        slope = mp.quad(lambda f: -2 * mp.cos(f) * (1 + e * mp.cos(f)) ** -3, nodes)
        return float(time * mp.mpf(p) ** 1.5), float(slope * mp.mpf(p) ** 1.5)


ARCS = {
    "beside the parabola": (0.0, 2.0943951023931953, 1.0, 0.999999),
    "parabola": (0.0, 2.0943951023931953, 1.0, 1.0),
    "beyond the parabola": (0.0, 2.0943951023931953, 1.0, 1.000001),
    "parabola, across": (-1.3, 2.0, 0.7, 1.0),
    "across the periapsis": (-1.0, 2.0, 1.3, 0.3),
    "backwards": (2.0, -1.0, 1.3, 0.3),
    "inbound": (-2.0, -1.0, 1.3, 0.3),
    "inbound, backwards": (-1.0, -2.0, 1.3, 0.3),
    "circle": (1.0, 2.0, 1.3, 0.0),
    "from the periapsis back": (0.0, -1.0, 1.0, 0.5),
    "to the periapsis": (-1.0, 0.0, 1.0, 0.5),
    "half a revolution": (0.0, np.pi, 1.0, 0.5),
    "from the apoapsis": (np.pi, 3.3, 1.0, 0.5),
    "more than a revolution": (2.0, 15.0, 1.0, 0.9),
    "less than a revolution back": (-0.5, -7.0, 1.0, 0.5),
    "short": (2.0, 2.0001, 1.0, 1.5),
    "hyperbola": (-2.0, 2.0, 1.0, 1.5),
    "none": (0.0, 0.0, 1.0, 0.4),
}


@pytest.mark.parametrize("name", ARCS)
def test_time_of_flight(name):
    """Against quadrature. The tolerance is some roundings of the terms, which grow with r^2."""
    start, end, p, e = ARCS[name]
    time, slope = quadrature(start, end, p, e)
    rate = [p**1.5 / (1 + e * np.cos(f)) ** 2 for f in (start, end)]
    exact = [-rate[0], rate[1], 1.5 * time / p, slope, -0.5 * time]
    x = start, end, p, e, 1.0
    found, forward, reverse = flight(*x)
    assert float(found) == pytest.approx(time, rel=3e-15)
    size = max(map(abs, exact))
    np.testing.assert_allclose(forward, exact, rtol=0, atol=1e-14 * size)
    np.testing.assert_allclose(reverse, exact, rtol=0, atol=1e-14 * size)
    # And back, with the derivatives of the inverse function.
    angle, slopes = after(start, float(found), p, e, 1.0)
    assert float(angle) == pytest.approx(end, abs=1e-14 * (1 + abs(end)))
    exact = [rate[0] / rate[1], 1 / rate[1], -exact[2] / rate[1], -slope / rate[1], 0.5 * time]
    exact[4] /= rate[1]
    np.testing.assert_allclose(slopes, exact, rtol=0, atol=2e-13 * max(map(abs, exact)))


def test_time_of_the_textbook():  # T4.13-13: hyperbola; T4.13-par stands above
    time = time_between(0.0, float(np.radians(70.0)), 2.5**2 - 1.0, 2.5, 1.0)
    assert float(time) == pytest.approx(1.9111308362334984, rel=1e-12)
    times = [time_between(0.0, 2.0943951023931953, 1.0, e, 1.0) for e in (0.999999, 1.0, 1.000001)]
    np.testing.assert_allclose(
        times, [1.7320501147498903, 1.7320508075688772, 1.7320515003905366], rtol=1e-15
    )


def test_no_time_beyond_the_asymptote():
    assert np.isnan(time_between(0.0, 2.5, 1.0, 1.5, 1.0))
    assert np.isnan(time_between(0.0, 6.5, 1.0, 1.5, 1.0))


def test_period():
    assert float(period(4.0, 1.0)) == pytest.approx(16 * np.pi)
    for a in (-1.0, np.inf):
        assert period(a, 1.0) == np.inf and jax.grad(period)(a, 1.0) == 0.0


def test_batches_and_single_precision():
    e = jnp.array([0.0, 0.5, 1.0, 1.2], jnp.float32)
    one = jnp.float32(1.0)
    time = jax.jit(time_of_flight)(jnp.float32(-0.4), jnp.float32(1.3), one, e, one)
    exact = [quadrature(-0.4, 1.3, 1.0, float(v))[0] for v in e]
    assert time.dtype == jnp.float32
    np.testing.assert_allclose(time, exact, rtol=1e-6)
    f = jax.jit(true_anomaly_after)(jnp.float32(-0.4), time, one, e, one)
    assert f.dtype == jnp.float32
    np.testing.assert_allclose(f, 1.3 + 0 * e, rtol=2e-6)


BURNOUTS = {
    "up": (1.1, 1.2, 0.3),
    "down": (1.1, 0.7, -0.4),
    "level": (1.0, 1.1, 0.0),
    "slow": (1.0, 0.8, 0.0),
    "parabola": (2.0, 1.0, 0.5),
    "hyperbola": (1.0, 1.9, 1.2),
}
burnout = jax.jit(elements_from_burnout)
place = jax.jit(orbit_from_burnout)


@pytest.mark.parametrize("name", BURNOUTS)
def test_orbit_from_burnout(name):
    """The two ways agree: by the formulas, and by the elements of the state."""
    r, v, beta = BURNOUTS[name]
    x = burnout(r, v, beta, 1.3)
    state = place(r, v, 1.3, beta)
    np.testing.assert_allclose(state, state_from_elements(x, 1.3), atol=1e-14)
    y = elements_from_state(*state, 1.3)
    for key in ("semi_latus_rectum", "eccentricity"):
        np.testing.assert_allclose(getattr(x, key), getattr(y, key), atol=1e-14)
    assert np.cos(x.true_anomaly - y.true_anomaly) == pytest.approx(1.0, abs=1e-14)
    lam = r * v * v / 1.3
    if lam < 2.0:  # r_p, r_a = r (1 -+ sqrt(1 - lambda (2 - lambda) cos^2 beta)) / (2 - lambda)
        root = np.sqrt(1 - lam * (2 - lam) * np.cos(beta) ** 2)
        assert float(periapsis_radius(*state, 1.3)) == pytest.approx(r * (1 - root) / (2 - lam))
        assert float(apoapsis_radius(*state, 1.3)) == pytest.approx(r * (1 + root) / (2 - lam))
    tilted = place(r, v, 1.3, beta, 0.4, 1.1, -0.6)
    z = elements_from_state(*tilted, 1.3)
    assert float(z.inclination) == pytest.approx(0.4)
    assert float(z.node) == pytest.approx(1.1)
    assert np.cos(z.argument_of_periapsis + z.true_anomaly + 0.6) == pytest.approx(1.0)


def test_burnout_on_a_circle():
    """e and f have no derivative there, and get zero; p has."""
    x = elements_from_burnout(1.0, 1.0, 0.0, 1.0)
    assert float(x.eccentricity) == 0.0 and float(x.true_anomaly) == 0.0
    slopes = jax.jacfwd(elements_from_burnout, (0, 1, 2, 3))(1.0, 1.0, 0.0, 1.0)
    np.testing.assert_allclose(slopes.semi_latus_rectum, [2.0, 2.0, 0.0, -1.0])
    np.testing.assert_allclose(slopes.eccentricity, 0.0)
    np.testing.assert_allclose(slopes.true_anomaly, 0.0)


def test_a_burnout_straight_up():
    r, v = orbit_from_burnout(1.0, 0.5, 1.0, 0.5 * np.pi)
    np.testing.assert_allclose(v, [0.5, 0.0, 0.0], atol=1e-16)
    with pytest.raises(InputError, match=r"burnout_speed is -1: it must be positive"):
        orbit_from_burnout(1.0, -1.0, 1.0)


def test_speeds():
    """T4.10-P3 and the speeds of Explorer 6, T4.9-P4, in miles and seconds."""
    K, R = 1.407e16 / 5280.0**3, 3960.0
    assert float(escape_speed(R + 300.0, K)) * 5280.0 == pytest.approx(35370.42561391171, rel=1e-12)
    q, Q = R + 157.0, R + 26400.0
    a = 0.5 * (q + Q)
    assert float(vis_viva_speed(q, a, K)) * 5280 == pytest.approx(33762.98229067559, rel=1e-12)
    assert float(period(a, K)) / 60.0 == pytest.approx(766.6226790315832, rel=1e-12)
    assert float(vis_viva_speed(2.0, 2.0, 1.0)) == pytest.approx(float(circular_speed(2.0, 1.0)))
    assert float(vis_viva_speed(2.0, np.inf, 1.0)) == float(escape_speed(2.0, 1.0))
    assert np.isnan(vis_viva_speed(5.0, 2.0, 1.0))


def test_axis_of_a_period():  # T4.6-P1
    """It undoes the period; its logarithmic slopes are 2/3 and 1/3."""
    mu = jnp.array([1.0, 3.986004418e14])
    a = jnp.array([1e-3, 4.2164e7])
    found, slopes = jax.jvp(
        lambda s: semi_major_axis_of_period(period(a, mu) * s, mu * s), (1.0,), (1.0,)
    )
    np.testing.assert_allclose(found, a, rtol=4e-16)
    np.testing.assert_allclose(slopes, a, rtol=1e-15)
    single = semi_major_axis_of_period(jnp.float32(86164.1), jnp.float32(3.986004418e14))
    assert single.dtype == jnp.float32
    np.testing.assert_allclose(single, 4.216417e7, rtol=1e-6)
