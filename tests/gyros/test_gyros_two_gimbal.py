"""The gyro in two gimbals: Thomson 6.2 (without gimbal mass), 6.3 (gimbal walk), and what must be
conserved."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from jax.flatten_util import ravel_pytree
from numpy.testing import assert_allclose
from reference_run import check_derivatives, drifts, long_run, run

from jaxspace.core import InputError
from jaxspace.gyros import GimbalState, TwoGimbalGyro
from jaxspace.gyros.duffing import DuffingOscillator
from jaxspace.gyros.gimbal_walk import GimbalWalk
from jaxspace.rotations import Quaternion
from jaxspace.rotations.euler_angles import omega_from_euler_rates

CASE = 1e-9  # relative tolerance of the reference cases
UPRIGHT, SIXTY = 1.5707963267948966, 1.0471975511965979
BARE = TwoGimbalGyro(transverse_inertia=0.002, axial_inertia=0.0008, spin_rate=500.0)
HEAVY = TwoGimbalGyro(
    0.002, 0.0008, 500.0, inner_xi=0.0006, inner_eta=0.0005, inner_zeta=0.0004, outer=0.0015
)


def state(gyro, *values):
    return gyro.state(*(jnp.asarray(v) for v in values))


def test_impulse_on_the_inner_axis():  # T6.2-1x
    y = state(BARE, UPRIGHT, 0.0, 0.004 / 0.002, 0.0)
    states = run(BARE, y, [0.0, 0.02])
    assert_allclose(states.theta[-1], 1.56322730090527, rtol=1e-9)
    assert_allclose(states.psi[-1], 0.016534496174736173, rtol=1e-8)
    theta, psi = BARE.impulse_response(0.02, 0.004)
    assert_allclose(
        [UPRIGHT + theta, psi], [states.theta[-1], states.psi[-1]], atol=4.0 * 0.01**3
    )  # 4 rad, amplitude 0.01


def test_constant_moment_on_the_inner_axis():  # T6.2-P1
    gyro = TwoGimbalGyro(0.002, 0.0008, 500.0, moment_inner=0.02)
    assert_allclose(
        gyro.step_response(0.1), [0.000147979484546652, 0.004771763687318093], rtol=CASE
    )
    states = run(gyro, state(gyro, UPRIGHT, 0.0, 0.0, 0.0), [0.0, 0.1])
    assert_allclose(states.theta[-1], 1.5709443069515414, rtol=1e-9)
    assert_allclose(states.psi[-1], 0.004771763019152748, rtol=1e-8)


def test_constant_moment_on_the_outer_axis():  # T6.2-P4
    gyro = TwoGimbalGyro(0.002, 0.0008, 500.0, moment_outer=0.05)
    assert_allclose(gyro.swing_time(UPRIGHT, 0.0), 8.0, rtol=CASE)
    assert_allclose(gyro.swing(2.0, SIXTY), 0.7227342478134157, rtol=CASE)
    # With a nutation: its amplitude in theta is about A M / H^2, 6e-4 rad, at 5 rad/s of spin
    # momentum per inertia.
    states = run(
        gyro, state(gyro, SIXTY, 0.0, 0.0, 0.0), np.linspace(0.0, 2.0, 3), rtol=1e-9, atol=1e-12
    )
    assert_allclose(states.theta[-1], 0.7227342478134157, atol=2e-3)
    assert_allclose(states.angular_momentum[-1], 0.2 + 0.1, rtol=1e-12)


def test_misaligned_rotor():  # T6.2-P11
    angles, rates = jnp.array([0.0, 1.1, 0.7]), jnp.array([0.3, -0.4, 20.0])
    omega = Quaternion.about(0, 0.05).rotate_back(omega_from_euler_rates(angles, rates))
    assert_allclose(omega, [-0.13369741160939955, 1.4679838626216108, 20.08781476015543], rtol=CASE)


WALKS = [
    (2.0, -0.004738609112709832, -0.0047400409147937686, 0.054519434694265394),
    (0.2, -4.738609112709832e-05, -4.738623426702283e-05, 0.05451968072938296),
]


@pytest.mark.parametrize(("rate", "second_order", "exact", "period"), WALKS)
def test_gimbal_walk(rate, second_order, exact, period):  # T6.3-walk
    walk = HEAVY.walk(SIXTY, rate)
    assert_allclose(HEAVY.outer_inertia(SIXTY), 0.003475, rtol=CASE)
    assert_allclose(
        [HEAVY.nutation_frequency(SIXTY), walk.frequency], [115.24618148307799] * 2, rtol=CASE
    )
    assert_allclose(walk.drift_to_second_order, second_order, rtol=CASE)
    assert_allclose(walk.drift, exact, rtol=CASE)
    assert_allclose(walk.period, period, rtol=CASE)
    # The motion itself, over ten periods from the start at theta_0: psi is then drift times time.
    states = long_run(HEAVY, state(HEAVY, SIXTY, 0.3, rate, 0.0), 10.0 * period, 400)
    assert_allclose(states.theta[-1], SIXTY, atol=1e-12)
    assert_allclose((states.psi[-1] - states.psi[0]) / (10.0 * period), exact, rtol=1e-9)
    assert max(drifts(HEAVY, states, np.linspace(0.0, 10.0 * period, 401)).values()) < 1e-13


def test_mean_of_theta():  # T6.3-P5
    walk = HEAVY.walk(SIXTY, 0.2)
    assert_allclose(walk.offset_to_second_order, -1.2196524436630843e-07, rtol=CASE)
    assert_allclose(walk.offset, -1.219669868774932e-07, rtol=1e-5)
    period = float(walk.period)
    theta = long_run(HEAVY, state(HEAVY, SIXTY, 0.0, 0.2, 0.0), 100.0 * period, 4000).theta
    assert_allclose(jnp.mean(theta[1:]) - SIXTY, -1.219669868774932e-07, rtol=1e-5)
    assert_allclose(
        (theta[-1] - theta[0]) / (100.0 * period), 0.0, atol=1e-10
    )  # theta_secular_rate


def test_walk_vanishes_where_it_must():
    """At 90 deg by symmetry, without gimbal mass because psi' then averages out; it changes sign
    from theta to 180 - theta."""
    assert_allclose(HEAVY.walk(UPRIGHT, 2.0).drift, 0.0, atol=1e-16)
    assert_allclose(HEAVY.walk(np.pi - SIXTY, 2.0).drift, -HEAVY.walk(SIXTY, 2.0).drift, rtol=1e-12)
    assert_allclose(HEAVY.walk(SIXTY, -2.0).drift, HEAVY.walk(SIXTY, 2.0).drift, rtol=1e-12)
    assert_allclose(BARE.walk(SIXTY, 2.0).drift_to_second_order, 0.0, atol=0.0)
    # The axis of a free body runs round a circle and back to its start: no drift to any order.
    assert_allclose(BARE.walk(SIXTY, 2.0).drift, 0.0, atol=1e-13)


@given(
    st.floats(0.4, 2.7),
    st.floats(-5.0, 5.0),
    st.floats(-5.0, 5.0),
    st.floats(-1.0, 1.0),
    st.floats(-1.0, 1.0),
)
def test_rate_of_every_invariant_is_zero(theta, theta_rate, psi_rate, moment_inner, moment_outer):
    gyro = TwoGimbalGyro(
        *(jnp.asarray(v) for v in (2.0, 0.8, 5.0, 0.6, 0.5, 0.4, 1.5, moment_inner, moment_outer))
    )
    y = state(gyro, theta, 0.1, theta_rate, psi_rate)
    for change in INVARIANT_RATES(gyro, jnp.asarray(0.7), y).values():
        assert_allclose(change, 0.0, atol=1e-11)  # sums of terms up to 1e3
    assert_allclose(gyro.outer_rate(y), psi_rate, atol=1e-13)


@jax.jit
def INVARIANT_RATES(gyro, t, y):
    return jax.jvp(gyro.invariants, (t, y), (jnp.ones_like(t), gyro.vector_field(t, y)))[1]


def test_equations_are_those_of_the_lagrangian():
    """T = (A + A_i) theta'^2/2 + I_Z psi'^2/2 + C (phi' + psi' cos theta)^2/2, differentiated
    instead of written out."""
    A, C, Ai, Bi, Ci, C0, Mx, Mz = 2.0, 0.8, 0.6, 0.5, 0.4, 1.5, 0.3, -0.2
    gyro = TwoGimbalGyro(A, C, 5.0, Ai, Bi, Ci, C0, Mx, Mz)
    q, psi_rate = jnp.array([0.9, 0.2, 0.0]), 1.3
    v = jnp.array([-0.7, psi_rate, 5.0 - psi_rate * np.cos(0.9)])

    def lagrangian(q, v):
        theta, (theta_rate, psi_rate, phi_rate) = q[0], v
        s, c = jnp.sin(theta), jnp.cos(theta)
        inner = (A + Ai) * theta_rate**2 + ((A + Bi) * s**2 + Ci * c**2 + C0) * psi_rate**2
        return 0.5 * (inner + C * (phi_rate + psi_rate * c) ** 2) + Mx * theta + Mz * q[1]

    mass = jax.hessian(lagrangian, 1)(q, v)
    coupling = jax.jacfwd(jax.grad(lagrangian, 1), 0)(q, v) @ v
    acceleration = jnp.linalg.solve(mass, jax.grad(lagrangian, 0)(q, v) - coupling)
    y = state(gyro, 0.9, 0.2, -0.7, psi_rate)
    rate = gyro.vector_field(0.0, y)
    assert_allclose(rate.theta_rate, acceleration[0], rtol=1e-13)
    _, psi_acceleration = jax.jvp(gyro.outer_rate, (y,), (rate,))
    assert_allclose(psi_acceleration, acceleration[1], rtol=1e-13)


def test_gimbal_lock_needs_gimbals_without_mass():
    with pytest.raises(InputError, match="theta is 0 rad, gimbal lock"):
        state(BARE, 0.0, 0.0, 1.0, 0.0)
    # In a batch only the run that is locked has no rate.
    locked = state(BARE, np.array([0.0, 0.5]), 0.0, 1.0, 0.0)
    np.testing.assert_array_equal(np.isfinite(BARE.outer_rate(locked)), [False, True])
    through = state(HEAVY, 0.5, 0.0, -200.0, 0.0)
    states = run(HEAVY, through, np.linspace(0.0, 0.01, 11))
    assert np.min(states.theta) < 0.0 and np.all(np.isfinite(states.psi))
    assert (
        max(drifts(HEAVY, states, np.linspace(0.0, 0.01, 11)).values()) < 1e-11
    )  # DOP853 at rtol 1e-12


STARTS = {
    "general": [2.0, 0.8, 5.0, 0.6, 0.5, 0.4, 1.5, 0.3, -0.2, 0.9, 0.2, -0.7, 1.3],
    "locked": [2.0, 0.8, 5.0, 0.6, 0.5, 0.4, 1.5, 0.3, -0.2, 0.0, 0.2, -0.7, 1.3],
    "no spin": [2.0, 0.8, 0.0, 0.6, 0.5, 0.4, 1.5, 0.0, 0.0, 0.9, 0.2, -0.7, 1.3],
    "at rest, massless": [2.0, 2.0, 5.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.9, 0.0, 0.0, 0.0],
}


def motion(v):
    """Rates and invariants of a gyro (nine numbers) in a state (four)."""
    gyro = TwoGimbalGyro(*v[:9])
    y = gyro.state(*v[9:])
    return jnp.concatenate(
        [ravel_pytree(gyro.vector_field(0.2, y))[0], ravel_pytree(gyro.invariants(0.2, y))[0]]
    )


@pytest.mark.parametrize("x", STARTS.values(), ids=STARTS)
def test_derivatives_of_the_motion(x):
    check_derivatives(motion, x)


def walk_results(v):
    """All results of the walk of a gyro (seven numbers) from an angle at a rate."""
    w = TwoGimbalGyro(*v[:7]).walk(v[7], v[8])
    return jnp.stack(
        [
            w.drift,
            w.period,
            w.offset,
            w.drift_to_second_order,
            w.offset_to_second_order,
        ]
    )


@pytest.mark.sweep
@pytest.mark.parametrize("rate", [0.6, 0.0])
def test_derivatives_of_the_walk(rate):
    check_derivatives(walk_results, [2.0, 0.8, 5.0, 0.6, 0.5, 0.4, 1.5, 0.9, rate])


def test_a_gimbal_that_passes_the_pole_does_not_walk():
    """Whether it passes changes at the greatest rate; from there on the exact results say so, and
    so do their derivatives."""
    gyro = TwoGimbalGyro(2.0, 0.8, 5.0, 0.6, 0.5, 0.4, 1.5)
    limit = float(gyro.walk(0.9, 0.1).greatest_rate)
    slope_of_drift = jax.jit(jax.value_and_grad(lambda rate: gyro.walk(0.9, rate).drift))
    for rate, passes in ((0.999 * limit, False), (1.001 * limit, True)):
        theta = run(gyro, state(gyro, 0.9, 0.0, -rate, 0.0), np.linspace(0.0, 20.0, 401)).theta
        assert (np.min(theta) < 0.0) == passes
        drift, slope = slope_of_drift(rate)
        assert np.isnan(drift) == np.isnan(slope) == passes


def test_single_precision_stays():
    y = HEAVY.state(*(jnp.asarray(v, jnp.float32) for v in (1.0, 0.0, 2.0, 0.1)))
    walk = HEAVY.walk(jnp.asarray(1.0, jnp.float32), jnp.asarray(2.0, jnp.float32))
    for tree in (
        y,
        HEAVY.vector_field(0.0, y),
        HEAVY.invariants(0.0, y),
        walk.drift,
        walk.period,
    ):
        assert {x.dtype for x in jax.tree.leaves(tree)} == {jnp.dtype("float32")}


def test_a_batch_is_a_loop():
    values = np.random.default_rng(4).uniform(0.5, 1.5, (13, 4))

    @jax.jit
    def everything(v):
        gyro = TwoGimbalGyro(*v[:9])
        y = gyro.state(*v[9:])
        walk = gyro.walk(v[9], 0.1 * v[11])
        return (
            y,
            gyro.vector_field(0.3, y),
            gyro.invariants(0.3, y),
            walk.drift,
            walk.offset,
            walk.period,
        )

    batch = everything(jnp.asarray(values))
    for i in range(4):
        one = everything(jnp.asarray(values[:, i]))
        jax.tree.map(
            lambda a, b, i=i: assert_allclose(a[..., i], b, rtol=1e-12, atol=1e-14), batch, one
        )
    assert HEAVY.vector_field(0.0, jax.tree.map(lambda x: x[:3], batch[0])).theta.shape == (3,)
    assert HEAVY.walk(jnp.ones(3), 0.5).drift.shape == (3,)


def test_bad_input_is_named():
    with pytest.raises(InputError, match=r"TwoGimbalGyro\.outer is -1"):
        TwoGimbalGyro(1.0, 1.0, 1.0, outer=-1.0)
    with pytest.raises(InputError, match=r"TwoGimbalGyro\.axial_inertia is 0"):
        TwoGimbalGyro(1.0, 0.0, 1.0)
    assert isinstance(state(BARE, 1.0, 0.0, 0.0, 0.0), GimbalState)


@pytest.mark.parametrize("name", ["drift", "offset"])
def test_the_means_of_a_small_nutation_keep_their_digits(name):
    """They are of second order: a mean of terms of first order would lose seven digits of them."""

    def mean(rate, exact):
        walk = GimbalWalk(*map(jnp.asarray, (1.1, rate, 1.0, 1.0, 0.6, 1.3)))
        return getattr(walk, name if exact else f"{name}_to_second_order")

    # What follows the second order is the square of the rate, 1e-14, times some ten.
    assert_allclose(mean(1e-7, True), mean(1e-7, False), rtol=1e-12)
    slope, expected = (jax.grad(mean)(1e-7, exact) for exact in (True, False))
    assert_allclose(slope, expected, rtol=1e-12)


def test_second_harmonic_of_the_gimbal_walk():
    """6.3-P1: 0.003118 rad/s of cos(2 w t) in psi' for a rate of 2 rad/s, as the exact motion has
    it in the limit of a small nutation: the step of Runge and Kutta is a two-thousandth of it."""
    H, J, I1, I2, theta, rate = 0.4, 0.0026, 0.0019, 0.004, np.pi / 3.0, 0.02
    walk = GimbalWalk(*map(jnp.asarray, (theta, rate, H, J, I1, I2)))
    scaled, _ = jax.jit(lambda walk: walk.second_harmonic)(
        GimbalWalk(*map(jnp.asarray, (theta, 2.0, H, J, I1, I2)))
    )
    assert_allclose(scaled, 0.003118, atol=5e-7)  # the digits of the case

    def outer(angle):
        inertia = I1 * np.cos(angle) ** 2 + I2 * np.sin(angle) ** 2
        return H * (np.cos(theta) - np.cos(angle)) / inertia

    def field(y):
        psi_rate = outer(y[0])
        bend = (I2 - I1) * np.sin(y[0]) * np.cos(y[0]) * psi_rate**2
        return np.array([y[1], (bend - H * psi_rate * np.sin(y[0])) / J])

    steps, y, path = 2000, np.array([theta, rate]), []
    h = float(walk.period) / steps
    for _ in range(steps):
        path.append(y[0])
        a = field(y)
        b = field(y + 0.5 * h * a)
        c = field(y + 0.5 * h * b)
        y = y + h / 6.0 * (a + 2.0 * b + 2.0 * c + field(y + h * c))
    path = np.array(path)
    wave = 2.0 / steps * np.cos(4.0 * np.pi / steps * np.arange(steps))
    # Fourth-order terms: the amplitude 1.7e-4 squared; of psi', first harmonics cancel to 1e-7.
    for found, series in zip(walk.second_harmonic, (outer(path), path - theta), strict=True):
        assert_allclose(found, series @ wave, rtol=1e-6)
    # Of second order in the rate, in both modes.
    turning = lambda walk: walk.theta_rate  # noqa: E731
    for mode in (jax.jacfwd, jax.jacrev):
        slope = mode(lambda r: eqx.tree_at(turning, walk, r).second_harmonic[0])(jnp.array(2.0))
        assert_allclose(slope, scaled, rtol=1e-13)


def test_balance_of_any_spring():
    """(k - 3/4 b a^2) a = F of either sign and any size: the root near the linear one, and the only
    one beyond the jump, where Newton's steps from the linear one wander for ever."""
    key = np.random.default_rng(0)
    k, b, force = key.normal(size=(3, 20_000)) * 10.0 ** key.uniform(-3.0, 3.0, (3, 20_000))
    a = np.asarray(DuffingOscillator(1.0, k, b, force).harmonic_balance())
    terms = k * a, -0.75 * b * a**3, -force
    # A rounding of each term.
    assert_allclose(sum(terms) / sum(map(np.abs, terms)), 0.0, atol=1e-15)
    # Up to the jump it is within 1.5 of the linear one, and on its side.
    near = (k * b < 0.0) | (81.0 * np.abs(b) * force**2 < 16.0 * np.abs(k) ** 3)
    assert np.all((a * k / force)[near] > 0.0) and np.all((a * k / force)[near] < 1.5)
    assert np.all((a * k / force)[~near] < 0.0)


def test_resonance_curve_of_a_softening_spring():
    """6.3-P3, P4: by the amplitude, the frequencies that the harmonic balance has; without damping
    p^2 = (k - 3/4 b a^2)/m -+ F/(a m)."""
    spring = DuffingOscillator(1.0, 4.0, 0.1, 1.0, 1.0)
    a = spring.harmonic_balance()
    lower, _ = spring.resonance_frequencies(a)
    assert_allclose(lower, 1.0, rtol=1e-13)
    lower, upper = spring.resonance_frequencies(jnp.array([0.5, 2.0]))
    amplitude = np.array([0.5, 2.0])
    middle = 4.0 - 0.075 * amplitude**2
    assert_allclose(lower, np.sqrt(middle - 1.0 / amplitude), rtol=1e-14)
    assert_allclose(upper, np.sqrt(middle + 1.0 / amplitude), rtol=1e-14)

    # With damping: (K - m p^2)^2 + c^2 p^2 = (F/a)^2, and nothing beyond the peak.
    @jax.jit
    def damped(a):
        return DuffingOscillator(1.0, 4.0, 0.1, 1.0, 1.0, 0.2).resonance_frequencies(a)

    for p in damped(jnp.array([1.0, 2.0])):
        K = 4.0 - 0.075 * np.array([1.0, 4.0])
        assert_allclose((K - p**2) ** 2 + 0.04 * p**2, [1.0, 0.25], rtol=1e-12)
    assert np.all(np.isnan(damped(jnp.array([4.0]))))
    for mode in (jax.jacfwd, jax.jacrev):
        slopes = mode(lambda a: jnp.stack(spring.resonance_frequencies(a)))(2.0)
        # d(p^2)/da = -3/2 b a +- F/a^2.
        by_square = np.array([-0.3 + 0.25, -0.3 - 0.25])
        assert_allclose(slopes, 0.5 * by_square / np.array([lower[1], upper[1]]), rtol=1e-13)
