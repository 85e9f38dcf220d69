"""Derivatives of statistics by the few runs that have a weight in them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from test_robust_design import MODES, algebraic
from test_robust_train import Gain

from jaxspace.dispersion import Normal
from jaxspace.robust._runs import problem_of
from jaxspace.robust.statistics import CVaR, Mean, Quantile, Worst
from jaxspace.simulation import Status

RUNS = 2048
TAILS = [Quantile("y", 0.05).at_least(0.0), CVaR("y", 0.95).at_most(9.0), Worst("y").at_most(9.0)]


def wave(x, w):
    """Linear in x, with other slopes for each run."""
    parts = jnp.arange(1.0, x.size + 1.0)[:, None]
    return jnp.sum(x[:, None] * (1.0 + jnp.cos(parts * w)) / parts, axis=0) + 0.3 * w


@pytest.mark.parametrize(
    ("unknowns", "objective"), [(6, Quantile("y", 0.99)), (40, Mean("y"))], ids=["forward", "back"]
)
def test_derivatives_by_few_runs_are_those_of_all(unknowns, objective):
    """Against differences with common numbers, where half of the runs are refused."""
    half = algebraic(wave, {"w": Normal(0.0, 1.0)}, limits={"w": Gain.limit()})
    x = jnp.cos(jnp.arange(float(unknowns)))
    problem = problem_of(half, x, objective, TAILS, RUNS, 0, None, 0.6)
    values = jax.jit(lambda x: problem.numbers(x)[0])

    def numbers(x):
        found = problem(x)
        assert found.non_negative is not None
        return jnp.concatenate([found.objective[None], found.non_negative])

    forward, reverse = jax.jit(lambda x: [mode(numbers)(x) for mode in MODES])(x)
    # The rows are those of one Jacobian, whichever mode asks for it.
    np.testing.assert_allclose(forward, reverse, rtol=1e-12, atol=1e-14)
    rng, step = np.random.default_rng(4), 1e-6
    for way in rng.normal(size=(3, unknowns)):
        differences = (values(x + step * way) - values(x - step * way)) / (2.0 * step)
        # Numbers of size ten are rounded to 2e-15, and divided by 2e-6.
        np.testing.assert_allclose(forward @ way, differences, rtol=1e-5, atol=1e-7)
    runs = jax.jit(lambda x: problem.runs(x))(x)
    refused = np.asarray(runs.status) == Status.REFUSED
    weights = np.asarray(problem.weighted(runs)[1])
    # About half of a normal distribution, of which none has a weight.
    assert 0.4 < np.mean(refused) < 0.6 and not np.any(weights[:, refused])
    # Of 1,024 good runs about 56 are near a quantile of 5 %; 51 are beyond one of 95 %, and with
    # those before it up to thrice as many where the density falls.
    assert np.count_nonzero(weights[1]) < 112 and np.count_nonzero(weights[2]) < 200


def test_a_quantile_is_smooth_where_runs_change_places():
    """Runs with slopes of their own along a line: the derivative has no jumps."""
    rng, n = np.random.default_rng(0), 2048
    start, slopes = jnp.asarray(rng.normal(size=(2, n)))
    good = jnp.ones(n, bool)
    statistic = Quantile("y", 0.99)
    f = jax.jit(jax.vmap(jax.grad(lambda x: statistic.value(start + x * slopes, good))))
    d = np.asarray(f(jnp.linspace(-0.05, 0.05, 2001)))
    # A run's weight is a fortieth, and one change of places in a corner would be seen as a part of
    # it; the kernel has two continuous derivatives.
    assert np.max(np.abs(np.diff(d, 2))) < 1e-5


def test_a_quantile_among_sparse_values():
    """Of a lognormal law the 99 % quantile is exp(z s), and so is its derivative by a scale."""
    n, deviation = 4096, 2.0
    z = jax.scipy.special.ndtri((jnp.arange(float(n)) + 0.5) / n)
    good = jnp.ones(n, bool)

    def f(s):
        return Quantile("y", 0.99).value(jnp.exp(s * z), good)

    value, slope = jax.jit(jax.value_and_grad(f))(jnp.asarray(deviation))
    place = float(jax.scipy.special.ndtri(0.99))
    exact = np.exp(deviation * place)
    # A kernel of the deviation 1.3 errors, each of 12 % of the value, has a bias of a few percent.
    np.testing.assert_allclose(value, exact, rtol=0.06)
    np.testing.assert_allclose(slope, place * exact, rtol=0.12)
