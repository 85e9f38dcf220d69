"""Figure of a flight log beside a run: each channel, and its residuals below."""

__all__ = ["log_figure"]

from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np

from ..core.extras import extra
from ._style import COLOURS, MUTED, dress, headline

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MEASURED, PREDICTED = "#303030", COLOURS[0]


@runtime_checkable
class _Channel(Protocol):
    """A channel as `jaxspace.io.log_comparison` makes it."""

    @property
    def name(self) -> str: ...
    @property
    def unit(self) -> str: ...
    @property
    def times(self) -> np.ndarray: ...
    @property
    def phase(self) -> np.ndarray: ...
    @property
    def measured(self) -> np.ndarray: ...
    @property
    def predicted(self) -> np.ndarray: ...
    @property
    def residual(self) -> np.ndarray: ...
    @property
    def mean(self) -> np.ndarray | None: ...
    @property
    def deviation(self) -> np.ndarray | None: ...


@runtime_checkable
class _Comparison(Protocol):
    @property
    def channels(self) -> tuple[_Channel, ...]: ...


def log_figure(comparison: _Comparison, title: str = "") -> "Figure":
    """Each channel of a log beside the run over the time, and the residuals below it.

    Shaded are two standard deviations of the campaign to either side of its mean, where the
    comparison has one; dotted lines separate the phases.

    **Arguments**

    - `comparison`: a `LogComparison` (`jaxspace.io.log_comparison`).
    - `title`: of the figure.

    **Raises** `ImportError` where matplotlib is not installed."""
    with extra("app"):
        from matplotlib.figure import Figure as NewFigure

    channels = [x for x in comparison.channels if x.times.size]
    figure = NewFigure(figsize=(7.5, 3.6 * len(channels)), layout="constrained")
    if title:
        headline(figure, title)
    ratios = [2.0, 1.0] * len(channels)
    axes = figure.subplots(len(ratios), 1, squeeze=False, height_ratios=ratios, sharex=True)[:, 0]
    for x, above, below in zip(channels, axes[::2], axes[1::2], strict=True):
        unit = f" ({x.unit})" if x.unit else ""
        _draw(above, x)
        dress(above, x.name, "", f"{x.name}{unit}")
        above.legend(fontsize=8, frameon=False)
        _draw_residuals(below, x)
        dress(below, "", "", f"log - run{unit}")
    axes[-1].set_xlabel("time of the run (s)", fontsize=9)
    return figure


def _draw(axes: "Axes", x: _Channel) -> None:
    if x.mean is not None and x.deviation is not None:
        low, high = x.mean - 2.0 * x.deviation, x.mean + 2.0 * x.deviation
        axes.fill_between(x.times, low, high, color=PREDICTED, alpha=0.2, linewidth=0.0)
    axes.plot(x.times, x.predicted, color=PREDICTED, linewidth=1.4, label="run")
    axes.plot(x.times, x.measured, ".", color=MEASURED, markersize=2.5, label="log")
    _borders(axes, x)


def _draw_residuals(axes: "Axes", x: _Channel) -> None:
    if x.mean is not None and x.deviation is not None:
        centre = x.mean - x.predicted
        low, high = centre - 2.0 * x.deviation, centre + 2.0 * x.deviation
        axes.fill_between(x.times, low, high, color=PREDICTED, alpha=0.2, linewidth=0.0)
    axes.axhline(0.0, color=PREDICTED, linewidth=1.0)
    axes.plot(x.times, x.residual, ".", color=MEASURED, markersize=2.5)
    _borders(axes, x)


def _borders(axes: "Axes", x: _Channel) -> None:
    """Dotted lines between the phases."""
    for k in np.flatnonzero(np.diff(x.phase)):
        middle = 0.5 * (x.times[k] + x.times[k + 1])
        axes.axvline(float(middle), color=MUTED, linewidth=0.8, linestyle=":")
