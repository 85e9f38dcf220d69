"""Runs tests of this project and stores what they compared: `python -m validation._recorder FILE
TEST ...`, each test as pytest names it, from the folder `tests` on."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

TESTS = Path(__file__).resolve().parents[1] / "tests"
sys.path.insert(0, str(TESTS))

from case_errors import Recorder  # noqa: E402


class Comparisons(Recorder):
    """A plugin of pytest that keeps every comparison of each test: ours, theirs, allowed."""

    def __init__(self):
        super().__init__({})
        self.now = []

    def take(self, actual, desired, rtol, atol=0.0):
        ours, theirs = np.broadcast_arrays(np.asarray(actual, float), np.asarray(desired, float))
        allowed = np.broadcast_to(atol + rtol * np.abs(theirs), theirs.shape)
        self.now.append([x.tolist() for x in (ours, theirs, allowed)])

    def pytest_collection_modifyitems(self, items):
        """All that were named."""

    def pytest_runtest_setup(self, item):
        self.now = self.record.setdefault(item.nodeid.removeprefix("tests/"), [])

    def pytest_runtest_teardown(self, item):
        """Nothing: the comparisons are in the record."""


def main() -> int:
    """Status of pytest; the record is written all the same, with what was compared before."""
    file, *names = sys.argv[1:]
    recorder = Comparisons()
    # Each with the compiler's optimisations, as users run it.
    options = ["-q", "-n", "0", "--sweep", "all", "-p", "no:cacheprovider"]
    status = pytest.main([*options, *(str(TESTS / name) for name in names)], plugins=[recorder])
    Path(file).write_text(json.dumps(recorder.record))
    return int(status)


if __name__ == "__main__":
    sys.exit(main())
