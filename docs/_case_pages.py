"""Writes the page of reference cases, and a page of each group of chapters, from the tables of the
tests."""

import importlib
import inspect
import json
import sys
from pathlib import Path

import numpy as np
from mkdocs.structure.files import File

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from case_errors import RECORD  # noqa: E402
from cases import CHAPTERS  # noqa: E402
from cases.rows import PAGES, row_of  # noqa: E402

ERRORS = json.loads(RECORD.read_text())

START = """\
# Reference cases

This page lists the textbook cases (Thomson, *Introduction to Space Dynamics*; Harrison and
Nettleton, *Advanced Engineering Dynamics*) that the tests compute with jaxspace; they are defined
in `tests/cases`. The values are in the units of the book. The tolerance of a vector is relative to
its greatest component; a zero is compared with the magnitude of the cancelling terms. The errors
were measured by `python tests/case_errors.py`."""
HEAD = """\
| Case | Quantity | Expected | Computed by | Relative tolerance | Error |
|---|---|---|---|---|---|"""
ROWS_START = """\
# {title}

This page lists the functions for each section of {books}, and the reference cases with which the
tests compare them. The error is the largest relative error of these comparisons, measured by
`python tests/case_errors.py`. The values of most cases are listed in [reference cases](cases.md).

| Section | Subject | Computed by | Cases | Error |
|---|---|---|---|---|"""
BOOKS = {
    "chapters_1_to_4": (
        "Thomson, *Introduction to Space Dynamics*, chapters 1 to 4, and the central forces of\n"
        "Harrison and Nettleton, *Advanced Engineering Dynamics* (H)"
    ),
    "chapter_5": (
        "Thomson, *Introduction to Space Dynamics*, chapter 5, and the rigid bodies of Harrison\n"
        "and Nettleton, *Advanced Engineering Dynamics* (H)"
    ),
    "chapter_8": ("Thomson, *Introduction to Space Dynamics*, chapter 8"),
    "chapter_6": ("Thomson, *Introduction to Space Dynamics*, chapter 6"),
    "chapter_9": (
        "Thomson, *Introduction to Space Dynamics*, chapter 9 and appendices B and C"
    ),
    "vehicles": (
        "Thomson, *Introduction to Space Dynamics*, sections 7.1 to 7.6 and 7.11"
    ),
    "variable_mass": (
        "Thomson, *Introduction to Space Dynamics*, sections 7.7 to 7.10"
    ),
}


def on_files(files, config):
    """Add the generated pages to the site."""
    pages = {"cases": cases(), **{name: theory(name) for name in PAGES}}
    for name, text in pages.items():
        files.append(
            File.generated(config, f"reference/{name}.md", content=text)
        )
    return files


def theory(page: str) -> str:
    """The page of a group of chapters: a line for each row of the theory."""
    title, rows = PAGES[page]
    lines = [ROWS_START.format(title=title, books=BOOKS[page])]
    for row, functions, names, reached in computed(rows):
        cells = (
            *(row.section, row.title),
            ", ".join(f"`{f}`" for f in functions) or "-",
            ", ".join(names) or "-",
            _error(max(reached)) if reached else "-",
        )
        lines.append(_line(cells))
    return "\n".join(lines) + "\n"


def computed(rows):
    """Each row of the theory with the functions that compute it, the names of its cases, and the
    errors that these reached."""
    tables = [case for c in CHAPTERS.values() for case in c.CASES]
    # A case that stands in a test and in no table is known by its error.
    used = {**dict.fromkeys(ERRORS, ()), **{c.id: c.uses for c in tables}}
    for row in rows:
        names = sorted(name for name in used if row_of(name, rows) is row)
        functions = row.functions.split()
        functions += [_name(f) for name in names for f in used[name]]
        reached = [
            ERRORS[name]["error"]
            for name in names
            if "error" in ERRORS.get(name, {})
        ]
        yield row, list(dict.fromkeys(functions)), names, reached


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
    # A case whose numbers are all zero has no relative error.
    reached = (
        _error(ERRORS[case.id]["error"])
        if "error" in ERRORS.get(case.id, {})
        else "-"
    )
    return _line(
        (case.id, case.title, expected, uses, f"{case.rtol:.0e}", reached)
    )


def _error(value: float) -> str:
    return f"{value:.0e}" if value else "0"


def _line(cells) -> str:
    # A bar would end the cell.
    return "| " + " | ".join(c.replace("|", "\\|") for c in cells) + " |"


def _number(value) -> str:
    if np.ndim(value):
        return f"({', '.join(_number(x) for x in value)})"
    return f"{value:.12g}"


def _name(used) -> str:
    """The public name of a function, class, method or property of the library."""
    used = getattr(used, "fget", used)
    package, file = used.__module__.split(".")[1:3]
    given = vars(importlib.import_module(f"jaxspace.{package}"))
    first = given.get(used.__qualname__.split(".")[0])
    # What the root does not give, a public module does.
    of_root = first is not None and not inspect.ismodule(first)
    path = package if of_root else f"{package}.{file}"
    return f"{path}.{used.__qualname__}"
