"""Rank correlation of two quantities over the same runs, with its confidence interval."""

__all__ = ["RankCorrelation", "rank_correlation"]

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..core import InputError
from ..core.printing import printed


@printed()
class RankCorrelation(NamedTuple):
    """Spearman's rank correlation of an input with an output.

    - `value`: from -1 to 1; of a law that rises everywhere it is 1, however curved.
    - `low`, `high`: its confidence interval of 95 %."""

    value: float
    low: float
    high: float


def rank_correlation(x: ArrayLike, y: ArrayLike) -> RankCorrelation:
    """Spearman's rank correlation of two quantities over their runs.

    The interval is that of Fisher's transformation with the variance of Bonett and Wright,
    Psychometrika 65 (2000), 23. Infinite values have their ranks, and pairs with NaN are left out.

    **Arguments**

    - `x`, `y`: the quantities, each (runs,).

    **Raises** `InputError` for fewer than five pairs."""
    from scipy.stats import rankdata

    x, y = np.asarray(x, float), np.asarray(y, float)
    both = ~(np.isnan(x) | np.isnan(y))
    if both.sum() < 5:
        raise InputError(f"{both.sum()} pairs are too few: at least five are required.")
    a, b = (rankdata(v[both]) for v in (x, y))
    # A constant quantity has no correlation; zero means that it has no influence.
    if np.ptp(a) == 0.0 or np.ptp(b) == 0.0:
        return RankCorrelation(0.0, 0.0, 0.0)
    r = float(np.clip(np.corrcoef(a, b)[0, 1], -1.0, 1.0))
    # 1.96 standard deviations on both sides contain 95 % of a normal distribution.
    half = 1.96 * np.sqrt((1.0 + 0.5 * r * r) / (both.sum() - 3))
    # A perfect correlation has an infinite transform: its interval is a point.
    centre = np.arctanh(np.clip(r, -1.0 + 1e-15, 1.0 - 1e-15))
    low, high = (float(np.tanh(centre + s * half)) for s in (-1.0, 1.0))
    # The clipped transform of a perfect correlation would leave it outside by rounding.
    return RankCorrelation(r, min(low, r), max(high, r))


def strongest_correlations(
    inputs: Mapping[str, np.ndarray], y: np.ndarray, count: int
) -> dict[str, RankCorrelation]:
    """The correlations of `y` with the `inputs`, each (runs,), of which the `count` strongest are
    listed, the strongest first."""
    result = {}
    for name, x in inputs.items():
        some = ~(np.isnan(x) | np.isnan(y))
        a, b = x[some].astype(float), y[some].astype(float)
        # Fewer pairs have no interval, and a constant input has no ranks.
        if a.size >= 5 and np.ptp(a) > 0.0:
            result[name] = rank_correlation(a, b)
    order = sorted(result.items(), key=lambda pair: -abs(pair[1].value))
    return dict(order[:count])
