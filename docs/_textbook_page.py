"""Writes the page that leads from a number of the two books to function, picture and proof."""

import re

from _case_pages import computed
from _gallery_pages import scripts
from _uses import anchor, homes
from cases.rows import PAGES
from mkdocs.structure.files import File

START = """\
---
hide: [toc]
---
# From the textbook

This page lists the functions for each section, problem and figure of the textbooks.

- Numbers refer to Thomson, *Introduction to Space Dynamics*; numbers with an H refer to Harrison
  and Nettleton, *Advanced Engineering Dynamics*.
- The column *Pictures* links to the scripts that draw the figures, the column *Tests* to the values
  of the book that the tests compute."""
HEAD = """\
| Section | Subject | Computed by | Pictures | Tests |
|---|---|---|---|---|"""
TOOLS = ("core.", "simulation.", "scene.")
SECTION = re.compile(r"\((?:Ex\. )?((?:H )?\d+\.\d+)[^)]*\)")


def on_files(files, config):
    """Add the generated page to the site."""
    files.append(
        File.generated(
            config, "reference/from_the_textbook.md", content=textbook()
        )
    )
    return files


def textbook() -> str:
    """The page: a table for each group of chapters."""
    pictures = _pictures()
    parts = [START]
    for page, (title, rows) in PAGES.items():
        lines = [
            _line(row, functions, page, names, pictures)
            for row, functions, names, _ in computed(rows)
        ]
        parts.append("\n".join([f"## {title}\n", HEAD, *lines]))
    return "\n\n".join(parts) + "\n"


def _line(row, functions, page, names, pictures) -> str:
    links = [
        f"[{s.name}](../gallery/{s.path.parent.name}.md#{anchor(s.goal)})"
        for s in pictures.get(_section(row.section), ())
    ]
    count = f"{len(names)} case{'s' * (len(names) != 1)}"
    proof = f"[{count}]({page}.md)" if names else "-"
    # The tools of every computation say nothing, but where they are all there is.
    theory = [f for f in functions if not f.startswith(TOOLS)]
    cells = (
        *(row.section, row.title),
        ", ".join(map(_linked, theory or functions)) or "-",
        ", ".join(links) or "-",
        proof,
    )
    return "| " + " | ".join(c.replace("|", "\\|") for c in cells) + " |"


def _section(text: str) -> str:
    """The section of a row such as 7.6 P3: 7.6."""
    return re.match(r"(?:H )?[\w.]+", text)[0].rstrip(",")


def _linked(function: str) -> str:
    """A public name with a link to where it is described; a method is described with its class."""
    described = set(homes().values())
    for path in (function, function.rpartition(".")[0]):
        if path in described:
            return f"[`{function}`][jaxspace.{path}]"
    return f"`{function}`"


def _pictures():
    """The gallery's scripts by section."""
    found = {}
    for script in sorted(scripts().values()):
        words = f"{script.name}\n{script.caption}"
        sections = set(SECTION.findall(words))
        number = re.match(r"fig_(\d+)_(\d+)", script.path.stem)
        if number:
            sections.add(f"{number[1]}.{number[2]}")
        for section in sections:
            found.setdefault(section, []).append(script)
    return found
