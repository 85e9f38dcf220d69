"""A dispersion as one page for any browser: everything is in the file, no network is needed."""

import base64
import gzip
import io
import os
import re
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..core.extras import extra
from ..core.record import Record
from ..core.text import in_words
from ._dispersion_figure import heading
from ._page_data import page_data, processor_words
from ._page_script import page_script
from ._sweep_figure import sweep_figure

if TYPE_CHECKING:
    from ..dispersion import RunPaths
    from ..statistics import Dispersion, Failure
    from ..statistics.table import Row

HERE = Path(__file__).parent
MOST_ROWS = 200
"""Rows of a sweep that the page lists."""
EXAMPLES = 5
"""Numbers of failed runs that are named for each cause."""
ELLIPSE = "The ellipse belongs to a normal distribution with the same covariance."


def dispersion_page(
    dispersion: "Dispersion",
    path: str | os.PathLike[str],
    *,
    count: int = 8,
    title: str = "Dispersion",
    nominal: Mapping[str, float] | None = None,
    paths: "RunPaths | None" = None,
    wind: tuple[ArrayLike, ArrayLike] | None = None,
) -> Path:
    """Write a page of a campaign: its card, tables and interactive plots, light or dark.

    It contains the outputs with their nominal values and limits, a scatter plot of any two
    quantities with the 99 % ellipse, histograms, a scatter matrix, the largest contributors to
    each output, convergence, failures, the time budget, and trajectories; also the landing points
    if `east` and `north` are outputs. Of a million runs the plots show bins and 2000 points: the
    file stays below 5 MB.

    **Arguments**

    - `dispersion`: the result of a campaign.
    - `path`: of the HTML file.
    - `count`: of contributors for each output.
    - `title`: of the page.
    - `nominal`: the outputs of the nominal run, in the units of the dispersion.
    - `paths`: some runs in full (`jaxspace.dispersion.run_paths`).
    - `wind`: components to the east and to the north, m/s, for a wind rose next to the landings, in
      the form of `LaunchSite.winds`.

    **Returns** the path.
    """
    nominal = {} if nominal is None else nominal
    data = page_data(dispersion, nominal, count, paths, wind)
    body = [
        f"<h1>{escape(title)}</h1>",
        f'<p class="note">{escape(heading(dispersion))}.</p>',
        _card(dispersion),
        *_sweep(dispersion),
        _section("Outputs", _table(dispersion, nominal)),
        *_landings(dispersion, data),
        *_plots(dispersion, data),
        _section("Failures", _failures(dispersion)),
        _section("Time", *_time(dispersion, data)),
        _section("Inputs", f"<pre>{escape(str(dispersion.attributes.get('inputs', '')))}</pre>"),
        _section("Record", f"<pre>{escape(_record(dispersion))}</pre>"),
    ]
    page = f"""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{escape(title)}</title><style>
{(HERE / "_dispersion.css").read_text(encoding="utf-8")}</style></head><body>
{"".join(body)}
<script id="library" type="text/plain">{_library()}</script>
{page_script(data, "_dispersion_runs", "_dispersion_statistics", "_dispersion")}</body></html>
"""
    path = Path(path)
    path.write_text(page, encoding="utf-8")
    return path


def _library() -> str:
    """The plotting library, compressed, as letters."""
    with extra("app"):
        from plotly.offline import get_plotlyjs

    # Compressed, because it would be most of the page; without a time stamp, so that the same runs
    # give the same file.
    return base64.b64encode(gzip.compress(get_plotlyjs().encode(), 9, mtime=0)).decode()


def _section(title: str, *parts: str) -> str:
    return f"<section><h2>{escape(title)}</h2>\n" + "\n".join(parts) + "</section>\n"


def _plot(name: str, size: str = "") -> str:
    return f'<div class="plot {size}" id="{name}"></div>'


def _picker(name: str, words: str, choices: list[str], chosen: str) -> str:
    options = "".join(
        f'<option value="{escape(c)}"{" selected" * (c == chosen)}>{escape(in_words(c))}</option>'
        for c in choices
    )
    return f'<label>{words} <select id="{name}">{options}</select></label>'


def _card(dispersion: "Dispersion") -> str:
    """Overview of the campaign, its settings and its machine."""
    record = dispersion.attributes
    good = int(np.count_nonzero(dispersion.good))
    versions = record.get("versions", {})
    rows = {
        "runs": f"{good} of {dispersion.runs} succeeded",
        "unfinished": dispersion.missing_runs,
        "ended": dispersion.ending,
        "seed": str(dispersion.seed),
        "inputs": str(len(dispersion.inputs)),
        "outputs": str(len(dispersion.outputs)),
        "accuracy": f"{record['rtol']:.3g}, method {record.get('method', 'auto')}"
        if "rtol" in record
        else "",
        "time": f"{dispersion.seconds:.3g} s" if np.isfinite(dispersion.seconds) else "",
        "evaluations": f"{np.mean(dispersion.evaluations):.0f} of the vector field per run",
        "versions": ", ".join(f"{k} {v}" for k, v in versions.items() if v != "not installed"),
    }
    terms = "".join(f"<dt>{k}</dt><dd>{escape(v)}</dd>" for k, v in rows.items() if v)
    return f"<dl>{terms}</dl>"


def _cells(cells: list[str], tag: str = "td", text: int = 2, heads: Sequence[str] = ()) -> str:
    """A line of a table, whose first `text` cells are words.

    `heads`: of the columns, which a narrow page shows before each cell."""
    named = [f' data-head="{escape(head)}"' for head in heads] or [""] * len(cells)
    shown = (
        f"<{tag}{' class=text' * (k < text)}{named[k]}>{escape(cell)}</{tag}>"
        for k, cell in enumerate(cells)
    )
    return "<tr>" + "".join(shown) + "</tr>"


def _table(dispersion: "Dispersion", nominal: Mapping[str, float]) -> str:
    """The outputs, with their nominal values, limits and requirements."""
    required = dispersion.requirements
    violations = dispersion.violations()
    verdicts = dispersion.verdicts
    heads = ["output", "nominal", "mean", "std\u00a0dev", "0.5th to 99.5th percentile"]
    heads += ["95\u00a0% interval of the 99.5th percentile", "least, greatest", "runs"]
    known = "numerical_errors" in dispersion.attributes
    heads += ["numerical error"] if known else []
    heads += ["required", "violated", "at most"] if required else []
    heads += ["allowed", "verdict"] if verdicts else []
    lines = [_cells(heads, "th", 1)]
    for row in dispersion.table():
        name = in_words(row.name) + (f" [{row.unit}]" if row.unit else "")
        cells = [name, *_numbers(dispersion, row, nominal), str(row.runs)]
        cells += [row.numerical_words.replace(" ", "\u00a0")] if known else []
        if required:
            result = violations.get(row.name)
            words = (
                [f"{100.0 * x:.3g}\u00a0%" for x in (result.value, result.high)]
                if result
                else ["", ""]
            )
            # No sign at the end of a line.
            cells += [re.sub("([≥≤]) ", "\\1\u00a0", dispersion.required(row.name)), *words]
        if verdicts:
            verdict = verdicts.get(row.name)
            cells += (
                [f"{100.0 * verdict.allowed:.6g}\u00a0%", verdict.word] if verdict else ["", ""]
            )
        lines.append(_cells(cells, text=1, heads=heads))
    note = (
        "The 95 % interval contains the 99.5th percentile of the distribution with 95 % confidence."
    )
    if required:
        note += " A failed run counts as a violation. “At most” is the upper limit of the 95 %"
        note += " confidence interval, or of that with the confidence of the requirement."
    purpose = dispersion.purpose
    sentences = [*dispersion.warnings, *([] if purpose is None else [purpose.sentence])]
    warnings = "".join(f'<p class="note">{escape(x)}</p>' for x in sentences)
    return f'{_outputs_table(lines)}{warnings}<p class="note">{note}</p>'


def _outputs_table(lines: list[str]) -> str:
    """A table of which a narrow page shows each line as a block."""
    return '<table class="outputs">' + "\n".join(lines) + "</table>"


def _numbers(dispersion: "Dispersion", row: "Row", nominal: Mapping[str, float]) -> list[str]:
    """The numbers of an output, all by the same rule."""
    if row.runs + row.above + row.below == 0:
        # As many cells as below, so that the columns stay.
        return ["", *["none"] * 5]
    limit = dispersion.percentile(row.name, 0.995)
    nominal_value = row.shown(nominal[row.name]) if row.name in nominal else "–"
    spans = ((row.low, row.high), (limit.low, limit.high))
    # One break, which is not within a number.
    shown = [" … ".join(row.shown(x) for x in span) for span in spans]
    ends = ((row.min, row.min_run), (row.max, row.max_run))
    shown.append(" … ".join(f"{row.shown(x)} (run\u00a0{run})" for x, run in ends))
    return [nominal_value, row.shown(row.mean), row.shown(row.std), *shown]


def _sweep(dispersion: "Dispersion") -> list[str]:
    """The section of a sweep: its figure and its table."""
    if "sweep" not in dispersion.attributes:
        return []
    head, *rows = dispersion.by_row().table
    lines = [_cells(list(head), "th", 0), *(_cells(list(row), text=0) for row in rows[:MOST_ROWS])]
    more = len(rows) - MOST_ROWS
    note = f'<p class="note">The table has {more} more rows.</p>' if more > 0 else ""
    picture = io.BytesIO()
    sweep_figure(dispersion).savefig(picture, format="png", dpi=110)
    image = base64.b64encode(picture.getvalue()).decode()
    table = '<div class="wide"><table>' + "\n".join(lines) + "</table></div>"
    drawn = f'<img style="max-width:100%" alt="sweep" src="data:image/png;base64,{image}">'
    text = "The sections below are about the runs of all rows together."
    return [_section("Sweep", drawn, table, note, f'<p class="note">{text}</p>')]


def _plots(dispersion: "Dispersion", data: Record) -> list[str]:
    """The sections with plots, each with its pickers."""
    names = data["names"]
    outputs = list(dispersion.outputs)
    pickers = _picker("across", "across", names, data["pair"][0])
    pickers += _picker("up", "up", names, data["pair"][1])

    def chosen(name: str, words: str = "output") -> str:
        return f'<div class="pickers">{_picker(name, words, outputs, outputs[0])}</div>'

    shown = len(data["numbers"])
    good = int(np.count_nonzero(dispersion.good))
    thinned = f" The first {shown} of {good} runs are shown." if shown < good else ""
    parts = [
        _section(
            "Scatter plot of two quantities",
            f'<div class="pickers">{pickers}</div>',
            _plot("scatter", "tall"),
            '<p class="note bad" id="scatter-words"></p>',
            f'<p class="note">{ELLIPSE}{thinned}</p>',
        ),
        _section(
            "Distribution",
            chosen("histogram-of"),
            '<p class="note" id="histogram-words"></p>',
            _plot("histogram"),
        ),
        _section(
            "Contributors to the variance",
            chosen("contributors-of"),
            '<p class="note" id="contributors-words"></p>',
            _plot("contributors"),
        ),
        _section(
            "Convergence",
            chosen("convergence-of"),
            '<p class="note" id="convergence-words"></p>',
            _plot("convergence"),
        ),
    ]
    if len(data["matrix"]) > 1:
        parts.append(_section("Scatter matrix of outputs", _plot("matrix", "tall")))
    if data["trajectories"] is not None:
        parts.append(_section("Trajectories", _plot("trajectories", "tall")))
    return parts


def _landings(dispersion: "Dispersion", data: Record) -> list[str]:
    """The section of the footprint, with the wind rose next to it."""
    result = dispersion.footprint()
    if result is None:
        return []
    head, *rows = result.words
    lines = [_cells(list(head), "th", 1), *(_cells(list(row), text=1, heads=head) for row in rows)]
    beside = "" if data["rose"] is None else _plot("rose")
    place = " Pointing at a run shows its latitude and longitude." * bool(
        data["footprint"]["degrees"]
    )
    words = "The rail is the origin. The ellipses belong to normal distributions."
    return [
        _section(
            "Landings",
            f'<div class="beside">{_plot("footprint", "tall")}{beside}</div>',
            _outputs_table(lines),
            f'<p class="note">{words}{place}</p>',
        )
    ]


def _time(dispersion: "Dispersion", data: Record) -> list[str]:
    """Wall time by stages, and utilisation of the cores."""
    if not data["time"]:
        return ["<p>The computing time is unknown.</p>"]
    return [_plot("time", "low"), f'<p class="note">{escape(processor_words(dispersion))}</p>']


def _failures(dispersion: "Dispersion") -> str:
    """The failed runs: their status, their cause, their number, and the numbers of some of them."""
    if not dispersion.failed:
        return "<p>All runs succeeded.</p>"
    lines = [_cells(["status", "cause", "runs", "run numbers"], "th")]
    lines += [_cells(_failure(dispersion, f)) for f in dispersion.failed]
    table = "\n".join(lines)
    return f'<div class="wide bad"><table>{table}</table></div>'


def _failure(dispersion: "Dispersion", failure: "Failure") -> list[str]:
    numbers = np.flatnonzero(dispersion.status == failure.status)
    some = ", ".join(str(n) for n in numbers[:EXAMPLES]) + (" …" if numbers.size > EXAMPLES else "")
    return [failure.status.name, failure.sentence, str(failure.count), some]


def _record(dispersion: "Dispersion") -> str:
    """The record of how the runs were made, one line for each entry."""
    record = {"seed": dispersion.seed, "seconds": f"{dispersion.seconds:.4g}"}
    # The inputs have a separate section.
    record |= {k: v for k, v in dispersion.attributes.items() if k != "inputs"}
    # By their names: a table of measured values may be longer than all the rest.
    if "files" in record:
        record["files"] = ", ".join(record["files"])
    lines = []
    for key, value in record.items():
        text = (
            ", ".join(f"{k} {v}" for k, v in value.items())
            if isinstance(value, dict)
            else str(value)
        )
        if text:
            lines.append(f"{key.replace('_', ' ')}: " + text.replace("\n", "\n    "))
    return "\n".join(lines)
