"""The lines of a table of results: moments, extremes and limits of a quantity."""

from typing import NamedTuple

import numpy as np

from ._rounding import rounded

LIMITS = (0.005, 0.995)
"""Quantiles that bound the middle 99 % of the runs."""


class Row(NamedTuple):
    """One line of the table: a quantity over its good runs.

    - `mean`, `std`, `min`, `max`: its moments and extremes.
    - `low`, `high`: the limits of the middle 99 % of the runs.
    - `runs`: the number of good runs in which it is finite.
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

    def shown(self, value: float) -> str:
        """A value of this quantity in digits that its deviation justifies: the rule of every
        table."""
        return rounded(value, self.std)


def row_of(name: str, unit: str, x: np.ndarray) -> Row:
    """The row of a quantity with these values."""
    if x.size == 0:
        return Row(name, unit, *(float("nan"),) * 6, runs=0)
    # In double precision, so that the moments of many runs of single precision lose nothing.
    x = x.astype(float)
    # With one degree of freedom less, because the mean comes from the same runs.
    deviation = float(np.std(x, ddof=1)) if x.size > 1 else 0.0
    low, high = (float(q) for q in np.quantile(x, LIMITS))
    return Row(
        name,
        unit,
        float(np.mean(x)),
        deviation,
        low,
        high,
        float(x.min()),
        float(x.max()),
        x.size,
    )
