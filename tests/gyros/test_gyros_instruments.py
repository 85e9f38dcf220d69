"""Gyrocompass, gyropendulum, rate gyro and navigator's errors beyond their reference cases."""

import equinox as eqx
import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
import scipy.linalg
from numpy.testing import assert_allclose
from unchecked import unchecked

from jaxspace import simulate
from jaxspace.core import InputError
from jaxspace.gyros import (
    Gyrocompass,
    GyrocompassState,
    Gyropendulum,
    GyropendulumState,
    RateGyro,
    RateGyroState,
)
from jaxspace.gyros._linear import stacked
from jaxspace.gyros.navigation_errors import NavigationErrors, coupled_rates
from jaxspace.gyros.noise import allan_of_walks, allan_variance, gyro_noise
from jaxspace.gyros.platform import gimbal_lock_margin
from jaxspace.solvers import ExponentialRosenbrock
from jaxspace.studies import modes

COMPASS = Gyrocompass(339.0, 0.2, 0.2, 8.5, 0.8, damping_moment=0.0)
GYROPENDULUM = Gyropendulum(1.0, 0.0118, 0.3, 0.0174, acceleration_theta=0.014, gravity=15.0)


def test_gyrocompass_linearised_is_the_book_s():
    """Both modes and the rest of the nonlinear instrument; the book leaves out terms of the size of
    the earth's rate over the nutation's, 1e-7."""

    @eqx.filter_jit
    def found(compass):
        y = compass.state(compass.rest_tilt, compass.rest_azimuth)
        return modes(compass, y).frequencies, compass.vector_field(0.0, y)

    frequencies, rate = found(COMPASS)
    slow, fast = COMPASS.frequencies
    # The stiffness wl cos(alpha) at the rest tilt of 2e-3 rad differs by 2e-6.
    assert_allclose(frequencies, [slow, slow, fast, fast], rtol=1e-5)
    # The moments of the inertias leave the square of the earth's rate.
    assert abs(float(rate.azimuth_rate)) < 1e-8 and abs(float(rate.tilt_rate)) < 1e-8
    # A ship to the north turns the meridian to the west.
    moving = Gyrocompass(339.0, 0.2, 0.2, 8.5, 0.8, speed=8.0)
    assert_allclose(moving.heading_error, moving.rest_azimuth, rtol=1e-12)
    assert moving.rest_azimuth > 0.0


def test_the_offset_of_the_bail_damps():
    """About the rest the nonlinear instrument has the book's linear equations, to the tilt squared
    and the inertias' moments."""
    compass = Gyrocompass(339.0, 0.2, 0.25, 8.5, 0.8, damping_moment=0.17)

    @jax.jit
    def jacobian(x):
        return jax.jacfwd(lambda x: jnp.stack(jax.tree.leaves(rate(x))))(x)

    def rate(x):
        return compass.vector_field(0.0, GyrocompassState(*x))

    found = jacobian(jnp.stack([compass.rest_tilt, compass.rest_azimuth, 0.0, 0.0]))
    assert_allclose(found[3, 0], -0.17 / 0.25, rtol=1e-4)
    slow = np.sort(np.abs(np.linalg.eigvals(found).real))[-2:]
    decay = float(compass.damping_ratio * compass.slow_frequency)
    assert_allclose(slow, decay, rtol=1e-3)


def test_gyrocompass_s_flow_has_derivatives():
    @jax.jit
    def azimuth(momentum):
        compass = Gyrocompass(momentum, 0.2, 0.2, 8.5, 0.8, damping_moment=0.17)
        return compass.slow_motion(900.0, 0.0, 0.1)[1]

    h = 1e-3
    slope = (azimuth(339.0 + h) - azimuth(339.0 - h)) / (2 * h)
    assert_allclose(jax.grad(azimuth)(339.0), slope, rtol=1e-7)
    assert_allclose(jax.jvp(azimuth, (339.0,), (1.0,))[1], slope, rtol=1e-7)


@pytest.mark.sweep
def test_gyrocompass_over_a_million_radians_by_default():
    """`auto` finds the exponential method: the nutation of 1e6 rad is not resolved."""
    y = COMPASS.state(0.0, 0.01)
    run = simulate(COMPASS, y, jnp.array([0.0, 600.0]))
    assert isinstance(run.config.method, ExponentialRosenbrock)
    # The book's linear motion: the angle of 0.01 rad leaves its square.
    expected = COMPASS.small_motion(600.0, y)
    assert_allclose(run.final.azimuth, expected.azimuth, atol=1e-6)


def test_tuned_gyropendulum():
    radius = 6.371e6
    pendulum = Gyropendulum(1.0, 1e-3, 0.01, gravity=9.8, acceleration_theta=0.02).tuned(radius)
    slow, fast = pendulum.frequencies
    assert_allclose(slow, np.sqrt(9.8 / radius), rtol=1e-13)

    @eqx.filter_jit
    def both(pendulum):
        y = GyropendulumState(*(jnp.zeros(()) for _ in range(4)))
        return modes(pendulum, y).frequencies, pendulum.closed_form().flow(900.0, y)

    frequencies, end = both(pendulum)
    assert_allclose(frequencies, [slow, slow, fast, fast], rtol=1e-9)
    # Without nutation: theta = -(a/g)(1 - cos p t), phi = (a/g) sin p t to its sign.
    tilt = 0.02 / 9.8
    assert_allclose(end.theta, -tilt * (1.0 - np.cos(slow * 900.0)), atol=1e-6 * tilt)
    assert_allclose(abs(end.phi), tilt * abs(np.sin(slow * 900.0)), rtol=1e-4)


def test_a_vertical_gyro_is_brought_upright():
    gyro = Gyropendulum(1.0, 1e-3, erection_rate=0.02)
    y = GyropendulumState(jnp.array(0.05), jnp.array(-0.02), jnp.zeros(()), jnp.zeros(()))
    end = eqx.filter_jit(lambda g, y: g.closed_form().flow(100.0, y))(gyro, y)
    # Both tilts decay at the rate k = 0.02, and turn by A k / H in each time of decay.
    assert_allclose([end.theta, end.phi], np.exp(-2.0) * np.array([0.05, -0.02]), atol=2e-5)


def test_errors_of_a_rate_gyro():
    gyro = RateGyro(
        1e-4,
        0.004,
        0.05,
        spring=0.2,
        scale_factor_error=0.01,
        bias_torque=2e-6,
        spin_unbalance=1e-7,
        input_unbalance=2e-7,
        anisoelasticity=1e-9,
        input_rate=0.1,
        input_force=9.8,
        spin_force=4.9,
    )
    torque = 2e-6 + 1e-7 * 9.8 - 2e-7 * 4.9 + 1e-9 * 9.8 * 4.9
    assert_allclose(gyro.drift_rate, torque / 0.05, rtol=1e-13)
    assert_allclose(gyro.steady_angle, (0.05 * 1.01 * 0.1 + torque) / 0.2, rtol=1e-13)
    assert_allclose(gyro.step_response(5.0), gyro.steady_angle, rtol=1e-8)


def test_one_flow_serves_rate_and_integrating_gyros():
    """The derivative by the spring at zero, where the closed forms of both part."""

    @jax.jit
    def angle(spring):
        gyro = RateGyro(1e-4, 0.004, 0.05, spring=spring, input_rate=0.1)
        y = RateGyroState(jnp.zeros(()), jnp.zeros(()))
        return gyro.closed_form().flow(0.1, y).angle

    h = 1e-5
    assert_allclose(jax.grad(angle)(0.0), (angle(h) - angle(-h)) / (2 * h), rtol=1e-7)


def test_navigator_has_three_periods():
    """At rest: Schuler's, split by Foucault's rotation, and the day; the vertical grows until an
    altimeter damps it."""
    earth, latitude = 7.292115e-5, 0.8
    rate = (0.0, earth * np.cos(latitude), earth * np.sin(latitude))

    @jax.jit
    def roots(k1, k2):
        errors = NavigationErrors(
            6.371e6,
            9.8,
            rate=rate,
            specific_force=(0.0, 0.0, 9.8),
            altitude_rate_gain=k1,
            altitude_gain=k2,
        )
        return modes(errors, errors.errors()).eigenvalues

    w0 = np.sqrt(9.8 / 6.371e6)
    found = np.asarray(roots(0.0, 0.0))
    assert_allclose(np.min(np.abs(np.abs(found.imag) - earth)), 0.0, atol=1e-12)
    assert_allclose(np.max(found.real), np.sqrt(2.0) * w0, rtol=3e-3)
    level = np.sort(np.abs(found.imag))[-4:]
    # Foucault: w0 -+ W sin(latitude), each twice.
    split = earth * np.sin(latitude)
    assert_allclose(level, [w0 - split] * 2 + [w0 + split] * 2, rtol=3e-3)
    damped = np.asarray(roots(0.02, 2.0 * w0**2 + 1e-4))
    assert np.max(damped.real) < 1e-9


def test_coupled_rates_end_in_an_orbit():
    oscillation, growth = coupled_rates(1e-3, 1e-3)
    assert_allclose(oscillation, 1e-3, rtol=1e-14)
    assert growth == 0.0
    # Close to it the growth keeps its digits: sqrt(6 w0 (w0 - w)) to first order.
    assert_allclose(coupled_rates(1.0, 1.0 - 1e-10)[1], np.sqrt(6e-10), rtol=1e-6)


def test_gimbal_lock_is_told_by_a_margin():
    assert_allclose(
        gimbal_lock_margin(jnp.array([0.0, np.pi / 2, np.pi])), [1.0, 0.0, 1.0], atol=1e-15
    )


def test_states_hold_what_they_are_given():
    assert isinstance(COMPASS.state(0.1), GyrocompassState)


def test_allan_variance_is_that_of_the_walks(key):
    step, factors = 0.01, (10, 100, 1000)
    errors = gyro_noise(key, 200_000, step, 2e-3, 1e-3)
    found = allan_variance(errors, step, factors)
    expected = allan_of_walks(step * jnp.array(factors, float), 2e-3, 1e-3)
    # Of 200 independent averages of the longest: about 8 per cent.
    assert_allclose(found, expected, rtol=0.25)
    assert_allclose(found[:2], expected[:2], rtol=0.1)


def by_longdouble(rates, m):
    """The Allan variance by second differences of the sums, in extended precision."""
    sums = np.cumsum(np.insert(rates.astype(np.longdouble), 0, 0.0, axis=0), axis=0)
    second = (sums[2 * m :] - sums[m:-m]) - (sums[m:-m] - sums[: -2 * m])
    return np.mean((second / m) ** 2, axis=0).astype(float) / 2.0


def test_allan_variance_of_a_long_log_in_single_precision():
    """Noise of 1e-5 rad/s on a constant rate, a ramp and a slow wave of up to 5 rad/s, and the
    constant rate alone. What the log itself has rounded is in both."""
    samples, factors = 40_000, (1, 7, 100, 3000, 20_000)
    time = np.linspace(0.0, 1.0, samples)[:, None]
    noise = 1e-5 * np.random.default_rng(3).normal(size=(samples, 4)) * [1.0, 1.0, 1.0, 0.0]
    rates = (5.0 * np.hstack([time**0, time, np.sin(9.0 * time), time**0]) + noise).astype("f4")
    variance = jax.jit(lambda x: allan_variance(x, 0.01, factors))
    found = variance(jnp.asarray(rates))
    assert found.dtype == jnp.float32
    expected = [by_longdouble(rates, m) for m in factors]
    # Some roundings of each difference of averages.
    assert_allclose(found, expected, rtol=1e-5, atol=1e-17)
    # d(variance)/d(rates) is linear in them: along the rates themselves it is twice the variance.
    x = jnp.asarray(rates[:, 2])
    _, forward = jax.jvp(lambda x: allan_variance(x, 0.01, (7, 100)), (x,), (x,))
    reverse = jax.grad(lambda x: allan_variance(x, 0.01, (7, 100))[1])(x)
    assert_allclose(forward, 2.0 * np.array(expected)[1:3, 2], rtol=1e-4)
    assert_allclose(np.float64(reverse) @ rates[:, 2], forward[1], rtol=1e-3)


@pytest.mark.parametrize("factors", [(0,), (1, -3), (6,), (1.5,), (), "a"])
def test_factors_of_the_allan_variance(factors):
    """Up to half of the samples, where one difference is left."""
    rates = jnp.array([1.0, 2.0, 4.0, 7.0, 11.0, 16.0, 22.0, 29.0, 37.0, 46.0, 56.0])
    first = 0.5 * (np.mean(rates[5:10]) - np.mean(rates[:5])) ** 2
    second = 0.5 * (np.mean(rates[6:11]) - np.mean(rates[1:6])) ** 2
    assert_allclose(allan_variance(rates, 1.0, (5,)), [0.5 * (first + second)])
    wrong = pytest.raises(InputError, match="factors .* from 1 to 5, half of the 11 rates")
    with unchecked(), wrong:
        allan_variance(rates, 1.0, factors)


def test_the_exponential_is_that_of_scipy_between_powers_of_two():
    """SciPy's, for norms just under a power of two times those of its Pade approximants: the phase
    of |A t| = 160 costs its digits."""
    flow = GYROPENDULUM.closed_form().flow
    y = GyropendulumState(*jnp.array([0.02, -0.01, 0.6, 0.02]))
    linear = GYROPENDULUM.closed_form()
    found = jax.jit(jax.vmap(lambda t: jnp.stack(jax.tree.leaves(flow(t, y)))))
    ts = jnp.array([0.06, 0.12, 0.249, 0.499, 0.999, 1.9])
    for t, state in zip(ts, found(ts), strict=True):
        whole = np.zeros((5, 5))
        whole[:4, :4], whole[:4, 4] = linear.matrix, linear.drive
        exact = scipy.linalg.expm(whole * float(t)) @ [0.02, -0.01, 0.6, 0.02, 1.0]
        np.testing.assert_allclose(state, exact[:4], rtol=0.0, atol=1e-13)


def gyro_of(spring):
    return RateGyro(2e-6, 1e-4, 0.005, spring=spring, input_rate=0.1)


NAVIGATOR = NavigationErrors(
    6.4e6, 9.8, [0.0, 5e-5, 5e-5], [0.0, 0.1, 9.8], altitude_rate_gain=0.01
)
ERRORS = NAVIGATOR.errors(*jnp.array([[100.0, 20.0, 3.0], [0.1, 0.2, 0.3], [1e-4, 2e-4, 3e-4]]))
REST = RateGyroState(jnp.zeros(()), jnp.zeros(()))
FLOWS = {
    "gyro": (gyro_of(0.3), REST, 0.003),
    "later gyro": (gyro_of(0.3), REST, 0.03),
    "stiff gyro": (gyro_of(3e3), REST, 3e-4),
    "no spring": (gyro_of(0.0), REST, 0.03),
    "navigator": (NAVIGATOR, ERRORS, 600.0),
    "navigator back": (NAVIGATOR, ERRORS, -6000.0),
}


@pytest.mark.parametrize("name", FLOWS)
def test_single_precision_loses_the_digits_of_the_phase_alone(name):
    """Against fifty digits, of the same numbers: a rounding for each radian of the fastest motion,
    four times as many for the terms of a Pade approximant and its quotient. SciPy's exponential is
    no truth: that of 1.14 loses blocks beside one that grows by 1e26."""
    single = jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), FLOWS[name])
    found = jax.jit(lambda system, y, t: stacked(system.closed_form().flow(t, y)))(*single)
    assert found.dtype == jnp.float32
    system, y, t = jax.tree.map(lambda x: jnp.asarray(x, float), single)
    flow, n = system.closed_form(), found.size
    whole = np.zeros((n + 1, n + 1))
    whole[:n, :n], whole[:n, n] = flow.matrix, flow.drive
    phase = np.abs(np.linalg.eigvals(whole * t)).max()
    with mpmath.workdps(50):
        exact = mpmath.expm(mpmath.matrix((whole * float(t)).tolist()), method="taylor")
    moved = np.array(exact.tolist(), float)
    start = np.append(stacked(y), 1.0)
    error = np.abs(np.asarray(found, float) - (moved @ start)[:n])
    # Of sums that cancel the terms count.
    size = (np.abs(moved) @ np.abs(start))[:n]
    assert np.all(error <= 4.0 * max(phase, 1.0) * np.finfo(np.float32).eps * size)
