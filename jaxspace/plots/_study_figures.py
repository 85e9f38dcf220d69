"""Figures of the cost of accuracy, and of the influence of each effect."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np

from ..core.extras import extra
from ._style import COLOURS, MUTED, dress, headline

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure


# The tables are drawn with these functions, which therefore declare the parts of a table that they
# read, and do not import it; tests check their types.
@runtime_checkable
class CostRow(Protocol):
    """The attributes of a `jaxspace.studies.cost_table.Cost` for the figure."""

    @property
    def method(self) -> str: ...
    @property
    def precision(self) -> str: ...
    @property
    def tolerance(self) -> float | None: ...
    @property
    def error(self) -> float: ...
    @property
    def seconds(self) -> float: ...
    @property
    def evaluations(self) -> int: ...
    @property
    def gradient_error(self) -> float | None: ...
    @property
    def gradient_seconds(self) -> float | None: ...
    @property
    def failure(self) -> str: ...


@runtime_checkable
class CostPrice(Protocol):
    """The attributes of a `jaxspace.studies.cost_table.Price` for the figure."""

    @property
    def error(self) -> float: ...
    @property
    def seconds(self) -> float: ...


@runtime_checkable
class CostTable(Protocol):
    """The attributes of a `jaxspace.studies.AccuracyCost` for the figure."""

    @property
    def rows(self) -> Sequence[CostRow]: ...
    @property
    def reference_error(self) -> float: ...
    def prices(self) -> Sequence[CostPrice]: ...


@runtime_checkable
class InfluenceRow(Protocol):
    """The attributes of a `jaxspace.studies.budget_table.Influence` for the figure."""

    @property
    def effect(self) -> str: ...
    @property
    def influence(self) -> float: ...
    @property
    def share(self) -> float: ...


@runtime_checkable
class InfluenceTable(Protocol):
    """The attributes of a `jaxspace.studies.EffectBudget` for the figure."""

    @property
    def rows(self) -> Sequence[InfluenceRow]: ...
    @property
    def output(self) -> str: ...
    @property
    def unit(self) -> str: ...
    @property
    def tolerance(self) -> float | None: ...
    @property
    def dropped(self) -> Sequence[str]: ...


MARKS = {"float64": ("o", "-"), "float32": ("s", "--")}


def _figure(width: float, height: float) -> "Figure":
    """An empty figure. Raises `ImportError` where matplotlib is not installed."""
    with extra("app"):
        from matplotlib.figure import Figure
    return Figure(figsize=(width, height), layout="constrained")


def accuracy_cost_figure(cost: CostTable, *, title: str = "") -> "Figure":
    """The work-precision diagram of a run: error of the final state against time and evaluations.

    Where gradients were measured, their error against their time is shown as well. A dotted line
    is the error of the reference, and the grey steps are the price list: the least time for each
    error.

    **Arguments**

    - `cost`: the result of `accuracy_cost`.
    - `title`: of the figure.

    **Raises** `ImportError` where matplotlib is not installed.
    """
    gradient = any(row.gradient_seconds is not None for row in cost.rows)
    figure = _figure(12.6 if gradient else 9.0, 4.0)
    panels = figure.subplots(1, 3 if gradient else 2, sharey=True)
    if title:
        headline(figure, title)

    def error(row: CostRow) -> float:
        # An error below that of the reference is not known.
        return max(row.error, cost.reference_error)

    def evaluations(row: CostRow) -> float:
        # A closed form evaluates no vector field.
        return row.evaluations or np.nan

    def gradient_point(row: CostRow) -> tuple[float, float]:
        # Not every method has a gradient.
        if row.gradient_seconds is None or row.gradient_error is None:
            return np.nan, np.nan
        return 1e3 * row.gradient_seconds, row.gradient_error

    _curves(panels[0], cost, lambda r: (1e3 * r.seconds, error(r)))
    _curves(panels[1], cost, lambda r: (evaluations(r), error(r)))
    prices = cost.prices()
    steps = [1e3 * p.seconds for p in prices], [p.error for p in prices]
    if prices:
        look = {"color": MUTED, "linewidth": 5.0, "alpha": 0.3, "label": "cheapest"}
        panels[0].step(*steps, where="post", **look)
    dress(panels[0], "Time", "time of a run [ms]", "relative error of the final state")
    dress(panels[1], "Arithmetic", "evaluations of the vector field")
    if gradient:
        _curves(panels[2], cost, gradient_point)
        dress(panels[2], "Gradient", "time of a gradient [ms]", "relative error of the gradient")
        panels[2].tick_params(labelleft=True)
    for axes in panels[:2]:
        axes.axhline(cost.reference_error, color=MUTED, linewidth=0.9, linestyle=":")
    for axes in panels:
        _ticks(axes.xaxis)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, fontsize=8, loc="outside right center", frameon=False)
    return figure


def _ticks(axis: "Axis") -> None:
    """Plain numbers at 1, 2 and 5 of every decade, or only at 1 where there are many decades."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    low, high = axis.get_view_interval()
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < 1e2 * low else (1.0,)))
    axis.set_major_formatter(
        FuncFormatter(lambda x, _: f"{x:g}" if 1e-3 <= x < 1e5 else f"{x:.0e}")
    )
    axis.set_minor_formatter(NullFormatter())


def _curves(axes: "Axes", cost: CostTable, point: Callable[[CostRow], tuple[float, float]]) -> None:
    """A curve for each method and precision, over its tolerances."""
    names = list(dict.fromkeys(row.method for row in cost.rows))
    for name, precision in dict.fromkeys((row.method, row.precision) for row in cost.rows):
        rows = [
            r for r in cost.rows if (r.method, r.precision) == (name, precision) and not r.failure
        ]
        points = np.array([point(r) for r in rows], float).reshape(-1, 2)
        # An error of zero has no place on a logarithmic axis.
        points[:, 1] = np.maximum(points[:, 1], np.finfo(float).eps)
        mark, line = MARKS[precision]
        colour = COLOURS[names.index(name) % len(COLOURS)]
        axes.loglog(
            *points.T,
            mark + line,
            color=colour,
            label=f"{name}, {precision}",
            markersize=4,
            linewidth=1.3,
        )


def effect_budget_figure(budget: InfluenceTable, *, title: str = "") -> "Figure":
    """Two bars for each effect: its change of the output, and its share of the arithmetic.

    Effects that may be left out are pale.

    **Arguments**

    - `budget`: the result of `effect_budget`.
    - `title`: of the figure.

    **Raises** `ImportError` where matplotlib is not installed.
    """
    figure = _figure(9.0, 1.3 + 0.45 * len(budget.rows))
    left, right = figure.subplots(1, 2, sharey=True)
    rows = sorted(budget.rows, key=lambda r: r.influence)
    names = [r.effect for r in rows]
    places = np.arange(len(rows))
    pale = [0.35 if r.effect in budget.dropped else 1.0 for r in rows]
    # The length of the bar of an effect without influence, on a logarithmic axis.
    least = 0.1 * min([r.influence for r in rows if r.influence > 0.0] or [1.0])
    for place, row, alpha in zip(places, rows, pale, strict=True):
        left.barh(place, max(row.influence, least), color=COLOURS[0], alpha=alpha, height=0.6)
        right.barh(place, 100.0 * row.share, color=COLOURS[1], alpha=alpha, height=0.6)
    # Stated, because bars of one length alone leave an axis without a length.
    lengths = [max(row.influence, least) for row in rows]
    lengths += [] if budget.tolerance is None else [budget.tolerance]
    left.set_xlim(0.5 * min(lengths), 2.0 * max(lengths))
    left.set_xscale("log")
    left.set_yticks(places, names)
    if budget.tolerance is not None:
        left.axvline(
            budget.tolerance, color=MUTED, linewidth=1.2, linestyle="--", label="tolerance"
        )
        left.legend(fontsize=8, frameon=False)
    unit = f" [{budget.unit}]" if budget.unit else ""
    dress(
        left, title or "Influence of the effects", f"change of the {budget.output} without it{unit}"
    )
    dress(right, "Cost of the effects", "share of the arithmetic [%]")
    return figure
