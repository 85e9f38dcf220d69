"""A dispersion in one figure: a scatter plot, histograms of the outputs, and their contributors."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..core.extras import extra
from ..core.text import in_words
from ._bins import bins
from ._style import BAD, COLOURS, dress, headline

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ..statistics import Dispersion
    from ..statistics.contributors import Contributors
    from ..statistics.table import Row

LEAST_SHARE = 5e-4
"""The least share of the variance that is shown, with one digit of a percent."""
MOST_OUTPUTS = 6
"""Outputs that one figure shows legibly."""


def dispersion_figure(
    dispersion: "Dispersion",
    outputs: tuple[str, ...] | list[str] | None = None,
    *,
    scatter: tuple[str, str] | None = None,
    count: int = 5,
    title: str = "",
    nominal: Mapping[str, float] | None = None,
) -> "Figure":
    """A matplotlib figure of a dispersion.

    `dispersion_figure(result).savefig("dispersion.png")` shows for each output a histogram with the
    limits of the middle 99 % of the runs, and its largest contributors.

    **Arguments**

    - `dispersion`: the result of a campaign.
    - `outputs`: which outputs are shown; the first six by default.
    - `scatter`: two quantities, outputs or inputs, for the scatter plot at the top; by default
      perigee over apogee if available, else the first two outputs.
    - `count`: of contributors for each output.
    - `title`: of the figure; by default the number of runs.
    - `nominal`: the outputs of the nominal run, in the units of the dispersion.

    **Raises** `InputError` for a name that is not an output.
    """
    with extra("app"):
        from matplotlib.figure import Figure

    names = list(dispersion.outputs)[:MOST_OUTPUTS] if outputs is None else list(outputs)
    pair = chosen_pair(dispersion, names) if scatter is None else scatter
    # Rows above those of the outputs.
    top = 0 if pair is None else 1
    # Higher for places on the ground, which have one scale in both directions.
    height = 1.7 if pair is None or not on_ground(dispersion, *pair) else 3.0
    inches = 2.0 * height * top + 2.1 * len(names) + 0.7
    figure = Figure(figsize=(10.0, inches), layout="constrained")
    headline(figure, title or heading(dispersion))
    grid = figure.add_gridspec(
        top + len(names), 2, height_ratios=[height] * top + [1.0] * len(names)
    )
    if pair is not None:
        _scatter(figure.add_subplot(grid[0, :]), dispersion, *pair)
    rows = {row.name: row for row in dispersion.table()}
    for number, name in enumerate(names):
        values = dispersion.values(name)
        _histogram(
            figure.add_subplot(grid[top + number, 0]),
            dispersion,
            name,
            values,
            rows.get(name),
            (nominal or {}).get(name, np.nan),
        )
        _contributors(figure.add_subplot(grid[top + number, 1]), dispersion, name, count)
    return figure


def heading(dispersion: "Dispersion") -> str:
    """The number of runs, and of those that failed."""
    failed = sum(f.count for f in dispersion.failed)
    planned = f" of {dispersion.planned_runs} planned" if dispersion.missing_runs else ""
    return f"{dispersion.runs}{planned} runs, seed {dispersion.seed}" + (
        f", {failed} failed" if failed else ", none failed"
    )


def chosen_pair(dispersion: "Dispersion", names: list[str]) -> tuple[str, str] | None:
    """The outputs of the scatter plot: apogee and perigee, else the first two, else none."""
    for far, near in (("apogee", "perigee"), ("apoapsis", "periapsis")):
        both = [[n for n in dispersion.outputs if word in n] for word in (far, near)]
        if all(both):
            return both[0][0], both[1][0]
    return (names[0], names[1]) if len(names) > 1 else None


def shown(dispersion: "Dispersion", *names: str) -> np.ndarray:
    """Whether each run is good, and all the named quantities finite in it, (runs,)."""
    return dispersion.good & np.all([np.isfinite(dispersion.values(n)) for n in names], axis=0)


def on_ground(dispersion: "Dispersion", across: str, up: str) -> bool:
    """Whether these are the places of the landings, to the east and to the north."""
    return (across, up) == ("east", "north") and dispersion.footprint() is not None


def _scatter(axes: "Axes", dispersion: "Dispersion", across: str, up: str) -> None:
    """Two quantities against each other, a point for each good run."""
    good = shown(dispersion, across, up)
    x = dispersion.values(across)[good]
    y = dispersion.values(up)[good]
    # Many points are drawn smaller and paler, so that their density shows.
    size, alpha = (16.0, 0.7) if x.size < 500 else (6.0, 0.35)
    axes.scatter(
        x,
        y,
        s=size,
        alpha=alpha,
        color=COLOURS[0],
        linewidths=0.0,
        # In a vector file many points would be slow to draw.
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
            # The sample of a pale point would be hard to see.
            if handle is not None:
                handle.set_alpha(1.0)
    dress(
        axes,
        f"{in_words(up)} vs. {in_words(across)}",
        dispersion.label(across),
        dispersion.label(up),
    )
    if on_ground(dispersion, across, up):
        # A metre is a metre in both directions.
        axes.set_aspect("equal", adjustable="datalim")


def _histogram(
    axes: "Axes",
    dispersion: "Dispersion",
    name: str,
    values: np.ndarray,
    row: "Row | None",
    nominal: float,
) -> None:
    """The histogram of a quantity, with its mean, its limits, its nominal value and its
    requirement."""
    good = values[shown(dispersion, name)]
    if good.size and row is not None:
        start, counts, width = bins(good)
        places = start + width * np.arange(counts.size)
        axes.bar(places, counts, width, align="edge", color=COLOURS[0], alpha=0.75)
        axes.axvline(row.mean, color=COLOURS[1], linewidth=1.6)
        for limit in (row.low, row.high):
            # Matplotlib would have an infinite one move the axis.
            if np.isfinite(limit):
                axes.axvline(limit, color=COLOURS[6], linewidth=1.1, linestyle="--")
        words = summary(row)
        if np.isfinite(nominal):
            axes.axvline(nominal, color=COLOURS[2], linewidth=1.6, linestyle=":")
            words += f"; nominal {row.shown(nominal)}"
        _requirements(axes, dispersion.requirements.get(name, ()))
        _subtitle(axes, words)
    else:
        # Good runs without a finite value have no place either.
        words = "no finite value" if dispersion.good.any() else "no successful run"
        axes.text(0.5, 0.5, words, ha="center", va="center", color=BAD, transform=axes.transAxes)
    dress(axes, "", dispersion.label(name), "runs")
    axes.set_title(in_words(name), loc="left", fontsize=10, fontweight="bold", pad=17)


def _requirements(axes: "Axes", limits: Sequence[float | None]) -> None:
    """Lines at the limits of an output; one that is far from the runs is marked at the edge,
    because at its position it would compress them to a line."""
    low, high = axes.get_xlim()
    room = 0.6 * (high - low)
    for limit in limits:
        if limit is None:
            continue
        if low - room < limit < high + room:
            axes.axvline(limit, color=BAD, linewidth=1.4, linestyle=(0, (8, 3)))
            continue
        right = limit > high
        axes.annotate(
            f"required {limit:.6g} →" if right else f"← required {limit:.6g}",
            (1.0 if right else 0.0, 0.95),
            xycoords="axes fraction",
            ha="right" if right else "left",
            va="top",
            fontsize=8,
            color=BAD,
        )


def _contributors(axes: "Axes", dispersion: "Dispersion", name: str, count: int) -> None:
    """A bar for each of the largest contributors to the variance of an output."""
    result = contributors_or_none(dispersion, name, count)
    dress(axes, "", "contribution to the variance, %")
    if result is None:
        axes.text(
            0.5,
            0.5,
            "too few runs, or no dispersion",
            ha="center",
            va="center",
            transform=axes.transAxes,
            fontsize=9,
        )
        axes.set_yticks([])
        return
    inputs = list(result.shares)
    # A share of zero may be estimated below zero.
    shares = [100.0 * max(share, 0.0) for share in result.shares.values()]
    bars = axes.barh(inputs, shares, color=COLOURS[2], height=0.7)
    axes.bar_label(bars, [f"{s:.1f}" for s in shares], padding=3, fontsize=8)
    axes.set_yticks(inputs, [in_words(n) for n in inputs])
    # Bars are stacked upwards: the largest contributor belongs on top.
    axes.invert_yaxis()
    # Room for the number behind the longest bar.
    axes.set_xlim(0.0, max(10.0, 1.18 * max(shares)))
    axes.grid(False, axis="y")
    axes.set_title(
        f"contributors to {in_words(name)}", loc="left", fontsize=10, fontweight="bold", pad=17
    )
    _subtitle(axes, explained(result))


def _subtitle(axes: "Axes", text: str) -> None:
    """A line between the title and the axes."""
    line = axes.text(0.0, 1.03, text, transform=axes.transAxes, fontsize=7.5, va="bottom")
    # A long line must not make the axes narrower.
    line.set_in_layout(False)


def summary(row: "Row") -> str:
    """Mean, standard deviation and limits of an output, with the digits that its standard deviation
    justifies; and the number of runs outside the bins."""
    numbers = (row.shown(x) for x in (row.mean, row.std, row.low, row.high))
    words = "mean {}, std dev {}; 99 % within {} … {}".format(*numbers)
    return words + (f"; beyond the bins: {row.missing()}" if row.missing() else "")


def explained(contributors: "Contributors") -> str:
    """The sum of the shares and the unexplained rest, in words."""
    part = f"{100.0 * max(contributors.r_squared, 0.0):.1f} % from individual inputs"
    complete = contributors.r_squared >= 0.9995
    return part + ("" if complete else "; rest: interactions, nonlinear terms")


def contributors_or_none(dispersion: "Dispersion", name: str, count: int) -> "Contributors | None":
    """The contributors, or `None` without dispersion or with too few runs."""
    # An unknown name is an error of the caller; too few runs are not.
    dispersion.values(name)
    try:
        result = dispersion.contributors(name, count)
    except ValueError:
        return None
    # An input shown as 0.0 % is not a contributor.
    shares = {name: share for name, share in result.shares.items() if share >= LEAST_SHARE}
    return result._replace(shares=shares) if shares else None
