"""Designs assessed by fresh runs, against closed forms of a linear and quadratic problem."""

import html

import jax.numpy as jnp
import numpy as np
import pytest
import scipy.stats
from test_robust_design import SCATTER, algebraic, linear_quadratic

from jaxspace.core import InputError
from jaxspace.dispersion import Normal
from jaxspace.robust import assess_designs, optimise_design
from jaxspace.robust.statistics import CVaR, Mean, MeanPlus, Quantile

K = 2.0
# At the optimum y has the mean 0.16 and the deviation 0.24, and 0 and 0.4 at the nominal one.
LIMIT = 0.6
CAMPAIGN = algebraic(linear_quadratic, {"w": Normal(0.0, 1.0)})


@pytest.fixture(scope="module")
def best():
    return optimise_design(
        CAMPAIGN,
        jnp.asarray(0.9),
        minimise=MeanPlus("y", K),
        subject_to=[Quantile("y", 0.95).at_most(LIMIT), Mean("y").at_most(0.5)],
    )


@pytest.fixture(scope="module")
def assessment(best):
    return assess_designs(best, {"nominal": jnp.asarray(1.0)})


def of_x(x):
    return (x - 1.0) ** 2, SCATTER * x


def test_values_lie_within_their_errors(assessment):
    for design in assessment.designs.values():
        mean, deviation = of_x(float(design.x))
        # Four errors: one of 16,000 draws is farther out.
        value, error = design.value
        assert abs(value - (mean + K * deviation)) < 4.0 * error
        # The error of m + k s of normal values: s sqrt((1 + k^2/2)/n).
        np.testing.assert_allclose(error, deviation * np.sqrt((1.0 + K**2 / 2.0) / 4096), rtol=0.05)
        quantile, average = design.limits
        exact = mean + scipy.stats.norm.ppf(0.95) * deviation
        assert abs(quantile.value.value - exact) < 4.0 * quantile.value.error
        assert average.verdict is None and not average.fails
        violation = quantile.verdict.violation
        assert violation.low < scipy.stats.norm.sf(LIMIT, mean, deviation) < violation.high


def test_the_worth_of_modelling_the_scatter(assessment):
    """(k s)^2/4 for (x - 1)^2 + k s x, known better than either value from the same runs."""
    worth = assessment.worth("nominal")
    assert abs(worth.value - (K * SCATTER) ** 2 / 4.0) < 4.0 * worth.error
    assert worth.error < 0.6 * assessment.designs["nominal"].value.error


def test_the_table_names_requirements_gap_and_tail(assessment):
    nominal, robust = (
        assessment.designs["nominal"].limits[0],
        assessment.designs["robust"].limits[0],
    )
    assert (nominal.verdict.word, robust.verdict.word) == ("fail", "pass")
    assert nominal.fails and not robust.fails
    # The gap is that of the fresh runs, within both errors.
    assert abs(assessment.gap.value) < 4.0 * assessment.gap.error
    text = repr(assessment)
    verdicts = "5 % allowed: fail", "5 % allowed: pass"
    for part in ("nominal", "robust", *verdicts, "failed", "205 of 4096"):
        assert part in text
    assert " larger for nominal, which violates a constraint." in text


def test_a_share_of_all_runs_is_written_as_a_number(best):
    """Of 4,096 runs all violate the limit: the least share of 95 % confidence is 99.9 %."""
    table = repr(assess_designs(best, {"far": jnp.asarray(30.0)}))
    assert "100 % (99.9 to 100), 5 % allowed: fail" in table


def test_the_figure_has_a_histogram_of_each(assessment):
    axes = assessment.plot(title="y").axes[0]
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["nominal", "robust"]
    # The line of the limit of y.
    assert [line.get_xdata()[0] for line in axes.lines] == [LIMIT]


def test_the_page_holds_table_sentences_and_pictures(assessment, tmp_path):
    text = assessment.page(tmp_path / "designs.html", "A <design>").read_text()
    assert "<h1>A &lt;design&gt;</h1>" in text and "<script" not in text
    assert "<th>nominal</th><th>robust</th>" in text
    for sentence in (*assessment.sentences, assessment.optimum.sentence()):
        assert html.escape(sentence) in text
    # One of the output, one of the search.
    assert text.count("<svg") == 2 and "http-equiv" not in text


def test_what_is_wrong_is_said(best):
    for arguments, sentence in (
        ({"seed": best.seed}, "seed is 0, the seed of the search"),
        ({"others": {"robust": best.x}}, '"robust" is reserved for the optimum'),
        ({"runs": 100}, "runs is 100, too few for the 95 % quantile of y"),
    ):
        with pytest.raises(InputError, match=sentence):
            assess_designs(best, **arguments)
    nominal = optimise_design(CAMPAIGN, jnp.asarray(0.9), minimise=CVaR("y", 0.9), nominal=True)
    with pytest.raises(InputError, match="optimum belongs to the nominal run"):
        assess_designs(nominal)
