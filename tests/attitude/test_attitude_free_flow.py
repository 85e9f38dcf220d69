"""The closed form of the free body: against integration, the hyperbolic solution, the laws of a
flow, and differences."""

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jax.flatten_util import ravel_pytree
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

from jaxspace import Accuracy, simulate
from jaxspace.attitude import TorqueFreeBody
from jaxspace.bodies import BodyState, InertiaTensor, PrincipalInertia
from jaxspace.bodies.principal_frame import _diagonal, _transformed
from jaxspace.core.jacobi import jacobi, third
from jaxspace.rotations import Quaternion
from jaxspace.solvers import DOP853

START = np.array([0.8, 0.0, 0.6, 0.0])


@jax.jit
def flow(duration, moments, omega):
    """Quaternion and angular velocity, (7, *runs)."""
    start = jnp.asarray(START, omega.dtype)
    y = BodyState(attitude=Quaternion(start), omega=omega)
    later = TorqueFreeBody(PrincipalInertia(moments)).closed_form().flow(duration, y)
    return jnp.concatenate([later.attitude.wxyz, later.omega])


@jax.jit
def advanced(body, y, duration):
    """The state of any body, a time later."""
    return body.closed_form().flow(duration, y)


invariants = jax.jit(lambda body, y: body.invariants(0.0, y))

# Runs in one call of `flow`, so that the tests share one program.
RUNS = 12


def integrated(duration, moments, omega):
    """The same, (7, runs), by DOP853 of scipy in the numpy of this file, all runs together on the
    clock t / duration."""
    moments, duration = np.asarray(moments, float), np.asarray(duration, float)

    def rate(_, flat):
        y = flat.reshape(7, -1)
        w, u, omega = y[0], y[1:4], y[4:]
        momentum = moments * omega
        turning = (
            np.concatenate([-np.sum(u * omega, 0)[None], w * omega + np.cross(u, omega, axis=0)])
            / 2.0
        )
        return (
            duration * np.concatenate([turning, np.cross(momentum, omega, axis=0) / moments])
        ).ravel()

    y0 = np.concatenate([START[:, None] + 0.0 * omega[:1], omega]).ravel()
    answer = solve_ivp(rate, (0.0, 1.0), y0, method="DOP853", rtol=3e-14, atol=1e-16)
    return answer.y[:, -1].reshape(7, -1)


def bodies(seed, n):
    """Physical moments in any order and rates: general, a rate of zero, a small rate, two equal
    moments, three."""
    rng = np.random.default_rng(seed)
    x, omega = rng.uniform(0.1, 1.0, (3, n)), rng.normal(size=(3, n))
    moments = np.stack([x[1] + x[2], x[2] + x[0], x[0] + x[1]])
    for i in range(n):
        if i % 6 == 1:
            omega[rng.integers(3), i] = 0.0
        elif i % 6 == 2:
            omega[rng.integers(3), i] *= 1e-4
        elif i % 6 == 3:
            moments[:, i] = rng.permutation([1.0, 1.0, rng.uniform(0.3, 2.0)])
        elif i % 6 == 4:
            moments[:, i] = 1.3
    return rng.uniform(-20.0, 20.0, n), moments, omega


def test_it_is_the_integral():
    run = bodies(0, 5 * RUNS)
    parts = [[x[..., i : i + RUNS] for x in run] for i in range(0, 5 * RUNS, RUNS)]
    # Up to some 60 rad at the integration's tolerance of 3e-14 per step.
    found = np.concatenate([flow(*part) for part in parts], axis=-1)
    assert_allclose(found, integrated(*run), atol=1e-10)


def test_batch_lanes_are_single_runs():
    duration, moments, omega = bodies(1, RUNS)
    batch = flow(duration, moments, omega)
    for i in range(RUNS):
        assert_allclose(batch[:, i], flow(duration[i], moments[:, i], omega[:, i]), atol=1e-13)
    y = BodyState(attitude=Quaternion(jnp.array(START)), omega=jnp.asarray(omega))
    shared = advanced(TorqueFreeBody([3.0, 2.0, 1.0]), y, 2.0)
    one = flow(np.float64(2.0), np.array([3.0, 2.0, 1.0]), omega[:, 3])
    assert_allclose(shared.omega[:, 3], one[4:], atol=1e-13)


def test_separatrix():  # Thomson 5.12: sech and tanh
    ts = np.array([-9.0, -6.0, -3.0, -1.0, -0.2, 0.0, 0.1, 0.5, 1.0, 3.0, 6.0, 9.0])
    omega = np.array([1.0, 0.0, np.sqrt(3.0)])[:, None] + 0.0 * ts
    found = flow(ts, np.array([3.0, 2.0, 1.0])[:, None] + 0.0 * ts, omega)
    exact = [1.0 / np.cosh(ts), -np.sqrt(3.0) * np.tanh(ts), np.sqrt(3.0) / np.cosh(ts)]
    assert_allclose(found[4:], exact, atol=1e-11)  # rounding of the start grows as exp(t), by 1e4


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_near_the_separatrix(side):
    off = np.array([10.0**-k for k in range(3, 15)])
    omega = np.stack([1.0 + side * off, 0.3 + 0.0 * off, np.sqrt(3.0) + 0.0 * off])
    run = np.full(off.shape, 7.0), np.array([3.0, 2.0, 1.0])[:, None] + 0.0 * off, omega
    assert_allclose(flow(*run), integrated(*run), atol=1e-10)  # rounding grows by exp(7) = 1e3


def test_ten_thousand_flips_keep_energy_and_momentum():
    moments, omega = jnp.array([1.0, 2.0, 3.0]), jnp.array([1e-3, 1.0, 2e-3])
    body, y = TorqueFreeBody(moments), BodyState(attitude=Quaternion(jnp.array(START)), omega=omega)
    # A flip takes some 24.6 s.
    kept, later = invariants(body, y), invariants(body, advanced(body, y, 2.5e5))
    for name, value in kept.items():
        assert_allclose(later[name], value, rtol=1e-11, atol=1e-11)


def test_ten_thousand_flips_step_by_step():
    """The free rotation as the drift of a splitting takes it: 3e4 steps of 8.5 s, each from where
    the last one ended."""
    moments = jnp.array([1.0, 2.0, 3.0])
    body, y = (
        TorqueFreeBody(moments),
        BodyState(attitude=Quaternion(jnp.array(START)), omega=jnp.array([1e-3, 1.0, 2e-3])),
    )

    @jax.jit
    def stepped(y):
        def one(carry, _):
            later = body.closed_form().flow(8.5, carry[0])
            return (
                later,
                carry[1] + jnp.where(later.omega[1] * carry[0].omega[1] < 0.0, 1, 0),
            ), None

        return jax.lax.scan(one, (y, 0), length=30_000)[0]

    later, flips = stepped(y)
    assert flips > 10_000
    kept, left = invariants(body, y), invariants(body, later)
    for name, value in kept.items():
        assert_allclose(left[name], value, rtol=1e-11, atol=1e-11)


@pytest.mark.sweep
def test_a_hundred_precessions():
    """Long spans of every kind of body, beside integration at a tolerance of 3e-14 over some 600
    rad."""
    moments = np.array(
        [[3.0, 2.0, 1.0], [1.0, 1.0, 1.8], [2.0, 1.0, 1.0], [1.3, 1.3, 1.3], [3.0, 2.9999, 1.0]]
    ).T
    omega = np.array(
        [[0.4, 0.1, 1.0], [0.3, 0.2, 1.0], [1.0, 0.2, -0.3], [0.5, 0.6, 0.7], [0.9, 0.2, 0.3]]
    ).T
    smallest = np.linalg.norm(moments * omega, axis=0) / moments.max(axis=0)
    run = 200.0 * np.pi / smallest * [1, 1, -1, 1, 1], moments, omega
    assert_allclose(flow(*run), integrated(*run), atol=1e-9)


def test_no_time_changes_nothing():
    _, moments, omega = bodies(2, RUNS)
    assert_allclose(flow(0.0 * omega[0], moments, omega)[4:], omega, rtol=1e-15)
    assert_allclose(
        flow(0.0 * omega[0], moments, omega)[:4], START[:, None] + 0.0 * omega[:1], atol=1e-15
    )


size, rate, time = st.floats(0.1, 1.0), st.floats(-1.0, 1.0), st.floats(-5.0, 5.0)


@settings(deadline=None)
@given(st.tuples(size, size, size), st.tuples(rate, rate, rate), time, time)
def test_flows_add(sizes, omega, a, b):
    x, y, z = sizes
    body = TorqueFreeBody(PrincipalInertia(jnp.array([y + z, z + x, x + y])))
    start = BodyState(attitude=Quaternion(jnp.array(START)), omega=jnp.array(omega))
    once, twice = advanced(body, start, a + b), advanced(body, advanced(body, start, a), b)
    kept, left = invariants(body, start), invariants(body, twice)
    for name, value in kept.items():
        assert_allclose(left[name], value, rtol=1e-12, atol=1e-12)
    # The state between carries rounding, which near the separatrix grows at a rate below |omega| /
    # 2 in such bodies.
    growth = np.exp(0.5 * np.linalg.norm(omega) * (abs(a) + abs(b)))
    for found, expected in zip(jax.tree.leaves(twice), jax.tree.leaves(once), strict=True):
        assert_allclose(found, expected, atol=1e-13 * growth)


STARTS = {
    "asymmetric": [3.0, 2.0, 1.0, 0.4, 0.1, 2.0, 4.0],
    "many turns": [3.0, 2.0, 1.0, 2.0, 0.1, 0.4, -14.0],
    "separatrix": [3.0, 2.0, 1.0, 1.0, 0.0, np.sqrt(3.0), 1.0],
    "vertex": [3.0, 2.0, 1.0, 0.4, 0.0, 2.0, 5.0],
    "symmetric": [2.0, 2.0, 3.0, 0.4, 0.3, 2.0, 5.0],
    "first axis of symmetry": [3.0, 2.0, 2.0, 0.4, 0.3, 2.0, 5.0],
    "next to the separatrix": [3.0, 2.0, 1.0, 1.0 + 1e-9, 0.1, np.sqrt(3.0), 1.0],
    "symmetric, across": [2.0, 2.0, 3.0, 0.4, 0.3, 0.0, 5.0],
    "sphere": [2.0, 2.0, 2.0, 0.4, 0.3, 1.0, 5.0],
    "at rest": [3.0, 2.0, 1.0, 0.0, 0.0, 0.0, 5.0],
    "sphere at rest": [2.0, 2.0, 2.0, 0.0, 0.0, 0.0, 5.0],
    "greatest axis": [3.0, 2.0, 1.0, 1.0, 0.0, 0.0, 5.0],
    "middle axis": [3.0, 2.0, 1.0, 0.0, 1.0, 0.0, 2.0],
    "least axis": [3.0, 2.0, 1.0, 0.0, 0.0, 1.0, 5.0],
    "no time": [3.0, 2.0, 1.0, 0.4, 0.1, 2.0, 0.0],
    "little time": [3.0, 2.0, 1.0, 0.4, 0.1, 2.0, 1.5e-3],
}


def principal(x):
    return flow(x[6], x[:3], x[3:6])


def tensor_of(x):
    a, b, c, d, e, f = x
    return jnp.stack([jnp.stack([a, d, e]), jnp.stack([d, b, f]), jnp.stack([e, f, c])])


def tensorial(x):
    y = BodyState(attitude=Quaternion(jnp.array(START)), omega=x[6:9])
    return ravel_pytree(
        TorqueFreeBody(InertiaTensor(tensor_of(x[:6]))).closed_form().flow(x[9], y)
    )[0]


SIXTH = [(1, 45.0 / 60.0), (2, -9.0 / 60.0), (3, 1.0 / 60.0)]  # weights of differences of order six


def differences(f, x, step=3e-4):
    """Derivatives of order six: truncation and rounding both below 1e-9 here."""
    rows = [
        sum(w * (f(x + i * step * e) - f(x - i * step * e)) for i, w in SIXTH) / step
        for e in np.eye(x.size)
    ]
    return np.stack(rows, axis=-1)


@pytest.fixture(scope="module")
def derivatives():
    # The values of `principal` come from the program of `flow` itself.
    return {
        f: (value, jax.jit(jax.jacfwd(f)), jax.jit(jax.jacrev(f)))
        for f, value in ((principal, principal), (tensorial, jax.jit(tensorial)))
    }


@pytest.mark.sweep
def test_ten_thousand_flips_have_derivatives(derivatives):
    """The time of a flip depends on the start, and ten thousand of them on it as often: derivatives
    of up to 1e7."""
    value, forward, reverse = derivatives[principal]
    x = np.array([1.0, 2.0, 3.0, 1e-3, 1.0, 2e-3, 2.5e5])
    found = forward(x)
    assert_allclose(reverse(x), found, rtol=1e-9, atol=1e-9 * np.abs(found).max())
    for column, size in enumerate(np.abs(found).max(axis=0)):
        step = 1e-4 / size * np.eye(7)[column]  # a change of some 1e-4, seen to 1e-10
        change = (
            sum(w * (value(x + i * step) - value(x - i * step)) for i, w in SIXTH) / step[column]
        )
        assert_allclose(found[:, column], change, atol=1e-4 * size)


@pytest.mark.sweep
def test_single_precision(derivatives):
    """The error is what the rounding of the inputs does to the result, some times over."""
    duration, moments, omega = bodies(3, 24)
    single = flow(*(jnp.asarray(x, jnp.float32) for x in (duration, moments, omega)))
    assert single.dtype == jnp.float32
    exact = flow(duration, moments, omega)
    for i in range(24):
        x = np.concatenate([moments[:, i], omega[:, i], duration[i : i + 1]])
        loss = np.finfo(np.float32).eps * max(1.0, np.linalg.norm(derivatives[principal][1](x) * x))
        assert_allclose(single[:, i], exact[:, i], atol=16.0 * loss)


# `test_attitude_flips.py` has the same of the turn alone, in programs which it needs anyway.
@pytest.mark.sweep
@pytest.mark.parametrize("x", STARTS.values(), ids=STARTS)
def test_derivatives(derivatives, x):
    value, forward, reverse = derivatives[principal]
    x = np.asarray(x)
    assert_allclose(forward(x), differences(value, x), atol=1e-8)
    assert_allclose(reverse(x), forward(x), atol=1e-11)


@pytest.mark.parametrize(
    "tensor",
    [
        [3.0, 2.0, 1.0, 0.1, 0.2, -0.1],
        [3.0, 2.0, 1.0, 0.0, 0.0, 0.0],
        [2.0, 2.0, 1.0, 0.0, 0.0, 0.0],
        [2.0, 2.0, 2.0, 0.0, 0.0, 0.0],
    ],
    ids=["general", "principal", "symmetric", "sphere"],
)
@pytest.mark.sweep
def test_derivatives_of_a_tensor(derivatives, tensor):
    value, forward, reverse = derivatives[tensorial]
    x = np.array([*tensor, 0.4, 0.1, 2.0, 2.0])
    assert_allclose(forward(x), differences(value, x), atol=1e-8)
    assert_allclose(reverse(x), forward(x), atol=1e-11)


def cube(x):
    """The cube of a tensor by way of its principal axes, at the start one of moments x[:3] in
    these."""
    local, frame, _ = _diagonal(tensor_of(x))
    return _transformed(jnp.diag(jnp.stack([local[k, k] ** 3 for k in range(3)])), frame.matrix().T)


@pytest.mark.sweep
def test_principal_axes_have_derivatives_of_second_order_or_say_not():
    x, bend = np.array([3.0, 2.0, 1.0, 0.0, 0.0, 0.0]), jax.jit(jax.hessian(cube))
    exact = jax.hessian(lambda x: tensor_of(x) @ tensor_of(x) @ tensor_of(x))(x)
    assert_allclose(bend(x), exact, atol=1e-13)
    assert np.isnan(bend(np.array([2.0, 2.0, 1.0, 0.0, 0.0, 0.0]))).any()


@pytest.mark.sweep
@pytest.mark.parametrize("case", ["the rate alone", "general", "principal", "symmetric"])
def test_second_derivatives_of_a_tensor(case):
    """Along one direction, against differences of the gradient; of equal moments, those of second
    order in the tensor are NaN."""
    weights, direction = (
        jnp.array([1.0, -2.0, 0.5, 0.3, 1.0, -1.0, 0.7]),
        np.linspace(1.0, -0.8, 10),
    )
    tensors = {
        "general": [3.0, 2.0, 1.0, 0.1, 0.2, -0.1],
        "principal": [3.0, 2.0, 1.0, 0.0, 0.0, 0.0],
    }
    x = np.array([*tensors.get(case, [2.0, 2.0, 1.0, 0.0, 0.0, 0.0]), 0.4, 0.1, 2.0, 2.0])
    first = 6 if case == "the rate alone" else 0

    def f(moving):
        return jnp.sum(weights * tensorial(jnp.concatenate([jnp.asarray(x[:first]), moving])))

    gradient = jax.jit(jax.grad(f))
    found = jax.jit(lambda x, v: jax.jvp(gradient, (x,), (v,))[1])(x[first:], direction[first:])
    known = np.arange(first, 10) >= (6 if case == "symmetric" else 0)
    x, step = x[first:], 1e-3 * direction[first:]
    expected = sum(w * (gradient(x + i * step) - gradient(x - i * step)) for i, w in SIXTH) / 1e-3
    assert_allclose(found[known], expected[known], atol=1e-9)
    assert np.isnan(found[~known]).all()


def test_a_tensor_is_the_body_in_other_axes():
    turn = Quaternion(jnp.array([0.5, 0.5, -0.5, 0.5])).then(Quaternion.about(0, 0.3))
    C, moments, omega = turn.matrix(), jnp.array([3.0, 2.0, 1.0]), jnp.array([0.4, 0.2, 2.0])
    start = Quaternion(jnp.array(START))
    y = BodyState(attitude=start.then(turn.inverse()), omega=C @ omega)
    other = advanced(TorqueFreeBody(InertiaTensor(C @ jnp.diag(moments) @ C.T)), y, 5.0)
    expected = flow(np.float64(5.0), moments, omega)
    assert_allclose(other.omega, C @ expected[4:], atol=1e-13)
    assert_allclose(
        other.attitude.wxyz, Quaternion(expected[:4]).then(turn.inverse()).wxyz, atol=1e-13
    )


def test_simulation_takes_the_closed_form():
    y = BodyState(attitude=Quaternion(jnp.array(START)), omega=jnp.array([0.4, 0.1, 2.0]))
    body, ts = TorqueFreeBody([3.0, 2.0, 1.0]), np.array([0.0, 4.0, 10.0])
    exact = simulate(body, y, ts)
    assert int(exact.stats["evaluations"]) == 0
    for k, t in enumerate(ts):
        found = np.concatenate([exact.states.attitude.wxyz[:, k], exact.states.omega[:, k]])
        assert_allclose(found, flow(t, np.array([3.0, 2.0, 1.0]), np.asarray(y.omega)), atol=1e-12)


@pytest.mark.sweep
def test_simulation_by_steps_is_the_closed_form():
    y = BodyState(attitude=Quaternion(jnp.array(START)), omega=jnp.array([0.4, 0.1, 2.0]))
    body, ts = TorqueFreeBody([3.0, 2.0, 1.0]), jnp.array([0.0, 4.0, 10.0])
    exact = simulate(body, y, ts)
    integral = simulate(body, y, ts, accuracy=Accuracy(rtol=1e-12, atol=1e-14, method=DOP853()))
    jax.tree.map(lambda a, b: assert_allclose(a, b, atol=1e-10), exact.states, integral.states)


@pytest.mark.parametrize("complement", [1.0, 0.6, 0.51, 0.49, 1e-2, 1e-6, 1e-14, 1e-40])
@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_elliptic_functions(complement, share):
    top = 1.7
    with mpmath.workdps(60):
        m = 1 - mpmath.mpf(complement * top) / mpmath.mpf(top)
        n = mpmath.sqrt(top)
        t = float(share * mpmath.ellipk(m) / n)
        phase = jacobi(t, top, float(m * top), complement * top)
        sn, cn, dn = (mpmath.ellipfun(f, u=n * mpmath.mpf(t), m=m) for f in ("sn", "cn", "dn"))
        # The relative error of cn and dn is that of the argument, which is below 47.
        assert_allclose(
            [phase.s, phase.c, phase.d], [float(sn / n), float(cn), float(dn)], rtol=1e-13
        )
        if complement < 1e-3:
            return
        pole = 0.4 * top
        strength = np.sqrt((pole + top) * (pole + float(m * top)) / pole)

        def rate(u):
            return 1 - 1 / (1 + pole / top * mpmath.ellipfun("sn", u=n * u, m=m) ** 2)

        expected = strength * mpmath.quad(rate, [0, t / 2, t])
        assert_allclose(
            third(phase.s, phase.c, phase.d, 1.0 + pole * phase.s**2, pole * strength),
            float(expected),
            rtol=1e-13,
        )


@pytest.mark.parametrize("dtype", [jnp.float64, jnp.float32])
def test_derivatives_of_elliptic_functions_after_short_times(dtype):
    # By the parameters x and y, of which one is small, both are equal, or neither.
    x, y = np.meshgrid([1.7, 1e-6, 0.9], [1.7, 1e-6, 0.3])
    t = np.array([1e-9, 1e-3, 0.03, 0.2, 0.34, 0.35, 0.6])
    t, x, y = (np.ravel(v).astype(dtype) for v in np.broadcast_arrays(t[:, None, None], x, y))

    def of(v):
        phase = jacobi(v[0], v[1], v[2], v[1] - v[2])
        return jnp.stack([phase.s, phase.c, phase.d])

    slopes = [
        jax.jit(jax.vmap(mode(of), in_axes=1, out_axes=2))(jnp.stack([t, x, y]))
        for mode in (jax.jacfwd, jax.jacrev)
    ]
    with mpmath.workdps(60):

        def exact(t, x, y):
            n, m = mpmath.sqrt(max(x, y)), min(x, y) / max(x, y)
            sn, cn, dn = (mpmath.ellipfun(f, u=n * t, m=m) for f in ("sn", "cn", "dn"))
            return (sn / n, cn, dn) if x > y else (sn / n, dn, cn)

        truth = np.empty(slopes[0].shape)
        for i, place in enumerate(zip(t, x, y, strict=True)):
            v = [mpmath.mpf(float(c)) for c in place]
            for k, c in enumerate(v):
                h = c * mpmath.mpf(10) ** -12
                ahead, behind = (exact(*v[:k], c + sign * h, *v[k + 1 :]) for sign in (1, -1))
                pairs = zip(ahead, behind, strict=True)
                truth[:, k, i] = [float((a - b) / (2 * h)) for a, b in pairs]
    # The derivatives of S by x and y are of the order of t^3, those of c and d of the order of t^2.
    size = np.array([[np.ones_like(t), t**3, t**3], [t, t**2, t**2], [t, t**2, t**2]])
    for slope in slopes:
        assert np.max(np.abs(np.asarray(slope) - truth) / size) < 30.0 * jnp.finfo(dtype).eps
