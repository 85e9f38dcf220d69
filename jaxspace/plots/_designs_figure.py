"""Figure of an output of several designs over the same runs."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..core import InputError
from ..core.common_units import factor_between
from ..core.extras import extra
from ._bins import MOST_BINS
from ._style import COLOURS, MUTED, dress, headline

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..statistics import Dispersion


def designs_figure(
    designs: Mapping[str, "Dispersion"],
    output: str,
    limits: Sequence[float] = (),
    title: str = "",
) -> "Figure":
    """Histograms of an output of several designs over one another.

    **Arguments**

    - `designs`: the runs of each, by the name of the design; all are shown in the unit of the
      first.
    - `output`: name of the output.
    - `limits`: lines across the histograms, in the unit of the first design.
    - `title`: of the figure.

    **Raises** `InputError` for an unknown output, and for one with incompatible units in the
    designs; `ImportError` where matplotlib is not installed.
    """
    with extra("app"):
        from matplotlib.figure import Figure as NewFigure

    unit = next(iter(designs.values())).units.get(output, "")
    values = {
        name: _factor(name, output, runs.units.get(output, ""), unit)
        * runs.values(output)[runs.good].astype(float)
        for name, runs in designs.items()
    }
    values = {name: x[np.isfinite(x)] for name, x in values.items()}
    figure = NewFigure(figsize=(7.0, 3.8), layout="constrained")
    axes = figure.subplots()
    if title:
        headline(figure, title)
    # The same bins for all, so that areas compare.
    every = np.concatenate(list(values.values()))
    edges = np.histogram_bin_edges(every, MOST_BINS).tolist() if every.size else [0.0, 1.0]
    for (name, x), colour in zip(values.items(), COLOURS, strict=False):
        axes.hist(x, edges, color=colour, alpha=0.25)
        axes.hist(x, edges, color=colour, histtype="step", linewidth=1.4, label=name)
    for limit in limits:
        axes.axvline(limit, color=MUTED, linewidth=1.0, linestyle="--")
    label = next(iter(designs.values())).label(output)
    dress(axes, "", label, "runs")
    axes.legend(fontsize=8, frameon=False)
    return figure


def _factor(name: str, output: str, given: str, shown: str) -> float:
    """The number of units `shown` in one unit `given`, for an output of a design."""
    factor = factor_between(given, shown)
    if factor is None:
        raise InputError(
            f"{output} is in {given or 'no unit'} in the design {name!r}, and in "
            f"{shown or 'no unit'} in the first one: all designs must use units of the same "
            "dimension."
        )
    return factor
