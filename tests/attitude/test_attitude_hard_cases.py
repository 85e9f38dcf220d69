"""Places where the formulas of rotation lose their digits, each against an analytic truth: nearly
equal moments, fast tops, ten thousand nutations, the sleeping top at its limit, a half turn."""

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from both_modes import both_modes
from numpy.testing import assert_allclose
from test_attitude_nutation import WL, A, C, exact, swing, tilted

from jaxspace.attitude import Top, TorqueFreeBody
from jaxspace.attitude.polhode import Polhode
from jaxspace.attitude.torque_free import symmetric_flow
from jaxspace.bodies import BodyState
from jaxspace.rotations import Quaternion

TOP = Top(A, C, WL)


@jax.jit
def flow(v, t):
    """Attitude and rate of a top, a time later."""
    y = BodyState(attitude=Quaternion(v[3:7]), omega=v[7:])
    end = Top(v[0], v[1], v[2]).closed_form().flow(t, y)
    return end.attitude.wxyz, end.omega


def tilt_of(wxyz):
    """The angle of the axis from the upward vertical, with all digits near it."""
    across = 2.0 * np.hypot(wxyz[1], wxyz[2]) * np.hypot(wxyz[0], wxyz[3])
    up = wxyz[0] ** 2 + wxyz[3] ** 2 - wxyz[1] ** 2 - wxyz[2] ** 2
    return np.arctan2(across, up)


Q0, RATES = Quaternion([0.7, 0.1, -0.5, 0.5]).normalised(), np.array([0.3, -0.2, 0.9])


@jax.jit
def by_symmetry(omega, turn):
    """Attitude and rate after 50 s, and their slopes by the rate; `turn` leads from axes whose
    third is that of symmetry to those of the body."""

    def end_of(omega):
        y = BodyState(attitude=Q0.then(Quaternion.from_matrix(turn)), omega=turn.T @ omega)
        end = symmetric_flow(50.0, y, 1.0, 2.0)
        back = end.attitude.then(Quaternion.from_matrix(turn.T))
        state = jnp.concatenate([back.wxyz, turn @ end.omega])
        return state, state

    slopes, state = jax.jacfwd(end_of, has_aux=True)(omega)
    return state, slopes


@jax.jit
def by_ellipses(omega, moments):
    """The same by the flow of a body of any three moments."""

    def end_of(omega):
        y = BodyState(attitude=Q0, omega=omega)
        end = TorqueFreeBody(moments).closed_form().flow(jnp.asarray(50.0), y)
        state = jnp.concatenate([end.attitude.wxyz, end.omega])
        return state, state

    slopes, state = jax.jacfwd(end_of, has_aux=True)(omega)
    return state, slopes


@pytest.mark.parametrize("which", [(0, 1), (1, 2), (0, 2)])
def test_moments_that_differ_by_a_rounding(which):
    """To 1e-14 it is the symmetric body, whatever axis that has; its derivatives, too."""
    other = 3 - sum(which)
    nearly = np.where(np.arange(3) == other, 2.0, 1.0)
    nearly[which[0]] += 1e-14
    # The axis of symmetry is the third one of `symmetric_flow`: the axes in a right-handed order.
    turn = np.eye(3)[[(other + 1) % 3, (other + 2) % 3, other]].T
    truth, expected = (np.array(x) for x in by_symmetry(RATES, turn))
    found, slopes = by_ellipses(RATES, nearly)
    sign = np.sign(np.sum(truth[:4] * found[:4]))
    truth[:4] *= sign
    # 50 s of turning by 1 rad/s, each radian to a rounding.
    assert_allclose(found, truth, atol=2e-13)
    expected[:4] *= sign
    assert_allclose(slopes, expected, atol=2e-12 * np.max(np.abs(expected)))


@pytest.mark.parametrize("ratio", [1e4, 1e6, 1e10])
def test_a_fast_top(ratio):
    """(Cn)^2/(A W l) of instruments: the width of the nutation keeps its digits beside 0.8 rad, and
    a thousand nutations their phase."""
    n = np.sqrt(ratio * A * WL) / C
    v = tilted((A, C, WL), 0.8, [0.0, 0.0, n])
    with mpmath.workdps(100):
        truth = [float(x) for x in exact([mpmath.mpf(float(x)) for x in v])]
    found = swing(v)
    assert_allclose(found, truth, rtol=1e-14)
    # 2 A W l sin/(Cn)^2 to first order: of the width itself nothing is lost but the rounding of the
    # angle.
    width = 2.0 * np.sin(0.8) / ratio
    assert_allclose(found[1] - found[0], width, rtol=5.0 / ratio, atol=3e-16)
    wxyz, _ = flow(v, jnp.asarray(1000.0 * truth[2]))
    assert_allclose(tilt_of(wxyz), 0.8, atol=1e-13)
    wxyz, _ = flow(v, jnp.asarray(1000.5 * truth[2]))
    assert_allclose(tilt_of(wxyz), truth[1], atol=1e-13)


def test_ten_thousand_nutations():
    """The axis is back at its tilt, and its precession is ten thousand times that of one."""
    v = tilted((A, C, WL), 0.7, [0.0, 0.0, 150.0])
    with mpmath.workdps(60):
        low, _, period, turn = exact([mpmath.mpf(float(x)) for x in v])
        time, turned = 10_000 * period, float(mpmath.fmod(10_000 * turn, 2 * mpmath.pi))
    wxyz, omega = flow(v, jnp.asarray(float(time)))
    assert_allclose(tilt_of(wxyz), float(low), atol=1e-12)
    assert_allclose(omega[2], 150.0, rtol=1e-14)
    # psi from the node: the sum and the difference of psi and phi are the angles of (q0, q3) and
    # (q1, q2).
    psi = np.arctan2(wxyz[3], wxyz[0]) + np.arctan2(wxyz[2], wxyz[1])
    psi_0 = np.arctan2(v[6], v[3]) + np.arctan2(v[5], v[4])
    # Some 600 rad, each number of the motion to a rounding.
    assert_allclose(np.exp(1j * (psi - psi_0)), np.exp(1j * turned), atol=1e-11)


@pytest.mark.parametrize("gap", [0.0, 1e-12, -1e-12, 1e-6, -1e-6, 1e-3, -1e-3])
def test_a_sleeping_top_at_its_limit(gap):
    """A tilt of 1e-6 at rest, at the critical spin and on both sides of it: z = theta e^(i psi)
    seen from axes that turn at C n/(2A) obeys z'' + W^2 z = 0, W^2 = ((Cn)^2 - 4 A W l)/(2A)^2."""
    n = float(TOP.least_spin(0.0)) * (1.0 + gap)
    tilt, half = 1e-6, 0.5 * C * n / A
    v = tilted((A, C, WL), tilt, [0.0, 0.0, n])
    square = half**2 - WL / A
    if gap == 0.0:
        square = 0.0  # but for the rounding of n
    t = np.array([0.1, 0.7, 2.0])
    rate = np.sqrt(complex(square) + 1e-300)
    z = np.cos(rate * t) - 1j * half * np.sin(rate * t) / rate
    for when, place in zip(t, z, strict=True):
        wxyz, _ = flow(v, jnp.asarray(when))
        # The cube of the tilt, which grows to 1e-4, and the rounding of W^2 over the time.
        assert_allclose(tilt_of(wxyz), tilt * abs(place), rtol=1e-6)


@both_modes
def through_the_logarithm(v):
    """The vector of a turn back from its quaternion."""
    return Quaternion.from_rotation_vector(v).rotation_vector()


@pytest.mark.parametrize("short", [0.0, 1e-15, 1e-9, 1e-4])
def test_logarithm_of_a_half_turn(short):
    """The vector of a turn by pi, and just below it, comes back; its slopes are those of one."""
    direction = np.array([0.48, -0.6, 0.64])
    v = (np.pi - short) * direction

    found, forward, reverse = through_the_logarithm(v)
    found = np.asarray(found)
    # At pi itself both signs name the same turn.
    sign = np.sign(found @ direction)
    assert_allclose(sign * found, v, atol=1e-15 * 8)
    if short > 1e-12:
        assert sign == 1.0
        assert_allclose(forward, np.eye(3), atol=1e-12)
    assert np.isfinite(forward).all() and np.isfinite(reverse).all()


FLIPPING = np.array([1.0, 1.7, 2.5])


@both_modes
def time_of_a_flip(log_tilt):
    omega = 1.3 * jnp.stack([jnp.exp(log_tilt), jnp.ones(()), 0.0 * log_tilt])
    return 0.5 * Polhode.of(jnp.asarray(FLIPPING), omega).period


@pytest.mark.parametrize("tilt", [1e-4, 1e-8, 1e-14])
def test_slope_of_the_time_of_a_flip(tilt):
    """From a spin about the middle axis, tilted by that much: 2 K(k)/N, with K = ln(4/k') and k'
    proportional to the tilt, so that the time falls by 2/N for each e-fold of it, N the rate of
    growth."""
    growth = np.sqrt((2.5 - 1.7) * (1.7 - 1.0) / (2.5 * 1.0)) * 1.3
    at = np.log(tilt)
    for slope in time_of_a_flip(at)[1:]:
        # What is neglected is of the order of the square of the tilt times its logarithm.
        assert_allclose(slope, -2.0 / growth, rtol=1e-12 + 20.0 * tilt**2 * abs(at))
