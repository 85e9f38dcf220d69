"""A dispersion as one page for any browser: everything is in the file, no network is needed."""

import os
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ._dispersion_figure import (
    chosen_pair,
    contributors_or_none,
    explained,
    heading,
    rounded,
    shown,
)
from ._style import COLOURS

if TYPE_CHECKING:
    from collections.abc import Callable

    from plotly.graph_objects import Figure

    from ..dispersion import Dispersion

MOST_POINTS = 10000
"""Points of the scatter plot: more make a browser slow."""

STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #222; }
body { max-width: 1080px; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.5rem; margin-bottom: 0.2rem; } h2 { font-size: 1.15rem; margin-top: 2.2rem; }
p.note { color: #555; margin-top: 0.2rem; } p.bad { color: #b00020; }
table { border-collapse: collapse; font-size: 14px; } .wide { overflow-x: auto; }
th, td { padding: 0.25rem 0.8rem; border-bottom: 1px solid #ddd; text-align: right; }
td { font-variant-numeric: tabular-nums; }
th:first-child, td:first-child, th:nth-child(2), td:nth-child(2) { text-align: left; }
pre { background: #f6f6f6; padding: 0.8rem; overflow-x: auto; font-size: 13px; }
"""


def dispersion_page(
    dispersion: "Dispersion",
    path: str | os.PathLike[str],
    *,
    count: int = 8,
    title: str = "Dispersion",
) -> Path:
    """Write a page with a table of the outputs and interactive plots.

    It holds a scatter plot of any two quantities, histograms, the largest contributors to each
    output, the failures, and the record of how the runs were made.

    **Arguments**

    - `dispersion`: the result of a campaign.
    - `path`: of the HTML file.
    - `count`: of contributors for each output.
    - `title`: of the page.

    **Returns** the path.
    """
    body = [
        f"<h1>{escape(title)}</h1>",
        f'<p class="note">{escape(heading(dispersion))}.</p>',
        *(f'<p class="bad">{f.count} runs: {escape(f.sentence)}</p>' for f in dispersion.failed),
        "<h2>Outputs</h2>",
        _table(dispersion),
        *_figures(dispersion, count),
        "<h2>Record</h2>",
        f"<pre>{escape(_record(dispersion))}</pre>",
    ]
    head = (
        '<meta charset="utf-8"><meta name="viewport" content="width=device-width">'
        f"<title>{escape(title)}</title>"
    )
    page = (
        f'<!DOCTYPE html>\n<html lang="en"><head>{head}<style>{STYLE}</style></head>\n<body>\n'
        + "\n".join(body)
        + "\n</body></html>\n"
    )
    path = Path(path)
    path.write_text(page, encoding="utf-8")
    return path


def _table(dispersion: "Dispersion") -> str:
    """The table of the outputs, in HTML."""
    heads = (
        "output",
        "unit",
        "mean",
        "deviation",
        "0.5 % limit",
        "99.5 % limit",
        "least",
        "greatest",
        "runs",
    )
    lines = ["<tr>" + "".join(f"<th>{h}</th>" for h in heads) + "</tr>"]
    for row in dispersion.table():
        numbers = [rounded(x, row.std) for x in (row.mean, row.low, row.high, row.min, row.max)]
        cells = [
            row.name.replace("_", " "),
            row.unit,
            numbers[0],
            f"{row.std:.3g}",
            *numbers[1:],
            str(row.runs),
        ]
        lines.append("<tr>" + "".join(f"<td>{escape(c)}</td>" for c in cells) + "</tr>")
    return '<div class="wide"><table>' + "\n".join(lines) + "</table></div>"


def _figures(dispersion: "Dispersion", count: int) -> list[str]:
    """The headings and plots, in HTML."""
    parts = [("Any two quantities", _scatter(dispersion)), ("Distribution", _histogram(dispersion))]
    parts += [
        (f"Contributors to {name.replace('_', ' ')}", _contributors(dispersion, name, count))
        for name in dispersion.outputs
    ]
    lines = []
    # The first plot brings plotly's script along for all of them.
    script = True
    for words, figure in parts:
        lines.append(f"<h2>{escape(words)}</h2>")
        if figure is None:
            lines.append('<p class="note">Too few good runs, or nothing scatters.</p>')
            continue
        lines.append(
            figure.to_html(
                full_html=False,
                include_plotlyjs=script,
                config={"displaylogo": False, "responsive": True},
            )
        )
        script = False
    return lines


def _layout(across: str, up: str, height: int = 460) -> dict[str, Any]:
    """The layout of a plot with the labels of its axes, in plotly's words."""
    axis = {"gridcolor": "#e3e3e3", "zerolinecolor": "#e3e3e3", "linecolor": "#888"}
    return {
        "template": "none",
        "height": height,
        "margin": {"l": 80, "r": 20, "t": 50, "b": 60},
        "xaxis": {**axis, "title": {"text": across}},
        "yaxis": {**axis, "title": {"text": up}, "automargin": True},
        "showlegend": False,
    }


def _menu(
    names: list[str], choice: "Callable[[str], list[dict[str, Any]]]", active: int, place: float
) -> dict[str, Any]:
    """A menu above the plot; `choice(name)` gives the arguments of plotly's update."""
    buttons = [
        {"label": name.replace("_", " "), "method": "update", "args": choice(name)}
        for name in names
    ]
    return {
        "buttons": buttons,
        "active": active,
        "x": place,
        "y": 1.13,
        "xanchor": "left",
        "yanchor": "bottom",
    }


def _scatter(dispersion: "Dispersion") -> "Figure":
    """Two quantities against each other, chosen by menus; a point shows the number of its run."""
    import plotly.graph_objects as go

    # Inputs that do not vary would be lines.
    names = [*dispersion.outputs, *(n for n, x in dispersion.inputs.items() if np.ptp(x) > 0.0)]
    across, up = chosen_pair(dispersion, list(dispersion.outputs)) or (names[-1], names[0])
    good = np.flatnonzero(shown(dispersion))[:MOST_POINTS]
    data = {name: _listed(dispersion.values(name)[good]) for name in names}
    points = go.Scattergl(
        x=data[across],
        y=data[up],
        mode="markers",
        marker={"size": 5, "opacity": 0.5, "color": COLOURS[0]},
        customdata=good.tolist(),
        hovertemplate=(
            "run %{customdata}<br>%{xaxis.title.text}: %{x}<br>"
            "%{yaxis.title.text}: %{y}<extra></extra>"
        ),
    )
    figure = go.Figure(points, _layout(dispersion.label(across), dispersion.label(up), 560))
    menus = [
        _menu(
            names,
            # Bound now: the loop changes the name of the axis before plotly is asked.
            lambda n, a=a: [{a: [data[n]]}, {f"{a}axis.title.text": dispersion.label(n)}],
            names.index(first),
            place,
        )
        for a, first, place in (("x", across, 0.0), ("y", up, 0.4))
    ]
    figure.update_layout(updatemenus=menus, margin={"t": 90})
    for text, place in (("across", 0.0), ("up", 0.4)):
        note = {
            "text": text,
            "showarrow": False,
            "xref": "paper",
            "yref": "paper",
            "xanchor": "left",
            "yanchor": "bottom",
        }
        figure.add_annotation(x=place, y=1.05, font={"size": 12, "color": "#555"}, **note)
    return figure


def _listed(values: np.ndarray) -> list[float]:
    """The values with five digits beyond the first one of their deviation: the file stays small."""
    finite = values[np.isfinite(values)]
    deviation = float(np.std(finite)) if finite.size else 0.0
    decimals = 5 - int(np.floor(np.log10(deviation))) if deviation > 0.0 else 15
    return np.round(values.astype(float), decimals).tolist()


def _histogram(dispersion: "Dispersion") -> "Figure":
    """The histogram of an output, chosen by a menu."""
    import plotly.graph_objects as go

    names = list(dispersion.outputs)
    data = {name: _listed(dispersion.values(name)[shown(dispersion, name)]) for name in names}
    figure = go.Figure(
        go.Histogram(x=data[names[0]], marker={"color": COLOURS[0]}),
        _layout(dispersion.label(names[0]), "runs"),
    )
    choice = _menu(
        names, lambda n: [{"x": [data[n]]}, {"xaxis.title.text": dispersion.label(n)}], 0, 0.0
    )
    return figure.update_layout(updatemenus=[choice], margin={"t": 80}, bargap=0.03)


def _contributors(dispersion: "Dispersion", name: str, count: int) -> "Figure | None":
    """A bar for each of the largest contributors, or `None` where there are none."""
    import plotly.graph_objects as go

    found = contributors_or_none(dispersion, name, count)
    if found is None:
        return None
    inputs = [n.replace("_", " ") for n in found.shares]
    shares = [100.0 * s for s in found.shares.values()]
    bars = go.Bar(
        x=shares,
        y=inputs,
        orientation="h",
        marker={"color": COLOURS[2]},
        text=[f"{s:.1f}" for s in shares],
        textposition="outside",
    )
    figure = go.Figure(bars, _layout("share of the variance, %", "", 130 + 28 * len(inputs)))
    # The largest share on top, with room for the number behind its bar.
    figure.update_yaxes(autorange="reversed").update_xaxes(
        range=[0.0, max(10.0, 1.15 * max(shares))]
    )
    return figure.update_layout(
        title={"text": explained(found.r_squared), "font": {"size": 13}, "x": 0.0, "xref": "paper"}
    )


def _record(dispersion: "Dispersion") -> str:
    """The record of how the runs were made, one line for each entry."""
    record = {
        "seed": dispersion.seed,
        "seconds": f"{dispersion.seconds:.4g}",
        **dispersion.attributes,
    }
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
