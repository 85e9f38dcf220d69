"""The style that all figures share: quiet axes, colours that differ in print and for colour-blind
readers."""

import textwrap
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Okabe and Ito, Color Universal Design (2008), in an order of good contrast on white.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
BAD = "#B00020"
GRID = "#D9D9D9"
MUTED = "#707070"


def dress(axes: "Axes", title: str = "", across: str = "", up: str = "") -> None:
    """Give axes a title, labels and a light grid behind the data.

    **Arguments**

    - `axes`: of matplotlib.
    - `title`: above the axes.
    - `across`, `up`: labels of the horizontal and the vertical axis.
    """
    axes.set_title(title, loc="left", fontsize=10, fontweight="bold")
    axes.set_xlabel(across, fontsize=9)
    axes.set_ylabel(up, fontsize=9)
    axes.tick_params(labelsize=8)
    axes.grid(True, color=GRID, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def headline(figure: "Figure", title: str) -> None:
    """Give a figure its title, at the left; a long one is wrapped, so that it is not cut off.

    **Arguments**

    - `figure`: of matplotlib.
    - `title`: above all axes.
    """
    # Letters of this size and weight are a tenth of an inch wide, in the mean.
    letters = max(int(10.0 * figure.get_figwidth()), 20)
    words = textwrap.fill(title, letters)
    figure.suptitle(words, fontsize=12, fontweight="bold", x=0.01, ha="left")
