"""Figure of a search: objective, violation and gradient after each of its steps."""

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Array, Float

from ..core.extras import extra
from ._style import COLOURS, dress, headline

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def convergence_figure(history: Float[Array, "rows 3"], title: str = "") -> "Figure":
    """Objective, violation and gradient over the steps of a search.

    **Arguments**

    - `history`: of an `optimization.Minimum`; rows of NaN are steps not taken.
    - `title`: of the figure.

    **Raises** `ImportError` where matplotlib is not installed.
    """
    with extra("app"):
        from matplotlib.figure import Figure as NewFigure

    rows = np.asarray(history)
    rows = rows[~np.isnan(rows[:, 0])]
    steps = np.arange(1, len(rows) + 1)
    figure = NewFigure(figsize=(9.0, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    if title:
        headline(figure, title)
    left.plot(steps, rows[:, 0], color=COLOURS[0])
    dress(left, "Objective", "step", "objective, scaled")
    for column, name, colour in ((1, "violation", COLOURS[1]), (2, "gradient", COLOURS[2])):
        # A constraint that is met exactly has no place on a logarithmic axis.
        size = np.where(rows[:, column] > 0.0, rows[:, column], np.nan)
        right.semilogy(steps, size, color=colour, label=name, marker=".", markersize=4)
    dress(right, "Residuals", "step")
    right.legend(fontsize=8, frameon=False)
    return figure
