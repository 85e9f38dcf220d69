"""Statistics of finite samples, against closed forms and by counting how often intervals hold."""

import numpy as np
import pytest
import scipy.stats

from jaxspace.core import InputError
from jaxspace.dispersion import (
    Dispersion,
    StopRule,
    circular_error,
    clopper_pearson,
    convergence,
    ellipsoid,
    percentile,
    rank_correlation,
    runs_for,
)
from jaxspace.dispersion._rounding import rounded, scatters
from jaxspace.simulation import Status


def dispersion(n=4000, seed=1, **outputs):
    r = np.random.default_rng(seed)
    inputs = {"a": r.standard_normal(n), "b": r.standard_normal(n)}
    status = np.zeros(n, int)
    status[3] = Status.NOT_FINITE
    return Dispersion(inputs, outputs, status, np.ones(n, int), {"x": "m", "a": "km"}, 0)


def test_interval_of_a_percentile_holds_it():
    """95 % of intervals, or more, hold the percentile; of 2000 samples the share scatters by half a
    percent. The ends are order statistics, which SciPy finds as well."""
    draws = np.random.default_rng(5).exponential(size=(2000, 300))
    true = -np.log(1.0 - 0.9)
    found = [percentile(x, 0.9) for x in draws]
    held = np.mean([p.low <= true <= p.high for p in found])
    assert 0.945 < held < 0.985
    one = scipy.stats.quantile_test(draws[0], p=0.9).confidence_interval(0.95)
    assert (found[0].low, found[0].high) == pytest.approx((one.low, one.high))
    few = percentile(draws[0][:50], 0.99)
    assert few.high == np.inf and np.isfinite(few.low)
    # 299 runs: the greatest one bounds 99 % of all with 95 % confidence (Wilks).
    assert runs_for(0.99) == 299 and runs_for(0.95) == 59
    with pytest.raises(InputError, match="share"):
        percentile(draws[0], 1.0)


def test_clopper_and_pearson():
    """Against SciPy's; and the rule of three, 1 - 0.025^(1/n), for no violation at all."""
    for k, n in ((0, 50), (3, 50), (50, 50), (17, 10000)):
        found = clopper_pearson(k, n)
        expected = scipy.stats.binomtest(k, n).proportion_ci(0.95, "exact")
        assert (found.low, found.high) == pytest.approx((expected.low, expected.high), rel=1e-10)
    assert clopper_pearson(0, 1000).high == pytest.approx(1.0 - 0.025 ** (1.0 / 1000.0))
    with pytest.raises(InputError, match="count"):
        clopper_pearson(3, 2)


def test_failed_runs_count_as_violations_and_in_no_mean():
    x = np.arange(4000.0)
    x[3] = np.nan
    d = dispersion(x=x)
    found = d.violation("x", at_most=3989.0)
    assert found.count == 11 and found.runs == 4000  # ten above, one failed
    assert d.violation("x", at_least=1.0).count == 2
    assert np.all(np.isfinite(d.covariance("x", "a")))
    assert d.covariance("x").shape == (1, 1)
    assert d.covariance("x")[0, 0] == pytest.approx(np.var(np.delete(x, 3), ddof=1))
    assert d.percentile("x", 0.5).value == pytest.approx(np.median(np.delete(x, 3)))
    with pytest.raises(InputError, match="at_least and at_most"):
        d.violation("x")


def test_ellipsoids():
    """The semi-axes of a known covariance, km against mm, and the share inside of 200 000 runs of a
    normal law to five standard errors."""
    r = np.random.default_rng(2)
    z = r.standard_normal((2, 200000))
    factor = np.array([[1e3, 0.0], [0.5e-3, 1e-3]])
    found = ellipsoid(factor @ z, 0.9)
    assert found.inside == pytest.approx(0.9, abs=5.0 * np.sqrt(0.09 / 200000))
    k2 = scipy.stats.chi2.ppf(0.9, 2)
    c = factor @ factor.T
    # The outline lies where (y - m)^T C^-1 (y - m) = k^2; a variance of the sample to 1 %.
    y = found.outline() - found.centre[:, None]
    np.testing.assert_allclose(np.sum(y * np.linalg.solve(c, y), axis=0), k2, rtol=0.03)
    axes = np.sort(np.linalg.norm(found.axes, axis=0)) ** 2 / k2
    expected = np.array([np.linalg.det(c) / np.trace(c), np.trace(c)])
    np.testing.assert_allclose(axes, expected, rtol=0.03)
    three = ellipsoid(r.standard_normal((3, 50000)), 0.99)
    assert three.axes.shape == (3, 3)
    assert three.inside == pytest.approx(0.99, abs=5.0 * np.sqrt(0.0099 / 50000))


def test_circular_error_probable():
    """Of a round normal law it is sqrt(2 ln 2) deviations: 1.1774."""
    x, y = np.random.default_rng(4).standard_normal((2, 100000))
    found = circular_error(x, y, (0.0, 0.0))
    assert found.low < np.sqrt(2.0 * np.log(2.0)) < found.high
    assert found.high - found.low < 0.02


def test_convergence_and_the_stop_rule():
    x = 1e6 + np.random.default_rng(6).standard_normal(20000)
    found = convergence(x)
    assert found.runs[0] == 10 and found.runs[-1] == 20000
    for k in (3, -1):
        n = found.runs[k]
        assert found.mean[k] == pytest.approx(x[:n].mean(), rel=1e-14)
        assert found.std[k] == pytest.approx(x[:n].std(ddof=1), rel=1e-9)
        assert found.limit[k] == np.quantile(x[:n], 0.99)
    # The 99 % limit of a normal law, 2.3263 s above the mean, has the standard error
    # sqrt(p q / n) / phi(2.3263), 3.73 / sqrt(n): of half an interval of 95 %, 7.3 / sqrt(n).
    rule = StopRule("x", 0.99, 0.01)
    assert rule.error(x) == pytest.approx(1.96 * 3.733 / np.sqrt(20000) / 2.3263, rel=0.25)
    assert not rule.met(x) and StopRule("x", 0.99, 0.05).met(x)
    assert rule.more(x) == pytest.approx(20000 * (rule.error(x) / 0.01) ** 2, abs=1)
    assert rule.error(x[:50]) == np.inf and rule.more(x[:50]) == 0
    assert StopRule("x").met(np.ones(500))


def test_rank_correlation():
    """A law that rises has 1, however curved; the interval holds the true value, which for a normal
    pair of correlation r is 6/pi asin(r/2), in 95 of 100 samples."""
    r = np.random.default_rng(7)
    held, expected = 0, 6.0 / np.pi * np.arcsin(0.3)
    for _ in range(200):
        a, b = r.standard_normal((2, 100))
        found = rank_correlation(a, 0.6 * a + 0.8 * b)
        held += found.low <= expected <= found.high
    assert 180 <= held <= 199
    assert found.value == pytest.approx(scipy.stats.spearmanr(a, 0.6 * a + 0.8 * b)[0])
    assert rank_correlation(a, np.exp(a)).value == pytest.approx(1.0, rel=1e-14)
    d = dispersion(x=np.zeros(4000))
    d = dispersion(x=np.exp(3.0 * d.inputs["b"]) + 0.1 * d.inputs["a"])
    assert list(d.rank_correlations("x")) == ["b", "a"]


def test_shares_add_up_to_what_is_explained():
    """Also with products, which the inputs one by one do not explain: V = 1 + 1/4 + 1/4."""
    d = dispersion(x=np.zeros(4000))
    a, b = d.inputs["a"], d.inputs["b"]
    found = dispersion(x=a + 0.5 * b + 0.5 * a * b).contributors("x")
    assert sum(found.shares.values()) == pytest.approx(found.r_squared, rel=1e-12)
    # 4000 runs know a share to 0.02; five times.
    assert found.r_squared == pytest.approx(1.25 / 1.5, abs=0.05)


def test_rounding_has_no_contributors():
    """Constant but for some units of rounding: nothing scatters. Noise of its own: no input
    explains it."""
    noise = np.random.default_rng(8).standard_normal(4000)
    constant = dispersion(x=1234.5 + 1e-12 * np.round(noise))
    assert np.ptp(constant.outputs["x"]) > 0.0
    assert constant.contributors("x").shares == {}
    own = dispersion(x=5e-11 * noise).contributors("x")
    assert own.shares == {} and own.r_squared < 0.01
    assert not scatters(np.ones(5)) and scatters(np.array([1.0, 1.0 + 1e-9]))


@pytest.mark.parametrize(
    "value, deviation, text",
    [
        (84795.2, 1953.0, "84795"),
        (1953.0, 1953.0, "1953"),
        (184.9991, 0.0592, "184.9991"),
        (7e-13, 3.1e-3, "0"),
        (-0.0001, 3.0, "0"),
        (1.23e-9, 2e-10, "1.230e-09"),
        (1234.5, 5e-13, "1234.5"),
        (0.5, 0.0, "0.5"),
        (np.inf, 1.0, "∞"),
        (np.nan, 1.0, "none"),
    ],
)
def test_one_rule_for_digits(value, deviation, text):
    assert rounded(value, deviation) == text


def test_tables_for_other_programs(tmp_path):
    pandas = pytest.importorskip("pandas")
    d = dispersion(x=np.arange(4000.0) / 3.0)
    d.to_csv(tmp_path / "d.csv")
    back = pandas.read_csv(tmp_path / "d.csv", index_col="run")
    assert list(back.columns) == ["status", "a [km]", "b", "x [m]"]
    assert back["status"][3] == "NOT_FINITE" and back["status"][4] == "COMPLETED"
    # A table of text has all digits.
    np.testing.assert_array_equal(back["x [m]"], d.outputs["x"])
    d.to_parquet(tmp_path / "d.parquet")
    assert pandas.read_parquet(tmp_path / "d.parquet").equals(back)
