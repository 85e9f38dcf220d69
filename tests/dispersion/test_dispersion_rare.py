"""Rare events by both methods, judged by their coverage where the probability is known in closed
form: inputs and outputs that move in steps, many directions, and both tails."""

from typing import final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.stats import beta, chi2, norm

from jaxspace.core import AbstractClosedForm, AbstractSystem, InputError, Scalar
from jaxspace.dispersion import Campaign, Correlated, Discrete, Normal, Samples, Uniform
from jaxspace.dispersion._estimate import Estimate
from jaxspace.dispersion._importance import importance
from jaxspace.dispersion._subset import CHAINED, _widening, subset
from jaxspace.dispersion.rare import rare_event
from jaxspace.simulation import Mission, Phase

SEEDS = 20
# Of 20 intervals of 95 % fewer than 16 hold the truth once in 400 cases.
LEAST = 16


def one(z):
    return np.ones(len(z))


def ball(n, p):
    """The square of the distance from zero of n numbers: every direction leads to a violation."""
    r = np.sqrt(chi2.isf(p, n))

    def slope(z):
        d = np.linalg.norm(z, axis=1)
        return r - d, -z / d[:, None]

    return lambda z: r - np.linalg.norm(z, axis=1), one, slope, n, p


def cube(n, p):
    """The greatest of the magnitudes of n numbers: 2 n equal design points."""
    r = norm.isf(-np.expm1(np.log1p(-p) / n) / 2.0)

    def slope(z):
        place = np.argmax(np.abs(z), axis=1)
        s = np.zeros_like(z)
        s[np.arange(len(z)), place] = -np.sign(z[np.arange(len(z)), place])
        return r - np.abs(z).max(axis=1), s

    return lambda z: r - np.abs(z).max(axis=1), one, slope, n, p


def branches():
    """Four limits about the origin, of which derivatives from there lead to the nearer two."""

    def parts(z):
        a, b = z.T
        along, across = (a + b) / np.sqrt(2.0), a - b
        near = 3.0 + 0.1 * across**2
        far = 7.0 / np.sqrt(2.0)
        return np.stack([near - along, near + along, far - across, far + across])

    def slope(z):
        g = parts(z)
        across = 0.2 * (z[:, 0] - z[:, 1])
        unit, half = np.ones(len(z)), np.full(len(z), np.sqrt(0.5))
        da = np.stack([across - half, across + half, -unit, unit])
        db = np.stack([-across - half, -across + half, unit, -unit])
        place = np.argmin(g, axis=0), np.arange(len(z))
        return g[place], np.stack([da[place], db[place]], axis=1)

    # Over v = (a - b)/sqrt(2), beyond 3.5 of which everything violates.
    inside = quad(lambda v: 2.0 * norm.pdf(v) * norm.sf(3.0 + 0.2 * v * v), -3.5, 3.5)[0]
    return lambda z: parts(z).min(axis=0), one, slope, 2, inside + 2.0 * norm.sf(3.5)


def measured(p):
    """Eleven inputs, one of which has 52 % of the variance, from 60 measured values."""
    values = np.sort(np.random.default_rng(0).standard_normal(60))
    values = (values - values.mean()) / values.std() * np.sqrt(0.52)
    limit = brentq(lambda x: norm.sf((x - values) / np.sqrt(0.48)).mean() / p - 1.0, 2.0, 9.0)

    def margin(z):
        place = np.minimum((60 * norm.cdf(z[:, 0])).astype(int), 59)
        return limit - values[place] - np.sqrt(0.048) * z[:, 1:].sum(axis=1)

    def slope(z):
        s = np.full_like(z, -np.sqrt(0.048))
        s[:, 0] = 0.0
        return margin(z), s

    return margin, one, slope, 11, p


def steps(p):
    """A sum of three normal numbers, rounded down to a half: no derivative, and many equal runs."""
    limit = 0.5 * np.floor(2.0 * norm.isf(p))

    def margin(z):
        return limit - 0.01 - 0.5 * np.floor(2.0 * z.sum(axis=1) / np.sqrt(3.0))

    return margin, one, None, 3, norm.sf(limit)


LIST = Discrete(np.array([0.0, 1.0, 3.0]), np.array([0.9, 0.099, 0.001]))
OF_LIST = float(norm.sf(5.5 - np.array([0.0, 1.0, 3.0])) @ np.array([0.9, 0.099, 0.001]))
PROBLEMS = {
    "two numbers": ball(2, 1e-6),
    "three numbers": ball(3, 1e-5),
    "ten points": cube(5, 1e-5),
    "twenty points": cube(10, 1e-5),
    "four branches": branches(),
    "six numbers": ball(6, 1e-5),
    "measured": measured(9.5e-6),
    "steps": steps(1e-5),
}


@pytest.mark.parametrize(
    "method, name",
    [
        *(("importance", name) for name in PROBLEMS),
        *(("without derivatives", name) for name in ("two numbers", "three numbers")),
        *(("subset", name) for name in PROBLEMS),
    ],
)
def test_intervals_hold_the_truth(method, name):
    margin, likelihood, slope, n, truth = PROBLEMS[name]
    held, values = 0, []
    for seed in range(SEEDS):
        rng = np.random.default_rng(seed)
        if method == "subset":
            found = subset(margin, likelihood, n, 4000, rng)
        else:
            used = slope if method == "importance" else None
            found = importance(margin, likelihood, used, n, 8000, rng)[1]
        assert found is not None and found.runs < 12000
        low, high = found.interval()
        held += low <= truth <= high
        values.append(found.value)
    assert held >= LEAST
    # The values scatter by a tenth, of subset simulation by a half: their median by less than a
    # quarter of that.
    assert abs(np.median(values) / truth - 1.0) < (0.4 if method == "subset" else 0.2)


@pytest.mark.parametrize("name", ["twenty points", "four branches"])
def test_design_points_apart_are_found(name):
    """All of 20 equal points; the farther of the branches, from violations of the wide search."""
    margin, likelihood, slope, n, _ = PROBLEMS[name]
    expected = {"twenty points": 20, "four branches": 4}[name]
    for seed in range(5):
        rng = np.random.default_rng(seed)
        points, _ = importance(margin, likelihood, slope, n, 8000, rng)
        assert len(points) == expected


def test_an_interval_that_is_not_to_be_trusted_says_so():
    """Of 100 directions no search without derivatives finds the one that matters."""
    limit, truth = norm.isf(1e-4), 1e-4

    def margin(z):
        return limit - z.sum(axis=1) / 10.0

    for seed in range(5):
        rng = np.random.default_rng(seed)
        found = importance(margin, one, None, 100, 5000, rng)[1]
        assert found is not None
        low, high = found.interval()
        assert low <= truth <= high or not found.reliable
        assert found.reliable == ("The interval is not reliable" not in found.warning)
    assert not found.reliable


def test_a_limit_that_curves_about_many_points_widens_the_interval():
    """About a ball in six directions the draws miss the largest weights, and their variance
    underestimates that of the value: the mean square of the errors is one standard error."""
    margin, likelihood, slope, n, truth = PROBLEMS["six numbers"]
    square = 0.0
    for seed in range(SEEDS):
        found = importance(margin, likelihood, slope, n, 10_000, np.random.default_rng(seed))[1]
        assert found is not None
        square += (np.log(found.value / truth) / found.variation) ** 2
    assert square / SEEDS < 1.2


@pytest.mark.parametrize("half_width", [1e-3, 1e-4])
def test_chains_that_hardly_move_say_so(half_width):
    """A narrow strip, which steps of the chains leave: many intervals of subset simulation miss the
    probability, and few of them without being marked. Those of a wide strip are not marked."""
    truth = norm.cdf(3.0 + half_width) - norm.cdf(3.0 - half_width)
    missed = marked = unmarked = 0
    for seed in range(SEEDS):
        found = subset(
            lambda z: np.abs(z[:, 0] - 3.0) - half_width, one, 2, 4000, np.random.default_rng(seed)
        )
        low, high = found.interval()
        missed += not low <= truth <= high
        marked += not found.reliable
        unmarked += found.reliable and not low <= truth <= high
        assert found.reliable == ("The interval is not reliable" not in found.warning)
    assert missed >= 5 and unmarked <= 1 and marked >= missed - 1
    wide = [
        subset(lambda z: np.abs(z[:, 0] - 2.0) - 0.1, one, 2, 4000, np.random.default_rng(seed))
        for seed in range(SEEDS)
    ]
    assert all(found.reliable for found in wide)


def test_correlation_of_chains():
    """Of equal chains 1 + 2 sum (1 - k/L) rho(k) with rho(k) = 1: the number of steps L; of
    independent runs at least the usual widening."""
    rng = np.random.default_rng(0)
    once = rng.random(1000) < 0.3
    assert _widening(np.tile(once, 10), 1000) == pytest.approx(10.0, rel=1e-9)
    assert _widening(rng.random(10_000) < 0.3, 1000) == 1.0 + CHAINED
    assert _widening(once, 0) == 1.0


class Point(eqx.Module):
    x: Scalar
    v: Scalar


@final
class Rest(AbstractClosedForm):
    """Nothing moves."""

    def flow(self, duration, y):
        return y


@final
class Still(AbstractSystem):
    """x' = 0: in closed form, so that only the statistics are on trial."""

    def vector_field(self, t, y):
        return Point(jnp.zeros_like(y.v), jnp.zeros_like(y.v))

    def invariants(self, t, y):
        return {}

    def closed_form(self):
        return Rest()


def build(samples):
    return Mission([Phase(Still(), 1.0)]), Point(samples["a"], samples["b"])


def outputs(result, samples):
    a, b = samples["a"], samples["b"]
    return {"sum": a + b, "list": a, "radius": jnp.hypot(a, b)}


LISTED = Campaign(build, {"a": LIST, "b": Normal(0.0, 1.0)}, outputs)
EVEN = Campaign(build, {"a": Normal(0.0, 0.6), "b": Normal(0.0, 0.8)}, outputs)


@pytest.mark.parametrize("method", ["importance", "subset"])
def test_a_list_of_values_and_a_normal_number(method):
    """P(a + b > 5.5) = sum_k w_k Phi(v_k - 5.5); and a value of one run in a million, alone."""
    found = [
        rare_event(LISTED, "sum", above=5.5, runs=4000, method=method, seed=s) for s in range(5)
    ]
    assert sum(f.low <= OF_LIST <= f.high for f in found) >= 4
    seldom = Discrete(np.array([0.0, 7.0, 1.0]), np.array([0.5, 1e-6, 0.5]))
    alone = Campaign(build, {"a": seldom, "b": Uniform(0.0, 1.0)}, outputs)
    rare = rare_event(alone, "list", above=6.0, runs=4000, method=method)
    assert rare.low <= 1e-6 / 1.000001 <= rare.high and rare.high < 2e-6


@pytest.mark.parametrize("method", ["importance", "subset"])
@pytest.mark.parametrize("sigma", [-5.0, -3.0, -0.4, 0.0, 0.5])
def test_both_tails(method, sigma):
    """Of a standard normal output, whose nominal run violates the limits below zero."""
    found = rare_event(EVEN, "sum", above=sigma, runs=4000, method=method, seed=1)
    assert found.low <= norm.sf(sigma) <= found.high
    # The complement of a limit at -5 deviations is known to a factor of a few.
    size = min(norm.sf(sigma), norm.cdf(sigma))
    assert found.high - found.low < (0.2 if abs(sigma) < 2.0 else 8.0) * size
    assert found.method == (method if abs(sigma) > 2.0 else "monte_carlo")


def test_what_is_never_met_and_always_met():
    """The greatest of five values of a list is 3: nothing lies above 4, and everything above -1."""
    with pytest.raises(InputError, match="No violation was found in [0-9]+ runs"):
        rare_event(LISTED, "list", above=4.0, runs=2000)
    none = rare_event(LISTED, "list", above=4.0, runs=2000, method="subset")
    assert none.value == none.low == 0.0 and 0.0 < none.high < 0.01
    assert "No violation was found" in none.warning
    for method in ("importance", "subset"):
        every = rare_event(LISTED, "list", above=-1.0, runs=2000, method=method)
        assert every.value == every.high == 1.0 and 0.99 < every.low < 1.0
    with pytest.raises(InputError, match="above is nan: it must be finite"):
        rare_event(LISTED, "list", above=float("nan"))


def test_a_limit_on_a_value_of_the_list():
    """A value at the limit meets it: P(a > 1) is that of 3, P(a < 1) that of 0."""
    above = rare_event(LISTED, "list", above=1.0, runs=4000, seed=2)
    assert above.low <= 1e-3 <= above.high
    below = rare_event(LISTED, "list", below=1.0, runs=4000, seed=2)
    assert below.low <= 0.9 <= below.high


def test_interval_of_few_violations():
    """Of k violations of equal weight it is the exact one of a Poisson count, from the quantiles of
    the gamma distribution; that of none has the limit of three in n, 3.69."""
    for k in (1, 4, 100):
        low, high = Estimate(k * 1e-3, k**-0.5, 1e-3, 0.0, 1000).interval()
        assert low == pytest.approx(1e-3 * chi2.ppf(0.025, 2 * k) / 2.0, rel=1e-9)
        assert high == pytest.approx(1e-3 * chi2.ppf(0.975, 2 * k + 2) / 2.0, rel=1e-9)
        # Nearly that of Clopper and Pearson, where the violations are few of many.
        assert high == pytest.approx(beta.ppf(0.975, k + 1, 1000 - k), rel=0.06)
    assert Estimate(0.0, np.inf, 1e-3, 0.0, 1000).interval() == pytest.approx(
        (0.0, 3.689e-3), rel=1e-3
    )


def test_samples_in_a_campaign():
    """Five measured values and a normal number, P = mean of Phi((v - x) / s)."""
    values = np.array([-1.0, -0.2, 0.1, 0.6, 2.0])
    campaign = Campaign(build, {"a": Samples(values), "b": Normal(0.0, 0.5)}, outputs)
    truth = norm.sf((4.0 - values) / 0.5).mean()
    found = rare_event(campaign, "sum", above=4.0, runs=4000)
    assert found.low <= truth <= found.high and found.variation < 0.15


@pytest.mark.parametrize("correlation", [0.0, 0.7])
def test_a_list_among_correlated_inputs(correlation):
    """A value of one run in a million, beside a normal number with which it is correlated: it is
    drawn where the number behind it is above z, so that P = integral of phi(m) Phi(...) from z."""
    rare = Discrete(np.array([0.0, 7.0]), np.array([1.0 - 1e-6, 1e-6]))
    matrix = np.array([[1.0, correlation], [correlation, 1.0]])
    joint = Correlated.of((rare, Normal(0.0, 1.0)), matrix)
    campaign = Campaign(build, joint.inputs("a", "b"), outputs)
    left = np.sqrt(1.0 - correlation**2)

    def above(limit):
        return quad(
            lambda m: norm.pdf(m) * norm.sf((limit - correlation * m) / left),
            norm.isf(1e-6),
            np.inf,
            epsabs=0.0,
        )[0]

    # The normal number alone exceeds 8 with a probability of 6e-16 only.
    truth = above(1.0)
    found = [rare_event(campaign, "sum", above=8.0, runs=2000, seed=seed) for seed in range(5)]
    assert sum(f.low <= truth <= f.high for f in found) >= 4
    assert all(f.high < 2.0 * truth for f in found)
