"""Comparison of two campaigns, and parts of one: intervals against SciPy, units, verdicts."""

import dataclasses

import numpy as np
import pytest
from scipy import stats

from jaxspace.core import InputError
from jaxspace.statistics import Dispersion
from jaxspace.statistics.comparison import compare

RUNS = 200


def campaign(shift: float = 0.0, seed: int = 1, failed: int = 3, unit: str = "m") -> Dispersion:
    """Runs whose output depends on one input and on noise of its own."""
    wind = np.random.default_rng(seed).standard_normal(RUNS)
    noise = np.random.default_rng(17 + seed + int(10 * shift)).standard_normal(RUNS)
    drift = (5.0 + shift + 2.0 * wind + 0.1 * noise) / {"m": 1.0, "km": 1e3}[unit]
    status = np.where(np.arange(RUNS) == failed, 9, 0)
    drift = np.where(status > 0, np.nan, drift)
    limit = 8.0 / {"m": 1.0, "km": 1e3}[unit]
    record = {
        "requirements": {"drift": [None, limit, 0.1]},
        "description": f"shift = {shift}\nsame",
        "planned_runs": RUNS,
        "rtol": 1e-6,
        "versions": {"jax": "0.12"},
    }
    units = {"drift": unit, "wind": "m/s"}
    outputs = {"drift": drift, "time": 3.0 * wind}
    return Dispersion({"wind": wind}, outputs, status, np.ones(RUNS, int), units, seed, 1.0, record)


def test_paired_runs_give_the_interval_of_a_paired_t_test():
    before, after = campaign(failed=3), campaign(0.5, failed=5)
    found = compare(before, after)
    assert found.paired
    row = found.differences[0]
    keep = ~np.isin(np.arange(RUNS), (3, 5))
    x, y = before.outputs["drift"][keep], after.outputs["drift"][keep]
    expected = stats.ttest_rel(y, x).confidence_interval(0.95)
    np.testing.assert_allclose((row.low, row.high), expected, rtol=1e-12)
    assert (row.output, row.unit, row.runs) == ("drift", "m", RUNS - 2)
    assert row.significant and row.low < 0.5 < row.high
    np.testing.assert_allclose(row.spread_ratio, np.std(y) / np.std(x), rtol=1e-12)
    # An output that is the same in both has no difference at all.
    same = found.differences[1]
    assert (same.difference, same.low, same.high) == (0.0, 0.0, 0.0) and not same.significant


def test_independent_runs_give_the_interval_of_welch():
    before, after = campaign(), campaign(0.5, seed=2)
    found = compare(before, after, confidence=0.9)
    assert not found.paired
    x, y = (there.outputs["drift"][there.good] for there in (before, after))
    expected = stats.ttest_ind(y, x, equal_var=False).confidence_interval(0.9)
    np.testing.assert_allclose(found.differences[0][5:7], expected, rtol=1e-12)
    # The pairs know the same difference twenty times as well.
    paired = compare(before, campaign(0.5)).differences[0]
    assert (paired.high - paired.low) < 0.1 * (expected.high - expected.low)


def test_outputs_are_compared_in_the_units_of_the_first():
    metres, kilometres = campaign(), campaign(0.5, unit="km")
    expected = compare(metres, campaign(0.5)).differences[0]
    found = compare(metres, kilometres).differences[0]
    np.testing.assert_allclose(found[2:7], expected[2:7], rtol=1e-9)
    other = dataclasses.replace(kilometres, units=kilometres.units | {"drift": "s"})
    assert compare(metres, other).left_out == ("drift",)


def test_settings_lines_and_verdicts_that_changed():
    before, after = campaign(), campaign(2.0)
    after.attributes["rtol"] = 1e-8
    found = compare(before, after)
    assert {x.name: (x.before, x.after) for x in found.settings} == {"rtol": ("1e-06", "1e-08")}
    assert found.lines == ("- shift = 0.0", "+ shift = 2.0")
    (verdict,) = found.changed_verdicts
    assert (verdict.word_before, verdict.word_after) == ("pass", "fail")
    assert verdict.share_after == after.violations()["drift"].value
    printed = repr(found)
    for text in ("drift", "1e-08", "+ shift = 2.0", "fail", "same number"):
        assert text in printed
    assert compare(before, before).settings == ()


def test_campaigns_that_cannot_be_compared_are_refused():
    there = campaign()
    with pytest.raises(InputError, match="no output in common: the first has drift, time"):
        compare(there, dataclasses.replace(there, outputs={"x": there.outputs["drift"]}))
    with pytest.raises(InputError, match="no run number in common"):
        compare(there, dataclasses.replace(there, numbers=np.arange(RUNS, 2 * RUNS)))
    with pytest.raises(InputError, match="confidence is"):
        compare(there, there, confidence=1.0)


def test_a_part_of_a_campaign_has_the_statistics_of_its_runs(tmp_path):
    there = campaign()
    part = there.where(lambda v: v["wind"] > 0.5)
    kept = there.inputs["wind"] > 0.5
    np.testing.assert_array_equal(part.run_numbers, np.flatnonzero(kept))
    np.testing.assert_array_equal(part.outputs["drift"], there.outputs["drift"][kept])
    good = kept & there.good
    mean = np.mean(there.outputs["drift"][good])
    np.testing.assert_allclose(part.table()[0].mean, mean, rtol=1e-12)
    violated = kept & ~(there.outputs["drift"] <= 8.0)
    assert part.violations()["drift"].count == np.count_nonzero(violated)
    assert part.run_of("greatest", "drift") == there.run_of("greatest", "drift")
    # Nothing is missing of it, and its table has the numbers of the campaign.
    assert part.missing_runs == ""
    part.to_csv(tmp_path / "part.csv")
    first = (tmp_path / "part.csv").read_text().splitlines()[1]
    assert first.startswith(f"{np.flatnonzero(kept)[0]},")
    again = part.where(np.arange(part.runs) < 2)
    np.testing.assert_array_equal(again.run_numbers, np.flatnonzero(kept)[:2])
    # Both parts are pairs of no run, unless they overlap.
    overlap = there.where(there.inputs["wind"] > 0.0)
    assert compare(part, overlap).differences[0].runs == np.count_nonzero(good)


def test_conditions_that_select_nothing_or_are_none_are_refused():
    there = campaign()
    with pytest.raises(InputError, match=r"float64 of shape \(200,\): it must be booleans"):
        there.where(there.inputs["wind"])
    with pytest.raises(InputError, match=r"of shape \(3,\): it must be booleans of shape \(200,\)"):
        there.where(np.ones(3, bool))
    with pytest.raises(InputError, match="met by none of 200 runs"):
        there.where(lambda v: v["wind"] > 100.0)
