"""Rows from comparisons that the tests of this project make."""

import json
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from ._row import Row, compared


@dataclass(frozen=True)
class OfTest:
    """The row of one comparison in a test.

    - `test`: as pytest names it, from the folder `tests` on.
    - `index`: of the comparison among those of the test; `part`: of its array, by default the
      place where it differs most.
    - `allowed`: by the source, where the test's tolerance is wider.
    - The rest as in `Row`."""

    test: str
    what: str
    source: str
    quantity: str
    why: str
    index: int = 0
    part: int | None = None
    allowed: float | None = None
    note: str = ""

    def row(self, comparisons: dict[str, list]) -> Row:
        """From the comparisons of every test."""
        ours, theirs, allowed = comparisons[self.test][self.index]
        if self.part is not None:
            ours, theirs, allowed = (x[self.part] for x in (ours, theirs, allowed))
        if self.allowed is not None:
            allowed = self.allowed
        words = ("what", "source", "quantity", "why", "note")
        return compared(ours, theirs, allowed, **{word: getattr(self, word) for word in words})


def rows(wanted: tuple[OfTest, ...]) -> list[Row]:
    """The rows, from one run of their tests in a process of its own, whose settings are theirs."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "comparisons.json"
        names = dict.fromkeys(one.test for one in wanted)
        command = [sys.executable, "-m", "validation._recorder", str(file), *names]
        child = subprocess.run(command, capture_output=True, text=True)
        if not file.exists():
            raise RuntimeError(f"The tests did not run:\n{child.stdout}\n{child.stderr}")
        # A test that fails has compared all the same, and its row says so.
        comparisons = json.loads(file.read_text())
    return [one.row(comparisons) for one in wanted]
