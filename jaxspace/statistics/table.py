"""The lines of a table of results: moments, extremes and limits of a quantity."""

__all__ = ["Row"]

import math
from typing import NamedTuple

import numpy as np

from ..core.printing import printed
from ._rounding import rounded
from .limits import quantile

LIMITS = (0.005, 0.995)
"""Quantiles that bound the middle 99 % of the runs."""


@printed()
class Row(NamedTuple):
    """One line of the table: a quantity over its successful runs.

    - `mean`, `std`: its moments, over the runs in which it is finite.
    - `low`, `high`: the limits of the middle 99 % of the runs, and `min`, `max` the extremes, in
      which infinite values count.
    - `runs`: the number of successful runs in which it is finite.
    - `above`, `below`: of those in which it is infinite and positive, or negative.
    - `undefined`: of those in which it is NaN, which are excluded from all statistics.
    - `min_run`, `max_run`: the numbers of the runs of the extremes; -1 where there is none.
    - `numerical_error`: in squares the mean over some hundred runs of the error that the tolerance
      of the steps leaves; NaN where it is not known.
    """

    name: str
    unit: str
    mean: float
    std: float
    low: float
    high: float
    min: float
    max: float
    runs: int
    above: int = 0
    below: int = 0
    undefined: int = 0
    min_run: int = -1
    max_run: int = -1
    numerical_error: float = math.nan

    @property
    def numerical_words(self) -> str:
        """The numerical error as a share of the standard deviation, "0.4 % of std"; empty where it
        is unknown."""
        share = 100.0 * self.numerical_error / self.std if self.std > 0.0 else math.nan
        return f"{share:.1g} % of std" if math.isfinite(share) else ""

    def shown(self, value: float) -> str:
        """A value of this quantity with the digits that its standard deviation justifies, as in
        every table."""
        return rounded(value, self.std)

    def missing(self) -> str:
        """Number of successful runs in which it is not finite, in words; empty if there are
        none."""
        counts = (("∞", self.above), ("-∞", self.below), ("not a number", self.undefined))
        return ", ".join(f"{words} in {count}" for words, count in counts if count)

    @property
    def warning(self) -> str:
        """Effect of these runs on the statistics, in sentences; empty if there are none."""
        if not self.missing():
            return ""
        good = self.runs + self.above + self.below + self.undefined
        left = (
            "Mean, standard deviation and contributions to the variance exclude them, limits count "
        )
        if not self.undefined:
            left += "them."
        elif self.above or self.below:
            left += "the infinite ones."
        else:
            left = "They are excluded from all statistics."
        return f"{self.name} is {self.missing()} of {good} successful runs. {left}"


def row_of(name: str, unit: str, x: np.ndarray, runs: np.ndarray) -> Row:
    """The row of a quantity with these values, those of all successful runs, whose numbers are
    `runs`."""
    # In double precision, so that the moments of many runs of single precision are accurate.
    runs = runs[~np.isnan(x)]
    known = x[~np.isnan(x)].astype(float)
    undefined = x.size - known.size
    if known.size == 0:
        return Row(name, unit, *(float("nan"),) * 6, runs=0, undefined=undefined)
    x = known[np.isfinite(known)]
    # With one degree of freedom less, because the mean comes from the same runs.
    deviation = float(np.std(x, ddof=1)) if x.size > 1 else 0.0
    # Infinite values are known to be large: without them a limit would be finite by mistake.
    low, high = (quantile(known, share) for share in LIMITS)
    return Row(
        name,
        unit,
        float(np.mean(x)) if x.size else float("nan"),
        deviation if x.size else float("nan"),
        low,
        high,
        float(known.min()),
        float(known.max()),
        x.size,
        int(np.count_nonzero(known == np.inf)),
        int(np.count_nonzero(known == -np.inf)),
        undefined,
        int(runs[np.argmin(known)]),
        int(runs[np.argmax(known)]),
    )
