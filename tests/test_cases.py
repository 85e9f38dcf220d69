"""The reference cases of the textbooks: every row of the tables in `cases/`."""

import numpy as np
import pytest
from cases import CHAPTERS

ROWS = [pytest.param(case, id=case.id) for chapter in CHAPTERS.values() for case in chapter.CASES]


def test_each_case_stands_once():
    names = [case.id for chapter in CHAPTERS.values() for case in chapter.CASES]
    assert len(names) == len(set(names))


@pytest.mark.parametrize("case", ROWS)
def test_case(case):
    found = case.compute(**case.given)
    assert len(found) == len(case.expected)
    for (name, expected), value in zip(case.expected.items(), found, strict=True):
        size = np.max(np.abs(np.asarray(expected, float)))
        # A vector is compared to its size: a component that is zero has no digits of its own.
        np.testing.assert_allclose(
            value, expected, rtol=case.rtol, atol=case.rtol * size + case.atol, err_msg=name
        )
