"""Percentiles and probabilities from a finite sample, with confidence intervals.

    P(x_(l) <= q_p <= x_(u)) = B(u - 1; n, p) - B(l - 1; n, p)      order statistics
    k violations in n runs:  p_low = I^-1(k, n - k + 1, a/2),  p_high = I^-1(k + 1, n - k, 1 - a/2)

    symbol        meaning                                          unit
    x_(k)         the k-th smallest of n values                    that of the values
    q_p           quantile p of the values                         that of the values
    B(k; n, p)    binomial distribution, k or fewer of n           1
    I^-1(a, b, u) inverse of the regularised incomplete beta       1
    a             1 - confidence                                   1

No distribution of the values is assumed: infinite ones are ranked like any other, and a percentile
among them is infinite. NaN has no rank, and is excluded. Source: David and Nagaraja, Order
Statistics, 3rd edition, 7.1; Clopper and Pearson, Biometrika 26 (1934), 404.
"""

__all__ = ["Percentile", "Probability", "clopper_pearson", "percentile", "runs_for"]

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..core import InputError
from ..core.printing import printed


@printed()
class Percentile(NamedTuple):
    """A percentile of a quantity over its runs.

    - `share`: of the runs below the value, from 0 to 1.
    - `value`: the estimate; `low`, `high`: its confidence interval, infinite where there are too
      few runs for one.
    - `confidence`: lower bound of the probability that the interval contains the percentile of the
      distribution."""

    share: float
    value: float
    low: float
    high: float
    confidence: float


@printed()
class Probability(NamedTuple):
    """A probability, from 0 to 1, with its confidence interval from `low` to `high`.

    - `count`, `runs`: number of occurrences and of runs."""

    value: float
    low: float
    high: float
    count: int
    runs: int
    confidence: float


def check_share(name: str, value: float) -> None:
    """Raise `InputError` unless `value` is between 0 and 1, exclusive."""
    if not 0.0 < value < 1.0:
        raise InputError(f"{name} is {value}: it must be between 0 and 1, both excluded.")


def percentile(x: ArrayLike, share: float, confidence: float = 0.95) -> Percentile:
    """The quantile `share` over all runs, with a confidence interval.

    **Arguments**

    - `x`: the values, (runs,), including infinite ones; NaN is excluded.
    - `share`: from 0 to 1, exclusive.
    - `confidence`: of the interval, split evenly between its ends.

    **Raises** `InputError` for a share or a confidence outside (0, 1), and without values."""
    check_share("share", share)
    check_share("confidence", confidence)
    ordered = np.sort(np.asarray(x, float))
    ordered = ordered[~np.isnan(ordered)]
    n = ordered.size
    if n == 0:
        raise InputError("x is empty: a percentile requires at least one number.")
    tail = 0.5 * (1.0 - confidence)
    # The largest l with B(l - 1) <= tail, and the smallest u with B(u - 1) >= 1 - tail.
    lower = _binomial_quantile(tail, n, share)
    upper = _binomial_quantile(1.0 - tail, n, share) + 1
    # An order statistic that the sample does not have bounds nothing.
    low = ordered[lower - 1] if lower >= 1 else -np.inf
    high = ordered[upper - 1] if upper <= n else np.inf
    return Percentile(share, quantile(ordered, share), float(low), float(high), confidence)


def _binomial_quantile(p: float, n: int, share: float) -> int:
    """The least k with B(k; n, share) >= p."""
    # Not from scipy.stats, whose import takes as long as the tables of a campaign.
    from scipy.special import bdtr, bdtrik

    k = int(np.ceil(bdtrik(p, n, share)))
    # The root is known to rounding: at a whole number it may be just above.
    return k - 1 if k > 0 and bdtr(k - 1, n, share) >= p else k


def quantile(x: np.ndarray, share: float) -> float:
    """The quantile `share` of these numbers, with linear interpolation between two of them;
    infinite where one of the two is."""
    if np.isfinite(x).all():
        return float(np.quantile(x, share))
    # NumPy would take the difference of the two, which is NaN of infinite ones.
    ordered = np.sort(x)
    place = share * (x.size - 1)
    k = int(place)
    below, above = float(ordered[k]), float(ordered[min(k + 1, x.size - 1)])
    part = place - k
    if part == 0.0 or below == above:
        return below
    # Interpolation between minus and plus infinity is undefined: the nearer one is used.
    if np.isinf(below) and np.isinf(above):
        return below if part < 0.5 else above
    if np.isinf(below) or np.isinf(above):
        return below if np.isinf(below) else above
    return below + (above - below) * part


def clopper_pearson(count: int, runs: int, confidence: float = 0.95) -> Probability:
    """The probability of an event that occurred in `count` of `runs` runs, with the Clopper-Pearson
    interval, whose coverage is at least this confidence.

    Raises `InputError` for counts that are not from 0 to `runs`, and for no runs.

    **Arguments**

    - `count`: number of occurrences.
    - `runs`: number of runs.
    - `confidence`: of the interval, within 0 and 1."""
    from scipy.special import betaincinv

    check_share("confidence", confidence)
    if not 0 <= count <= runs or runs < 1:
        raise InputError(
            f"count is {count} of {runs} runs: it must be from 0 to the number of runs, which must "
            "be positive."
        )
    tail = 0.5 * (1.0 - confidence)
    # With no event, or with nothing else, the beta distribution degenerates: the bound is known.
    low = float(betaincinv(count, runs - count + 1, tail)) if count > 0 else 0.0
    high = float(betaincinv(count + 1, runs - count, 1.0 - tail)) if count < runs else 1.0
    return Probability(count / runs, low, high, int(count), int(runs), confidence)


def runs_for(share: float, confidence: float = 0.95) -> int:
    """Number of runs required for a one-sided limit: the smallest n whose greatest value is above
    the percentile with this confidence, 1 - share^n >= confidence (Wilks 1941).

    **Arguments**

    - `share`: of the percentile, between 0 and 1.
    - `confidence`: between 0 and 1."""
    check_share("share", share)
    check_share("confidence", confidence)
    # The slack avoids one run too many where the quotient is a whole number plus rounding.
    return int(np.ceil(np.log1p(-confidence) / np.log(share) - 1e-12))
