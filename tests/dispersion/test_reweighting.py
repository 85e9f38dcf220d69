"""Stored runs under other distributions: densities against SciPy, statistics against closed forms
and against new draws, and what is refused."""

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.stats
from test_campaign_commands import COAST
from test_campaigns import CAMPAIGN
from unchecked import unchecked

from jaxspace.cli import _reweight, main
from jaxspace.core import InputError
from jaxspace.dispersion import (
    ConeDirection,
    Constant,
    Correlated,
    Discrete,
    Dispersion,
    Lognormal,
    MultivariateNormal,
    Normal,
    Samples,
    Triangular,
    TruncatedNormal,
    Uniform,
)
from jaxspace.dispersion.reweighting import reweight
from jaxspace.io import load
from jaxspace.sampling.densities import _by_normals, log_density
from jaxspace.statistics.weighted import WeightedDispersion, weighted

RUNS = 20000
STANDARD = dataclasses.replace(CAMPAIGN, inputs={"w": Normal(0.0, 1.0), "x0": Uniform(0.0, 1.0)})


def drawn(campaign, seed=1, runs=RUNS, required=(None, None)):
    """The runs of a campaign whose output is y = 2 w + 1, without a simulation."""
    numbers = jnp.arange(runs, dtype=jnp.uint32)
    draws = campaign.samples(jax.random.key(seed), numbers)
    inputs = {name: np.asarray(draws[name]) for name in campaign.inputs}
    record = {"inputs": campaign.text(), "requirements": {"y": required}}
    y = 2.0 * inputs["w"] + 1.0
    good = np.zeros(runs, int)
    return Dispersion(inputs, {"y": y}, good, good, {}, seed, attributes=record)


BEFORE = drawn(STANDARD, required=[None, 5.0, 0.1, 0.95])


# ----------------------------------------------------------------------------------- densities

X = np.linspace(0.1, 5.0, 41)
LOGNORMAL = scipy.stats.lognorm(np.sqrt(np.log1p(0.25)), scale=2.0 / np.sqrt(1.25))


@pytest.mark.parametrize(
    "distribution, known",
    [
        (Normal(2.0, 0.7), scipy.stats.norm(2.0, 0.7)),
        (Uniform(1.0, 4.0), scipy.stats.uniform(1.0, 3.0)),
        (Lognormal(2.0, 1.0), LOGNORMAL),
        (Triangular(2.0, 1.0, 4.0), scipy.stats.triang(1.0 / 3.0, 1.0, 3.0)),
        (TruncatedNormal(2.0, 1.0, 1.0, 4.0), scipy.stats.truncnorm(-1.0, 2.0, 2.0, 1.0)),
    ],
)
def test_densities_of_one_number(distribution, known):
    # Without the ends, where a density may jump.
    x = X[(X - 1.0) * (X - 4.0) != 0.0]
    np.testing.assert_allclose(
        np.exp(log_density(distribution, x)), known.pdf(x), rtol=1e-7, atol=1e-12
    )


def test_the_density_of_a_distribution_without_a_closed_form():
    """By bisection: that of a triangular one, whose closed form is known."""
    triangular = Triangular(2.0, 1.0, 4.0)
    x = np.array([0.9, 1.0 + 1e-6, 1.5, 2.5, 3.99, 4.1])
    np.testing.assert_allclose(_by_normals(triangular, x)[1], log_density(triangular, x), rtol=1e-7)


def test_probabilities_of_values_of_a_list():
    listed = Discrete([1.0, 2.0, 1.0], [1.0, 2.0, 1.0])
    x = np.array([1.0, 2.0, 1.5])
    np.testing.assert_allclose(np.exp(log_density(listed, x)), [0.5, 0.5, 0.0])
    shares = np.exp(log_density(Samples([1.0, 2.0, 2.0]), x))
    np.testing.assert_allclose(shares, [1.0 / 3.0, 2.0 / 3.0, 0.0])
    np.testing.assert_array_equal(np.exp(log_density(Constant(2.0), x)), [0.0, 1.0, 0.0])


def test_densities_of_joint_distributions():
    mean, covariance = np.array([1.0, -2.0]), np.array([[2.0, 0.6], [0.6, 0.5]])
    x = np.random.default_rng(0).standard_normal((2, 50)) + mean[:, None]
    known = scipy.stats.multivariate_normal(mean, covariance).logpdf(x.T)
    found = log_density(MultivariateNormal(mean, covariance), x)
    np.testing.assert_allclose(found, known, rtol=1e-12)
    # The same distribution as a copula of its marginals.
    spread = np.sqrt(np.diag(covariance))
    marginals = tuple(Normal(m, s) for m, s in zip(mean, spread, strict=True))
    copula = Correlated.of(marginals, covariance / np.outer(spread, spread))
    np.testing.assert_allclose(log_density(copula, x), known, rtol=1e-9)
    with pytest.raises(InputError, match="^A ConeDirection has no density"):
        log_density(ConeDirection(jnp.array([0.0, 0.0, 1.0]), 0.1), np.ones((3, 2)))
    with pytest.raises(InputError, match="^Numbers with a singular covariance"):
        log_density(MultivariateNormal(mean, np.ones((2, 2))), x)


# ---------------------------------------------------------------------------------- statistics


@pytest.mark.parametrize("shift, factor", [(0.5, 1.0), (0.0, 0.8), (-0.3, 1.2)])
def test_a_normal_law_in_closed_form(shift, factor):
    """y = 2 w + 1 is normal before and after; n_e = n / E[q/p]."""
    found = reweight(BEFORE, STANDARD, {"w": Normal(shift, factor)})
    law = scipy.stats.norm(1.0 + 2.0 * shift, 2.0 * factor)
    # E_q[q/p] of normal laws, by Gaussian integrals.
    root = math.sqrt(2.0 - factor**2)
    loss = math.exp(shift**2 / (2.0 - factor**2)) / (factor * root)
    assert found.effective_runs == pytest.approx(RUNS / loss, rel=0.05)
    error = law.std() / math.sqrt(found.effective_runs)
    mean = found.mean("y", 0.999)
    assert mean.low < law.mean() < mean.high and mean.high - mean.low < 12.0 * error
    assert found.std("y") == pytest.approx(law.std(), abs=4.0 * error)
    for share in (0.01, 0.5, 0.99):
        quantile = found.percentile("y", share, 0.999)
        assert quantile.low < law.ppf(share) < quantile.high
        assert quantile.low < quantile.value < quantile.high
    lost = found.violation("y", at_most=4.0, confidence=0.999)
    assert lost.low < law.sf(4.0) < lost.high and lost.high - lost.low < 0.05
    (row,) = found.table()
    assert row.mean == mean.value and row.std == found.std("y")


def test_it_agrees_with_a_new_campaign():
    """Of another kind of law, and of an input on which the output does not depend."""
    new = {"w": TruncatedNormal(0.2, 0.9, -2.0, 2.5), "x0": Triangular(0.5, 0.0, 1.0)}
    found = reweight(BEFORE, STANDARD, new)
    fresh = drawn(dataclasses.replace(STANDARD, inputs=new), seed=2)
    for name in ("y", "x0"):
        mean = found.mean(name, 0.999)
        error = np.std(fresh.values(name)) / math.sqrt(RUNS)
        assert mean.low - 3.0 * error < np.mean(fresh.values(name)) < mean.high + 3.0 * error
        assert found.std(name) == pytest.approx(np.std(fresh.values(name)), rel=0.03)
    assert found.violation("y", at_most=3.0).value == pytest.approx(
        fresh.violation("y", at_most=3.0).value, abs=0.015
    )


def test_equal_weights_give_the_statistics_of_the_runs():
    same = WeightedDispersion(BEFORE, np.full(RUNS, 1.0 / RUNS), RUNS)
    (row,), (plain,) = same.table(), BEFORE.table()
    assert row.mean == pytest.approx(plain.mean) and row.std == pytest.approx(plain.std)
    for share in (0.005, 0.5, 0.999):
        a, b = same.percentile("y", share), BEFORE.percentile("y", share)
        # The same value to a part of a step, and the same ends to one run.
        for here, there in zip(a[1:4], b[1:4], strict=True):
            between = (np.minimum(here, there), np.maximum(here, there))
            y = BEFORE.values("y")
            assert np.count_nonzero((between[0] < y) & (y < between[1])) <= 1
    a, b = (x.violation("y", at_most=5.0) for x in (same, BEFORE))
    np.testing.assert_allclose(a[:5], b[:5], rtol=1e-9)
    # Without a violation the interval is that of Clopper and Pearson too.
    a, b = (x.violation("y", at_most=50.0) for x in (same, BEFORE))
    np.testing.assert_allclose(a[:5], b[:5], rtol=1e-9)


def test_intervals_contain_the_truth_as_often_as_they_promise():
    law = scipy.stats.norm(1.8, 2.0)
    rng = np.random.default_rng(5)
    inside = np.zeros(3)
    for _ in range(400):
        w = rng.standard_normal(1000)
        weights = np.exp(0.4 * w)
        runs = dataclasses.replace(
            BEFORE, inputs={"w": w}, outputs={"y": 2.0 * w + 1.0},
            status=np.zeros(1000, int), evaluations=np.zeros(1000, int),
        )  # fmt: skip
        found = WeightedDispersion(runs, weights / weights.sum(), 1.0)
        mean, quantile = found.mean("y"), found.percentile("y", 0.9)
        lost = found.violation("y", at_most=4.0)
        inside += [
            mean.low < law.mean() < mean.high,
            quantile.low < law.ppf(0.9) < quantile.high,
            lost.low < law.sf(4.0) < lost.high,
        ]
    # 95 % of 400, less three standard deviations of the count.
    assert (inside >= 367).all() and (inside <= 399).all()


def test_failed_and_infinite_runs():
    status, y = BEFORE.status.copy(), BEFORE.values("y").copy()
    status[:2000] = 9
    y[2000:4000], y[4000:6000] = np.inf, np.nan
    runs = dataclasses.replace(BEFORE, status=status, outputs={"y": y})
    found = reweight(runs, STANDARD, {"w": Normal(0.3, 1.0)})
    lost = found.violation("y", at_most=1e9)
    assert lost.value == pytest.approx(0.3, abs=0.02) and lost.count == 6000
    # Of the successful runs with a value one in eight is infinite.
    assert found.percentile("y", 0.95).value == np.inf
    assert math.isfinite(found.percentile("y", 0.5).high) and math.isfinite(found.std("y"))


def test_verdicts_and_the_printed_tables():
    """P(y > 5) is 2.3 % before, and 15.9 % with a mean of 1; 10 % are allowed."""
    assert BEFORE.verdicts["y"].word == "pass"
    found = reweight(BEFORE, STANDARD, {"w": Normal(1.0, 1.0)})
    assert found.verdicts["y"].word == "fail" and found.verdicts["y"].runs_needed is None
    assert found.violations()["y"].value == pytest.approx(scipy.stats.norm.sf(1.0), abs=0.01)
    text = repr(found)
    assert "20000 runs with weights, as accurate as" in text and "fail" in text
    assert "w: normal, mean 0, deviation 1 → normal, mean 1, deviation 1" in text


def test_numbers_that_are_drawn_together():
    mean, before = [0.0, 0.5], np.array([[1.0, 0.3], [0.3, 0.5]])
    joint = MultivariateNormal(mean, before)
    campaign = dataclasses.replace(CAMPAIGN, inputs=joint.inputs("w", "x0"))
    runs = drawn(campaign)
    after = np.array([[0.8, 0.1], [0.1, 0.4]])
    found = reweight(runs, campaign, MultivariateNormal([0.2, 0.5], after).inputs("w", "x0"))
    x = np.stack([runs.values(name) for name in ("w", "x0")])
    away = x - (x @ found.weights)[:, None]
    np.testing.assert_allclose(away * found.weights @ away.T, after, atol=0.03)
    with pytest.raises(InputError, match="^w is drawn together with x0: change all of them"):
        reweight(runs, campaign, {"w": Normal(0.0, 1.0)})
    with pytest.raises(InputError, match="^w is drawn together with x0|^w is one number"):
        reweight(BEFORE, STANDARD, {"w": joint.inputs("w", "x0")["w"]})


@pytest.mark.parametrize(
    "inputs, sentence",
    [
        ({}, "^inputs is empty"),
        ({"W": Normal(0.0, 1.0)}, "^inputs has 'W': it must be one of w, x0"),
        ({"w": 1.0}, "^inputs.'w'. is 1.0: it must be a distribution"),
        ({"w": Normal(4.0, 1.0)}, "^The effective number of runs is .* of 20000, and at least 100"),
        # Mean square of the weights without bound: the weights at hand would not reveal it.
        ({"w": Normal(0.0, 1.5)}, "the new distribution of w is too far from the stored one"),
        ({"x0": Uniform(0.0, 1.1)}, r"^9.* % of the draws from the new distribution of x0 are"),
        ({"w": Constant(0.0)}, "^w has values of a list either before or now"),
        ({"w": Normal(0.0, 0.0)}, "^A distribution without dispersion has no density"),
        ({"w": Uniform(20.0, 21.0)}, "^w: none of the stored runs has possible values"),
    ],
)
def test_what_the_runs_cannot_answer_is_refused(inputs, sentence):
    with unchecked(), pytest.raises(InputError, match=sentence):
        reweight(BEFORE, STANDARD, inputs)


@pytest.mark.parametrize(
    "weights, sentence",
    [
        (np.ones(RUNS - 1), r"^weights has the shape \(19999,\): it must be \(20000,\)"),
        (
            np.r_[np.ones(RUNS - 2), np.nan, -1.0],
            "^weights is negative or not finite in 2 of 20000",
        ),
        (np.r_[np.ones(RUNS - 1), np.inf], "^weights is negative or not finite in 1 of 20000"),
        (np.zeros(RUNS), "^weights is zero in all runs"),
        (np.r_[np.ones(50), np.zeros(RUNS - 50)], "^The effective number of runs is 50 of 20000"),
    ],
)
def test_wrong_weights_are_refused(weights, sentence):
    with pytest.raises(InputError, match=sentence):
        weighted(BEFORE, weights)


def test_weights_up_to_a_factor():
    found = weighted(BEFORE, 1e200 * np.exp(0.5 * BEFORE.values("w")))
    same = reweight(BEFORE, STANDARD, {"w": Normal(0.5, 1.0)})
    np.testing.assert_allclose(found.weights, same.weights, rtol=1e-9)


def test_other_campaigns_and_rows_of_a_sweep_are_refused():
    with pytest.raises(InputError, match="^campaign has other inputs"):
        reweight(BEFORE, CAMPAIGN, {"w": Normal(0.0, 0.9)})
    swept = STANDARD.at({"x0": [0.2, 0.4]})
    record = {"inputs": swept.text(), "sweep": {"rows": 2, "inputs": ["x0"]}}
    runs = dataclasses.replace(drawn(swept), attributes=record)
    with pytest.raises(InputError, match="several rows of a sweep"):
        reweight(runs, swept, {"w": Normal(0.0, 0.9)})
    found = reweight(runs.row(1), swept, {"w": Normal(0.5, 1.0)})
    assert found.mean("w", 0.999).low < 0.5 < found.mean("w", 0.999).high


# ---------------------------------------------------------------------- files and the command line


@pytest.fixture
def stored(tmp_path, monkeypatch):
    """The runs of a scene file whose output is its first input, which no simulation has made."""
    path = tmp_path / "coast.toml"
    path.write_text(COAST + '"planet.mu" = { distribution = "uniform", low = 3e14, high = 5e14 }\n')
    file = load(path)
    campaign = file.campaign(warn=False)
    draws = campaign.samples(jax.random.key(0), jnp.arange(4000, dtype=jnp.uint32))
    inputs = {name: np.asarray(draws[name]) for name in campaign.inputs}
    good = np.zeros(4000, int)
    outputs = {"y": inputs["initial.orbit.periapsis_altitude"]}
    record = {"inputs": campaign.text(), "description": file.text, "planned_runs": 4000}
    runs = Dispersion(inputs, outputs, good, good, {"y": "m"}, 0, attributes=record)
    monkeypatch.setattr(_reweight, "open_store", lambda store: runs)
    return file, runs


def test_a_file_changes_keys_of_its_tables(stored):
    """The other keys of an input remain; a mean is one more key."""
    file, runs = stored
    path = "initial.orbit.periapsis_altitude"
    found = file.reweight(runs, {path: {"mean": "644.7376 km"}})
    mean = found.mean("y", 0.999)
    assert mean.low < 644737.6 < mean.high and found.std("y") == pytest.approx(2000.0, rel=0.1)
    assert "deviation 2000 → normal, mean 644737.6, deviation 2000" in found.changes[0]
    same = file.reweight(runs, {path: {"distribution": "normal", "deviation": "1.6 km"}})
    assert same.std("y") == pytest.approx(1600.0, rel=0.1)
    for changes, sentence in (
        ({"planet.radius": {"deviation": 1.0}}, "^planet.radius is not a known input of this file"),
        ({path: {"width": 1.0}}, f"^{path}.width is not a known key of normal"),
        ({path: {"deviation": "1 kg"}}, f"^{path}.deviation is .*: it must be"),
        ({"planet.mu": {"low": 2e14}}, "of the draws from the new distribution of planet.mu"),
    ):
        with pytest.raises(InputError, match=sentence):
            file.reweight(runs, changes)


@pytest.mark.usefixtures("settings_stay")
def test_the_command(stored, capsys):
    path = "initial.orbit.periapsis_altitude"
    assert main(["reweight", "s.zarr", f"{path}.deviation=1.5 km", f"{path}.mean=643000"]) == 0
    printed = capsys.readouterr().out
    assert "A coast: 4000 runs with weights" in printed and "mean 643000, deviation 1500" in printed
    for change in ("deviation=1", "body.mass.deviation", "=", f"{path}.deviation="):
        assert main(["reweight", "s.zarr", change]) == 2
        assert "must be the path of an input, a key of its table" in capsys.readouterr().err
    assert main(["reweight", "s.zarr", f"{path}.deviation=3 km"]) == 2
    assert "The effective number of runs is" in capsys.readouterr().err
