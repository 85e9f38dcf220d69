"""The closed form of the heavy top: value and derivative against the Taylor series of the equations
of motion, in 18 digits, with complex steps; the reference cases; steps and batches."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree
from numpy.testing import assert_allclose
from systems import Integrated

from jaxspace import simulate
from jaxspace.attitude import Top
from jaxspace.bodies import BodyState
from jaxspace.rotations import Quaternion

A, C, WL = 0.002, 0.0008, 0.3
TOP = Top(A, C, WL)
ORDER = 28


@jax.jit
def flow(v, duration):
    """Quaternion and angular velocity, (7, *runs), from v = (A, C, W l, quaternion, omega)."""
    y = BodyState(attitude=Quaternion(v[3:7]), omega=v[7:])
    later = Top(*v[:3]).closed_form().flow(duration, y)
    return jnp.concatenate([later.attitude.wxyz, later.omega])


@jax.jit
def flow_and_rate(v, dv, duration):
    return jax.jvp(lambda v: flow(v, duration), (v,), (dv,))


ANGLES = jax.jit(lambda top, duration, y: top.closed_form().angles(duration, y))


def series(v, duration):
    """The same as `flow`, by Taylor series; polynomials, so that complex steps are derivatives."""
    A, C, Wl = v[:3]
    q, w = v[3:7], v[7:]
    size = max(np.max(np.abs(v[7:])), np.max(np.abs(C / A * w[2])), np.max(np.abs(Wl / A)) ** 0.5)
    # h w < 0.8: the terms fall as 0.8^k / k!, below 1e-19 at the 28th.
    steps = int(np.ceil(np.max(np.abs(duration)) * float(size) / 0.8))
    h = duration / steps
    for _ in range(steps):
        Q, W = (np.zeros((ORDER + 1, *x.shape), x.dtype) for x in (q, w))
        Q[0], W[0] = q, w
        for k in range(ORDER):

            def times(f, g, k=k):
                return np.sum(f[: k + 1] * g[k::-1], axis=0)

            (q0, q1, q2, q3), (a, b, c) = np.moveaxis(Q, 1, 0), np.moveaxis(W, 1, 0)
            rate = [
                -times(q1, a) - times(q2, b) - times(q3, c),
                times(q0, a) + times(q2, c) - times(q3, b),
                times(q0, b) + times(q3, a) - times(q1, c),
                times(q0, c) + times(q1, b) - times(q2, a),
            ]
            Q[k + 1] = np.stack(rate) / (2 * (k + 1))
            Zx = 2 * (times(q1, q3) - times(q0, q2))
            Zy = 2 * (times(q2, q3) + times(q0, q1))
            spin = (A - C) / A * w[2]
            rate = [spin * b[k] + Wl / A * Zy, -spin * a[k] - Wl / A * Zx, 0 * Zx]
            W[k + 1] = np.stack(rate) / (k + 1)
        q = sum(Q[k] * h**k for k in range(ORDER + 1))
        w = sum(W[k] * h**k for k in range(ORDER + 1))
    return np.concatenate([q, w])


SLOW, FAST = (float(x) for x in TOP.steady_precession_rates(0.6, 150.0))
CRITICAL = float(TOP.least_spin(0.0))
# W l, the angles, their rates with the total spin n as the last, and the time.
MOTIONS = {
    "cusps": (WL, [0.2, 0.7, 0.1], [0.0, 0.0, 150.0], 0.11),
    "loops": (WL, [0.2, 0.7, 0.1], [-4.0, 1.0, 120.0], 0.12),
    "waves, backwards": (WL, [0.2, 0.7, 0.1], [5.0, 0.3, -90.0], -0.12),
    "large nutation": (WL, [0.2, 0.5236, 0.1], [0.0, 0.0, 45.0], 0.14),
    "past the vertical": (WL, [0.0, 0.349, 0.0], [30.942, 0.0, 150.0], 0.12),
    "through the vertical": (WL, [0.4, 0.0, 0.3], [0.0, 25.0, 90.0], 0.14),
    "hangs": (-WL, [0.2, 0.7, 0.1], [3.0, 0.3, 49.0], 0.14),
    "through the bottom": (WL, [0.2, np.pi, 0.1], [0.0, 3.0, 20.0], 0.14),
    "pendulum": (WL, [0.2, 2.0, 0.1], [0.0, 0.3, 0.0], 0.14),
    "pendulum that turns over": (WL, [0.2, 1.0, 0.1], [0.0, 25.0, 0.0], 0.14),
    "spherical pendulum": (WL, [0.2, 2.0, 0.1], [4.0, 0.3, 0.0], 0.14),
    "steady, slow": (WL, [0.2, 0.6, 0.1], [SLOW, 0.0, 150.0], 0.14),
    "steady, fast": (WL, [0.2, 0.6, 0.1], [FAST, 0.0, 150.0], 0.14),
    "nearly steady": (WL, [0.2, 0.6, 0.1], [SLOW, 1e-9, 150.0], 0.14),
    "sleeps": (WL, [0.2, 0.0, 0.1], [0.0, 0.0, 80.0], 0.14),
    "sleeps at the critical spin": (WL, [0.2, 0.0, 0.1], [0.0, 0.0, CRITICAL], 0.14),
    "too slow to sleep": (WL, [0.2, 0.0, 0.1], [0.0, 0.0, 45.0], 0.14),
    "tilt of 1e-8": (WL, [0.2, 1e-8, 0.1], [0.0, 0.0, 45.0], 0.14),
    "separatrix": (WL, [0.2, 2.0, 0.1], [0.0, float(np.sqrt(300.0 * (1 - np.cos(2.0)))), 0.0], 0.1),
    "without weight": (0.0, [0.2, 0.7, 0.1], [3.0, 0.3, 49.0], 0.14),
    "upright at rest": (WL, [0.2, 0.0, 0.1], [0.0, 0.0, 0.0], 0.14),
    "hangs at rest": (WL, [0.2, np.pi, 0.1], [0.0, 0.0, 0.0], 0.14),
}


def start_of(theta, rates):
    """The state with the total spin as the last of the rates."""
    angles = jnp.asarray(theta)
    rates = jnp.asarray(rates).at[2].add(-rates[0] * jnp.cos(angles[1]))
    return Top.state(angles, rates)


def test_value_and_derivative():
    v, durations = [], []
    for Wl, angles, rates, duration in MOTIONS.values():
        y = start_of(angles, rates)
        v.append(np.concatenate([[A, C, Wl], y.attitude.wxyz, y.omega]))
        durations.append(duration)
    v, durations = np.stack(v, axis=1), np.array(durations)
    scale = np.concatenate([[A, C, WL], [1.0] * 4, [50.0] * 3])[:, None]
    dv = scale * np.random.default_rng(5).normal(size=v.shape)
    # The closed form is that of a unit quaternion: the direction keeps its length.
    dv[3:7] -= v[3:7] * np.sum(v[3:7] * dv[3:7], axis=0)
    value, rate = map(np.asarray, flow_and_rate(jnp.array(v), jnp.array(dv), jnp.array(durations)))
    step = np.longdouble(1e-40)
    truth = series(v.astype(np.clongdouble) + 1j * step * dv, durations.astype(np.longdouble))
    size = np.where(np.arange(7) < 4, 1.0, 50.0)[:, None]
    wrong = np.max(np.abs(value - truth.real) / size, axis=0)
    slope = np.max(np.abs(truth.imag / step / size), axis=0)
    wrong_slope = np.max(np.abs(rate - truth.imag / step) / size, axis=0) / slope
    for i, name in enumerate(MOTIONS):
        # Up to three turns of the spin, and a growth by e^2: 3e-14 and less is found.
        assert wrong[i] < 2e-13, (name, wrong[i])
        assert wrong_slope[i] < 1e-12, (name, wrong_slope[i])


def test_reference_cases_in_one_evaluation():  # T5.13-cusp, -slow, -near0, -long
    rows = [
        (0.6981317007977318, 150.0, 0.0, 0.05, 0.755694366933263, 0.11499016947497484),
        (0.6981317007977318, 150.0, 0.0, 2.0, 0.7053609656450497, 5.1908858120517065),
        (0.6981317007977318, 150.0, 0.0, 20.0, 0.7064303911108745, 51.64527364769969),
        (0.5235987755982989, 45.0, 0.0, 0.1, 0.8602301176060432, 0.2838831822612862),
        (0.5235987755982989, 45.0, 0.0, 1.0, 0.696057141447547, 7.639133401163674),
        (0.3490658503988659, 150.0, 30.942015944610034, 0.02, 0.2954486044, 0.61698745985),
        (0.3490658503988659, 150.0, 30.942015944610034, 0.2, 0.2670273329, 12.36722897151),
    ]
    for theta0, n, rate, t, theta, psi in rows:
        found = ANGLES(TOP, jnp.asarray(t), start_of([0.0, theta0, 0.0], [rate, 0.0, n]))
        assert_allclose(found[:2], [psi, theta], rtol=1e-8)  # the digits of the cases


@pytest.mark.sweep
def test_angles_without_jumps_are_those_of_the_states():
    ts = jnp.linspace(0.0, 0.5, 2001)
    for Wl, name in ((WL, "waves, backwards"), (-WL, "hangs"), (WL, "spherical pendulum")):
        top, y = Top(A, C, Wl), start_of(*MOTIONS[name][1:3])
        states = top.closed_form().flow(ts, jax.tree.map(lambda x: x[..., None], y))
        smooth = np.unwrap(np.asarray(Top.angles(states)), axis=-1)
        every = jnp.stack([ANGLES(top, t, y) for t in ts[::400]], axis=-1)
        assert_allclose(every, smooth[:, ::400], atol=1e-12)


def test_auto_takes_it():
    exact = simulate(TOP, start_of([0.2, 0.5236, 0.1], [0.0, 0.0, 45.0]), np.linspace(0.0, 1.0, 5))
    assert exact.config.method == "closed_form"
    assert max(float(jnp.max(d)) for d in exact.drift().values()) < 1e-12


# The reference cases in one evaluation are motions that were integrated.
@pytest.mark.sweep
def test_it_is_the_integral():
    y = start_of([0.2, 0.5236, 0.1], [0.0, 0.0, 45.0])
    ts = jnp.linspace(0.0, 1.0, 5)
    exact = simulate(TOP, y, ts)
    steps = simulate(Integrated(TOP), y, ts, accuracy=1e-11)
    for a, b in zip(jax.tree.leaves(exact.states), jax.tree.leaves(steps.states), strict=True):
        # 1e-11 a step, over some 100 steps, in units of the spin
        assert_allclose(a / 45.0, b / 45.0, atol=1e-9)


@pytest.mark.sweep
def test_long_and_in_single_precision():
    y = start_of([0.2, 0.5236, 0.1], [0.0, 0.0, 45.0])
    vector = ravel_pytree(y)[0]
    v = jnp.concatenate([jnp.array([A, C, WL]), vector])
    there = flow(v, jnp.asarray(1000.0))
    # Two ways to the same place: 2000 nutations, of which each adds its rounding.
    half = flow(v, jnp.asarray(500.0))
    assert_allclose(flow(jnp.concatenate([v[:3], half]), jnp.asarray(500.0)), there, atol=1e-8)
    single = flow(v.astype(jnp.float32), jnp.asarray(0.3, jnp.float32))
    assert single.dtype == jnp.float32
    double = flow(v, jnp.asarray(0.3))
    assert_allclose(single / 45.0, double / 45.0, atol=2e-5)  # some 100 roundings of 6e-8


def test_the_derivative_by_a_duration_of_zero_is_the_rate():
    # The state itself comes back to the bit, and goes on from there.
    y = Top.state(jnp.array([0.2, 0.7, 0.1]), jnp.array([1.0, 0.3, 149.0]))
    v = jnp.concatenate([jnp.array([A, C, WL]), y.attitude.wxyz, y.omega])
    rate = TOP.vector_field(0.0, y)
    value, change = jax.jvp(lambda t: flow(v, t), (0.0,), (1.0,))
    assert np.array_equal(value, v[3:])
    assert_allclose(change[:4], rate.attitude.wxyz, rtol=1e-12)
    assert_allclose(change[4:], rate.omega, rtol=1e-12, atol=1e-12)


def test_derivatives_in_single_precision_at_the_critical_spin():
    # Upright at the critical spin, where the parameters of the elliptic functions vanish, and next
    # to it; the rates across the axis decide how fast it leaves the vertical.
    critical = 2.0 * np.sqrt(0.8) / 0.6
    starts = [(0.0, critical), (1e-6, critical), (1e-3, critical), (1e-3, 1.0001 * critical)]
    x = np.array([[1.0, 0.6, 0.8, 1.0, 0.0, 0.0, 0.0, w, 0.0, n] for w, n in starts], np.float32).T
    step = np.longdouble(1e-40)
    steps = 1j * step * np.eye(10, dtype=np.longdouble)[:, :, None]
    moved = x.astype(np.clongdouble)[:, None] + steps
    truth = (series(moved.reshape(10, -1), np.longdouble(2.0)).imag / step).reshape(7, 10, -1)
    for mode in (jax.jacfwd, jax.jacrev):
        jacobian = jax.vmap(mode(lambda v: flow(v, jnp.asarray(2.0, jnp.float32))), 1, 2)
        slope = np.asarray(jacobian(jnp.asarray(x)))
        assert slope.dtype == np.float32
        # Without the length of the quaternion, on which the series depends. The state turns by 5
        # rad and its deviation grows by e^2: 8 roundings are found.
        wrong = np.abs(slope - truth)[:, np.arange(10) != 3]
        assert np.max(wrong) < 30 * jnp.finfo(jnp.float32).eps
