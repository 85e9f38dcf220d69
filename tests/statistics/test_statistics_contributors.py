"""Contributors of inputs that are nearly the same, or exactly."""

import numpy as np
import pytest
from scipy.special import fdtrc

from jaxspace.statistics.contributors import _significant, contributors

RUNS = 2000
RANDOM = np.random.default_rng(1)
A, D, C = RANDOM.normal(size=(3, RUNS))
ALL = np.ones(RUNS, bool)


@pytest.mark.parametrize("apart", [1e-6, 1e-9, 1e-10])
def test_inputs_that_differ_by_little(apart):
    """The output is their difference and a third input: products of the inputs have no digits of
    it below the root of the rounding."""
    values = D + 0.5 * C
    found = contributors("y", {"a": A, "b": A + apart * D, "c": C}, values, ALL)
    # The rounding of the difference is 1e-6 of it at most.
    assert found.r_squared > 1.0 - 1e-10
    assert list(found.shares) == ["a + b", "c"]
    np.testing.assert_allclose(sum(found.shares.values()), found.r_squared, atol=1e-3)
    # Up to the correlation of D and C in the sample.
    share = np.mean(0.5 * (C - np.mean(C)) * (values - np.mean(values))) / np.var(values)
    np.testing.assert_allclose(found.shares["c"], share, atol=0.02)


def test_inputs_that_are_the_same():
    found = contributors("y", {"a": A, "b": A, "c": C}, A + C, ALL)
    assert found.r_squared == pytest.approx(1.0)
    assert sum(found.shares.values()) == pytest.approx(1.0)
    assert list(found.shares) == ["a + b", "c"]


def test_what_random_columns_would_explain():
    """The F test, where a bound of its tail decides without it, too."""
    decided = set()
    for regressors in (2, 6, 40):
        for runs in (regressors + 2, 60, 4000):
            for r_squared in np.concatenate([[1e-6], np.linspace(0.005, 0.995, 199)]):
                rest = runs - regressors - 1
                statistic = r_squared / regressors / ((1.0 - r_squared) / rest)
                expected = fdtrc(regressors, rest, statistic) < 1e-3
                assert _significant(r_squared, regressors, runs) == expected
                decided.add(bool(expected))
    assert decided == {True, False}
