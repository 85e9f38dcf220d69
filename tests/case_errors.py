"""Measures the errors of the reference cases: `python tests/case_errors.py [FILE ...]`.

It runs every test that names a case of a textbook, of all test files or of these, and stores the
largest relative error of its comparisons in `tests/case_errors.json`, from which the manual's pages
of the chapters are written. Of a case that is a row of the tables these are the comparisons of its
row alone: other tests compare what follows from it, and in other ways."""

import inspect
import json
import re
import sys
from pathlib import Path

import jax
import numpy as np
import pytest

HERE = Path(__file__).parent
RECORD = HERE / "case_errors.json"
# A case of Thomson, of one of the appendices, or of Harrison and Nettleton.
NAME = re.compile(r"\b(?:T\d\.\d+|T[\dABC]-|H\d\.\d+|T\d\.P)(?:[\w-]|\.(?=\d)|\.\.(?=\d))*\b")
# Looser comparisons are of approximations with each other, not of numbers of a case.
LOOSEST = 1e-5


def cases_of(item) -> set[str]:
    """The cases that a test names: in its row, else in its text and the comment above it."""
    row = getattr(item, "callspec", None)
    named = [row.id, *row.params.values()] if row is not None else []
    named = {x for x in named if isinstance(x, str) and NAME.fullmatch(x)}
    if named or item.function.__name__ == "test_case":
        # A parameter that is a name comes before the joined names of all parameters.
        return {x for x in named if not any(x != y and x.startswith(y) for y in named)}
    lines, start = inspect.getsourcelines(item.function)
    above = inspect.getsourcelines(inspect.getmodule(item.function))[0][max(start - 3, 0) : start]
    text = "".join([*(line for line in above if line.startswith("#")), *lines])
    return set(NAME.findall(text))


def measured(items) -> dict[str, set[str]]:
    """The cases that each test measures: those it names, and of the tables only its own row."""
    # Not before `conftest.py`, which sets the precision of the numbers in the tables.
    from cases import CHAPTERS

    rows = {case.id for chapter in CHAPTERS.values() for case in chapter.CASES}
    return {
        item.nodeid: cases_of(item) - (set() if item.function.__name__ == "test_case" else rows)
        for item in items
    }


class Recorder:
    """A plugin of pytest that keeps the largest relative error of the comparisons of each test."""

    def __init__(self, record: dict):
        self.record, self.names, self.error = record, {}, None

    def pytest_configure(self):
        compare, approx, take = np.testing.assert_allclose, pytest.approx, self.take

        def allclose(actual, desired, rtol=1e-7, atol=0.0, **rest):
            take(actual, desired, rtol, atol)
            compare(actual, desired, rtol=rtol, atol=atol, **rest)

        class Approx:
            # NumPy leaves the comparison to this class.
            __array_ufunc__ = None

            def __init__(self, expected, rel=1e-6, abs=0.0, **rest):
                self.expected, self.rel, self.abs = expected, rel, abs
                # Without both there is pytest's own absolute tolerance.
                self.judge = approx(expected, rel=rel, abs=abs or None, **rest)

            def __eq__(self, actual):
                take(actual, self.expected, self.rel, self.abs)
                return self.judge == actual

        # Before any test is imported.
        np.testing.assert_allclose, pytest.approx = allclose, Approx

    def take(self, actual, desired, rtol, atol=0.0):
        """One comparison; a zero has no relative error."""
        actual, desired = np.asarray(actual, float), np.asarray(desired, float)
        size = np.max(np.abs(desired), initial=0.0)
        if size > 0.0 and 0.0 < rtol + np.max(atol) / size <= LOOSEST:
            error = float(np.max(np.abs(actual - desired)) / size)
            self.error = max(self.error or 0.0, error)

    def pytest_collection_modifyitems(self, items):
        # As the tests run every day: the compiler takes half of the time.
        jax.config.update("jax_disable_most_optimizations", True)
        self.names = measured(items)
        items[:] = [item for item in items if self.names[item.nodeid]]

    def pytest_runtest_setup(self):
        self.error = None

    def pytest_runtest_teardown(self, item):
        for name in self.names[item.nodeid]:
            # A test may judge by inequalities alone, of which no error is known.
            old = self.record.setdefault(name, {"file": item.path.name})
            if self.error is not None and self.error >= old.get("error", 0.0):
                # Two digits: the rest differs from machine to machine.
                old.update(file=item.path.name, error=float(f"{self.error:.1e}"))


def main() -> int:
    """Run the tests, and store what they reached."""
    files = sys.argv[1:] or sorted(map(str, HERE.rglob("test_*.py")))
    files = [f for f in files if NAME.search(Path(f).read_text()) or "test_cases" in f]
    old = json.loads(RECORD.read_text()) if RECORD.exists() else {}
    names = {Path(f).name for f in files}
    record = {k: v for k, v in old.items() if sys.argv[1:] and v["file"] not in names}
    status = pytest.main(["-q", "-n", "0", "--sweep", "all", *files], plugins=[Recorder(record)])
    RECORD.write_text(json.dumps(dict(sorted(record.items())), indent=1) + "\n")
    return int(status)


if __name__ == "__main__":
    sys.exit(main())
