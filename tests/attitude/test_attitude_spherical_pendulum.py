"""The spherical pendulum against closed forms, the heavy top without spin, and another
integration."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import ellipk

from jaxspace import simulate
from jaxspace.attitude import PendulumState, SphericalPendulum, Top
from jaxspace.core import InputError

L, G = 1.3, 9.80665
PENDULUM = SphericalPendulum(L, G)


def angle(y):
    """Angle of the rod from the downward vertical, rad."""
    across = jnp.sqrt(y.direction[0] ** 2 + y.direction[1] ** 2)
    return jnp.arctan2(across, -y.direction[2])


@pytest.mark.parametrize("theta", [1e-3, 0.4, 1.2, 1.5])
def test_the_conical_pendulum_stays_at_its_angle(theta):
    rate = PENDULUM.conical_rate(theta)
    assert float(rate) == pytest.approx(np.sqrt(G / (L * np.cos(theta))), rel=1e-14)
    y0 = PENDULUM.state(theta, 0.3, 0.0, rate)
    ts = jnp.linspace(0.0, 4.0, 5)
    run = simulate(PENDULUM, y0, ts, accuracy=1e-11)
    # A hundred steps or fewer, each within 1e-11 of the state.
    assert float(angle(run.final)) == pytest.approx(theta, abs=1e-8)
    psi = np.arctan2(run.final.direction[1], run.final.direction[0])
    turned = (psi - 0.3 - 4.0 * float(rate) + np.pi) % (2.0 * np.pi) - np.pi
    assert abs(turned) < 1e-8 / np.sin(theta)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_nothing_pulls_along_the_rod_at_a_vertical(side):
    tilt = 1e-11
    at = PendulumState(jnp.array([tilt, 0.0, side]), jnp.zeros(3))
    pull = PENDULUM.vector_field(0.0, at).direction_rate
    expected = np.array([G / L * side * tilt, 0.0, -G / L * tilt**2])
    # By component: the one along the rod is of second order.
    np.testing.assert_allclose(pull, expected, rtol=1e-14)


@pytest.mark.parametrize("amplitude", [1e-4, 0.5, 2.0, 3.0])
def test_the_swing_in_a_plane_has_its_period(amplitude):
    """Scipy's K; after one period the rod is where it was."""
    period = PENDULUM.plane_period(amplitude)
    expected = 4.0 * np.sqrt(L / G) * ellipk(np.sin(0.5 * amplitude) ** 2)
    assert float(period) == pytest.approx(expected, rel=1e-13)
    y0 = PENDULUM.state(amplitude, 0.7)
    run = simulate(PENDULUM, y0, jnp.array([0.0, float(period)]), accuracy=1e-11)
    # Near the upper vertical a deviation grows by e^(2 pi / 3) in the time of a small swing.
    np.testing.assert_allclose(run.final.direction, y0.direction, atol=1e-7)


def test_it_is_the_heavy_top_without_spin():
    """Thomson 5.13 with C n = 0: A = l^2 and W l = g l per unit mass. Period and turning circles
    from the closed form of the top's nutation."""
    theta, rates = 2.1, (0.4, 0.9)  # of the top: from the upward vertical
    top = Top(L * L, 0.7, G * L)
    spin = -rates[1] * np.cos(theta)  # so that the rate about the top's own axis is zero
    nutation = top.nutation(Top.state([0.3, theta, 0.1], [rates[1], rates[0], spin]))
    y0 = PENDULUM.state(np.pi - theta, 0.3, -rates[0], rates[1])
    period = float(nutation.period)
    ts = jnp.linspace(0.0, period, 3)
    run = simulate(PENDULUM, y0, ts, accuracy=1e-12)
    assert float(run.final.direction[2]) == pytest.approx(np.cos(theta), abs=1e-9)
    assert float(run.final.direction_rate[2]) == pytest.approx(
        float(y0.direction_rate[2]), abs=1e-8
    )


@pytest.mark.parametrize(
    "given", [(0.0, 0.0, 2.0, 0.0), (np.pi, 0.0, 1e-3, 0.0), (0.9, 0.2, -0.7, 1.4)]
)
def test_it_agrees_with_another_integration(given):
    """Scipy's DOP853 on position and velocity of a point on a sphere; the verticals included."""
    y0 = PENDULUM.state(*given)

    def rate(t, y):
        x, v = y[:3], y[3:]
        factor = (G * x[2] - v @ v) / L**2
        return np.concatenate([v, factor * x - [0.0, 0.0, G]])

    start = L * np.concatenate([y0.direction, y0.direction_rate])
    other = solve_ivp(rate, (0.0, 3.0), start, method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    run = simulate(PENDULUM, y0, jnp.array([0.0, 3.0]), accuracy=1e-12)
    # From the upper vertical an error grows by e^(3 sqrt(g/l)) = 4e3.
    np.testing.assert_allclose(L * run.final.direction, other[:3], atol=1e-7)


def test_invariants_are_those_of_the_textbook():
    theta, psi, theta_rate, psi_rate = 0.8, 0.3, -0.5, 1.7
    found = PENDULUM.invariants(0.0, PENDULUM.state(theta, psi, theta_rate, psi_rate))
    kinetic = 0.5 * L**2 * (theta_rate**2 + (psi_rate * np.sin(theta)) ** 2)
    assert float(found["energy"]) == pytest.approx(kinetic - G * L * np.cos(theta), rel=1e-13)
    momentum = L**2 * psi_rate * np.sin(theta) ** 2
    assert float(found["vertical_angular_momentum"]) == pytest.approx(momentum, rel=1e-13)
    assert float(found["direction_norm"]) == pytest.approx(1.0, rel=1e-15)


def test_derivatives_at_the_verticals_are_finite_in_both_modes():
    """About the lower vertical u'' = -(g/l) of the horizontal part of u, to first order."""
    down = PendulumState(jnp.array([0.0, 0.0, -1.0]), jnp.zeros(3))

    def acceleration(x):
        y = PendulumState(down.direction + jnp.array([x[0], x[1], 0.0]), down.direction_rate)
        return PENDULUM.vector_field(0.0, y).direction_rate[:2]

    for derivative in (jax.jacfwd, jax.jacrev):
        slope = derivative(acceleration)(jnp.zeros(2))
        np.testing.assert_allclose(slope, -G / L * np.eye(2), rtol=1e-14, atol=1e-14)


def test_the_slope_of_a_period_agrees_with_differences():
    """Central differences of order two at 1e-5: truncation 1e-10, rounding 1e-11."""
    for amplitude in (0.3, 2.5):
        h = 1e-5
        ahead, behind = PENDULUM.plane_period(amplitude + h), PENDULUM.plane_period(amplitude - h)
        slope = jax.grad(PENDULUM.plane_period)(amplitude)
        assert float(slope) == pytest.approx(float(ahead - behind) / (2.0 * h), rel=1e-6)


def test_bad_input_is_named():
    with pytest.raises(InputError, match=r"SphericalPendulum\.length is 0: it must be positive"):
        SphericalPendulum(0.0, G)
    with pytest.raises(InputError, match=r"SphericalPendulum\.gravity is -1"):
        SphericalPendulum(L, -1.0)
