"""The best design under dispersion, where statistics, their derivatives and the optimum are known
in closed form or by quadrature."""

import dataclasses
import re
from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest
import scipy.optimize
import scipy.stats
from unchecked import unchecked

from jaxspace.core import AbstractClosedForm, AbstractSystem, InputError, Scalar, quantity
from jaxspace.dispersion import Campaign, Constant, Normal, Uniform
from jaxspace.robust import optimise_design
from jaxspace.robust._runs import problem_of
from jaxspace.robust.statistics import CVaR, Mean, MeanPlus, Quantile, Violation, Worst
from jaxspace.simulation import Accuracy, Event, Mission, Phase, Status
from jaxspace.solvers import Tsit5
from jaxspace.statistics.limits import clopper_pearson

MODES = (jax.jacfwd, jax.jacrev)
FAST = Accuracy(1e-7, method=Tsit5(), max_steps=64)
# Of a standard normal number: 99 % of all draws lie below the first, and the mean of those above
# the 95 % quantile is the second.
Z99 = scipy.stats.norm.ppf(0.99)
BEYOND95 = scipy.stats.norm.pdf(scipy.stats.norm.ppf(0.95)) / 0.05
STATISTICS = {
    "mean": (Mean("y"), 0.0),
    "mean + k std": (MeanPlus("y", 2.0), 2.0),
    "quantile": (Quantile("y", 0.99), Z99),
    "mean beyond": (CVaR("y", 0.95), BEYOND95),
}


class Line(eqx.Module):
    """A place that stays."""

    y: Scalar


@final
class Still(AbstractClosedForm):
    """Nothing moves."""

    def flow(self, duration, y):
        return y


@final
class Rest(AbstractSystem):
    """y' = 0, without any integration."""

    def vector_field(self, t, y):
        return Line(jnp.zeros_like(y.y))

    def invariants(self, t, y):
        return {"y": y.y}

    def closed_form(self):
        return Still()


def algebraic(function, inputs, **options):
    """A campaign whose output y is `function(x, w)` without any motion."""

    def campaign(x):
        def build(samples):
            return Mission([Phase(Rest(), 1.0)]), Line(function(x, samples["w"]))

        return Campaign(build, inputs, lambda result, samples: {"y": result.final.y}, **options)

    return campaign


SCATTER = 0.4


def linear_quadratic(x, w):
    """Normal, with the mean (x - 1)^2 and the deviation 0.4 x."""
    return (x - 1.0) ** 2 + SCATTER * x * w


@jax.jit
def all_values(x, good):
    every = [s.value(x, good) for s, _ in STATISTICS.values()]
    every += [Violation("y", high=1.5).value(x, good), Violation("y", low=-1.0).value(x, good)]
    return jnp.stack([*every, Worst("y").value(x, good)])


def test_statistics_of_a_normal_sample():
    """At the places of equal shares, beside rows of failed runs."""
    n = 4096
    shares = (np.arange(n) + 0.5) / n
    x = np.concatenate([scipy.stats.norm.ppf(shares), [np.nan, np.inf]])
    found = all_values(jnp.asarray(x), jnp.arange(n + 2) < n)
    expected = [k for _, k in STATISTICS.values()]
    # Two failed runs count as violations.
    expected += [scipy.stats.norm.sf(1.5) + 2.0 / n, scipy.stats.norm.cdf(-1.0) + 2.0 / n]
    # The kernel of the width 1.3/16 widens the distribution by a third of a percent.
    np.testing.assert_allclose(found[:-1], expected, atol=0.01)
    np.testing.assert_allclose(found[-1], x[n - 1])
    for (statistic, _), value in zip(STATISTICS.values(), expected, strict=False):
        measured = statistic.measured(x, np.arange(n + 2) < n)
        # Plain order statistics, of the middles of n layers.
        np.testing.assert_allclose(measured.value, value, atol=0.005)


def test_errors_of_statistics_over_many_samples():
    """The standard error that one sample gives is the deviation over many."""
    rng = np.random.default_rng(1)
    samples = rng.exponential(size=(400, 1000))
    good = np.ones(1000, bool)
    statistics = [s for s, _ in STATISTICS.values()]
    for statistic in [*statistics, Violation("y", high=2.0)]:
        measured = [statistic.measured(x, good) for x in samples]
        spread = np.std([m.value for m in measured])
        error = np.mean([m.error for m in measured])
        # The deviation of 400 values is known to 4 %, a density in the tail to a tenth.
        assert 0.85 < error / spread < 1.18, statistic.text()
    assert np.isnan(Worst("y").measured(samples[0], good).error)


def test_intervals_hold_the_truth_as_often_as_they_say():
    """Over many samples of a normal distribution, where every statistic is known: two standard
    errors, and the interval of a share of violations."""
    rng, count, good = np.random.default_rng(2), 1000, np.ones(4096, bool)
    samples = rng.normal(size=(count, good.size))
    share = scipy.stats.norm.sf(1.5)
    known = [*STATISTICS.values(), (Violation("y", high=1.5), share)]
    for statistic, truth in known:
        measured = [statistic.measured(x, good) for x in samples]
        held = np.mean([abs(m.value - truth) <= 1.96 * m.error for m in measured])
        # The share of 1,000 samples has the deviation 0.7 %. The error of a tail is itself known
        # from few runs: that of the 99 % quantile from the 41 above it.
        assert 0.90 < held < 0.975, (statistic.text(), held)
    intervals = [clopper_pearson(int(np.count_nonzero(x > 1.5)), good.size) for x in samples]
    # At least as often as it says, by three deviations.
    assert np.mean([i.low <= share <= i.high for i in intervals]) > 0.95 - 0.021


def test_derivatives_of_statistics_against_differences():
    """In both modes, with common numbers, and finite beside failed runs without a number."""
    w = jax.random.normal(jax.random.key(0), (600,))
    bad = jnp.arange(602) < 600

    def f(x):
        y = jnp.concatenate([linear_quadratic(x, w), jnp.array([jnp.nan, jnp.inf])])
        return all_values(y, bad)[:-1]

    x, step = jnp.asarray(0.7), 1e-4
    forward, reverse = jax.jit(lambda x: (jax.jacfwd(f)(x), jax.jacrev(f)(x)))(x)
    differences = (np.asarray(f(x + step)) - np.asarray(f(x - step))) / (2.0 * step)
    np.testing.assert_allclose(forward, reverse, rtol=1e-9)
    # The width of the kernel has a corner wherever a run passes the mean: 1/n of its derivative.
    np.testing.assert_allclose(forward, differences, rtol=1e-3, atol=1e-4)


def test_a_quantile_and_a_share_of_violations_are_one_requirement():
    x = jax.random.normal(jax.random.key(3), (500,)) ** 3
    good = jnp.ones(500, bool)
    limit = Quantile("y", 0.9).value(x, good)
    share = Violation("y", high=float(limit)).value(x, good)
    # Smoothed by other widths, they differ by less than one run.
    np.testing.assert_allclose(share, 0.1, atol=1.0 / 500)


def test_statistics_without_scatter():
    """All runs alike: the value itself, and finite derivatives."""
    good = jnp.ones(64, bool)

    def f(x):
        return all_values(x * jnp.ones(64), good)

    value, slope = f(jnp.asarray(2.0)), jax.jacfwd(f)(jnp.asarray(2.0))
    np.testing.assert_allclose(value, [2.0, 2.0, 2.0, 2.0, 1.0, 0.0, 2.0], rtol=1e-6)
    # Of the two that are smoothed, by a width of 4,096 units of rounding.
    np.testing.assert_allclose(slope[:4], 1.0, rtol=1e-3)
    assert np.all(np.isfinite(slope))


@pytest.mark.parametrize("name", STATISTICS)
def test_optimum_of_a_linear_quadratic_problem(name):
    """(x - 1)^2 + k s x is least at 1 - k s/2, for mean, deviation, quantile and CVaR."""
    statistic, k = STATISTICS[name]
    found = optimise_design(
        algebraic(linear_quadratic, {"w": Normal(0.0, 1.0)}),
        jnp.asarray(0.9),
        minimise=statistic,
        tolerance=1e-6,
    )
    assert found.converged, found.sentence()
    # The kernel widens by half a percent; 1,024 Sobol points know mean and deviation to 0.1 %.
    np.testing.assert_allclose(found.x, 1.0 - 0.5 * k * SCATTER, atol=0.005)
    np.testing.assert_allclose(found.objective, k * SCATTER - (k * SCATTER) ** 2 / 4.0, atol=0.01)


def test_newsvendor():
    """The order x at which the demand is met with the probability 1 - cost/price."""
    cost, price = 1.0, 4.0

    def loss(x, demand):
        return cost * x - price * jnp.minimum(x, demand)

    found = optimise_design(
        algebraic(loss, {"w": Uniform(50.0, 150.0)}),
        jnp.asarray(60.0),
        minimise=Mean("y"),
        bounds=(0.0, 200.0),
    )
    # A corner at the demand of each of 1,024 runs, 0.1 apart.
    np.testing.assert_allclose(found.x, 50.0 + 100.0 * (1.0 - cost / price), atol=0.3)
    assert found.without_influence == ()


WIND, GRAVITY, DRAG = 5.0, 10.0, 0.1


@final
class InWind(AbstractSystem):
    """A projectile with linear drag in a wind: u' = -k (u - w), v' = -g - k v."""

    wind: Scalar = quantity("m/s", doc="along the range")

    def vector_field(self, t, y):
        u, v = y["u"], y["v"]
        return {"x": u, "z": v, "u": -DRAG * (u - self.wind), "v": -GRAVITY - DRAG * v}

    def invariants(self, t, y):
        return {}


def thrown(x):
    ground = Event(lambda t, y: y["z"], direction=-1, within=20.0)

    def build(samples):
        w = samples["w"]
        speed = x["speed"] / np.sqrt(2.0)
        y0 = {"x": 0.0 * w, "z": 0.0 * w, "u": speed + 0.0 * w, "v": speed + 0.0 * w}
        return Mission([Phase(InWind(w), ground)]), y0

    def outputs(result, samples):
        return {"range": result.final["x"], "shortness": -result.final["x"]}

    return Campaign(build, {"w": Normal(0.0, WIND)}, outputs, accuracy=FAST)


def range_of(speed, wind):
    """In closed form, but for the time of the landing."""
    u = v = speed / np.sqrt(2.0)

    def height(t):
        return (v + GRAVITY / DRAG) * (1.0 - np.exp(-DRAG * t)) / DRAG - GRAVITY * t / DRAG

    t = scipy.optimize.brentq(height, 0.1, 20.0, xtol=1e-12)
    return wind * t + (u - wind) * (1.0 - np.exp(-DRAG * t)) / DRAG


def test_a_projectile_in_random_wind():
    """As far as possible on average, with 95 % of all landings within 50 m: through an event."""
    found = optimise_design(
        thrown,
        {"speed": jnp.asarray(20.0)},
        minimise=Mean("shortness"),
        subject_to=[Quantile("range", 0.95).at_most(50.0)],
        runs=1024,
    )
    assert found.converged, found.sentence()
    # The range grows with the wind: its quantile is the range in the wind of that quantile.
    strong = WIND * scipy.stats.norm.ppf(0.95)
    speed = scipy.optimize.brentq(lambda v: range_of(v, strong) - 50.0, 10.0, 40.0)
    # The kernel widens the scatter by 0.8 %, which is 0.1 m of the limit.
    np.testing.assert_allclose(found.x["speed"], speed, rtol=5e-3)
    nodes, weights = np.polynomial.hermite_e.hermegauss(20)
    ranges = np.array([range_of(float(found.x["speed"]), WIND * z) for z in nodes])
    mean = np.sum(weights * ranges) / np.sum(weights)
    # Sobol points know the mean of a smooth function far better than 1/sqrt(n).
    np.testing.assert_allclose(-found.objective, mean, rtol=1e-3)


@final
class Blow(AbstractSystem):
    """y' = w y^2, which is infinite before the end where w y_0 > 1."""

    w: Scalar = quantity("1", doc="rate")

    def vector_field(self, t, y):
        return Line(self.w * y.y**2)

    def invariants(self, t, y):
        return {}


def blown(x):
    def build(samples):
        return Mission([Phase(Blow(samples["w"]), 1.0)]), Line(x + 0.0 * samples["w"])

    def outputs(result, samples):
        return {"y": result.final.y, "rate": samples["w"]}

    return Campaign(build, {"w": Uniform(0.0, 1.25)}, outputs, accuracy=FAST)


def test_failed_runs_are_left_out_and_harm_no_other():
    """A ninth of the runs ends in a singularity: value and both derivatives are of the others."""
    x, limits = jnp.asarray(0.9), [Worst("rate").at_most(9.0)]
    problem = problem_of(blown, x, Mean("y"), limits, 64, 0, None, 0.5)
    found = jax.jit(lambda x: problem(x))(x)
    w, good = found.report.outputs["rate"], found.report.status <= Status.EVENT
    # The singularity is at w = 1/x, and near it the steps run out, too.
    assert np.all(good[w < 0.95]) and not np.any(good[w > 1.0 / 0.9]) and np.any(~good)
    w = np.asarray(w)[np.asarray(good)]
    np.testing.assert_allclose(found.objective, np.mean(x / (1.0 - w * x)), rtol=1e-4)
    slopes = jax.jit(lambda x: [d(lambda x: problem(x).objective)(x) for d in MODES])(x)
    # Of each run 1/(1 - w x)^2.
    np.testing.assert_allclose(slopes, np.mean((1.0 - w * x) ** -2.0), rtol=1e-3)


def test_a_search_turns_back_where_runs_fail():
    """The larger x, the better, until runs become singular: w x < 1 for w up to 0.8."""

    def held(x):
        inputs = {"w": Uniform(0.0, 0.8)}
        made = dataclasses.replace(blown(x), inputs=inputs)
        outputs = lambda result, samples: {"y": -result.final.y}  # noqa: E731
        return dataclasses.replace(made, outputs=outputs)

    found = optimise_design(held, jnp.asarray(0.9), minimise=Mean("y"), runs=64, max_steps=12)
    # One of 64 Sobol points lies in the last 64th of the range.
    assert 0.9 < float(found.x) < 1.0 / (0.8 * 63 / 64) and np.isfinite(found.objective)
    assert int(found.minimum.left_out) > 0
    assert "for their designs more than a fraction of 0 of the runs fail" in repr(found)
    assert re.search(
        r"At the last of them \d+ of 64 runs fail, most of them with this status: ", repr(found)
    )


def test_too_many_failed_runs_at_the_start_are_said():
    with pytest.raises(InputError, match="of 64 runs fail, .* At most a fraction of 0 may fail"):
        optimise_design(blown, jnp.asarray(0.9), minimise=Mean("y"), runs=64)


def test_what_is_wrong_is_said_before_anything_is_compiled():
    campaign = algebraic(linear_quadratic, {"w": Normal(0.0, 1.0)})
    x = jnp.asarray(0.9)
    for wrong, sentence in (
        ({"minimise": Quantile("y", 0.99), "runs": 1000}, "runs is 1000, too few .* at least 2000"),
        ({"minimise": CVaR("y", 0.9), "runs": 100}, "100, too few for the mean of y beyond"),
        ({"minimise": Mean("z")}, "'z' is not an output of the campaign: it must be one of y"),
        ({"minimise": "mean"}, "minimise is a str: it must be a statistic"),
        ({"minimise": Mean("y"), "subject_to": [Mean("y")]}, r"subject_to\[0\] is a Mean"),
        ({"minimise": Mean("y"), "bounds": (1.0, 0.0)}, "the lower one must be below"),
        ({"minimise": Mean("y"), "may_fail": 1.0}, "may_fail is 1.0"),
        ({"minimise": Mean("y"), "runs": 0}, "runs is 0"),
    ):
        with unchecked(), pytest.raises(InputError, match=sentence):
            optimise_design(campaign, x, **wrong)
    with pytest.raises(InputError, match="The inputs w have zero standard deviation"):
        still = algebraic(linear_quadratic, {"w": Constant(1.0)})
        optimise_design(still, x, minimise=Mean("y"))
    with unchecked(), pytest.raises(InputError, match="campaign returns a tuple for the start"):
        optimise_design(lambda x: (x, x), x, minimise=Mean("y"))
    for wrong, sentence in (
        (lambda: Quantile("y", 1.0), "Quantile.share is 1.0"),
        (lambda: CVaR("y", 0.0), "CVaR.share is 0.0"),
        (lambda: Violation("y"), "must have exactly one of them"),
        (lambda: Mean("y").at_most(np.inf), "must be a finite number"),
        (lambda: Violation("y", low=0.0).at_most(2.0), "The limit of the share .* is 2.0"),
    ):
        with pytest.raises(InputError, match=sentence):
            wrong()


@pytest.mark.parametrize(
    "optimiser, bounds",
    [
        ("sqp", None),
        # One of no influence near a bound is drawn to their middle.
        (
            "sqp",
            (
                {"a": jnp.asarray(0.0), "b": jnp.full(2, -0.01)},
                {"a": jnp.asarray(2.0), "b": jnp.full(2, 3.0)},
            ),
        ),
        (optax.lbfgs(), None),
    ],
    ids=["sqp", "bounds", "lbfgs"],
)
def test_an_unknown_without_influence_is_named(optimiser, bounds):
    def cost(x, w):
        return linear_quadratic(x["a"], w) + 0.0 * x["b"][0]

    found = optimise_design(
        algebraic(cost, {"w": Normal(0.0, 1.0)}),
        {"a": jnp.asarray(0.9), "b": jnp.zeros(2)},
        minimise=MeanPlus("y", 1.0),
        optimiser=optimiser,
        bounds=bounds,
    )
    # As for the mean and its deviation alone.
    np.testing.assert_allclose(found.x["a"], 1.0 - 0.5 * SCATTER, atol=0.005)
    assert found.without_influence == ("b[0]", "b[1]")
    assert "depend on b[0], b[1]" in repr(found)


def test_the_nominal_optimum():
    """Of (x - 1)^2 under x w + (x - 1)^2 <= 1 at w = 0: the constraint is no matter."""
    found = optimise_design(
        algebraic(linear_quadratic, {"w": Normal(0.0, 1.0)}),
        jnp.asarray(0.5),
        minimise=MeanPlus("y", 3.0),
        subject_to=[Violation("y", high=0.01).at_most(0.05)],
        nominal=True,
    )
    np.testing.assert_allclose(found.x, 1.0, atol=1e-3)
    assert repr(found).startswith("Nominal design")


def test_small_values_may_be_bad():
    """The lower side of a sample is the upper one of its negative, and what is to be greatest is
    the least of the negative, each in its own sign and words."""
    x = jnp.asarray(np.random.default_rng(1).normal(3.0, 1.0, 2048))
    good = jnp.arange(x.size) > 9
    for upper, lower in (
        (CVaR("y", 0.95), CVaR("y", 0.95, lower=True)),
        (Worst("y"), Worst("y", lower=True)),
    ):
        np.testing.assert_allclose(lower.value(x, good), -upper.value(-x, good), rtol=1e-14)
        mine, other = (
            s.measured(np.asarray(v), np.asarray(good)) for s, v in ((lower, x), (upper, -x))
        )
        np.testing.assert_allclose(mine.value, -other.value, rtol=1e-14)
        np.testing.assert_allclose(mine.influence, -other.influence, rtol=1e-14)
    assert CVaR("y", 0.95, lower=True).text() == "mean of the lowest 5 % of y"
    assert Worst("y", lower=True).text() == "least y"
    own = algebraic(lambda x, w: w - (x - 0.3) ** 2, {"w": Normal(5.0, 1.0)})
    seen = []
    found = optimise_design(
        own,
        jnp.asarray(0.9),
        maximise=Quantile("y", 0.05),
        progress=lambda *row: seen.append(row),
    )
    np.testing.assert_allclose(found.x, 0.3, atol=1e-3)
    assert (
        found.objective > 3.0 and found.converged and seen[-1][1] == pytest.approx(found.objective)
    )
    assert "5 % quantile of y" in repr(found)
    with pytest.raises(InputError, match="one of minimise and maximise"):
        optimise_design(own, jnp.asarray(0.9))
