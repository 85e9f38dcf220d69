"""Least squares against closed forms and SciPy; what cannot be seen; batches of data sets."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize
from numpy.testing import assert_allclose

from jaxspace import BodyState, simulate
from jaxspace.core import InputError
from jaxspace.estimation import fit
from jaxspace.orbits import TwoBody
from jaxspace.rotations import Quaternion

TS = jnp.linspace(0.0, 6.0, 25)
RNG = np.random.default_rng(17)
NOISE = RNG.normal(size=(3, 25))


def line(p):
    return p["rate"] * TS + p["bias"]


def shared(p):
    """Two parameters of which only the sum is seen, and one of no influence."""
    return p["a"] * TS + p["b"] * TS + 0.0 * p["c"]


START = {"bias": jnp.array(0.0), "rate": jnp.array(1.0)}


@pytest.mark.parametrize("method", ["levenberg_marquardt", "gauss_newton"])
def test_a_line_by_the_normal_equations(method):
    """With weights of each reading, and a gap in the data."""
    sigma = np.linspace(0.01, 0.05, 25)
    z = 2.0 * TS - 0.3 + sigma * NOISE[0]
    data = z.at[4].set(jnp.nan)
    found = fit(line, data, START, noise=jnp.asarray(sigma), method=method)
    keep = np.arange(25) != 4
    A = np.stack([np.ones(25), TS], axis=1)[keep] / sigma[keep, None]
    P = np.linalg.inv(A.T @ A)
    p = P @ A.T @ (np.asarray(z)[keep] / sigma[keep])
    assert bool(found.converged) and int(found.freedom) == 22
    assert found.names == ("bias", "rate")
    # The search ends at 1e-4 of a standard deviation.
    assert_allclose(found.parameters["bias"], p[0], atol=1e-4 * np.sqrt(P[0, 0]))
    assert_allclose(found.parameters["rate"], p[1], atol=1e-4 * np.sqrt(P[1, 1]))
    assert_allclose(found.covariance, P, rtol=1e-10)
    assert_allclose(found.correlation[0, 1], P[0, 1] / np.sqrt(P[0, 0] * P[1, 1]), rtol=1e-10)
    r = np.asarray(z)[keep] / sigma[keep] - A @ p
    assert_allclose(found.chi_squared, r @ r, rtol=1e-7)
    assert_allclose(found.p_value, scipy.stats.chi2.sf(r @ r, 22), rtol=1e-6)
    assert found.observability() == "" and not np.any(found.unseen)
    assert float(found.residuals[4]) == 0.0


def test_noise_that_is_not_stated_is_estimated():
    z = 2.0 * TS - 0.3 + 0.02 * NOISE[0]
    found = fit(line, z, START)
    A = np.stack([np.ones(25), TS], axis=1)
    _, rest, _, _ = np.linalg.lstsq(A, np.asarray(z), rcond=None)
    assert_allclose(found.covariance, rest[0] / 23 * np.linalg.inv(A.T @ A), rtol=1e-6)
    assert np.isnan(found.p_value)


def test_a_prior_is_one_more_reading():
    z = 2.0 * TS - 0.3 + 0.02 * NOISE[0]
    prior = {"bias": 1e-3, "rate": jnp.inf}
    found = fit(line, z, START, noise=0.02, prior=prior)
    A = np.stack([np.ones(25), TS], axis=1) / 0.02
    P = np.linalg.inv(A.T @ A + np.diag([1e6, 0.0]))
    p = P @ (A.T @ (np.asarray(z) / 0.02))
    assert_allclose(found.covariance, P, rtol=1e-9)
    assert_allclose(found.parameters["bias"], p[0], atol=1e-3 * np.sqrt(P[0, 0]))


def test_what_cannot_be_seen_is_told_and_stays():
    start = {"a": jnp.array(1.0), "b": jnp.array(0.5), "c": jnp.array(7.0)}
    z = 2.0 * TS + 0.02 * NOISE[0]
    found = fit(shared, z, start, noise=0.02)
    assert bool(found.converged)
    assert list(np.asarray(found.unseen)) == [True, True, True]
    assert np.all(np.isinf(found.std))
    told = found.observability()
    assert "c is unobservable: no reading depends on it." in told
    assert "The combination" in told and "a" in told and "b" in told
    assert float(found.parameters["c"]) == 7.0
    # The sum is found; the difference stays as it was.
    a, b = found.parameters["a"], found.parameters["b"]
    assert_allclose(a + b, np.sum(z * TS) / np.sum(TS**2), rtol=1e-6)
    assert_allclose(a - b, 0.5, atol=1e-6)
    assert "is unobservable" in repr(found)
    with_prior = fit(shared, z, start, noise=0.02, prior=1.0)
    assert with_prior.observability() == ""


def test_noise_zero_data_fit_exactly():
    found = fit(line, line({"bias": 0.25, "rate": -1.5}), START, noise=0.01)
    assert_allclose(found.parameters["rate"], -1.5, atol=1e-6)
    assert_allclose(found.p_value, 1.0, atol=1e-6)
    assert np.all(np.isfinite(jax.tree.leaves(found.tests)))


def test_residual_tests_see_a_bias_a_wave_and_an_outlier():
    n = 400
    noise = jnp.asarray(RNG.normal(size=n))
    ts = jnp.linspace(0.0, 1.0, n)
    data = {
        "good": noise,
        "biased": noise + 0.5,
        "wave": noise + jnp.sin(40.0 * ts),
        "outlier": noise.at[7].set(9.0),
    }
    tests = fit(lambda p: jax.tree.map(lambda z: p + 0.0 * z, data), data, jnp.zeros(()), noise=1.0)
    p = tests.tests
    # The four share one constant, a quarter of the bias.
    assert p["good"].whiteness > 0.01 and p["good"].normality > 0.01
    assert p["biased"].mean < 1e-6
    assert p["wave"].whiteness < 1e-6
    assert p["outlier"].normality < 1e-6


def orbit_readings(p):
    run = simulate(TwoBody(1.0), p["start"], TS, throw=False)
    offset = run.states.position - jnp.array([0.1, 0.2, 0.3])[:, None]
    distance = jnp.linalg.norm(offset, axis=0)
    # Direction cosines: an angle would jump by a whole turn.
    return jnp.stack([distance + p["bias"], offset[0] / distance, offset[2] / distance])


def test_a_batch_of_orbits_beside_scipy():
    """State and bias together; every data set as if it were alone."""
    start = BodyState(jnp.array([1.0, 0.0, 0.1]), jnp.array([0.0, 1.0, 0.2]))
    truth = {"start": start, "bias": jnp.array(0.02)}
    guess = jax.tree.map(lambda x: 1.03 * x + 0.01, truth)
    exact = orbit_readings(truth)
    data = jnp.stack([exact + 1e-3 * NOISE, exact - 2e-3 * NOISE], axis=-1)
    starts = jax.tree.map(lambda x: jnp.stack([x, 0.99 * x], axis=-1), guess)
    found = fit(orbit_readings, data, starts, noise=1e-3, batch=True)
    assert found.covariance.shape == (7, 7, 2) and found.names[1] == "start.position[0]"
    flat, tree = jax.flatten_util.ravel_pytree(guess)

    @jax.jit
    def residuals(x):
        return ((exact + 1e-3 * NOISE - orbit_readings(tree(x))) / 1e-3).ravel()

    jacobian = jax.jit(jax.jacfwd(residuals))
    other = scipy.optimize.least_squares(residuals, flat, jacobian, xtol=1e-12, ftol=1e-12)
    one = found.of(0)
    got = jax.flatten_util.ravel_pytree(one.parameters)[0]
    # Both end near the minimum, which is flat over a small part of a standard deviation.
    assert np.all(np.abs(got - other.x) < 1e-2 * one.std), (got - other.x) / one.std
    assert_allclose(one.chi_squared, 2.0 * other.cost, rtol=1e-6)
    assert_allclose(one.covariance, np.linalg.inv(other.jac.T @ other.jac), rtol=1e-3)
    assert np.all(found.converged) and int(np.max(found.steps)) < 20


def test_an_attitude_moves_on_its_group():
    """Stars seen from a turned body: the covariance has three rows."""
    stars = jnp.asarray(np.array([[1.0, 0.0, 0.6], [0.0, 1.0, 0.0], [0.0, 0.0, 0.8]]))
    turn = Quaternion.from_rotation_vector(jnp.array([0.9, -0.4, 0.3]))

    def seen(q):
        return q.inverse().matrix() @ stars

    found = fit(seen, seen(turn) + 1e-4 * NOISE[0][:9].reshape(3, 3), Quaternion.identity(),
                noise=1e-4)  # fmt: skip
    error = turn.inverse().then(found.parameters).rotation_vector()
    assert found.covariance.shape == (3, 3)
    # Beyond five standard deviations in one draw of three: the fit would be wrong.
    assert np.all(np.abs(error) < 5.0 * found.std)
    assert_allclose(jnp.sum(found.parameters.wxyz**2), 1.0, atol=1e-14)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"method": "newton"}, "method is 'newton'"),
        ({"noise": 0.0}, "must be positive"),
        ({"data": TS[:1]}, "must have the structure and shapes of the data"),
        ({"parameters": {}}, "nothing to fit"),
    ],
)
def test_wrong_calls(change, sentence):
    given = {"model": line, "data": TS, "parameters": START, "noise": 1.0} | change
    with pytest.raises(InputError, match=sentence):
        fit(**given)


def test_fewer_readings_than_parameters_need_a_prior():
    def first(p):
        return (p["rate"] + p["bias"])[None]

    with pytest.raises(InputError, match="1 readings for 2 parameters"):
        fit(first, jnp.ones(1), START, noise=1.0)


def test_single_precision_reaches_its_bound():
    """The line and the orbit in float32: within a hundredth of a standard deviation of float64,
    where the noise is a thousand times the rounding."""
    single = jax.tree.map(lambda x: x.astype(jnp.float32), START)
    z = 2.0 * TS - 0.3 + 1e-3 * NOISE[0]
    exact = fit(line, z, START, noise=1e-3)
    found = fit(
        lambda p: p["rate"] * TS.astype(jnp.float32) + p["bias"],
        z.astype(jnp.float32), single, noise=1e-3, tolerance=1e-4,
    )  # fmt: skip
    assert bool(found.converged) and found.parameters["rate"].dtype == jnp.float32
    for name, std in zip(("bias", "rate"), exact.std, strict=True):
        # Readings of 12 carry roundings of 7e-7, a thousandth of the noise.
        assert_allclose(found.parameters[name], exact.parameters[name], atol=1e-2 * float(std))
    # Sums of squares of 25 residuals that are known to a thousandth.
    assert_allclose(found.covariance, exact.covariance, rtol=1e-4)
    assert_allclose(found.chi_squared, exact.chi_squared, rtol=2e-2)
