"""The free body through flips of the intermediate axis, from a tilt of the spin of one down to
1e-150: the whole state against thirty digits and more. The square of the tilt is lost from them."""

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
import reference_free_body as reference
from both_modes import both_modes
from numpy.testing import assert_allclose
from test_attitude_free_flow import STARTS, differences

from jaxspace.bodies._free_rotation import free_rotation


@jax.jit
def flow(x):
    """Quaternion of the turn and angular velocity from the moments, omega and the duration."""
    turn, omega = free_rotation(x[6], x[:3], x[3:6])
    return jnp.concatenate([turn.wxyz, omega])


SLOPES = both_modes(flow)
EPS = np.finfo(float).eps


def digits(tilt):
    return 35 + int(-2.0 * np.log10(tilt))


def start(moments, tilt, axis, flips):
    """Moments, omega and the time of so many flips; omega is tilted towards the first axis or the
    third."""
    omega = [0.0, 1.0, 0.0]
    omega[axis] = tilt
    with mpmath.workdps(digits(tilt)):
        quarter = reference.quarter_period(moments, omega)
    return np.array([*moments, *omega, float(2 * flips * quarter)])


def exact(x, periods=0):
    """The state at x[6], which is `periods` whole periods and a rest."""
    x = [mpmath.mpf(float(v)) if not isinstance(v, mpmath.mpf) else v for v in x]
    rest = x[6] - 4 * periods * reference.quarter_period(x[:3], x[3:6])
    turn, omega = reference.closed(x[:3], x[3:6], rest, periods)
    return np.array([*turn, *omega])


def same_sign(state, found):
    """The quaternion of the same turn nearest to the one that was found."""
    sign = 1 if np.dot(state[:4], found[:4]) > 0 else -1
    return np.concatenate([sign * state[:4], state[4:]])


BODIES = [(3.0, 2.0, 1.0), (1.0, 1.7, 2.5), (3.0, 2.999, 1.0), (1.0, 1.001, 1.9)]


def test_both_references_agree():
    with mpmath.workdps(40):
        x = [mpmath.mpf(v) for v in (3.0, 2.0, 1.0, 1e-3, 1.0, 2e-3)]
        turn, omega = reference.taylor(x[:3], x[3:], 6.0, reach=0.25)
        other = reference.closed(x[:3], x[3:], 6.0)
        assert max(abs(a - b) for a, b in zip(turn + omega, sum(other, []), strict=True)) < 1e-25


# In this order each fifth row has another tilt, and all bodies.
@pytest.mark.slow
@pytest.mark.parametrize("tilt", [1e-150, 1.0, 0.1, 1e-3, 1e-6, 1e-10, 1e-20, 1e-60])
@pytest.mark.parametrize("moments", BODIES)
def test_one_flip(moments, tilt):
    for axis in (0, 2):
        for flips in (0.4, 0.55, 1.0):
            x = start(moments, tilt, axis, flips)
            with mpmath.workdps(digits(tilt)):
                found = np.asarray(flow(x))
                truth = same_sign(exact(x), found).astype(float)
            # Rounding of the angle about the momentum, which is that of the duration.
            assert_allclose(found, truth, atol=1e-14 + 4.0 * EPS * x[6])


@pytest.mark.slow
@pytest.mark.parametrize("tilt", [0.1, 1e-3, 1e-10, 1e-100])
@pytest.mark.parametrize("moments", BODIES[:2])
def test_ten_thousand_flips(moments, tilt):
    """As right as the rounding of the inputs allows, which moves the state by what its derivatives
    say."""
    for flips in (1.0, 2.0):
        x = start(moments, tilt, 0, flips + 1e4)
        with mpmath.workdps(digits(tilt)):
            found, forward, _ = (np.asarray(z) for z in SLOPES(x))
            truth = same_sign(exact(x, 5000), found).astype(float)
        loss = EPS * np.abs(forward * x).sum(axis=1).max()
        assert loss < 1e-7
        assert_allclose(found, truth, atol=loss)


@pytest.mark.parametrize(
    "tilt",
    [1e-30, 1e-3, *(pytest.param(x, marks=pytest.mark.slow) for x in (0.1, 1.0, 1e-6, 1e-10))],
)
@pytest.mark.parametrize("flips", [1.03, pytest.param(0.9, marks=pytest.mark.slow)])
def test_derivatives_through_a_flip(flips, tilt):
    x = start((3.0, 2.0, 1.0), tilt, 0, flips)
    columns = []
    with mpmath.workdps(digits(tilt) + 15):
        found, *derivatives = (np.asarray(z) for z in SLOPES(x))
        for i in range(7):
            # A third of the digits: the error of the central difference is the square of the step.
            step = mpmath.mpf(10) ** (-digits(tilt) // 3) * (mpmath.mpf(float(x[i])) or tilt)
            ends = []
            for s in (1, -1):
                moved = [mpmath.mpf(float(v)) + s * step * (i == j) for j, v in enumerate(x)]
                ends.append(same_sign(exact(moved), found))
            columns.append(((ends[0] - ends[1]) / (2 * step)).astype(float))
    truth = np.stack(columns, axis=1)
    for slope in derivatives:
        for i in range(7):
            # The derivatives by the tilt grow and fall with 1/tilt, at rest too they keep their
            # digits. What is left is the rounding of the flip's time, some N t roundings.
            atol = 1e-12 * max(1.0, np.abs(truth[:, i]).max())
            assert_allclose(slope[:, i], truth[:, i], atol=atol)


@pytest.mark.parametrize("tilt", [1e-150, 1e-160, 1e-300, 0.0])
def test_derivatives_are_finite_however_small_the_tilt(tilt):
    for t in (0.0, 1.0, 50.0, 300.0, 600.0):
        x = np.array([3.0, 2.0, 1.0, tilt, 1.0, 0.0, t])
        for slope in SLOPES(x):
            assert np.isfinite(slope).all()


@pytest.mark.parametrize("x", STARTS.values(), ids=STARTS)
def test_derivatives(x):
    """Of every kind of body and start, against differences."""
    x = np.asarray(x)
    _, forward, reverse = SLOPES(x)
    assert_allclose(forward, differences(flow, x), atol=1e-8)
    assert_allclose(reverse, forward, atol=1e-11)
