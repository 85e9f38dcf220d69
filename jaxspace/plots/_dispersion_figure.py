"""A dispersion on one sheet: two outputs against each other, histograms of the outputs, and what
makes them scatter."""

from typing import TYPE_CHECKING, Any

import numpy as np

from ..dispersion import Dispersion, Row
from ._style import BAD, COLOURS, dress

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST = 6  # outputs that one sheet can show legibly


def dispersion_figure(
    dispersion: Dispersion,
    outputs: tuple[str, ...] | list[str] | None = None,
    *,
    scatter: tuple[str, str] | None = None,
    count: int = 5,
    title: str = "",
) -> "Figure":
    """A matplotlib figure of a dispersion.

    - `outputs`: which outputs get a histogram with the limits of the middle 99 % of the runs, and
      beside it the `count` largest contributors to its variance; the first six by default.
    - `scatter`: the two quantities, outputs or inputs, of the scatter plot at the top; perigee over
      apogee where there are such, else the first two outputs.

    Raises `InputError` for a name that is no output."""
    from matplotlib.figure import Figure

    names = list(dispersion.outputs)[:MOST] if outputs is None else list(outputs)
    pair = chosen_pair(dispersion, names) if scatter is None else scatter
    top = 0 if pair is None else 1
    figure = Figure(figsize=(10.0, 3.4 * top + 2.1 * len(names) + 0.7), layout="constrained")
    figure.suptitle(title or heading(dispersion), fontsize=12, fontweight="bold", x=0.01, ha="left")
    grid = figure.add_gridspec(top + len(names), 2, height_ratios=[1.7] * top + [1.0] * len(names))
    if pair is not None:
        _scatter(figure.add_subplot(grid[0, :]), dispersion, *pair)
    rows = {row.name: row for row in dispersion.table()}
    for number, name in enumerate(names):
        values = dispersion.values(name)
        _histogram(
            figure.add_subplot(grid[top + number, 0]), dispersion, name, values, rows.get(name)
        )
        _contributors(figure.add_subplot(grid[top + number, 1]), dispersion, name, count)
    return figure


def heading(dispersion: Dispersion) -> str:
    """How many runs there are, and how many of them failed."""
    failed = sum(f.count for f in dispersion.failed)
    return f"{dispersion.runs} runs, seed {dispersion.seed}" + (
        f", {failed} failed" if failed else ", none failed"
    )


def chosen_pair(dispersion: Dispersion, names: list[str]) -> tuple[str, str] | None:
    """The two outputs worth plotting against each other: apogee and perigee, else the first two,
    else none."""
    for far, near in (("apogee", "perigee"), ("apoapsis", "periapsis")):
        both = [[n for n in dispersion.outputs if word in n] for word in (far, near)]
        if all(both):
            return both[0][0], both[1][0]
    return (names[0], names[1]) if len(names) > 1 else None


def shown(dispersion: Dispersion, *names: str) -> np.ndarray:
    """The good runs in which all the named quantities are finite."""
    return dispersion.good & np.all([np.isfinite(dispersion.values(n)) for n in names], axis=0)


def _scatter(axes: Any, dispersion: Dispersion, across: str, up: str) -> None:
    kept = shown(dispersion, across, up)
    x, y = dispersion.values(across)[kept], dispersion.values(up)[kept]
    size, alpha = (16.0, 0.7) if x.size < 500 else (6.0, 0.35)
    axes.scatter(
        x,
        y,
        s=size,
        alpha=alpha,
        color=COLOURS[0],
        linewidths=0.0,
        rasterized=x.size > 5000,
        label="one run",
    )
    if x.size:
        axes.plot(
            np.mean(x),
            np.mean(y),
            marker="+",
            markersize=13,
            markeredgewidth=2.0,
            color=COLOURS[1],
            linestyle="",
            label="mean",
        )
        legend = axes.legend(fontsize=8, frameon=True, edgecolor="none", framealpha=0.8)
        for handle in legend.legend_handles:
            handle.set_alpha(1.0)
    dress(
        axes,
        f"{_plain(up)} against {_plain(across)}",
        dispersion.label(across),
        dispersion.label(up),
    )


def _plain(name: str) -> str:
    return name.replace("_", " ")


def _histogram(
    axes: Any, dispersion: Dispersion, name: str, values: np.ndarray, row: Row | None
) -> None:
    kept = values[shown(dispersion, name)]
    if kept.size and row is not None:
        axes.hist(kept, bins=int(np.clip(np.sqrt(kept.size), 8, 60)), color=COLOURS[0], alpha=0.75)
        axes.axvline(row.mean, color=COLOURS[1], linewidth=1.6)
        for limit in (row.low, row.high):
            axes.axvline(limit, color=COLOURS[6], linewidth=1.1, linestyle="--")
        _subtitle(axes, summary(row))
    else:
        axes.text(
            0.5, 0.5, "no good run", ha="center", va="center", color=BAD, transform=axes.transAxes
        )
    dress(axes, "", dispersion.label(name), "runs")
    axes.set_title(_plain(name), loc="left", fontsize=10, fontweight="bold", pad=17)


def _contributors(axes: Any, dispersion: Dispersion, name: str, count: int) -> None:
    found = contributors_or_none(dispersion, name, count)
    dress(axes, "", "share of the variance, %")
    if found is None:
        axes.text(
            0.5,
            0.5,
            "too few runs, or nothing scatters",
            ha="center",
            va="center",
            transform=axes.transAxes,
            fontsize=9,
        )
        axes.set_yticks([])
        return
    inputs, shares = list(found.shares), [100.0 * s for s in found.shares.values()]
    bars = axes.barh(inputs, shares, color=COLOURS[2], height=0.7)
    axes.bar_label(bars, [f"{s:.1f}" for s in shares], padding=3, fontsize=8)
    axes.set_yticks(inputs, [_plain(n) for n in inputs])
    axes.invert_yaxis()
    axes.set_xlim(0.0, max(10.0, 1.18 * max(shares)))
    axes.grid(False, axis="y")
    axes.set_title(
        f"contributors to {_plain(name)}", loc="left", fontsize=10, fontweight="bold", pad=17
    )
    _subtitle(axes, explained(found.r_squared))


def _subtitle(axes: Any, text: str) -> None:
    """A line between the title and the axes, which must not claim width of its own in the
    layout."""
    axes.text(0.0, 1.03, text, transform=axes.transAxes, fontsize=7.5, va="bottom").set_in_layout(
        False
    )


def summary(row: Row) -> str:
    """Mean, deviation and limits of an output, to the digits that its deviation gives a meaning."""
    mean, low, high = (rounded(x, row.std) for x in (row.mean, row.low, row.high))
    return f"mean {mean}, deviation {row.std:.3g}; 99 % within {low} … {high}"


def rounded(value: float, deviation: float) -> str:
    """The value with as many decimals as a hundredth of the deviation has."""
    if not (np.isfinite(value) and np.isfinite(deviation) and deviation > 0.0):
        return f"{value:.6g}"
    decimals = 2 - int(np.floor(np.log10(deviation)))
    return f"{value:.{max(decimals, 0)}f}" if decimals <= 6 else f"{value:.4g}"


def explained(r_squared: float) -> str:
    """What R^2 says about the shares."""
    sentence = f"each input by itself: {100.0 * max(r_squared, 0.0):.1f} % of the variance"
    return sentence if r_squared >= 0.5 else sentence + ", so shares say little"


def contributors_or_none(dispersion: Dispersion, name: str, count: int) -> Any:
    """The contributors, or `None` where there is nothing to find or too few runs to find it."""
    dispersion.values(name)
    try:
        found = dispersion.contributors(name, count)
    except ValueError:
        return None
    return found if found.shares else None
