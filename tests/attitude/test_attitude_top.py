"""The heavy top: Thomson 5.13, 5.14 and 6.1, Harrison and Nettleton 4.11, and what must hold of any
top."""

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from both_modes import both_modes
from hypothesis import given
from hypothesis import strategies as st
from jax.flatten_util import ravel_pytree
from numpy.testing import assert_allclose
from reference_run import check_derivatives, drifts, long_run, run

from jaxspace.attitude import Top, TorqueFreeBody
from jaxspace.attitude.nutation import Nutation
from jaxspace.attitude.outputs import continuous_precession
from jaxspace.attitude.torque_free import symmetric_flow
from jaxspace.bodies import BodyState
from jaxspace.core import InputError
from jaxspace.rotations import Quaternion

CASE = 1e-9  # relative tolerance of the reference cases
A, C, WL = 0.002, 0.0008, 0.3
TOP = Top(A, C, WL)
FIFTY = 0.8726646259971648  # rad


angles_of, rates_of = jax.jit(Top.angles), jax.jit(Top.rates)
precession_of = jax.jit(continuous_precession)


def released(theta, n, psi_rate=0.0, theta_rate=0.0):
    """The state at `theta` with the total spin n."""
    return Top.state(
        jnp.array([0.0, theta, 0.0]),
        jnp.array([psi_rate, theta_rate, n - psi_rate * np.cos(theta)]),
    )


NUTATIONS = {
    "T5.13-cusp": dict(
        start=(0.6981317007977318, 150.0),
        theta=[0.6981317007977318, 0.7572592485908576],
        tol=[CASE, CASE],
        u3=11.273278551581763,
        period=0.11180709586030699,
        psi=0.28854075183975536,
        mean=2.5807016059182986,
        constants=[60.0, 300.0, 45.962666587138685, 229.8133329356934],
        states={
            0.05: [0.755694366933263, 0.11499016947497484],
            0.5: [0.7568161470447645, 1.2828092852469635],
            2.0: [0.7053609656450497, 5.1908858120517065],
        },
    ),
    "T5.13-slow": dict(
        start=(0.5235987755982989, 45.0),
        theta=[0.5235987755982989, 1.627729553337187],
        tol=[CASE, CASE],
        u3=1.1369024743731644,
        period=0.46501980129292714,
        psi=3.7606424733079185,
        mean=8.087058793737258,
        constants=[18.0, 300.0, 15.588457268119896, 259.8076211353316],
        states={
            0.1: [0.8602301176060432, 0.2838831822612862],
            0.5: [0.5686452838164364, 3.778451072844197],
            1.0: [0.696057141447547, 7.639133401163674],
        },
    ),
    "T5.13-near0": dict(
        start=(0.3490658503988659, 150.0, 30.942015944610034),
        theta=[0.00011206067924660718, 0.3490658503988659],
        tol=[1e-6, CASE],
        u3=11.373318346036164,
        period=0.11246846633118651,
        psi=6.567686918242301,
        mean=58.39580757598665,
        constants=[60.0, 300.0, 60.001085532825854, 393.90328816298245],
        states={
            0.02: [0.2954486044119057, 0.6169874598532951],
            0.2: [0.2670273329074586, 12.367228971510569],
        },
    ),
}


@pytest.mark.parametrize("case", NUTATIONS.values(), ids=NUTATIONS)
def test_nutation_in_closed_form(case):
    nutation = TOP.nutation(released(*case["start"]))
    gamma = 0.5 * (nutation.gamma_up + nutation.gamma_down)
    alpha = 0.5 * (nutation.alpha_up + nutation.alpha_down)
    constants = [nutation.N, nutation.beta, gamma, alpha]
    assert_allclose(constants, case["constants"], rtol=CASE)
    for theta, expected, tol in zip(
        nutation.turning_points, case["theta"], case["tol"], strict=True
    ):
        assert_allclose(theta, expected, rtol=tol)
    assert_allclose(nutation.third_root / nutation.beta, case["u3"], rtol=CASE)
    assert_allclose(nutation.period, case["period"], rtol=CASE)
    assert_allclose(nutation.precession, case["psi"], rtol=CASE)
    assert_allclose(nutation.mean_precession_rate, case["mean"], rtol=CASE)


@pytest.mark.parametrize("case", NUTATIONS.values(), ids=NUTATIONS)
def test_nutation_in_time(case):
    # Samples dense enough for the spike of psi' near the vertical: there the axis swings past
    # within 1e-5 s.
    dense = np.linspace(0.0, max(case["states"]), 401)
    spikes = (
        [k * case["period"] / 2 + np.linspace(-2e-4, 2e-4, 161) for k in (1, 3)]
        if case["theta"][0] < 0.01
        else []
    )
    ts = np.unique(np.concatenate([dense, *spikes, list(case["states"])]))
    states = run(TOP, released(*case["start"]), ts)
    psi, theta = precession_of(states), angles_of(states)[1]
    for t, expected in case["states"].items():
        i = np.searchsorted(ts, t)
        assert_allclose([theta[i], psi[i]], expected, rtol=1e-8)
    assert max(drifts(TOP, states, ts).values()) < 1e-11  # rtol 1e-12 over up to 50 turns
    assert (
        np.all(rates_of(states)[0] >= -1e-6 * np.max(np.abs(rates_of(states)[0])))
        or case["theta"][0] > 0.01
    )


def test_long_run():  # T5.13-long
    states = long_run(TOP, released(0.6981317007977318, 150.0), 20.0, 16000)
    assert_allclose(angles_of(states)[1, -1], 0.7064303911108745, rtol=1e-8)
    assert_allclose(precession_of(states)[-1], 51.64527364769969, rtol=1e-8)


def test_sleeping_top():  # T5.14-sleep, H4.11-95
    critical = TOP.least_spin(0.0)
    assert_allclose(critical, 61.237243569579455, rtol=CASE)
    slow, fast = TOP.steady_precession_rates(0.0, 1.2 * critical)
    assert_allclose([fast, slow], [22.82097686133503, 6.572900052063108], rtol=CASE)
    assert_allclose(TOP.sleeping_growth_rate(0.8 * critical), 7.3484692283495345, rtol=CASE)
    assert TOP.sleeping_growth_rate(1.2 * critical) == 0.0
    # The growth rate is that of the motion: a tilt of 1e-6 rad after growth by e^4.
    y = released(1e-6, 0.8 * float(critical))
    ts = 0.5, 0.9
    end = angles_of(run(TOP, y, [0.0, *ts]))[1]
    assert_allclose(
        jnp.log(end[2] / end[1]) / (ts[1] - ts[0]), 7.3484692283495345, rtol=1e-3
    )  # the decaying part: e^-7


def test_steady_precession():  # T5.14-steady
    slow, fast = TOP.steady_precession_rates(FIFTY, 150.0)
    assert_allclose([slow, fast], [2.5708033766137244, 90.77262623501102], rtol=CASE)
    assert_allclose(TOP.least_spin(FIFTY), 49.09636988947882, rtol=CASE)
    assert_allclose(TOP.momentum_angle(FIFTY, slow, 150.0), 0.03281071489584299, rtol=CASE)
    assert_allclose(TOP.momentum_angle(FIFTY, fast, 150.0), 0.8588812551620129, rtol=CASE)
    assert_allclose(TOP.nutation_frequency(FIFTY, slow, 150.0), 56.729232078326326, rtol=CASE)
    assert_allclose(TOP.nutation_frequency(FIFTY, fast, 150.0), 89.71936291953774, rtol=CASE)
    peak = 46.67171480581237
    assert_allclose(TOP.precession_moment(FIFTY, peak, 150.0), 2.1451564666695777, rtol=CASE)
    assert_allclose(
        jax.grad(lambda p: TOP.precession_moment(FIFTY, p, 150.0))(peak), 0.0, atol=1e-15
    )
    for rate in (slow, fast):
        assert_allclose(TOP.precession_moment(FIFTY, rate, 150.0), WL * np.sin(FIFTY), rtol=1e-12)
    light = Top(A, C, WL * 1e-9)
    assert_allclose(
        1e9 * light.steady_precession_rates(FIFTY, 150.0)[0], 2.5, rtol=1e-8
    )  # slow_approx, W l/(C n)
    assert_allclose(
        light.steady_precession_rates(FIFTY, 150.0)[1], 93.34342961162474, rtol=1e-8
    )  # fast_approx


def test_slow_precession_from_the_momentum():  # T5.14-P5
    slow, _ = TOP.precession_rates_from_momentum(FIFTY, 0.08015173186048741)
    assert_allclose(slow, 2.5708033766137244, rtol=CASE)


def test_momentum_angle_in_the_limits():  # T5.14-P9
    least = TOP.least_spin(FIFTY)
    double_root = C * least / (2.0 * A * np.cos(FIFTY))
    assert_allclose(TOP.momentum_angle(FIFTY, double_root, least), 0.5373822171631671, rtol=CASE)
    slow, fast = TOP.steady_precession_rates(FIFTY, 2000.0)
    assert_allclose(A * WL * np.sin(FIFTY) / (C * 2000.0) ** 2, 0.00017954166635601048, rtol=CASE)
    assert_allclose(
        jnp.tan(TOP.momentum_angle(FIFTY, slow, 2000.0)), 0.00017956872306177786, rtol=CASE
    )
    assert_allclose(jnp.tan(TOP.momentum_angle(FIFTY, fast, 2000.0)), 1.191574023871148, rtol=CASE)


def test_equal_precession_at_both_circles():  # T5.14-P10
    theta = 0.6981317007977318
    n = TOP.least_spin(theta)
    # Just above the least spin, where both roots are the double root to half the digits.
    psi_rate = 0.5 * sum(TOP.steady_precession_rates(theta, n * (1.0 + 1e-15)))
    assert_allclose([n, psi_rate], [53.597263565374, 13.993251709300516], rtol=CASE)
    assert_allclose(TOP.nutation_frequency(theta, psi_rate, n), 8.99468881796336, rtol=CASE)
    assert_allclose(TOP.precession_per_nutation(theta, psi_rate, n), 0.0, atol=1e-7)


def test_small_nutation():  # T6.1
    slow, _ = TOP.steady_precession_rates(FIFTY, 150.0)
    assert_allclose(
        2.0 * np.pi / TOP.nutation_frequency(FIFTY, slow, 150.0), 0.11075745390849574, rtol=CASE
    )
    assert_allclose(
        2.0 * np.pi / TOP.nutation_frequency(FIFTY, 0.0, 1e9) * 1e9 / 150.0,
        0.10471975511965978,
        rtol=CASE,
    )
    assert_allclose(TOP.precession_per_nutation(FIFTY, slow, 150.0), 74.01011702964495, rtol=CASE)
    # The large nutation tends to it as the square of its size, 1e-8 rad^2 here.
    nutation = TOP.nutation(released(FIFTY, 150.0, slow, 1e-4 * 56.7))
    assert_allclose(nutation.period, 0.11075745390849574, rtol=1e-7)
    assert_allclose(nutation.mean_precession_rate, slow, rtol=1e-5)
    low, high = nutation.turning_points
    assert_allclose([low - FIFTY, high - FIFTY], [-1e-4, 1e-4], rtol=1e-3)


@pytest.mark.parametrize("spin", [65.0, 150.0, -150.0, 1e6])
@pytest.mark.parametrize("theta", [0.3, 1.5707963267948966, 2.5])
def test_both_steady_rates_balance_the_weight(spin, theta):  # GYRO-PRECESSION
    slow, fast = TOP.steady_precession_rates(theta, spin)
    assert_allclose(slow * (C * spin - A * slow * np.cos(theta)), WL, rtol=1e-13)
    # The fast root's bracket is a difference that keeps eps (C n)^2 / (A W l cos) of the weight's
    # digits.
    loss = 1.0 + (C * spin) ** 2 / (A * WL * abs(np.cos(theta)))
    if loss < 1e10:
        assert_allclose(fast * (C * spin - A * fast * np.cos(theta)), WL, rtol=1e-14 * loss)
    assert_allclose(slow, WL / (C * spin), rtol=2.0 * A * WL / (C * spin) ** 2)


def test_steady_precession_is_steady():
    slow, _ = TOP.steady_precession_rates(FIFTY, 150.0)
    states = run(TOP, released(FIFTY, 150.0, float(slow)), np.linspace(0.0, 1.0, 21))
    assert_allclose(angles_of(states)[1], FIFTY, atol=1e-11)  # rtol 1e-12 over some ten turns
    assert_allclose(rates_of(states)[0], slow, rtol=1e-9)
    assert_allclose(precession_of(states), slow * np.linspace(0.0, 1.0, 21), atol=1e-10)


def test_harrison_cosine_curve():  # H4.11-95
    # cos(theta) of steady precession against x = 1/psi'.
    cosine = lambda x: (C * 50.0 * x - WL * x * x) / A  # noqa: E731
    x = 0.06666666666666667
    assert_allclose(cosine(x), 0.6666666666666666, rtol=CASE)
    assert_allclose(jax.grad(cosine)(x), 0.0, atol=1e-12)
    assert_allclose(TOP.least_spin(jnp.arccos(0.6666666666666666)), 50.0, rtol=CASE)
    slow, fast = TOP.steady_precession_rates(1.2, 50.0)
    assert_allclose([cosine(1.0 / slow), cosine(1.0 / fast)], [np.cos(1.2)] * 2, rtol=1e-12)
    # The momentum of the steady precession at the maximum has its least V' there.
    angle = jnp.arccos(jnp.asarray(0.6666666666666666))
    h_Z = A / x * jnp.sin(angle) ** 2 + C * 50.0 * jnp.cos(angle)
    assert_allclose(TOP.pseudo_potential_minimum(h_Z, 50.0), angle, rtol=CASE)


@jax.jit
def pseudo(theta, h_Z, n):
    at = TOP.pseudo_potential_minimum(h_Z, n)
    return TOP.pseudo_potential(theta, h_Z, n), at, TOP.pseudo_potential(at, h_Z, n)


def test_pseudo_potential_and_its_minimum():  # H4.11
    """The formula itself where nothing cancels; the minimum is the steady precession with these
    momenta, of both rates."""
    theta, n = np.radians([20.0, 50.0, 130.0]), np.array([150.0, 80.0, -60.0])
    for rate in map(np.asarray, TOP.steady_precession_rates(jnp.asarray(theta), jnp.asarray(n))):
        h_Z = A * rate * np.sin(theta) ** 2 + C * n * np.cos(theta)
        V, at, least = pseudo(jnp.asarray(theta) + 0.1, jnp.asarray(h_Z), jnp.asarray(n))
        cosine = np.cos(theta + 0.1)
        turning = (h_Z - C * n * cosine) ** 2 / (2.0 * A * np.sin(theta + 0.1) ** 2)
        assert_allclose(V, turning + WL * cosine, rtol=1e-13)
        # The momentum keeps the angle to its roundings.
        assert_allclose(at, theta, rtol=1e-12)
        assert np.all(least < V)


def test_pseudo_potential_ends_at_the_nutation_s_turning_points():
    y = released(0.7, 150.0, 0.0)
    h_Z = C * 150.0 * np.cos(0.7)
    for end in TOP.nutation(y).turning_points:
        # Let go at rest: its energy is that of the height.
        V = TOP.pseudo_potential(end, h_Z, 150.0)
        assert_allclose(V, WL * np.cos(0.7), rtol=1e-12)


def test_pseudo_potential_at_the_verticals():
    """Finite with its derivatives where the axis may pass, infinite where it may not; near the
    vertical C^2 n^2 tan^2(theta/2)/(2 A) + W l cos(theta), whose minimum leaves it below the
    critical spin: cos^2(theta/2) = C n/sqrt(4 A W l)."""
    critical = float(TOP.least_spin(0.0))
    n = jnp.array([2.0, 0.5]) * critical
    p = C * n
    V, at, _ = pseudo(jnp.array([1e-9, 0.3]), p, n)
    half = np.tan(0.5 * np.array([1e-9, 0.3])) ** 2
    expected = np.asarray(p) ** 2 * half / (2.0 * A) + WL * np.cos([1e-9, 0.3])
    assert_allclose(V, expected, rtol=1e-14)
    assert at[0] == 0.0
    assert_allclose(np.cos(0.5 * at[1]) ** 2, 0.5, rtol=1e-13)
    V, at, _ = pseudo(jnp.array([0.0, 0.0]), p + jnp.array([0.0, 1e-3]), n)
    assert V[0] == WL and V[1] == np.inf
    # It hangs: h_Z = -C n, and the least V' is below; without spin that of a pendulum.
    assert pseudo(0.1, -C * 100.0, 100.0)[1] == np.pi and pseudo(0.1, 0.0, 0.0)[1] == np.pi
    for mode in (jax.jacfwd, jax.jacrev):
        slopes = jax.jit(mode(lambda x: TOP.pseudo_potential(x[0], C * x[1], x[1])))
        assert np.all(np.isfinite(slopes(jnp.array([0.0, 150.0]))))


def test_derivatives_of_the_pseudo_potential_s_minimum():
    """By the implicit function: of h_Z against that of the steady precession's own momentum."""
    theta, n = 0.7, 150.0

    def momentum(theta):
        slow = TOP.steady_precession_rates(theta, n)[0]
        return A * slow * jnp.sin(theta) ** 2 + C * n * jnp.cos(theta)

    h_Z, slope = jax.value_and_grad(momentum)(theta)
    for mode in (jax.jacfwd, jax.jacrev):
        found = jax.jit(mode(lambda h: TOP.pseudo_potential_minimum(h, n)))(h_Z)
        assert_allclose(found * slope, 1.0, rtol=1e-10)
    # Single precision keeps its seven digits.
    with jax.numpy_dtype_promotion("standard"):
        single = jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), TOP)
        found = single.pseudo_potential_minimum(jnp.float32(h_Z), jnp.float32(n))
    assert found.dtype == jnp.float32
    assert_allclose(found, theta, rtol=1e-3)  # the momentum's digits, over 1 - cos of the tilt


def test_precession_time_against_the_first_rate():  # H4.25
    theta = 0.6981317007977318
    slow, _ = TOP.steady_precession_rates(theta, 150.0)
    assert_allclose(slow, 2.5853369301824585, rtol=CASE)
    starts = [released(theta, 150.0, float(slow) * f) for f in (0.0, 0.5, 1.0, 1.5, 2.0)]
    ratios = [slow / TOP.nutation(y).mean_precession_rate for y in starts]
    expected = [1.001796148866467, 1.0006692079247508, 1.0, 0.9997915655656495, 1.0000467850988592]
    assert_allclose(ratios, expected, rtol=CASE)


angle = st.floats(-3.0, 3.0)


@given(angle, st.floats(0.0, 3.0), angle, st.lists(st.floats(-50.0, 50.0), min_size=3, max_size=3))
def test_angles_and_rates_return(psi, theta, phi, rates):
    if 0.0 < theta < 1e-6:
        theta = 0.0
    y, angles, back, again = ROUND_TRIP(jnp.array([psi, theta, phi]), jnp.array(rates))
    if theta > 0.0:
        # An angle of the axis near the vertical keeps the absolute error of the quaternion,
        # 1e-16/theta.
        assert_allclose(angles, [psi, theta, phi], atol=1e-14 / theta + 1e-13)
        assert_allclose(back, rates, atol=1e-12 / theta**2 + 1e-12)
    assert_allclose(again.attitude.matrix(), y.attitude.matrix(), atol=1e-13)
    # At the vertical the rates return in one sense alone: nutation and psi' + phi'.
    if theta > 0.0 or psi == 0.0:
        assert_allclose(again.omega, y.omega, atol=1e-9)
    assert_allclose(back[0] * np.cos(theta) + back[2], y.omega[2], rtol=1e-9, atol=1e-9)


@jax.jit
def ROUND_TRIP(angles, rates):
    y = Top.state(angles, rates)
    return y, Top.angles(y), Top.rates(y), Top.state(Top.angles(y), Top.rates(y))


def test_through_the_vertical():
    """A top thrown through the upright position: h_Z = C n there, the axis passes theta = 0
    exactly."""
    y = Top.state(jnp.array([0.4, 0.0, 0.3]), jnp.array([0.0, 25.0, 150.0]))
    before = run(TOP, y, [0.0, -0.02])
    ts = np.linspace(-0.02, 0.02, 9)
    states = run(TOP, jax.tree.map(lambda x: x[..., -1], before), ts)
    assert_allclose(
        ravel_pytree(jax.tree.map(lambda x: x[..., 4], states))[0], ravel_pytree(y)[0], atol=1e-9
    )
    theta = np.asarray(angles_of(states)[1])
    assert theta[4] < 1e-9 and np.all(np.delete(theta, 4) > 0.1)
    assert_allclose(theta, theta[::-1], atol=1e-9)  # the motion is its own mirror in time
    assert np.all(np.isfinite(rates_of(states)))
    assert max(drifts(TOP, states, ts).values()) < 1e-11
    nutation = TOP.nutation(y)
    assert_allclose(nutation.turning_points[0], 0.0, atol=1e-12)
    assert np.isfinite(nutation.period) and np.isfinite(nutation.precession)


def test_without_weight_it_is_the_free_symmetric_body():
    y = Top.state(jnp.array([0.3, 0.9, -0.4]), jnp.array([4.0, 1.0, 20.0]))
    top, body = Top(2.0, 3.0, 0.0), TorqueFreeBody([2.0, 2.0, 3.0])
    assert_allclose(
        ravel_pytree(top.vector_field(0.0, y))[0],
        ravel_pytree(body.vector_field(0.0, y))[0],
        atol=1e-12,
    )
    last = jax.tree.map(lambda x: x[..., -1], run(top, y, [0.0, 1.0]))
    assert_allclose(
        ravel_pytree(last)[0], ravel_pytree(symmetric_flow(1.0, y, 2.0, 3.0))[0], atol=1e-10
    )
    momentum = body.invariants(0.0, y)["angular_momentum"]
    nutation = top.nutation(
        y
    )  # about Z, from which h is inclined: one turn about h is one nutation
    assert_allclose(nutation.period, 2.0 * np.pi * 2.0 / jnp.linalg.norm(momentum), rtol=1e-13)
    tilt = jnp.arctan2(jnp.hypot(momentum[0], momentum[1]), momentum[2])
    axis = y.attitude.rotate(jnp.array([0.0, 0.0, 1.0]))
    cone = jnp.arccos(axis @ momentum / jnp.linalg.norm(momentum))
    assert_allclose(nutation.turning_points, [abs(tilt - cone), tilt + cone], rtol=1e-12)


@given(
    st.floats(0.1, 3.0),
    st.floats(0.2, 1.9),
    st.floats(-2.0, 2.0),
    st.lists(st.floats(-5.0, 5.0), min_size=3, max_size=3),
    angle,
)
def test_rate_of_every_invariant_is_zero(A, ratio, Wl, rates, theta):
    top = Top(jnp.asarray(A), jnp.asarray(A * ratio), jnp.asarray(Wl))
    y = Top.state(jnp.array([0.2, theta, 0.5]), jnp.array(rates))
    _, change = INVARIANT_RATES(top, y)
    assert_allclose(list(change.values()), 0.0, atol=1e-11)  # sums of terms up to 1e3


@jax.jit
def INVARIANT_RATES(top, y):
    return jax.jvp(lambda y: top.invariants(0.0, y), (y,), (top.vector_field(0.0, y),))


def test_mean_precession_is_that_of_the_motion():
    y = released(1.1, 90.0, -4.0, 3.0)
    nutation = TOP.nutation(y)
    period = float(nutation.period)
    states = run(TOP, y, np.linspace(0.0, period, 65))
    theta = np.asarray(angles_of(states)[1])
    assert_allclose(theta[-1], 1.1, atol=1e-10)
    assert_allclose(precession_of(states)[-1], nutation.precession, atol=1e-10)
    low, high = nutation.turning_points
    assert low <= theta.min() + 1e-12 and theta.max() <= high + 1e-12
    assert_allclose(
        [theta.min(), theta.max()], [low, high], atol=2e-3
    )  # 65 samples: amplitude (pi/65)^2/2 of 0.1 and more


STARTS = {
    "tilted": [2.0, 3.0, 0.7, 0.3, 0.9, -0.4, 0.5, 0.2, 1.5],
    "upright": [2.0, 3.0, 0.7, 0.0, 0.0, 0.4, 0.0, 0.2, 1.5],
    "no spin": [2.0, 3.0, 0.7, 0.3, 0.9, -0.4, 0.5, 0.2, 0.0],
    "sphere": [2.0, 2.0, 0.7, 0.3, 0.9, -0.4, 0.5, 0.2, 1.5],
    "at rest": [2.0, 3.0, 0.7, 0.3, 0.9, -0.4, 0.0, 0.0, 0.0],
}


# The laws ask for the slopes by the state, `test_attitude_top_motion.py` for those of the closed
# form by the state and the top.
@pytest.mark.sweep
@pytest.mark.parametrize("x", STARTS.values(), ids=STARTS)
def test_derivatives_of_the_motion(x):
    def motion(v):
        top, y = Top(v[0], v[1], v[2]), Top.state(v[3:6], v[6:9])
        return jnp.concatenate(
            [ravel_pytree(top.vector_field(0.0, y))[0], ravel_pytree(top.invariants(0.0, y))[0]]
        )

    check_derivatives(motion, x)


@pytest.mark.slow
@pytest.mark.parametrize("x", STARTS.values(), ids=STARTS)
def test_derivatives_of_the_angles(x):
    start = Top.state(jnp.array(x[3:6]), jnp.array(x[6:9]))

    def read(v):
        y = BodyState(attitude=Quaternion(v[:4]), omega=v[4:])
        return jnp.concatenate([Top.angles(y), Top.rates(y)])

    at = np.concatenate([start.attitude.wxyz, start.omega])
    if x[4] == 0.0:  # the angles have a corner there: finite is what can be asked for
        assert np.all(np.isfinite(jax.jacfwd(read)(jnp.asarray(at)))) and np.all(
            np.isfinite(jax.jacrev(read)(jnp.asarray(at)))
        )
    else:
        check_derivatives(read, at)


@pytest.mark.sweep
def test_derivatives_of_the_closed_forms():
    def steady(v):
        top, theta, n = Top(v[0], v[1], v[2]), v[3], v[4]
        slow, fast = top.steady_precession_rates(theta, n)
        return jnp.stack(
            [slow, fast, top.least_spin(theta), top.nutation_frequency(theta, slow, n)]
        )

    def forms(v):
        top, theta, n = Top(v[0], v[1], v[2]), v[3], v[4]
        slow, _ = top.steady_precession_rates(theta, n)
        nutation = top.nutation(
            Top.state(jnp.array([0.0, 1.0, 0.0]) * theta, jnp.array([0.1, 0.0, 1.0]) * n)
        )
        return jnp.stack(
            [
                *steady(v),
                *(
                    top.sleeping_growth_rate(0.1 * n),
                    top.momentum_angle(theta, slow, n),
                    *nutation.turning_points,
                ),
                *(
                    nutation.period,
                    nutation.precession,
                    *top.precession_rates_from_momentum(theta, v[1] * n),
                ),
            ]
        )

    check_derivatives(forms, [1.3, 1.0, 0.7, 0.8, 4.0], rtol=1e-6)
    forward, reverse = jax.jit(jax.jacfwd(steady)), jax.jit(jax.jacrev(steady))
    # Without weight the least spin begins as sqrt(Wl): that one slope, row 2 to Wl, is infinite.
    for x in ([1.3, 1.0, 0.7, 0.0, 4.0], [1.3, 1.3, 0.0, 0.8, 4.0], [1.3, 1.0, -0.7, 0.8, 0.0]):
        for derivative in (forward(jnp.array(x)), reverse(jnp.array(x))):
            infinite = np.argwhere(~np.isfinite(derivative)).tolist()
            assert infinite == ([[2, 2]] if x[2] == 0.0 else [])
            assert x[2] != 0.0 or derivative[2, 2] == np.inf


def test_continuous_precession_of_many_runs():
    """Times behind the components, runs last: each run by itself."""
    psi = jnp.linspace(0.0, 20.0, 50)[:, None] * jnp.array([1.0, -0.5, 0.3])
    angles = jnp.stack([psi, 0.8 + 0.0 * psi, 0.0 * psi])
    states = Top.state(angles, 0.0 * angles)
    assert_allclose(continuous_precession(states), psi, atol=1e-13)


def test_derivative_of_continuous_precession():
    def psi(shift):
        angles = jnp.stack([jnp.array([3.0, 3.2, 6.0]) + shift, jnp.ones(3), jnp.zeros(3)])
        return continuous_precession(Top.state(angles, 0.0 * angles))

    value, *slopes = jax.jit(lambda x: (psi(x), jax.jacfwd(psi)(x), jax.jacrev(psi)(x)))(0.0)
    assert_allclose(value, [3.0, 3.2, 6.0], atol=1e-14)
    for slope in slopes:
        assert_allclose(slope, np.ones(3), atol=1e-14)


def test_single_precision_stays():
    y = Top.state(
        jnp.array([0.1, 0.5, 0.2], jnp.float32), jnp.array([1.0, 0.0, 150.0], jnp.float32)
    )

    @jax.jit
    def period(y):
        return TOP.nutation(y).period

    @jax.jit
    def everything(y, theta, n):
        nutation = TOP.nutation(y)
        return (
            *(y, TOP.vector_field(0.0, y), TOP.invariants(0.0, y)),
            *(Top.angles(y), Top.rates(y), nutation),
            *(nutation.turning_points, nutation.period, nutation.precession),
            TOP.steady_precession_rates(theta, n),
            continuous_precession(jax.tree.map(lambda x: x[..., None], y)),
        )

    trees = everything(y, np.float32(0.5), np.float32(150.0))
    for tree in trees:
        assert {x.dtype for x in jax.tree.leaves(tree) if not x.weak_type} == {jnp.dtype("float32")}
    assert_allclose(period(y), period(jax.tree.map(lambda x: x.astype(float), y)), rtol=1e-5)


def test_a_batch_is_a_loop():
    rng = np.random.default_rng(3)
    values = np.concatenate([rng.uniform(1.0, 2.0, (3, 4)), rng.uniform(-1.0, 1.0, (6, 4))])
    values[4] = [0.0, 0.5, 1.0, 2.0]

    @jax.jit
    def everything(v):
        top, y = Top(v[0], v[1], v[2]), Top.state(v[3:6], v[6:9])
        nutation = top.nutation(y)
        forms = (
            top.steady_precession_rates(v[4], 9.0),
            top.least_spin(v[4]),
            nutation.turning_points,
            nutation.precession,
        )
        return (
            y,
            top.vector_field(0.0, y),
            top.invariants(0.0, y),
            Top.angles(y),
            Top.rates(y),
            nutation.period,
            forms,
        )

    batch = everything(values)
    for i in range(4):
        one = everything(values[:, i])
        jax.tree.map(
            lambda a, b, i=i: assert_allclose(np.asarray(a)[..., i], b, rtol=1e-12, atol=1e-13),
            batch,
            one,
        )
    # One top for all runs: its scalars meet states of any number of runs.
    y = Top.state(jnp.asarray(values[3:6]), jnp.asarray(values[6:9]))
    assert TOP.vector_field(0.0, y).omega.shape == (3, 4)


def test_bad_input_is_named():
    with pytest.raises(InputError, match=r"Top\.axial_inertia is 0"):
        Top(1.0, 0.0, 1.0)
    with pytest.raises(InputError, match=r"Top\.weight_moment"):
        Top(1.0, 1.0, np.inf)
    with pytest.raises(InputError, match="attitude and omega"):
        TOP.vector_field(0.0, BodyState(attitude=Quaternion.identity()))


@jax.jit
def swing(v):
    """Turning angles, period and precession from N, alpha, beta and gamma."""
    nutation = Nutation.of(*v)
    return jnp.stack([*nutation.turning_points, nutation.period, nutation.precession])


SLOPES = both_modes(swing)


@pytest.mark.parametrize("beta", [2.0, -2.0], ids=["stands", "hangs"])
@pytest.mark.parametrize("height", [0.5, -0.95, 1.5])
def test_plane_pendulum(height, beta):
    """theta'^2 = alpha - beta cos(theta): back and forth through the lowest place, or over the top;
    no precession."""
    lowest, highest = (np.pi, 0.0) if beta > 0.0 else (0.0, np.pi)
    turn = np.arccos(height * np.sign(beta)) if height < 1.0 else highest
    swings, energy = height < 1.0, height * abs(beta)
    m = (1.0 + height) / 2.0 if swings else 2.0 / (1.0 + height)
    period = (
        4.0 * float(mpmath.ellipk(m)) / np.sqrt(2.0 * abs(beta) if swings else energy + abs(beta))
    )
    v = np.array([0.0, energy, beta, 0.0])
    assert_allclose(swing(v), [*sorted([turn, lowest]), period, 0.0], atol=1e-13)
    differences = [(swing(v + 1e-6 * e) - swing(v - 1e-6 * e))[2] / 2e-6 for e in np.eye(4)]
    for slopes in SLOPES(v)[1:]:
        assert_allclose(slopes[2], differences, rtol=1e-7, atol=1e-8)


@pytest.mark.parametrize("size", [1e-9, 1e-5, 1e-3, 0.05])
def test_nearly_plane_pendulum(size):
    """Against the roots of the cubic in 50 digits; the swing turns in half a turn and a bit."""
    v = np.array([size, 1.0, 2.0, 3.0 * size])
    with mpmath.workdps(50):
        N, alpha, beta, gamma = (mpmath.mpf(x) for x in v)

        def cubic(u):
            return (alpha - beta * u) * (1 - u * u) - (gamma - N * u) ** 2

        low, high, third = (mpmath.findroot(cubic, u) for u in (-1, 0.5, 1))
        m = (high - low) / (third - low)
        period = 4 * mpmath.ellipk(m) / mpmath.sqrt(beta * (third - low))
        exact = [float(x) for x in (mpmath.acos(high), mpmath.acos(low), period)]
    found = swing(v)
    assert_allclose(found[:3], exact, rtol=1e-12)
    assert_allclose(found[3], np.pi, atol=10.0 * size)
