"""Filters against the linear one in NumPy, for consistency over many runs, and in hard cases."""

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import chi2

from jaxspace import Accuracy, BodyState, simulate
from jaxspace.attitude import TorqueFreeBody
from jaxspace.core import AbstractSystem, InputError
from jaxspace.estimation import kalman_filter
from jaxspace.rotations import Quaternion
from jaxspace.solvers import Tsit5

KINDS = pytest.mark.parametrize("kind", ["extended", "unscented"])
FAST = Accuracy(1e-7, method=Tsit5(), max_steps=64)
TS = np.linspace(0.0, 4.0, 21)
STEP = TS[1]


class Swing(AbstractSystem):
    """A pendulum: x'' = -k sin x; with `linear` x'' = -k x."""

    k: jax.Array
    linear: bool = False

    def vector_field(self, t, y):
        pull = y["x"] if self.linear else jnp.sin(y["x"])
        return {"v": -self.k * pull, "x": y["v"]}

    def invariants(self, t, y):
        return {}


SWING, SPRING = Swing(jnp.array(2.0)), Swing(jnp.array(2.0), linear=True)


def position(t, y):
    return y["x"][None]


def linear_filter(P, z, H, R, q):
    """The textbook's filter of x'' = -k x with white noise in x'', in NumPy; state (v, x). Of the
    readings z = H y, (m, times), the rows that are NaN are left out."""
    k = 2.0
    w, h = np.sqrt(k), STEP
    c, s = np.cos(w * h), np.sin(w * h)
    phi = np.array([[c, -w * s], [s / w, c]])
    # The integral of Phi(s) Q Phi(s)^T by Gauss's rule: exact to rounding for a smooth one.
    nodes, weights = np.polynomial.legendre.leggauss(12)
    Q = np.zeros((2, 2))
    for x, a in zip(0.5 * h * (nodes + 1.0), 0.5 * h * weights, strict=True):
        column = np.array([np.cos(w * x), np.sin(w * x) / w])
        Q += a * q * np.outer(column, column)
    m, means, covariances, nis = np.array([0.1, 0.4]), [], [], []
    for i, readings in enumerate(z.T):
        if i:
            m, P = phi @ m, phi @ P @ phi.T + Q
        there = ~np.isnan(readings)
        some, r = H[there], readings[there] - H[there] @ m
        S = some @ P @ some.T + R[np.ix_(there, there)]
        K = np.linalg.solve(S, some @ P).T
        m, P = m + K @ r, P - K @ some @ P
        means.append(m)
        covariances.append(P)
        nis.append(r @ np.linalg.solve(S, r))
    return np.array(means), np.array(covariances), np.array(nis)


START = {"v": jnp.array(0.1), "x": jnp.array(0.4)}


@KINDS
def test_a_linear_system_is_filtered_as_the_textbook_does(kind):
    r, q = 0.05, 0.02
    z = np.cos(1.4 * TS) * 0.5
    z[7] = np.nan
    P = np.diag([0.04, 0.09])
    process = np.diag([q, 0.0])
    found = kalman_filter(
        SPRING, START, P, TS, z[None], position,
        noise=np.array([r]), process=jnp.asarray(process), kind=kind, accuracy=FAST,
    )  # fmt: skip
    means, covariances, _ = linear_filter(P, z[None], np.array([[0.0, 1.0]]), r**2 * np.eye(1), q)
    assert found.names == ("v", "x") and np.all(np.asarray(found.status) <= 1)
    # The tolerance of each propagation.
    assert_allclose(found.states["x"], means[:, 1], atol=1e-6)
    assert_allclose(np.moveaxis(found.covariance, -1, 0), covariances, atol=1e-7)
    assert float(found.innovations[0, 7]) == 0.0


CORRELATED = np.array([[0.05**2, 0.9 * 0.05 * 0.02], [0.9 * 0.05 * 0.02, 0.02**2]])
"""The covariance of two readings with a correlation of 0.9."""


@KINDS
def test_correlated_readings_of_which_one_is_missing(kind):
    """Each of two readings, or both, are missing at times: the filter is the one whose readings
    there are the others alone. The error of a missing reading says nothing about the other one."""
    q, H = 0.02, np.array([[0.0, 1.0], [1.0, 0.5]])
    z = H @ np.stack([-0.7 * np.sin(1.4 * TS), np.cos(1.4 * TS) * 0.5]) + 0.03
    z[0, [0, 3, 4, 20]] = z[1, [2, 9, 10, 11]] = z[:, 15] = np.nan
    P = np.diag([0.04, 0.09])
    found = kalman_filter(
        SPRING, START, P, TS, z, lambda t, y: jnp.stack([y["x"], y["v"] + 0.5 * y["x"]]),
        noise=CORRELATED, process=np.diag([q, 0.0]), kind=kind, accuracy=FAST,
    )  # fmt: skip
    means, covariances, nis = linear_filter(P, z, H, CORRELATED, q)
    assert_allclose(found.states["v"], means[:, 0], atol=1e-6)
    assert_allclose(found.states["x"], means[:, 1], atol=1e-6)
    assert_allclose(np.moveaxis(found.covariance, -1, 0), covariances, atol=1e-7)
    assert_allclose(found.nis, nis, rtol=1e-3, atol=1e-6)
    assert np.all(np.asarray(found.innovations)[np.isnan(z)] == 0.0)


@KINDS
@pytest.mark.parametrize("missing", [0, 1])
def test_a_reading_that_never_comes_is_none(kind, missing):
    """The filter of a pendulum with one of two correlated readings always missing, beside the
    filter that has the other alone. Both readings curve, so that sigma points add to their
    covariance."""
    there = 1 - missing
    z = np.stack([np.sin(0.4 * np.cos(1.4 * TS)), np.cos(0.4 * np.cos(1.4 * TS))])
    z[missing] = np.nan

    def both(t, y):
        return jnp.stack([jnp.sin(y["x"]), jnp.cos(y["x"])])

    def filtered(z, measure, R):
        return kalman_filter(
            SWING, START, np.diag([0.04, 0.09]), TS[:6], z[:, :6], measure, noise=R, kind=kind,
            accuracy=FAST,
        )  # fmt: skip

    found = filtered(z, both, CORRELATED)
    R = CORRELATED[[there]][:, [there]]
    alone = filtered(z[[there]], lambda t, y: both(t, y)[there][None], R)
    # Two programs, which round differently.
    assert_allclose(found.covariance, alone.covariance, rtol=1e-9, atol=1e-14)
    for name in ("v", "x"):
        assert_allclose(found.states[name], alone.states[name], rtol=1e-9, atol=1e-12)
    assert_allclose(found.nis, alone.nis, rtol=1e-6)
    S = alone.innovation_covariance[0, 0]
    assert_allclose(found.innovation_covariance[there, there], S, rtol=1e-9)


@KINDS
def test_consistent_over_many_runs(kind):
    """Errors of 200 pendulums with noise in the acceleration, beside the covariance."""
    runs, q, r, fine = 200, 0.02, 0.05, 40
    rng = np.random.default_rng(5)
    P = np.diag([0.05**2, 0.1**2])
    v = 0.1 + 0.05 * rng.normal(size=runs)
    x = 0.4 + 0.1 * rng.normal(size=runs)
    truth = {"v": [v], "x": [x]}
    dt = STEP / fine
    for _ in range(TS.size - 1):
        for _ in range(fine):
            # A step of Stormer and Verlet, with noise: its error is far below the noise.
            half = v - 0.5 * dt * 2.0 * np.sin(x) + np.sqrt(q * dt) * rng.normal(size=runs)
            x = x + dt * half
            v = half - 0.5 * dt * 2.0 * np.sin(x)
        truth["v"].append(v)
        truth["x"].append(x)
    truth = {name: jnp.asarray(np.array(values)) for name, values in truth.items()}
    readings = truth["x"][None] + r * rng.normal(size=(1, TS.size, runs))
    start = jax.tree.map(lambda a: jnp.full(runs, a), START)
    found = kalman_filter(
        SWING, start, P, TS, readings, position, noise=np.array([r]),
        process=jnp.diag(jnp.array([q, 0.0])), kind=kind, batch=True, accuracy=FAST,
    )  # fmt: skip
    nees, nis = np.asarray(found.nees(truth)), np.asarray(found.nis)
    assert nees.shape == (TS.size, runs) and found.covariance.shape == (2, 2, TS.size, runs)
    # By chance outside in one of a thousand cases; the seed is fixed.
    low, high = chi2.ppf([5e-4, 1.0 - 5e-4], 2 * runs) / runs
    assert low < nees[-1].mean() < high and low < nees[10].mean() < high
    # Innovations are independent of each other: all of them count.
    low, high = chi2.ppf([5e-4, 1.0 - 5e-4], nis.size) / nis.size
    assert low < nis.mean() < high


@KINDS
def test_started_exactly_right_and_without_any_noise(kind):
    """No covariance, no noise: the filter is the simulation, and stays finite."""
    found = kalman_filter(
        SPRING, START, np.zeros((2, 2)), TS, np.full((1, TS.size), 0.4), position,
        noise=np.zeros(1), kind=kind, accuracy=FAST,
    )  # fmt: skip
    w = np.sqrt(2.0)
    exact = 0.4 * np.cos(w * TS) + 0.1 / w * np.sin(w * TS)
    # It believes itself, and no reading.
    assert_allclose(found.states["x"], exact, atol=1e-6)
    assert_allclose(found.covariance, 0.0, atol=1e-12)


@KINDS
def test_exact_readings_leave_no_doubt(kind):
    w = np.sqrt(2.0)
    x = 0.3 * np.cos(w * TS) + 0.2 * np.sin(w * TS)
    found = kalman_filter(
        SPRING, START, np.eye(2), TS, x[None], position,
        noise=np.zeros(1), kind=kind, accuracy=FAST,
    )  # fmt: skip
    # Two readings determine the state.
    assert_allclose(found.states["x"], x, atol=1e-6)
    assert_allclose(
        found.states["v"][-1], w * (0.2 * np.cos(4 * w) - 0.3 * np.sin(4 * w)), atol=1e-5
    )
    assert (
        np.all(np.isfinite(found.covariance)) and np.max(np.abs(found.covariance[..., -1])) < 1e-6
    )


# Of the deviations of prior and reading. Sigma points hold the place itself, whose rounding at the
# last ratio of the extended filter is greater than the error of the readings.
RATIOS = {
    ("extended", jnp.float64): (1e2, 1e5, 1e9, 1e12, 1e16),
    ("unscented", jnp.float64): (1e2, 1e5, 1e9, 1e12),
    ("extended", jnp.float32): (1e2, 1e6, 1e10),
    ("unscented", jnp.float32): (1e2, 1e4),
}


@pytest.mark.parametrize(("kind", "dtype"), RATIOS)
def test_precise_readings_after_a_loose_prior(kind, dtype):
    """A place known to 1e2 to 1e16 times the error of its readings, and a speed to as much: two
    readings of 1 mm, a second apart, then determine both, and a third one improves them. The
    covariance is that of a straight line through three points; the ratio is a run each."""
    r = 1e-3
    prior = r * jnp.array(RATIOS[kind, dtype], dtype)
    runs = prior.size
    rest = {"v": jnp.zeros(runs, dtype), "x": jnp.zeros(runs, dtype)}
    z = jnp.broadcast_to(jnp.array([[[0.0], [1e-3], [1e-3]]], dtype), (1, 3, runs))
    ts = jnp.array([0.0, 1.0, 2.0], dtype)
    accuracy = Accuracy(1e-5, method=Tsit5(), max_steps=64)

    def one(sigma, y0, z):
        P = jnp.eye(2, dtype=dtype) * sigma**2
        noise = jnp.array([r], dtype)
        system = Swing(jnp.array(0.0, dtype), linear=True)
        found = kalman_filter(
            system, y0, P, ts, z, position, noise=noise, kind=kind, accuracy=accuracy
        )
        return found.covariance[..., -1], found.covariance[1, 1, 0], found.states["x"][-1]

    batch = jax.jit(jax.vmap(one, in_axes=-1, out_axes=-1))
    P, first, x = batch(prior, rest, z)
    sigma = np.asarray(prior, np.float64)
    assert_allclose(first, sigma**2 * (r / np.hypot(sigma, r)) ** 2, rtol=1e-4)
    # The normal equations of a line through times -2, -1, 0, and the prior at the first of them.
    for k, s in enumerate(sigma / r):
        ground = np.array([[2.0 + 3.0, -3.0], [-3.0, 3.0]])
        N = ground + np.array([[1.0 + 4.0, -2.0], [-2.0, 1.0]]) / s**2
        exact = np.linalg.inv(N) * r**2
        assert_allclose(P[..., k], exact, rtol=1e-3)
        target = np.linalg.solve(N, [-1.0 * 1e-3, 1e-3 + 1e-3])[1]
        assert_allclose(x[k], target, rtol=2e-3)
    # The variance of the place follows that of the readings: d log P / d log r = 2, in both modes.
    if dtype == jnp.float64:
        for mode in (jax.jacfwd, jax.jacrev):

            def variance(r):
                found = kalman_filter(
                    Swing(jnp.array(0.0), linear=True), START, jnp.eye(2) * 1e8, ts[:2],
                    jnp.zeros((1, 2)), position, noise=r[None], kind=kind, accuracy=accuracy,
                )  # fmt: skip
                return found.covariance[1, 1, -1]

            slope = mode(variance)(jnp.array(r))
            assert_allclose(slope, 2.0 * r, rtol=1e-6)


@pytest.mark.sweep
def test_an_attitude_from_star_readings():
    """The covariance of an attitude has three rows; the error is within it."""
    body = TorqueFreeBody(jnp.array([1.0, 1.4, 1.9]))
    truth = BodyState(attitude=Quaternion.identity(), omega=jnp.array([0.3, 0.2, -0.4]))
    turn = Quaternion.from_rotation_vector(jnp.array([0.05, -0.04, 0.03]))
    start = BodyState(attitude=turn, omega=jnp.array([0.28, 0.22, -0.41]))
    stars = jnp.array([[1.0, 0.0], [0.0, 0.8], [0.0, 0.6]])

    def seen(t, y):
        return (y.attitude.inverse().matrix() @ stars).ravel()

    run = simulate(body, truth, TS)
    rng = np.random.default_rng(3)
    exact = run.along(lambda system, t, y: seen(t, y))
    z = exact + 1e-3 * rng.normal(size=exact.shape)
    P = np.diag([0.05**2] * 3 + [0.02**2] * 3)
    found = kalman_filter(body, start, P, TS, z, seen, noise=np.full(6, 1e-3), accuracy=FAST)
    assert found.covariance.shape == (6, 6, TS.size)
    nees = np.asarray(found.nees(run.states))
    assert nees[-1] < chi2.ppf(0.999, 6)
    assert float(found.std[0, -1]) < 1e-3 < float(found.std[0, 0]) * 2.0


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"kind": "ensemble"}, "kind is 'ensemble'"),
        ({"readings": np.zeros((1, 3))}, r"must be \(m, 21\)"),
        ({"covariance": np.eye(3)}, r"must be \(2, 2\) for v, x"),
        ({"noise": np.ones(2)}, "readings of 1 numbers"),
    ],
)
def test_wrong_calls(change, sentence):
    given = {
        "system": SPRING,
        "y0": START,
        "covariance": np.eye(2),
        "ts": TS,
        "readings": np.zeros((1, 21)),
        "measure": position,
        "noise": np.ones(1),
    } | change
    with pytest.raises(InputError, match=sentence):
        kalman_filter(**given)


@KINDS
def test_single_precision_stays_close(kind):
    """Every array in float32, beside the filter in float64."""
    z = np.cos(1.4 * TS) * 0.5
    P, process = np.diag([0.04, 0.09]), jnp.diag(jnp.array([0.02, 0.0]))

    def run(dtype, accuracy):
        cast = lambda x: jnp.asarray(x, dtype)  # noqa: E731
        return kalman_filter(
            Swing(cast(2.0), linear=True), jax.tree.map(cast, START), cast(P), cast(TS),
            cast(z[None]), position, noise=cast([0.05]), process=cast(process), kind=kind,
            accuracy=Accuracy(accuracy, method=Tsit5(), max_steps=64),
        )  # fmt: skip

    low, high = run(jnp.float32, 1e-5), run(jnp.float64, 1e-7)
    assert low.states["x"].dtype == low.covariance.dtype == jnp.float32
    # Twenty intervals at a tolerance of 1e-5 and roundings of 6e-8 of numbers of the order of one.
    assert_allclose(low.states["x"], high.states["x"], atol=2e-4)
    assert_allclose(low.covariance, high.covariance, atol=2e-5)


@KINDS
def test_little_process_noise_after_a_loose_prior(kind):
    """Variances that differ by a factor of 1e18, to as many digits as the motion, against sixty
    digits."""
    r, q, prior = 1e-3, 1e-9, 1e6
    found = kalman_filter(
        SPRING, START, np.diag([prior, prior]), TS, np.full((1, TS.size), 0.3), position,
        noise=np.array([r]), process=jnp.diag(jnp.array([q, 0.0])), kind=kind,
        accuracy=Accuracy(1e-9, method=Tsit5(), max_steps=64),
    )  # fmt: skip
    exact = []
    with mpmath.workdps(60):
        w, h, H = mpmath.sqrt(2), mpmath.mpf(STEP), mpmath.matrix([[0, 1]])
        c, s = mpmath.cos(w * h), mpmath.sin(w * h)
        phi = mpmath.matrix([[c, -w * s], [s / w, c]])
        # The integrals of cos^2, of sin cos/w and of sin^2/w^2.
        both, cross = s * c / (2 * w), s**2 / (2 * w**2)
        added = q * mpmath.matrix([[h / 2 + both, cross], [cross, (h / 2 - both) / w**2]])
        P = mpmath.diag([prior, prior])
        for k in range(TS.size):
            P = phi * P * phi.T + added if k else P
            S = (H * P * H.T)[0] + mpmath.mpf(r) ** 2
            P = P - P * H.T * H * P / S
            exact.append([[float(P[i, j]) for j in range(2)] for i in range(2)])
    exact, P = np.array(exact), np.moveaxis(found.covariance, -1, 0)
    assert np.all(np.linalg.eigvalsh(P / exact[:, :1, :1]) > 0.0)
    variances = np.diagonal(exact, axis1=1, axis2=2)
    assert_allclose(np.diagonal(P, axis1=1, axis2=2), variances, rtol=1e-6)
