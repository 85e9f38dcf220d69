"""The drift of the axis by internal damping: its closed form against the rate, integration, the
balance of energy and an independent quadrature."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import quad

from jaxspace import Accuracy, Scene, simulate
from jaxspace.attitude import AttitudeDrift, DriftState, EnergySink
from jaxspace.attitude.drift import (
    FASTEST_DRIFT,
    antenna_drift_constant,
    drift_by_dissipation,
    drift_energy,
    structural_damping,
    tube_drift_constant,
)
from jaxspace.attitude.energy_sink import energy_sink_angle
from jaxspace.bodies import BodyState, RigidBody
from jaxspace.rotations import Quaternion
from jaxspace.solvers import DOP853

K = 6.559e-4
# A tube, antennas without and with resonance, a narrow one, and a body that drifts back.
LAWS = [(K, 0.0, 0.0), (K, 0.7, 0.05), (K, 1.6, 0.1), (K, 1.2, 0.008), (-K, 1.3, 0.03)]
after = jax.jit(lambda law, t, start: AttitudeDrift(*law).angle_after(t, start))
slope = jax.jit(jax.grad(lambda law, t, x: AttitudeDrift(*law).angle_after(t, x), (0, 1, 2)))


@pytest.mark.parametrize("law", LAWS)
def test_the_time_is_the_integral_of_the_inverse_rate(law):
    drift = AttitudeDrift(*law)
    ratio, damping = law[1:]

    def inverse(theta):
        c2 = np.cos(theta) ** 2
        return ((1 - ratio**2 * c2) ** 2 + damping**2) / (law[0] * np.sin(theta) * c2)

    peak = [np.arccos(1.0 / ratio)] if ratio > 1.0 else None
    expected = quad(inverse, 0.02, 1.3, points=peak, epsabs=0.0, epsrel=1e-12, limit=200)[0]
    time = float(drift.drift_time(0.02, 1.3))
    assert_allclose(time, expected, rtol=1e-11)
    # And back: the root of the time.
    assert_allclose(after(law, time, 0.02), 1.3, rtol=1e-12)
    assert_allclose(after(law, -time, 1.3), 0.02, rtol=1e-12)


@pytest.mark.parametrize("law", LAWS)
def test_derivatives_of_the_angle(law):
    drift, t = AttitudeDrift(*law), 900.0
    end = after(law, t, 0.3)
    by_law, by_time, by_start = slope(law, t, 0.3)
    assert_allclose(by_time, drift.rate(end), rtol=1e-11)
    assert_allclose(by_start, drift.rate(end) / drift.rate(0.3), rtol=1e-11)
    for k, step in enumerate((1e-8, 1e-5, 1e-5)):
        low, high = (
            after(tuple(v + s * step * (i == k) for i, v in enumerate(law)), t, 0.3)
            for s in (-1.0, 1.0)
        )
        if law[k] > step:
            assert_allclose(by_law[k], (high - low) / (2.0 * step), rtol=1e-6)


def test_on_the_axis_the_drift_starts_exponentially():
    """theta = 0 stays, and a small angle grows by exp(K t / [(1 - R^2)^2 + alpha^2])."""
    law, t = (K, 1.3, 0.05), 400.0
    assert after(law, t, 0.0) == 0.0
    growth = np.exp(K * t / ((1.0 - 1.3**2) ** 2 + 0.05**2))
    assert_allclose(slope(law, t, 0.0)[2], growth, rtol=1e-13)
    assert_allclose(after(law, t, 1e-9), 1e-9 * growth, rtol=1e-12)


def test_a_right_angle_is_reached_never():
    """cos(theta) falls as 1/(K t): digits of the difference stay."""
    t = 1e9
    assert_allclose(jnp.cos(after((K, 0.0, 0.0), t, 0.1)) * K * t, 1.0, rtol=1e-4)
    assert_allclose(after((K, 0.0, 0.0), 1e30, 0.1), 0.5 * np.pi, rtol=1e-15)


def test_integration_agrees():
    drift = AttitudeDrift(K, 1.2, 0.05)
    run = simulate(drift, DriftState(jnp.array(0.05)), jnp.array([0.0, 2000.0]), accuracy=1e-10)
    by_steps = simulate(
        drift, DriftState(jnp.array(0.05)), jnp.array([0.0, 2000.0]),
        accuracy=Accuracy(rtol=1e-10, method=DOP853()),
    )  # fmt: skip
    assert_allclose(run.final.angle, by_steps.final.angle, rtol=1e-8)


def test_the_rate_loses_the_energy_of_the_dissipation():
    """-dT/dt by the rate is what was dissipated, of a prolate and of an oblate body."""
    for A, C in ((3.0, 1.0), (1.0, 1.6)):
        rate = drift_by_dissipation(0.7, A, C, 5.0, 0.02)
        fall = jax.grad(drift_energy)(0.7, A, C, 5.0) * rate
        assert_allclose(fall, -0.02, rtol=1e-13)
        assert np.sign(rate) == np.sign(A - C)


def test_the_constants_have_the_sign_of_the_drift():
    tube = (0.05, 29e6, 0.1136, 12.0, 3.0, 2.71, 14.5)
    whips = (4.0, 0.05, 0.2, 3.0, 0.4)
    for constant, first in ((tube_drift_constant, tube), (antenna_drift_constant, whips)):
        assert constant(*first, 20.0, 8.0, 150.0) > 0.0
        assert constant(*first, 8.0, 12.0, 150.0) < 0.0
        assert constant(*first, 8.0, 8.0, 150.0) == 0.0
    # Below resonance: the base moves with 2 (C/A) w0^2 sin cos in the mode, a cycle takes
    # pi alpha k x^2, and the load turns at (1 - C/A) w0 cos.
    A, C, w0, theta = 20.0, 8.0, 1.5, 0.6
    count, gamma, M, W1, J = whips
    load = 2.0 * J * (C / A) * w0**2 * np.sin(theta) * np.cos(theta)
    cycle = np.pi * structural_damping(gamma) * load**2 / (M * W1**2)
    loss = count * cycle * (1.0 - C / A) * w0 * np.cos(theta) / (2.0 * np.pi)
    found = AttitudeDrift(antenna_drift_constant(*whips, A, C, w0)).rate(theta)
    assert_allclose(found, drift_by_dissipation(theta, A, C, C * w0, loss), rtol=1e-13)


def test_the_fastest_drift():
    law = AttitudeDrift(K)
    assert_allclose(jax.grad(law.rate)(FASTEST_DRIFT), 0.0, atol=1e-18)
    assert_allclose(law.rate(FASTEST_DRIFT), K * 2.0 / (3.0 * np.sqrt(3.0)), rtol=1e-14)


def test_an_energy_sink_in_a_scene():
    """A symmetric body falls to its axis of greatest moment by the closed form of a slow sink; any
    body keeps the size of its momentum, and loses c w_h^2."""
    A, C, c, theta, h = 1.0, 1.6, 0.02, 0.9, 2.0
    scene = Scene((EnergySink(c),), RigidBody(inertia=[A, A, C]))
    omega = h * jnp.array([jnp.sin(theta) / A, 0.0, jnp.cos(theta) / C])
    y0 = BodyState(attitude=Quaternion.identity(), omega=omega)
    ts = jnp.linspace(0.0, 200.0, 5)
    run = simulate(scene, y0, ts, accuracy=1e-10)
    spin = jnp.array([A, A, C])[:, None] * run.states.omega
    assert_allclose(jnp.sqrt(jnp.sum(spin**2, axis=0)), h, rtol=1e-8)
    found = jnp.arctan2(jnp.hypot(spin[0], spin[1]), spin[2])
    assert_allclose(found, energy_sink_angle(theta, ts, A, C, c), rtol=1e-7)
    away = energy_sink_angle(theta, 1e3, C, A, c)
    assert_allclose(away, 0.5 * np.pi, atol=1e-3)
    # Its direction circles by c w_h/(h psi') at most.
    space = run.states.attitude.rotate(spin)
    first = space[:, :1]
    turned = jnp.sqrt(jnp.sum(jnp.cross(space, first, axis=0) ** 2, axis=0)) / h**2
    assert 0.0 < float(jnp.max(turned)) < 2.0 * c / h
    body = RigidBody(inertia=[1.0, 1.3, 1.9])
    any_body = Scene((EnergySink(c),), body)
    y = BodyState(attitude=Quaternion.identity(), omega=jnp.array([0.4, -0.7, 0.5]))
    rate = any_body.vector_field(jnp.zeros(()), y).omega
    moments = jnp.array([1.0, 1.3, 1.9])
    h = moments * y.omega
    across = y.omega - h * jnp.dot(y.omega, h) / jnp.dot(h, h)
    assert_allclose(jnp.dot(moments * y.omega, rate), -c * jnp.dot(across, across), rtol=1e-12)
    assert_allclose(jnp.dot(h, moments * rate), 0.0, atol=1e-15)
