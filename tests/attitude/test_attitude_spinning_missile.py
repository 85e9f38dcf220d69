"""A spinning missile under transverse moments: the closed forms against quadrature, mpmath, the
exact motion for small angles, and their removable singularities."""

from functools import partial

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxspace.attitude import SpinningMissile
from jaxspace.attitude.spinning_missile import _mean_ramp, principal_tilt
from jaxspace.attitude.torque_free import symmetric_flow
from jaxspace.bodies import BodyState, InertiaTensor
from jaxspace.rotations import Quaternion
from jaxspace.rotations.tilt import complex_tilt

START, ANGLE = jnp.array([0.03, -0.02]), jnp.array([0.01, 0.02])
MOMENT, TILT = jnp.array([0.4, -0.7]), jnp.array([0.02, -0.01])
# Prolate, oblate, a sphere, a body that does not spin, a fast one.
BODIES = jnp.array(
    [[40.0, 4.0, 6.0], [10.0, 12.0, 3.0], [5.0, 5.0, 2.0], [5.0, 2.0, 0.0], [9.0, 1.0, 300.0]]
)


@jax.jit
def motion(body, t, frequency, start=START, angle=ANGLE, moment=MOMENT, tilt=TILT):
    missile = SpinningMissile(*body)
    rate = missile.transverse_rate(t, start, moment, frequency)
    return rate, missile.complex_tilt(t, angle, start, moment, frequency, tilt)


def test_the_closed_forms_solve_their_equations():
    """w' - i lam w = M e^(i nu t)/A; Th' is w turned by the spin, and the wobble of an axis askew:
    seen in body axes the principal axis, not the z axis, moves with w."""

    def as_complex(x):
        return np.asarray(x)[0] + 1j * np.asarray(x)[1]

    for body in BODIES:
        A, C, n = np.asarray(body)
        rate = n * (C - A) / A
        # At resonance with the nutation, with the precession, between, and steady.
        for nu in (rate, -n, 0.7, 0.0):
            t = jnp.array(1.7)
            found, slope = jax.jvp(partial(motion, body, frequency=nu), (t,), (jnp.ones(()),))
            w, w1, th1 = (as_complex(x) for x in (found[0], *slope))
            push = as_complex(MOMENT) * np.exp(1j * nu * 1.7) / A
            assert_allclose(w1 - 1j * rate * w, push, rtol=1e-11, atol=1e-12)
            askew = (
                as_complex(TILT) * 1j * n * (np.exp(1j * (n + rate) * 1.7) - np.exp(1j * n * 1.7))
            )
            assert_allclose(th1, w * np.exp(1j * n * 1.7) + askew, rtol=1e-11, atol=1e-12)
        still, _ = motion(body, 0.0, 0.7)
        assert_allclose(still, START, rtol=1e-15)


def test_any_moment_is_integrated():
    """A half-sine by quadrature and as two harmonics, of w and Th."""
    missile = SpinningMissile(*BODIES[0])

    def pulse(t):
        return jnp.stack([0.4 * jnp.sin(0.9 * t), 0.0 * t])

    zero = jnp.zeros(2)
    half = jnp.array([0.0, -0.2])
    for t in (0.4, 9.0):
        by_parts = [
            motion(BODIES[0], t, nu, zero, zero, m, zero) for nu, m in ((0.9, half), (-0.9, -half))
        ]
        rate, angle = (a + b for a, b in zip(*by_parts, strict=True))
        assert_allclose(missile.transverse_rate(t, zero, pulse), rate, rtol=1e-11, atol=1e-16)
        assert_allclose(missile.complex_tilt(t, zero, zero, pulse), angle, rtol=1e-11, atol=1e-16)


def test_resonance_grows_with_time():
    missile = SpinningMissile(*BODIES[0])
    t = jnp.array([10.0, 100.0, 1e4])
    w, _ = motion(BODIES[0], t, missile.nutation_rate, jnp.zeros(2))
    assert_allclose(jnp.hypot(*w), jnp.hypot(*MOMENT) / 40.0 * t, rtol=1e-12)


@pytest.mark.parametrize(
    "places", [(0.3, 0.2), (0.99, -0.99), (1.01, 0.5), (5.0, 5.0), (20.0, 20.00001), (1e-9, 0.0)]
)
def test_the_divided_difference_has_no_singular_place(places):
    mp.mp.dps = 80
    x, y = mp.mpf(places[0]) + mp.mpf(10) ** -30, mp.mpf(places[1]) + mp.mpf(10) ** -31

    def mean(z):
        return (mp.exp(1j * z) - 1) / (1j * z)

    expected = complex((mean(x) - mean(y)) / (1j * (x - y)))
    found = np.asarray(_mean_ramp(*places))
    assert_allclose(found, [expected.real, expected.imag], atol=1e-15 * max(1.0, abs(expected)))


def test_the_closed_forms_are_the_exact_motion_for_small_angles():
    """A free body whose principal axis stands askew: the error falls with the third power."""

    def error(size):
        askew = Quaternion.from_rotation_vector(jnp.array([*(size * TILT), 0.0]))
        start = jnp.array([*(size * START), 3.0])
        turned = Quaternion.from_rotation_vector(jnp.array([*(size * ANGLE), 0.0]))
        # In principal axes, which stand turned by the tilt from those of the body.
        y0 = BodyState(attitude=turned.then(askew), omega=askew.rotate_back(start))
        end = symmetric_flow(4.0, y0, 10.0, 12.0).attitude.then(askew.inverse())
        _, expected = motion(
            BODIES[1], 4.0, 0.0, size * START, size * ANGLE, jnp.zeros(2), size * TILT
        )
        return float(jnp.max(jnp.abs(complex_tilt(end) - expected))) / size

    errors = [error(s) for s in (1.0, 0.1)]
    assert errors[0] < 1e-3
    assert_allclose(errors[0] / errors[1], 100.0, rtol=0.1)


def test_the_tilt_of_a_tensor():
    """The axis nearest to z, whatever the order of the moments; tan(beta) = E/D for a turn about
    x (Thomson, Problem 8 of 7.4)."""
    tilt = jnp.array([0.05, -0.11, 0.0])
    frame = Quaternion.from_rotation_vector(tilt).matrix()
    for moments in ((1.0, 1.3, 1.2), (1.1, 1.0, 1.9), (1.3, 1.25, 0.4), (1.0, 1.0, 1.5)):
        tensor = frame @ jnp.diag(jnp.array(moments)) @ frame.T
        assert_allclose(principal_tilt(InertiaTensor(tensor)), tilt[:2], rtol=1e-12)
    turned = Quaternion.about(0, jnp.array(0.07)).then(Quaternion.about(2, jnp.array(0.6))).matrix()
    tensor = turned @ jnp.diag(jnp.array([1.0, 1.1, 1.5])) @ turned.T
    assert_allclose(jnp.tan(principal_tilt(InertiaTensor(tensor))[0]), tensor[0, 2] / tensor[0, 1])


def test_a_tilt_of_1e_9_has_all_digits():
    # By 40 digits of the eigenvector; one of float64 is right to 1e-16, not to 1e-16 of its tilt.
    numbers = jnp.array([2.7, 2.0, 1.5, -9e-13, -5.7e-9, 1e-9])

    def tilt(x):
        return principal_tilt(InertiaTensor(x[jnp.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]])]))

    def truth(x):
        m = mp.matrix([[x[0], x[3], x[4]], [x[3], x[1], x[5]], [x[4], x[5], x[2]]])
        values, axes = mp.eigsy(m)
        # Beside the diagonal.
        k = min(range(3), key=lambda k: abs(values[k] - x[2]))
        along = axes[:, k] * mp.sign(axes[2, k])
        return [-along[1], along[0]]

    with mp.workdps(40):
        x = [mp.mpf(float(c)) for c in numbers]
        value = [float(c) for c in truth(x)]
        h = mp.mpf(10) ** -22
        moved = truth([*x[:4], x[4] * (1 + h), x[5]])
        slope = [float((a - b) / (h * x[4])) for a, b in zip(moved, truth(x), strict=True)]
    # Of the moments' difference, 1/5 of them.
    assert_allclose(jax.jit(tilt)(numbers), value, rtol=5e-15)
    for mode in (jax.jacfwd, jax.jacrev):
        assert_allclose(jax.jit(mode(tilt))(numbers)[:, 4], slope, rtol=1e-13, atol=1e-17)
