"""The page of validation: it is that of the committed record, and says why a row differs."""

import math
import re
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "docs")]

import _wall_page  # noqa: E402
import fuzz_page  # noqa: E402

from validation import flights, nesc, page  # noqa: E402
from validation._from_tests import OfTest  # noqa: E402
from validation._row import Row, compared  # noqa: E402
from validation.groups import ABOUT, GROUPS  # noqa: E402


def test_the_page_is_that_of_the_record():
    assert page.PAGE.read_text() == page.text(ABOUT)
    assert all(page.stored(name) for name in ABOUT), "a group has no record: make validation"


def test_every_row_has_a_source_and_a_reason_and_a_failing_one_is_explained():
    rows = [row for name in ABOUT for row in page.stored(name)]
    for row in rows:
        assert row.what and row.source and row.quantity and row.why, row
        assert row.agrees or len(row.note) > 40, row
        # What one reads, subtracted, is the difference; of angles, to whole turns.
        apart = abs(row.ours - row.theirs)
        turned = abs((apart + 180.0) % 360.0 - 180.0)
        assert (
            math.isclose(apart, row.difference, rel_tol=1e-9, abs_tol=1e-15 * abs(row.theirs))
            or abs(turned - row.difference) < 1e-12
        ), row


def test_rows_of_tests_name_tests_that_are_there():
    for group in GROUPS.values():
        for one in getattr(group, "WANTED", ()):
            assert isinstance(one, OfTest)
            file, _, name = one.test.partition("::")
            text = (ROOT / "tests" / file).read_text()
            assert re.search(rf"^def {name.partition('[')[0]}\(", text, re.MULTILINE), one.test


def test_a_row_shows_the_place_that_is_worst_beside_its_limit():
    words = dict(what="w", source="s", quantity="q", why="y")
    row = compared([1.0, 2.0, 3.0], [1.1, 2.0, 3.2], [1.0, 0.1, 0.1], **words)
    assert (row.ours, row.theirs) == (3.0, 3.2) and not row.agrees
    lost = compared([1.0, math.nan], [1.0, 2.0], 1.0, **words)
    assert not lost.agrees and math.isnan(lost.difference)
    line = page.text({}).splitlines()
    assert line[line.index("---", 1) + 2] == "# Validation"


def test_a_course_is_held_against_the_nearest_simulator():
    """And the limit is that of the middle pair: a simulator that is far off does not widen it."""
    theirs = {
        "a": np.zeros(3),
        "b": np.full(3, 0.1),
        "c": np.full(3, 90.0),
        "d": np.full(3, np.nan),
    }
    said = {"what": "w", "quantity": "q", "source": "s"}
    row = nesc.against(np.array([0.0, 0.15, 0.0]), theirs, False, **said)
    assert row.source == "s, simulator b" and row.difference == pytest.approx(0.1)
    assert row.allowed == pytest.approx(89.9) and "3 simulators" in row.why
    turned = nesc.against(np.array([359.95, 0.0, 0.0]), theirs, True, **said)
    assert turned.difference == pytest.approx(0.05) and isinstance(turned, Row)


def test_the_wall_has_every_closed_form_with_its_errors_and_nearly_all_with_their_equations():
    rows = [row for row in fuzz_page.stored().values() if row["package"] != "systems"]
    wall = _wall_page.wall()
    for row in rows:
        assert _wall_page.line(row) in wall, row["name"]
    sections = wall.split("\n### ")[1:]
    plain = [section.partition("\n")[0] for section in sections if "```text" not in section]
    # Vector algebra, and what gathers the formulas of other files.
    assert len(sections) > 100 and len(plain) < 8, plain
    assert sum("\nSource: " in section for section in sections) > len(sections) - 8


@pytest.mark.sweep
def test_measured_flights_reach_their_apogee():
    """All by one program; `flights` says to what share of the apogee, and why."""
    rows = flights.rows()
    assert len(rows) == 33 and all(row.agrees for row in rows), [r for r in rows if not r.agrees]
