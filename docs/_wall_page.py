"""Writes the equation reference: each closed form with its source and the worst errors found by the
fuzz tests."""

import importlib
import inspect
import re
import sys
from pathlib import Path

from mkdocs.structure.files import File

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

import fuzz_page  # noqa: E402

from jaxspace.core.modules import public_names  # noqa: E402

PAGE = "explanation/equations.md"
HEAD = """\
# Equation reference

This page lists the closed forms of the library: the equations from the docstrings, their sources,
and the largest errors found by [fuzz testing](fuzz_testing.md), for the value and for its
derivatives in both modes. Errors are in units of the rounding error (2.2e-16) times the condition
number: the effect of rounding the inputs is about 1. The search evaluated {functions} functions at
{places:,} inputs; the worst inputs are listed on its page. The symbols and their units are defined
in the docstrings.
"""
TABLE = """\
| Computed by | Value | Derivatives |
|---|--:|--:|
"""
# Paragraphs of equations are indented, as the table of symbols is, which is left out.
EQUATIONS = re.compile(r"^ {4}(?!\s*symbol\b)")
SOURCE = re.compile(r"^Sources?: (.*?)(?=\n\n|\Z)", re.MULTILINE | re.DOTALL)


def on_files(files, config):
    """Add the generated page to the site."""
    files.append(File.generated(config, PAGE, content=wall()))
    return files


def wall() -> str:
    """The page: a section of each package, in it one of each file."""
    rows = [
        r for r in fuzz_page.stored().values() if r["package"] != "systems"
    ]
    places = sum(row["places"] for row in rows)
    parts = [HEAD.format(places=places, functions=len(rows))]
    for package, title in fuzz_page.TITLES.items():
        files: dict[str, list[dict]] = {}
        for row in rows:
            if row["package"] == package:
                module = module_of(row["computes"][0])
                files.setdefault(module, []).append(row)
        sections = [section(module, some) for module, some in files.items()]
        if sections:
            parts += [f"## {title}\n", *sections]
    return "\n".join(parts)


def module_of(name: str) -> str:
    """The module of the file that a public name, "package.name", stands in."""
    package, first, *_ = name.split(".")
    # Of a class its own name is enough, where a method may be inherited.
    found = public_names(importlib.import_module(f"jaxspace.{package}"))[
        first
    ]
    return found.__module__


def section(module: str, rows: list[dict]) -> str:
    """Title, equations and source of a file, and a line of each of its forms."""
    text = inspect.getdoc(importlib.import_module(module)) or ""
    title, *paragraphs = text.split("\n\n")
    equations = "\n\n".join(x for x in paragraphs if EQUATIONS.match(x))
    parts = [f"### {' '.join(title.split()).rstrip('.').partition(':')[0]}\n"]
    if equations:
        parts.append(f"```text\n{inspect.cleandoc(equations)}\n```\n")
    if source := SOURCE.search(text):
        parts.append(f"Source: {' '.join(source[1].split())}\n")
    parts.append(TABLE + "\n".join(map(line, rows)) + "\n")
    return "\n".join(parts)


def line(row: dict) -> str:
    """The names that a form computes, and its worst errors."""
    names = (name.partition(".")[2] for name in row["computes"])
    figures = (fuzz_page.figure(row[key]) for key in ("value", "slopes"))
    cells = (", ".join(f"`{name}`" for name in names), *figures)
    return f"| {' | '.join(cells)} |"
