"""Statistics of finite samples, against closed forms and by counting how often intervals hold."""

from types import SimpleNamespace

import equinox as eqx
import numpy as np
import pytest
import scipy.stats

from jaxspace.core import InputError
from jaxspace.dispersion import Dispersion, StopRule
from jaxspace.io.reports.campaign_tables import contributor_lines, dispersion_report
from jaxspace.plots import dispersion_figure, dispersion_page
from jaxspace.simulation import Status
from jaxspace.statistics import contributors as _contributors
from jaxspace.statistics._rounding import rounded, scatters
from jaxspace.statistics.correlation import rank_correlation
from jaxspace.statistics.limits import clopper_pearson, percentile, quantile, runs_for
from jaxspace.statistics.spread import circular_error, convergence, ellipsoid


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


def with_infinite(n=4000):
    """A normal sample of which 15 % are infinite, two of them downwards, and three no number."""
    x = np.random.default_rng(9).standard_normal(n)
    x[5 : 5 + int(0.15 * n)] = np.inf
    x[[5, 6]], x[[1000, 2000, 3000]] = -np.inf, np.nan
    return x


def test_infinite_values_count_in_percentiles():
    """As very large numbers do, whose percentiles NumPy and SciPy know."""
    x = with_infinite()
    large = np.clip(x, -1e300, 1e300)
    large = large[~np.isnan(large)]
    for share in (0.01, 0.3, 0.5, 0.84, 0.86, 0.99):
        found = percentile(x, share)
        expected = scipy.stats.quantile_test(large, p=share).confidence_interval(0.95)
        for a, b in (
            (found.value, np.quantile(large, share)),
            (found.low, expected.low),
            (found.high, expected.high),
        ):
            assert a == pytest.approx(b, rel=1e-14) if abs(b) < 1e299 else a == np.sign(b) * np.inf
    assert percentile(x, 0.95).value == percentile(x, 0.95).low == np.inf
    assert percentile(np.full(9, np.inf), 0.5).value == np.inf
    with pytest.raises(InputError, match="requires at least one number"):
        percentile([np.nan], 0.5)


def test_a_quantile_between_finite_and_infinite_values():
    some = np.array([1.0, 2.0, np.inf])
    shares = (0.0, 0.25, 0.5, 0.51, 1.0)
    assert [quantile(some, s) for s in shares] == [1.0, 1.5, 2.0, np.inf, np.inf]
    assert [quantile(-some, s) for s in shares] == [-np.inf, -np.inf, -2.0, -1.98, -1.0]
    both = np.array([-np.inf, np.inf])
    assert [quantile(both, s) for s in (0.4, 0.6)] == [-np.inf, np.inf]
    # Of finite values NumPy's, to the bit.
    x = np.random.default_rng(10).standard_normal(1000)
    assert all(quantile(x, s) == np.quantile(x, s) for s in np.linspace(0.0, 1.0, 57))


def test_means_leave_infinite_values_out_and_say_so():
    d = dispersion(x=with_infinite())
    (row,) = d.table()
    assert (row.runs, row.above, row.below, row.undefined) == (3396, 598, 2, 3)
    finite = d.outputs["x"][np.isfinite(d.outputs["x"])]
    # One run has failed, and is in nothing.
    finite = np.delete(finite, 3)
    assert row.mean == np.mean(finite) and row.std == np.std(finite, ddof=1)
    assert row.high == row.max == np.inf and row.min == -np.inf and np.isfinite(row.low)
    (told,) = d.warnings
    assert "x is ∞ in 598, -∞ in 2, not a number in 3 of 3999 successful runs" in told
    assert "exclude them, limits count the infinite ones" in told
    for statistic in (d.covariance, d.ellipsoid):
        with pytest.warns(UserWarning, match="603 of 3999 successful runs are omitted: x, a must"):
            statistic("x", "a")
    assert d.percentile("x", 0.95).value == np.inf
    assert d.violation("x", at_most=1e9).count == 598 + 3 + 1
    assert d.violation("x", at_least=-1e9).count == 2 + 3 + 1
    assert dispersion(x=np.zeros(4000)).warnings == ()
    lost = dispersion(x=np.full(4000, np.nan))
    assert (
        lost.table()[0].undefined == 3999
        and "They are excluded from all statistics" in lost.warnings[0]
    )
    far = dispersion(x=np.full(4000, np.inf)).table()[0]
    assert far.low == far.high == np.inf and np.isnan(far.mean) and np.isnan(far.std)


def test_infinite_values_in_ranks_radii_and_convergence():
    x = with_infinite()
    d = dispersion(x=x)
    # Of a law that rises everywhere it is 1 up to infinity.
    rising = np.where(d.inputs["a"] > 1.0, np.inf, d.inputs["a"])
    found = dispersion(x=rising).rank_correlations("x")["a"]
    ties = scipy.stats.spearmanr(*(np.delete(v, 3) for v in (d.inputs["a"], rising)))[0]
    assert found.value == pytest.approx(ties, rel=1e-12) and found.value > 0.99
    assert circular_error(x, np.zeros(4000), (0.0, 0.0), 0.9).value == np.inf
    middle = circular_error(x, np.zeros(4000), share=0.5)
    assert np.isfinite(middle.value)
    path = convergence(x, 0.95)
    assert path.runs[-1] == 3997 and path.limit[-1] == np.inf
    finite = x[np.isfinite(x)]
    assert path.mean[-1] == pytest.approx(np.mean(finite), rel=1e-10)
    assert path.std[-1] == pytest.approx(np.std(finite, ddof=1), rel=1e-10)
    assert np.isnan(convergence(np.r_[np.full(20, np.inf), 1.0, 2.0]).mean[0])


def test_a_stop_rule_waits_for_a_limit_that_is_infinite():
    """The finite runs alone would know their limit of 95 % well enough."""
    x = with_infinite(40000)
    rule = StopRule("x", 0.95, 0.2)
    assert rule.met(x[np.isfinite(x)])
    assert rule.error(x) == np.inf and not rule.met(x) and rule.more(x) == 0
    assert not StopRule("x", 0.5, 0.2).met(np.full(500, np.inf))
    # A limit below all that is infinite is known.
    assert StopRule("x", 0.1, 0.2).met(x)


def test_a_part_of_the_planned_runs_says_so():
    def of(runs, **attributes):
        x = {"x": np.arange(float(runs))}
        ones = np.ones(runs, int)
        return Dispersion(x, x, 0 * ones, ones, {}, 0, 1.0, attributes, store="out/a.zarr")

    part = of(1488, planned_runs=2000, scene_file="a.toml")
    sentence = "1488 of 2000 planned runs are in the store: `jaxspace resume out/a.zarr` computes"
    assert part.missing_runs.startswith(sentence) and part.warnings == (part.missing_runs,)
    assert "`disperse(..., resume=True)` computes" in of(1488, planned_runs=2000).missing_runs
    # Whole, of unknown size, and ended by its rule.
    for whole in (of(20, planned_runs=20), of(20), of(20, planned_runs=90, enough_runs=20)):
        assert whole.missing_runs == "" and whole.warnings == ()
    assert "5 of 20 planned" in of(5, planned_runs=90, enough_runs=20).missing_runs


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


def test_text_of_a_stopping_rule_has_ordinal_numbers():
    shares = {
        0.005: "0.5th",
        0.11: "11th",
        0.51: "51st",
        0.52: "52nd",
        0.93: "93rd",
        0.975: "97.5th",
    }
    for share, ordinal in shares.items():
        text = StopRule("x", share, 0.02).text()
        assert text == f"until the {ordinal} percentile of x is known to 2 %"


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


def test_inputs_that_depend_on_each_other_share_together():
    """y = 2 a - b + c, where b is 0.9 a and a rest, and d depends on c^2: the pair has the variance
    of 2 a - b, which is (2 - 0.9)^2 + 0.19, and c and d all that c^2 leaves. Alone b would have
    0.9 (0.9 - 2 0.9) < 0."""
    r = np.random.default_rng(11)
    a, c, rest, noise = r.standard_normal((4, 20000))
    b = 0.9 * a + np.sqrt(0.19) * rest
    inputs = {"a": a, "b": b, "c": c, "d": c**2 + noise}
    y = 2.0 * a - b + c
    found = _contributors.contributors("y", inputs, y, np.ones(y.size, bool))
    pair = 1.1**2 + 0.19
    assert set(found.shares) == {"a + b", "c + d"}
    # 20,000 runs know a share to 0.01.
    assert found.shares["a + b"] == pytest.approx(pair / (pair + 1.0), abs=0.03)
    assert found.shares["c + d"] == pytest.approx(1.0 / (pair + 1.0), abs=0.03)
    assert sum(found.shares.values()) == pytest.approx(found.r_squared, rel=1e-12)


def test_the_table_says_what_no_input_explains():
    """Of V = a^2 + b^2/4 + a^2 b^2/4 the product is 1/6; with one input listed b is 1/6, too. What
    is left is beside the shares, as on the page."""
    d = dispersion(x=np.zeros(4000))
    a, b = d.inputs["a"], d.inputs["b"]
    a, b = (a - a.mean()) / a.std(), (b - b.mean()) / b.std()
    d = dispersion(x=a + 0.5 * b + 0.5 * a * b, y=a)
    found = d.contributors("x", None)
    rest = f"interactions and nonlinear terms {100.0 * (1.0 - found.r_squared):.0f} %"
    shares = [f"{name} {100.0 * share:.0f} %" for name, share in found.shares.items()]
    x, y = contributor_lines(d).splitlines()
    assert x == f"x  {', '.join([*shares, rest])}" and y == "y  a 100 %"
    others = f"other inputs {100.0 * found.shares['b']:.0f} %"
    assert contributor_lines(d, 1).splitlines()[0] == f"x  {shares[0]}, {others}, {rest}"
    assert f"\n{x}\n" in dispersion_report(d, {})


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
    # From 3.1 on, which warns of the option, the one reader of pandas rounds correctly.
    older = tuple(map(int, pandas.__version__.split(".")[:2])) < (3, 1)
    rounding = {"float_precision": "round_trip"} if older else {}
    back = pandas.read_csv(tmp_path / "d.csv", index_col="run", **rounding)
    assert list(back.columns) == ["status", "a [km]", "b", "x [m]"]
    assert back["status"][3] == "NOT_FINITE" and back["status"][4] == "COMPLETED"
    # A table of text has all digits.
    np.testing.assert_array_equal(back["x [m]"], d.outputs["x"])
    d.to_parquet(tmp_path / "d.parquet")
    assert pandas.read_parquet(tmp_path / "d.parquet").equals(back)


def test_table_figure_and_page_share_one_regression_for_each_output(tmp_path, monkeypatch):
    """Each asks for the contributors of the same outputs; one fit of an output serves them all, and
    a copy has fits of its own."""
    fits = []

    def lstsq(a, b, **options):
        fits.append(len(b))
        return np.linalg.lstsq(a, b, **options)

    monkeypatch.setattr(_contributors, "np", SimpleNamespace(**vars(np)))
    monkeypatch.setattr(_contributors.np, "linalg", SimpleNamespace(lstsq=lstsq, qr=np.linalg.qr))
    d = dispersion(400, x=np.zeros(400))
    a, b = d.inputs["a"], d.inputs["b"]
    d = dispersion(400, x=a + b, y=a - 2.0 * b, z=a * a)
    dispersion_report(d, {})
    dispersion_figure(d)
    dispersion_page(d, tmp_path / "page.html")
    # Two terms of each input.
    assert fits == [4] * 3
    assert list(d.contributors("y", 1).shares) == ["b"]
    assert list(d.contributors("y").shares) == ["b", "a"]
    other = eqx.tree_at(lambda d: d.outputs["y"], d, a + 0.1 * b)
    assert list(other.contributors("y", 1).shares) == ["a"] and len(fits) == 4


def test_one_infinite_input_hides_no_contributor():
    """Of y = 3 a + b the shares are 0.9 and 0.1; the run with an infinite input is left out."""
    a, b = np.random.default_rng(0).standard_normal((2, 4000))
    y = 3.0 * a + b
    b[7] = np.inf
    good = np.ones(4000, bool)
    found = _contributors.contributors("y", {"a": a, "b": b}, y, good)
    assert found.shares == pytest.approx({"a": 0.9, "b": 0.1}, abs=0.02)


def test_an_ellipsoid_needs_finite_values():
    x = np.random.default_rng(0).standard_normal((2, 50))
    x[1, 3] = np.nan
    with pytest.raises(InputError, match="values is not finite in 1 runs"):
        ellipsoid(x)
