"""Comparison of designs as a self-contained HTML page without scripts."""

import io
import os
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HERE = Path(__file__).parent
STYLE = """figure { margin: 1rem 0; }
figure svg { max-width: 100%; height: auto; background: white; }
"""


def designs_page(
    path: str | os.PathLike[str],
    title: str,
    note: str,
    rows: Sequence[Sequence[str]],
    sentences: Sequence[str],
    figures: Mapping[str, "Figure"],
) -> Path:
    """Write a page about designs, light or dark.

    **Arguments**

    - `path`: of the HTML file.
    - `title`, `note`: subject of the page, and its runs.
    - `rows`: of the table, of which the first has the names of the designs.
    - `sentences`: findings about them.
    - `figures`: by their headings.

    **Returns** the path.
    """
    drawn = [
        f"<section><h2>{escape(words)}</h2><figure>{_svg(figure)}</figure></section>\n"
        for words, figure in figures.items()
    ]
    said = "".join(f"<li>{escape(sentence)}</li>\n" for sentence in sentences)
    style = (HERE / "_dispersion.css").read_text(encoding="utf-8")
    page = f"""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{escape(title)}</title><style>
{style}{STYLE}</style></head><body>
<h1>{escape(title)}</h1><p class="note">{escape(note)}</p>
<section><h2>Results</h2><div class="wide">{_table(rows)}</div></section>
<section><h2>Findings</h2><ul>
{said}</ul></section>
{"".join(drawn)}</body></html>
"""
    path = Path(path)
    path.write_text(page, encoding="utf-8")
    return path


def _table(rows: Sequence[Sequence[str]]) -> str:
    head, *body = rows
    lines = ["".join(f"<th>{escape(cell)}</th>" for cell in head)]
    lines += ["".join(f"<td>{escape(cell.strip())}</td>" for cell in row) for row in body]
    return "<table>" + "".join(f"<tr>{line}</tr>\n" for line in lines) + "</table>"


def _svg(figure: "Figure") -> str:
    """The picture as part of a page: without the header of a separate file."""
    text = io.StringIO()
    # Without a date, so that the same runs give the same page.
    figure.savefig(text, format="svg", metadata={"Date": None})
    return text.getvalue()[text.getvalue().index("<svg") :]
