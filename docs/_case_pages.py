"""Writes the page of reference cases from the tables of the tests."""

import sys
from pathlib import Path

import numpy as np
from mkdocs.structure.files import File

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from cases import CHAPTERS  # noqa: E402

START = """\
# Reference cases

The cases of the textbooks (Thomson, *Introduction to Space Dynamics*; Harrison and Nettleton,
*Advanced Engineering Dynamics*) that the tests compute with the functions of this library, from the
tables in `tests/cases`. The numbers are in the units of the book. The tolerance of a vector is
relative to its greatest component; a zero is compared to the size of what cancels."""
HEAD = "| Case | What | Expected | Computed by | Relative tolerance |\n|---|---|---|---|---|"


def on_files(files, config):
    """Add the generated page to the site."""
    page = "reference/cases.md"
    files.append(File.generated(config, page, content=cases()))
    return files


def cases() -> str:
    """The page: a table for each chapter."""
    parts = [START]
    for title, chapter in CHAPTERS.items():
        rows = "\n".join(_row(case) for case in chapter.CASES)
        parts.append(f"## {title}\n\n{HEAD}\n{rows}")
    return "\n\n".join(parts) + "\n"


def _row(case) -> str:
    expected = "; ".join(
        f"{name}: {_number(value)}" for name, value in case.expected.items()
    )
    uses = ", ".join(f"`{_name(used)}`" for used in case.uses)
    cells = (case.id, case.title, expected, uses, f"{case.rtol:.0e}")
    # A bar would end the cell, an asterisk start an emphasis.
    return "| " + " | ".join(c.replace("|", "\\|") for c in cells) + " |"


def _number(value) -> str:
    if np.ndim(value):
        return f"({', '.join(_number(x) for x in value)})"
    return f"{value:.12g}"


def _name(used) -> str:
    """The public name of a function, class or method of the library."""
    room = used.__module__.split(".")[1]
    return f"{room}.{used.__qualname__}"
