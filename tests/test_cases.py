"""The reference cases of the textbooks: every row of the tables in `cases/`, and the rows of the
theory that they belong to."""

import importlib
import json
import operator
import re

import numpy as np
import pytest
from case_errors import RECORD, Recorder
from cases import CHAPTERS
from cases.rows import PAGES, row_of

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


THEORY = [row for _, rows in PAGES.values() for row in rows]


def test_functions_of_the_theory_are_public():
    for name in " ".join(row.functions for row in THEORY).split():
        package, attribute = name.split(".", 1)
        found = operator.attrgetter(attribute)(importlib.import_module(f"jaxspace.{package}"))
        assert found.__doc__, name


def test_each_case_belongs_to_one_row_of_the_theory():
    """The cases of the chapters that have a page of rows."""
    stored = json.loads(RECORD.read_text())
    names = {case.id for chapter in CHAPTERS.values() for case in chapter.CASES} | set(stored)
    theirs = re.compile(r"T[1-9ABC][.-]|H")
    for name in filter(theirs.match, names):
        found = [row_of(name, rows) for _, rows in PAGES.values()]
        assert sum(row is not None for row in found) == 1, name


def test_errors_of_the_cases_are_stored():
    """`python tests/case_errors.py tests/test_cases.py` after a change of the tables."""
    stored = json.loads(RECORD.read_text())
    for chapter in CHAPTERS.values():
        for case in chapter.CASES:
            # A case whose numbers are all zero has no relative error.
            if np.any([np.any(value) for value in case.expected.values()]):
                entry = stored[case.id]
                assert entry["file"] == "test_cases.py", case.id
                assert entry["error"] <= 2.0 * case.rtol + case.atol, case.id


def test_recorder_keeps_the_largest_relative_error():
    recorder = Recorder({})
    recorder.take([1.0, 2.2], [1.0, 2.0], 1e-6)
    recorder.take(1.05, 1.0, 1e-6)
    np.testing.assert_allclose(recorder.error, 0.1, rtol=1e-12)
    # A zero has no relative error, and a loose comparison is of approximations.
    recorder.take(0.5, 0.0, 1e-6)
    recorder.take(3.0, 1.0, 1e-3)
    recorder.take(3.0, 1.0, 1e-6, 1e-3)
    np.testing.assert_allclose(recorder.error, 0.1, rtol=1e-12)
