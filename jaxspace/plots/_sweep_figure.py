"""Figure of a sweep: curves over one input, heat maps over two."""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..core import InputError
from ..core.extras import extra
from ..core.text import in_words
from ._style import COLOURS, dress, headline

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ..statistics import Dispersion
    from ..statistics.sweeps import SweepTable

TITLES = {
    "mean": "mean of {}",
    "std": "standard deviation of {}",
    "violated": "violations of {} [%]",
}
# Cells of a heat map that show their number.
MOST_NUMBERS = 150
# Values of an input that are the ticks of its axis.
MOST_TICKS = 10


def sweep_figure(
    result: "Dispersion",
    outputs: Sequence[str] | None = None,
    *,
    take: str = "mean",
    x: str | None = None,
    y: str | None = None,
    at: Mapping[str, float] | None = None,
    title: str = "",
) -> "Figure":
    """A statistic of outputs over the swept inputs: a curve over one input, with a band of one
    standard deviation about the mean; a heat map over two; coloured points for rows that do not
    fill a quarter of the grid of their values.

    **Arguments**

    - `result`: of a campaign with a sweep.
    - `outputs`: their names; by default the first six, or those with a requirement.
    - `take`: "mean", "std", or "violated" for outputs with a requirement.
    - `x`, `y`: the swept inputs on the axes; by default the first ones with several values.
    - `at`: the values of further swept inputs; by default the first of each.
    - `title`: of the figure.

    **Raises** `InputError` for a campaign without a sweep, for unknown names, and without outputs;
    `ImportError` where matplotlib is not installed."""
    with extra("app"):
        from matplotlib.figure import Figure

    table = result.by_row()
    if take not in TITLES:
        raise InputError(f"take is {take!r}: it must be one of {', '.join(TITLES)}.")
    names = list(getattr(table, take, table.mean))[:6] if outputs is None else list(outputs)
    if not names:
        raise InputError("outputs is empty: there is nothing to draw.")
    axes_names = [name for name in table.varying if name not in (x, y)]
    x = axes_names.pop(0) if x is None and axes_names else x
    y = axes_names.pop(0) if y is None and axes_names else y
    wide = min(len(names), 2)
    high = math.ceil(len(names) / wide)
    figure = Figure(figsize=(1.5 + 4.6 * wide, 0.6 + 3.5 * high), layout="constrained")
    panels = figure.subplots(high, wide, squeeze=False).ravel()
    for axes, name in zip(panels, names, strict=False):
        label = TITLES[take].format(in_words(name) if take == "violated" else result.label(name))
        if y is None:
            _curve(axes, table, result, name, x, take, label)
        else:
            assert x is not None
            _map(axes, table, result, name, (x, y), take, at or {}, label)
    for axes in panels[len(names) :]:
        axes.set_visible(False)
    others = [name for name in table.varying if name not in (x, y)]
    fixed = ", ".join(
        f"{result.label(name)} = {(at or {}).get(name, table.columns[name][0]):.6g}"
        for name in others
    )
    if title or (fixed and y is not None):
        headline(figure, " at ".join(filter(None, (title, fixed if y is not None else ""))))
    return figure


def _curve(
    axes: "Axes",
    table: "SweepTable",
    result: "Dispersion",
    name: str,
    x: str | None,
    take: str,
    label: str,
) -> None:
    """The statistic over one input, or over the rows where none varies."""
    values = _shown(table, name, take)
    across = np.arange(len(values)) if x is None else table.columns[x]
    order = np.argsort(across, kind="stable")
    across, values = across[order], values[order]
    dress(axes, "", "row" if x is None else result.label(x), label)
    axes.plot(across, values, "o-", color=COLOURS[0], markersize=4)
    std = table.std[name][order]
    if take == "mean" and np.isfinite(std).any():
        axes.fill_between(across, values - std, values + std, color=COLOURS[0], alpha=0.2, lw=0)


def _map(
    axes: "Axes",
    table: "SweepTable",
    result: "Dispersion",
    name: str,
    on: tuple[str, str],
    take: str,
    at: Mapping[str, float],
    label: str,
) -> None:
    """The statistic over two inputs, as a heat map, or as points of few rows of it."""
    x, y = on
    dress(axes, "", result.label(x), result.label(y))
    axes.grid(False)
    places = [np.unique(table.columns[n]) for n in on]
    cells = places[0].size * places[1].size
    rows = np.unique(np.stack([table.columns[n] for n in on]), axis=1).shape[1]
    if 4 * rows < cells:
        values = _shown(table, name, take)
        drawn = axes.scatter(table.columns[x], table.columns[y], c=values, cmap="viridis")
    else:
        grid = table.grid(name, x, y, take, at)
        for ticked, cells_on in ((axes.set_xticks, grid.x), (axes.set_yticks, grid.y)):
            if cells_on.size <= MOST_TICKS:
                ticked(cells_on, [f"{place:.4g}" for place in cells_on])
        values = 100.0 * grid.values if take == "violated" else grid.values
        drawn = axes.pcolormesh(_edges(grid.x), _edges(grid.y), values, cmap="viridis")
        if values.size <= MOST_NUMBERS:
            _numbers(axes, grid.x, grid.y, values)
    bar = axes.figure.colorbar(drawn, ax=axes)
    bar.set_label(label, fontsize=9)
    bar.ax.tick_params(labelsize=8)


def _shown(table: "SweepTable", name: str, take: str) -> np.ndarray:
    values = table.statistic(name, take)
    return 100.0 * values if take == "violated" else values


def _edges(places: np.ndarray) -> np.ndarray:
    """The edges of cells about places in rising order."""
    if places.size == 1:
        half = 0.5 * abs(float(places[0])) or 0.5
        return np.array([places[0] - half, places[0] + half])
    middle = 0.5 * (places[1:] + places[:-1])
    return np.concatenate([[2.0 * places[0] - middle[0]], middle, [2.0 * places[-1] - middle[-1]]])


def _numbers(axes: "Axes", x: np.ndarray, y: np.ndarray, values: np.ndarray) -> None:
    """The number of each cell, with the digits that tell the cells apart."""
    finite = values[np.isfinite(values)]
    if finite.size == 0:
        return
    low, high = float(finite.min()), float(finite.max())
    digits = 3
    if high > low:
        digits += max(math.ceil(math.log10(max(abs(low), abs(high)) / (high - low))), 0)
    for i, j in zip(*np.nonzero(np.isfinite(values)), strict=True):
        # Dark cells have low values.
        bright = values[i, j] > 0.5 * (low + high)
        axes.text(
            float(x[j]),
            float(y[i]),
            f"{values[i, j]:.{min(digits, 6)}g}",
            ha="center",
            va="center",
            fontsize=6.5,
            color="black" if bright else "white",
        )
