"""What stands beside Monte Carlo: linear covariance, sigma points, rare events, Sobol indices,
gradients of statistics; against closed forms."""

import re
from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import norm

from jaxspace.core import AbstractClosedForm, AbstractSystem, InputError, Scalar
from jaxspace.dispersion import (
    Campaign,
    Constant,
    Correlated,
    Discrete,
    MultivariateNormal,
    Normal,
    TruncatedNormal,
    Uniform,
    disperse,
    moments,
)
from jaxspace.dispersion.comparison import compare_methods
from jaxspace.dispersion.covariance import sampled
from jaxspace.dispersion.rare import rare_event
from jaxspace.dispersion.sensitivity import sobol_indices
from jaxspace.io.reports.campaign import comparison_table, moments_report
from jaxspace.simulation import Mission, Phase
from jaxspace.statistics.sample_check import warning_of

DURATION = 3.0


class Point(eqx.Module):
    x: Scalar
    v: Scalar


@final
class StraightLine(AbstractClosedForm):
    """x grows by v t."""

    def flow(self, duration, y):
        return Point(y.x + duration * y.v, y.v)


@final
class Drift(AbstractSystem):
    """x' = v: in closed form, so that only the statistics are on trial."""

    def vector_field(self, t, y):
        return Point(y.v, jnp.zeros_like(y.v))

    def invariants(self, t, y):
        return {"v": y.v}

    def closed_form(self):
        return StraightLine()


def build(samples):
    return Mission([Phase(Drift(), DURATION)]), Point(samples["x0"], samples["v0"])


def outputs(result, samples):
    x, v = result.final.x, samples["v0"]
    return {
        "x": x,
        "square": x * x,
        "product": samples["x0"] * v,
        "radius": jnp.hypot(samples["x0"], v),
    }


NORMALS = Campaign(build, {"x0": Normal(1.0, 2.0), "v0": Normal(-1.0, 0.5)}, outputs)
CENTRED = Campaign(build, {"x0": Normal(0.0, 1.0), "v0": Normal(0.0, 1.0)}, outputs)
MEAN, VARIANCE = 1.0 - 3.0, 4.0 + 9.0 * 0.25  # of x = x0 + 3 v0
# The quantiles of a normal law at even shares: mean 0, deviation 1 to 0.3 %.
NORMAL_VALUES = norm.ppf((np.arange(1000) + 0.5) / 1000)
LIMIT = MEAN - 2.0 * np.sqrt(VARIANCE)


# Curved outputs are here to be computed, and those of the linear method to be wrong.
CURVED = pytest.mark.filterwarnings("ignore:.* is not reliable for")
# Up to JAX 0.10 the second derivatives of hypot are zero where both sides are alike, as here.
NO_RADIUS = pytest.mark.filterwarnings("ignore:second_order omits radius")


@NO_RADIUS
@CURVED
@pytest.mark.parametrize("method", ["lincov", "second_order", "unscented"])
def test_moments_of_a_linear_output_are_exact(method):
    found = moments(NORMALS, method)
    k = found.names.index("x")
    assert found.mean[k] == pytest.approx(MEAN, rel=1e-12)
    assert found.std("x") == pytest.approx(np.sqrt(VARIANCE), rel=1e-12)
    if found.jacobian is not None:
        np.testing.assert_allclose(found.jacobian[k], [1.0, 3.0], rtol=1e-12)


@NO_RADIUS
@CURVED
def test_second_order_is_exact_for_squares_and_products():
    """Of a normal x: E[x^2] = m^2 + s^2, V[x^2] = 2 s^4 + 4 m^2 s^2; E[x0 v0] = m_1 m_2, V = s_1^2
    s_2^2 + m_1^2 s_2^2 + m_2^2 s_1^2. The linear method knows neither shift nor product."""
    second, first = moments(NORMALS, "second_order"), moments(NORMALS)
    square, product = (second.names.index(n) for n in ("square", "product"))
    assert second.mean[square] == pytest.approx(MEAN**2 + VARIANCE, rel=1e-12)
    variance = 2.0 * VARIANCE**2 + 4.0 * MEAN**2 * VARIANCE
    assert second.std("square") ** 2 == pytest.approx(variance, rel=1e-12)
    assert second.mean[product] == pytest.approx(-1.0, rel=1e-12)
    assert second.std("product") ** 2 == pytest.approx(1.0 + 0.25 + 4.0, rel=1e-12)
    # Cov(x0 + 3 v0, x0 v0) = m_2 s_1^2 + 3 m_1 s_2^2.
    assert second.covariance[second.names.index("x"), product] == pytest.approx(-4.0 + 0.75)
    assert first.mean[square] == pytest.approx(MEAN**2, rel=1e-12)
    # The sigma points see the mean of a square exactly.
    assert moments(NORMALS, "unscented").mean[square] == pytest.approx(MEAN**2 + VARIANCE)


def folded(result, samples):
    """Smooth ones, and two that are not at the mean: |x0|, whose derivatives at zero JAX takes as
    those of one side, and the length of a vector that is zero there, whose are not finite."""
    x0, v0 = samples["x0"], samples["v0"]
    smooth = {"x": result.final.x, "bent": 1e3 * jnp.cos(x0) + v0**3, "none": 0.0 * x0}
    return smooth | {"size": jnp.abs(x0), "length": jnp.sqrt(x0**2 + v0**2)}


@CURVED
def test_second_order_leaves_out_what_is_not_smooth():
    campaign = Campaign(build, {"x0": Normal(0.0, 0.3), "v0": Normal(0.0, 2.0)}, folded)
    with pytest.warns(UserWarning, match="omits length, size: not smooth"):
        found = moments(campaign, "second_order")
    there = dict(zip(found.names, np.isfinite(found.mean), strict=True))
    assert there == {"x": True, "bent": True, "none": True, "size": False, "length": False}
    assert found.std("x") == pytest.approx(np.sqrt(0.09 + 36.0), rel=1e-12)
    assert np.isnan(found.std("size")) and np.isnan(found.std("length"))
    for name in ("size", "length"):
        assert "not smooth at the nominal run: 256 runs have the mean" in found.warnings[name]
    assert not {"x", "none"} & set(found.warnings)
    # To second order the mean of 1000 cos x is 1000 (1 - s^2/2).
    assert found.mean[found.names.index("bent")] == pytest.approx(1e3 * (1.0 - 0.045), rel=1e-12)


def spun(result, samples):
    """What a stage does that turns by ten radians for one deviation of an input: linear, the sine
    and the cosine of the turn; a turn that hardly scatters; and the size of a vector."""
    x0, v0 = samples["x0"], samples["v0"]
    turns = {"sine": jnp.sin(10.0 * x0), "cosine": jnp.cos(10.0 * x0), "calm": jnp.sin(0.1 * x0)}
    return {"x": result.final.x, **turns, "none": 0.0 * x0, "size": jnp.sqrt(x0**2 + v0**2 + 1e-6)}


SPUN = Campaign(build, {"x0": Normal(0.0, 1.0), "v0": Normal(0.0, 1.0)}, spun)


@pytest.mark.filterwarnings("ignore:second_order omits size")
@pytest.mark.parametrize(
    "method, off",
    [
        ("lincov", {"sine", "cosine", "size"}),
        ("second_order", {"sine", "cosine", "size"}),
        ("unscented", {"sine", "cosine"}),
    ],
)
def test_a_method_that_leaves_its_range_says_so(method, off):
    """Mean and deviation of sin(10 x) are 0 and 1/sqrt(2) to e^-50, its series has the deviation
    10; the mean of cos(10 x) is 0, its series has 1 - 50."""
    with pytest.warns(UserWarning, match=f"{method} is not reliable for cosine, sine"):
        found = moments(SPUN, method)
    if method == "second_order":
        assert found.mean[found.names.index("cosine")] == pytest.approx(-49.0, rel=1e-12)
    assert off <= set(found.warnings) and not {"x", "calm", "none"} & set(found.warnings)
    assert "256 runs have the mean" in found.warnings["cosine"]
    table = moments_report("A spin", found, {}, {n: (0.0, "") for n in found.names})
    marked = {line.split()[0] for line in table.splitlines() if line.endswith("warning")}
    assert marked == set(found.warnings) and "nan" not in table
    assert "warning: cosine: 256 runs have the mean" in table
    assert not moments(SPUN, method, check=0).warnings


def test_the_sample_is_as_large_as_it_must_be():
    with pytest.raises(InputError, match="check is 5: it must be 0, or at least 32"):
        moments(SPUN, check=5)


@pytest.mark.parametrize(
    "mean, std, x, words",
    [
        # Of a thousand values that are normal but for rounding: 4/sqrt(1000) = 0.13 deviations.
        (0.1, 1.0, NORMAL_VALUES, ""),
        (0.15, 1.0, NORMAL_VALUES, "off by .0.15 standard deviations and .0 %"),
        (0.0, 0.8, NORMAL_VALUES, "off by .* and -20 %"),
        (np.nan, np.nan, NORMAL_VALUES, "not smooth at the nominal run"),
        (0.0, 1.0, np.append(NORMAL_VALUES, np.nan), "1 of 1001 runs fail"),
        (3.0, 0.0, np.full(9, 3.0), ""),
        (3.0, 0.5, np.full(9, 3.0), "no dispersion"),
        (3.0, 0.5, np.zeros(0), ""),
    ],
)
def test_what_a_sample_says(mean, std, x, words):
    found = warning_of(mean, std, x)
    assert re.search(words, found) if words else found == ""


@CURVED
def test_moments_of_inputs_that_are_cut_or_correlated():
    """A normal cut at one deviation on each side has the variance 1 - 2 phi(1) / (2 Phi(1) - 1)."""
    cut = {"x0": TruncatedNormal(0.0, 1.0, -1.0, 1.0), "v0": Uniform(-1.0, 1.0)}
    variance = 1.0 - 2.0 * norm.pdf(1.0) / (2.0 * norm.cdf(1.0) - 1.0) + 9.0 / 3.0
    # The trapezoidal rule in z, whose integrand is smooth: far better than what is asked.
    assert moments(Campaign(build, cut, outputs)).std("x") ** 2 == pytest.approx(variance, rel=1e-9)
    joint = MultivariateNormal([1.0, 0.0], [[4.0, -0.9], [-0.9, 0.25]])
    together = Campaign(build, joint.inputs("x0", "v0"), outputs)
    expected = 4.0 + 9.0 * 0.25 - 6.0 * 0.9
    for method in ("lincov", "unscented"):
        assert moments(together, method).std("x") ** 2 == pytest.approx(expected, rel=1e-12)


def test_outputs_across_all_of_the_inputs():
    """Three inputs of two independent numbers each: across both directions the variance is zero,
    and by no method negative."""
    factors = np.random.default_rng(1).normal(size=(12, 3, 2))
    normals = np.cross(factors[:, :, 0], factors[:, :, 1])
    inputs = {}
    for i, a in enumerate(factors):
        joint = MultivariateNormal(np.zeros(3), a @ a.T)
        inputs |= joint.inputs(*(f"{name}{i}" for name in "abc"))

    def at_rest(samples):
        return build({"x0": 0.0 * samples["a0"], "v0": 0.0 * samples["a0"]})

    def combined(result, samples):
        return {
            f"d{i}": sum(x * samples[f"{c}{i}"] for x, c in zip(normal, "abc", strict=True))
            for i, normal in enumerate(normals)
        }

    for method in ("lincov", "unscented"):
        found = moments(Campaign(at_rest, inputs, combined), method, check=0)
        variances = np.diag(found.covariance)
        assert np.all(variances >= 0.0) and np.all(variances < 1e-13)


def test_linear_moments_of_an_uneven_cut():
    """Cut at -1 and 2 deviations: the mean is (phi(a) - phi(b)) / (Phi(b) - Phi(a)), alone and as
    a marginal of correlated inputs."""
    mean = (norm.pdf(-1.0) - norm.pdf(2.0)) / (norm.cdf(2.0) - norm.cdf(-1.0))
    cut, even = TruncatedNormal(0.0, 1.0, -1.0, 2.0), Uniform(-1.0, 1.0)
    joint = Correlated.of((cut, even), np.eye(2))
    for inputs in ({"x0": cut, "v0": even}, joint.inputs("x0", "v0")):
        found = moments(Campaign(build, inputs, outputs), check=0)
        assert found.mean[found.names.index("x")] == pytest.approx(mean, rel=1e-9)


def test_share_outside_of_joint_inputs():
    """Closed forms of the marginals, far below one in 4096."""
    joint = MultivariateNormal([1.0, 0.0], [[4.0, -0.9], [-0.9, 0.25]])
    share = joint.inputs("a", "b")["a"].outside(-np.inf, 11.0)
    assert share == pytest.approx(norm.sf(5.0), rel=1e-9)
    pair = Correlated.of((Normal(0.0, 1.0), Uniform(-1.0, 1.0)), [[1.0, 0.5], [0.5, 1.0]])
    a, b = pair.inputs("a", "b").values()
    assert a.outside(-np.inf, 6.0) == pytest.approx(norm.sf(6.0), rel=1e-9)
    assert b.outside(-np.inf, 0.999) == pytest.approx(0.0005, rel=1e-9)


def test_methods_beside_monte_carlo():
    """4000 runs know a mean to 1/sqrt(4000) = 0.016 deviations, and a deviation to 0.011; both five
    times. A magnitude about zero is where the linear method fails, and the table shows it."""
    reference = disperse(CENTRED, 4000, seed=2)
    with pytest.warns(UserWarning, match="omits radius: not smooth"):
        table = {(c.method, c.output): c for c in compare_methods(CENTRED, reference)}
    assert np.isnan(table["second_order", "radius"].std_error)
    doubted = {key for key, c in table.items() if c.warning}
    # Sigma points have the mean of a square, and not its deviation where there is no third moment.
    own = {(m, n) for m, n in doubted if m != "unscented"}
    assert own == {
        *((("lincov", n)) for n in ("square", "product", "radius")),
        ("second_order", "radius"),
    }
    shown = comparison_table(list(table.values()))
    assert "nan" not in shown and "warning: radius, second_order: It is not smooth" in shown
    assert sum(line.endswith("warning") for line in shown.splitlines()) == len(doubted)
    assert abs(table["lincov", "x"].mean_error) < 0.08
    assert abs(table["lincov", "x"].std_error) < 0.06
    # E[x^2] = s^2 and V = 2 s^4: the shift is 0.71 deviations, and the linear one sees none of it.
    assert table["lincov", "square"].mean_error == pytest.approx(-np.sqrt(0.5), abs=0.08)
    assert abs(table["second_order", "square"].mean_error) < 0.08
    assert table["lincov", "x"].runs == 1 and table["unscented", "x"].runs == 5


def test_rare_event_of_known_probability():
    """x = x0 + 3 v0 is normal: P(x > m + 4.7534 s) = 1e-6. Of 100 plain campaigns of
    10 000 runs 99 see none."""
    limit = MEAN + norm.isf(1e-6) * np.sqrt(VARIANCE)
    found = rare_event(NORMALS, "x", above=limit, runs=10000, seed=1)
    # The wide search for further regions takes some of the runs: the variation is 0.032.
    assert found.low < 1e-6 < found.high and found.variation < 0.04
    # Five standard errors.
    assert found.value == pytest.approx(1e-6, rel=5.0 * found.variation)
    # The search for design points adds its runs with derivatives.
    assert 10000 <= found.runs <= 10100 and found.failed == 0
    distance = np.linalg.norm(found.points, axis=1)
    np.testing.assert_allclose(distance, norm.isf(1e-6), rtol=1e-3)
    below = rare_event(NORMALS, "x", below=2.0 * MEAN - limit, runs=2000, seed=2)
    assert below.value == pytest.approx(1e-6, rel=5.0 * below.variation)


def test_rare_event_with_two_nearest_points():
    """|x| > k s happens on both sides: twice the probability of one."""
    limit = norm.isf(5e-6) ** 2 * 10.0
    found = rare_event(CENTRED, "square", above=limit, runs=4000, seed=3)
    assert len(found.points) == 2
    assert found.value == pytest.approx(1e-5, rel=5.0 * found.variation)
    # 0.065, because the wide search takes some of the runs.
    assert found.variation < 0.08


def test_subset_simulation_where_no_point_is_nearest():
    """P(sqrt(x0^2 + v0^2) > r) = exp(-r^2/2): a whole circle of nearest points. The interval of one
    run holds it in 19 of 20 cases; here it is asked of the mean of four, whose error is half."""
    r = np.sqrt(2.0 * np.log(1e6))
    found = [
        rare_event(CENTRED, "radius", above=r, runs=10000, method="subset", seed=s)
        for s in range(4)
    ]
    logs = np.log([f.value for f in found])
    assert abs(logs.mean() - np.log(1e-6)) < 5.0 * 0.5 * found[0].variation
    assert all(f.variation < 0.6 and f.runs < 12000 for f in found)
    # The stated variation is that which four repetitions show, to the factor that four can tell.
    assert logs.std(ddof=1) < 3.0 * found[0].variation


def test_rare_event_names_what_is_wrong():
    with pytest.raises(InputError, match="exactly one"):
        rare_event(NORMALS, "x")
    with pytest.raises(InputError, match="importance or subset"):
        rare_event(NORMALS, "x", above=1.0, method="luck")
    with pytest.raises(InputError, match="No violation was found"):
        rare_event(
            Campaign(build, {"x0": Constant(0.0), "v0": Constant(1.0)}, outputs), "x", above=9.0
        )
    with pytest.raises(InputError, match="lincov, second_order, unscented"):
        moments(NORMALS, "guess")
    with pytest.raises(InputError, match="output is 'radios': it must be .* Did you mean radius?"):
        rare_event(NORMALS, "radios", above=1.0)
    for wrong in ({"runs": True}, {"runs": 1}, {"seed": -1}, {"seed": True}):
        (name,) = wrong
        with pytest.raises(InputError, match=f"{name} is .*: it must be a whole number"):
            rare_event(NORMALS, "x", above=1.0, **wrong)


def unbounded(result, samples):
    """x, which is infinite where it lies three deviations above the limit of the test."""
    x = result.final.x
    return {"x": jnp.where(x > LIMIT + 3.0 * np.sqrt(VARIANCE), jnp.inf, x)}


@pytest.mark.parametrize("method", ["importance", "subset"])
def test_rare_event_below_a_limit_of_what_may_be_infinite(method):
    """An infinite value lies above the limit: P(x < m - 2 s) is that of a normal law."""
    found = rare_event(
        Campaign(build, NORMALS.inputs, unbounded),
        "x",
        below=LIMIT,
        runs=4000,
        method=method,
        seed=4,
    )
    assert found.value == pytest.approx(norm.sf(2.0), rel=5.0 * found.variation)
    assert found.variation < 0.3


def test_sobol_indices_of_a_sum_and_a_product():
    """Of x: first order and total are 4/6.25 and 2.25/6.25. Of x0 v0 about zero each input alone
    does nothing, and both together everything. Five standard errors, as estimated."""
    found = sobol_indices(NORMALS, 1024).indices["x"]
    for name, expected in (("x0", 4.0 / 6.25), ("v0", 2.25 / 6.25)):
        index = found[name]
        assert abs(index.first - expected) < 5.0 * index.first_error + 1e-3
        assert abs(index.total - expected) < 5.0 * index.total_error + 1e-3
        assert index.total_error < 0.05
    product = sobol_indices(CENTRED, 1024)
    for index in product.indices["product"].values():
        assert abs(index.first) < 5.0 * index.first_error
        assert abs(index.total - 1.0) < 5.0 * index.total_error
    assert product.runs == 4 * 1024 and product.failed == 0
    with pytest.raises(InputError, match="power of two"):
        sobol_indices(NORMALS, 100)


def seldom(result, samples):
    """x = x0 + 3 v0, infinite where x0 lies 2.9 deviations above its mean, in one run of 540; the
    same nowhere infinite; a constant that rounds; and one that is a number in no run."""
    x0, x = samples["x0"], result.final.x
    constant = (0.1 + 1e-17 * x0) * jnp.ones_like(x)
    infinite = jnp.where(x0 > 1.0 + 2.9 * 2.0, jnp.inf, x)
    return {"x": x, "seldom": infinite, "constant": constant, "never": jnp.nan * x}


def test_sobol_indices_leave_out_what_is_not_finite():
    """Without the points at which it is infinite, which change the indices by less than 1 %."""
    found = sobol_indices(Campaign(build, NORMALS.inputs, seldom), 1024)
    lost = found.left_out
    assert lost["x"] == 0 and 1 <= lost["seldom"] <= 12 and lost["never"] == 1024
    assert found.failed == found.runs
    for name, expected in (("x0", 4.0 / 6.25), ("v0", 2.25 / 6.25)):
        for output in ("x", "seldom"):
            index = found.indices[output][name]
            assert abs(index.first - expected) < 5.0 * index.first_error + 0.01
            assert abs(index.total - expected) < 5.0 * index.total_error + 0.01
        assert found.indices["constant"][name] == (0.0, 0.0, 0.0, 0.0)
        assert np.isnan(found.indices["never"][name]).all()


def test_sobol_indices_of_too_many_inputs():
    many = MultivariateNormal.from_factor(np.zeros(2), np.ones((2, 10601)))
    with pytest.raises(InputError, match="Sobol points with 21202 dimensions are required"):
        sobol_indices(Campaign(build, many.inputs("x0", "v0"), outputs), 2)


def test_moments_of_inputs_that_move_in_steps():
    """Of a list the variance is sum(w v^2) / sum(w) - mean^2, however rare a value: here of one
    that has no place among 2001 even numbers from -8.5 to 8.5. A sigma point may be infinite."""
    seldom = Discrete(np.array([-1.0, 30.0, 1.0]), np.array([0.5, 1e-4, 0.5]))
    campaign = Campaign(build, {"x0": seldom, "v0": Constant(0.0)}, outputs)
    mean = 30.0 * 1e-4 / 1.0001
    variance = (1.0 + 900.0 * 1e-4) / 1.0001 - mean**2
    assert moments(campaign, check=0).std("x") ** 2 == pytest.approx(variance, rel=1e-12)
    edge = Campaign(
        build, CENTRED.inputs, lambda r, s: {"x": 1.0 / jnp.maximum(1.0 - r.final.x, 0.0)}
    )
    with pytest.warns(UserWarning, match="unscented omits x: not finite at a sigma point"):
        assert np.isnan(moments(edge, "unscented", check=0).std("x"))


@final
class HardSpring(AbstractSystem):
    """x'' = -x - c x^3, which has to be integrated."""

    c: Scalar

    def vector_field(self, t, y):
        return Point(y.v, -y.x - self.c * y.x**3)

    def invariants(self, t, y):
        return {}


@final
class Kick(eqx.Module):
    """v grows by a given speed."""

    speed: Scalar

    def __call__(self, t, y):
        return Point(y.x, y.v + self.speed)


@jax.jit
def scatter_of(design):
    """Mean and deviation of the end of a mission of two phases, with the stiffness and the kick
    between them as parameters of its design."""

    def swings(samples):
        spring = HardSpring(design[0])
        phases = [Phase(spring, 1.0, Kick(design[1]), "before"), Phase(spring, 2.0, name="after")]
        return Mission(phases), Point(samples["x0"], samples["v0"])

    inputs = {"x0": Normal(1.0, 0.2), "v0": Normal(0.5, 0.1)}
    x = sampled(Campaign(swings, inputs, outputs), 64, accuracy=1e-11)["x"]
    return jnp.stack([jnp.mean(x), jnp.std(x)])


def test_gradient_of_a_statistic_of_an_integrated_mission():
    """By parameters of the design, with the draws fixed: against central differences of the
    fourth order, whose own errors are some 60 h^4 (6e-7 at four times this h) and 1e-11 over h."""
    design, h = jnp.array([0.4, -0.3]), 2.5e-3
    found = jax.jit(jax.jacrev(scatter_of))(design)
    for k in range(2):
        step = h * jnp.eye(2)[k]
        near, far = (scatter_of(design + s * step) - scatter_of(design - s * step) for s in (1, 2))
        expected = (8.0 * near - far) / (12.0 * h)
        np.testing.assert_allclose(found[:, k], expected, rtol=0.0, atol=1e-7)
        assert np.abs(expected).min() > 1e-2


def test_gradient_of_a_statistic_in_a_parameter():
    """With the draws fixed the deviation of x = x0 + 3 v0 is that of a normal sample: its slope
    in the deviation s_1 of x0 is cov(x, z_1)/std(x), with the same numbers z_1."""

    def deviation(s):
        inputs = {"x0": Normal(1.0, s), "v0": Normal(-1.0, 0.5)}
        return jnp.std(sampled(Campaign(build, inputs, outputs), 256)["x"])

    slope = jax.grad(deviation)(2.0)
    drawn = NORMALS.samples(jax.random.key(0), jnp.arange(256))
    z = (np.asarray(drawn["x0"]) - 1.0) / 2.0
    x = np.asarray(drawn["x0"] + 3.0 * drawn["v0"])
    expected = np.mean((x - x.mean()) * (z - z.mean())) / x.std()
    assert float(slope) == pytest.approx(expected, rel=1e-12)
    difference = (deviation(2.0 + 1e-5) - deviation(2.0 - 1e-5)) / 2e-5
    assert float(slope) == pytest.approx(float(difference), rel=1e-7)
