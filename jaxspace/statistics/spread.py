"""Joint statistics of outputs: covariance, ellipses, ellipsoids, circular error, convergence.

    (y - m)^T C^-1 (y - m) = k^2,   P(chi^2_d <= k^2) = P        the ellipsoid of probability P

    symbol  meaning                              unit
    m, C    mean and covariance of d outputs     theirs, and the products of them
    k       size in standard deviations          1

The ellipsoid contains the share P only for a normal distribution. The circular error probable is a
percentile of the runs, and valid for any distribution.
"""

__all__ = ["Convergence", "Ellipsoid", "circular_error", "convergence", "ellipsoid"]

import dataclasses
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..core import InputError
from ..core.field_types import check_types
from ..core.printing import printed
from ..core.suggestions import suggests
from .limits import Percentile, check_share, percentile


@printed()
class Ellipsoid(NamedTuple):
    """The ellipsoid of a probability; with two outputs an ellipse.

    - `centre`: (d,).
    - `axes`: the semi-axes as columns, (d, d), the longest first.
    - `probability`: the share of a normal distribution that it contains.
    - `inside`: the share of the runs inside."""

    centre: np.ndarray
    axes: np.ndarray
    probability: float
    inside: float

    def outline(self, points: int = 121) -> np.ndarray:
        """The points of an ellipse, (2, points), closed. Raises `InputError` unless d is 2."""
        if self.centre.size != 2:
            raise InputError(f"An ellipsoid of {self.centre.size} outputs has no outline.")
        angle = np.linspace(0.0, 2.0 * np.pi, points)
        return self.centre[:, None] + self.axes @ np.stack([np.cos(angle), np.sin(angle)])


def ellipsoid(values: ArrayLike, probability: float = 0.99) -> Ellipsoid:
    """The ellipsoid of a normal distribution with the mean and the covariance of the values.

    **Arguments**

    - `values`: of d outputs, (d, runs).
    - `probability`: share of the distribution within it.

    **Raises** `InputError` for a probability outside (0, 1), for fewer than two runs, and for
    values that are not finite."""
    from scipy.special import gammaincinv

    check_share("probability", probability)
    x = np.atleast_2d(np.asarray(values, float))
    if x.shape[1] < 2:
        raise InputError(f"values has {x.shape[1]} runs: an ellipsoid requires at least two.")
    lost = np.count_nonzero(~np.all(np.isfinite(x), axis=0))
    if lost:
        raise InputError(
            f"values is not finite in {lost} runs: all points of an ellipsoid must be finite."
        )
    # Scaled first: a covariance of km and mm would lose the small axis to rounding.
    scale = np.std(x, axis=1, ddof=1)
    scale = np.where(scale > 0.0, scale, 1.0)[:, None]
    centre = np.mean(x, axis=1)
    u, size, _ = np.linalg.svd((x - centre[:, None]) / scale, full_matrices=False)
    root = scale * u * (size / np.sqrt(x.shape[1] - 1))
    # The axes of the scaled problem are not axes in the units of the outputs: a second, small one.
    u, size, _ = np.linalg.svd(root)
    k2 = 2.0 * float(gammaincinv(0.5 * len(x), probability))
    # A pseudo-inverse: outputs may depend on each other, and the ellipsoid is then flat.
    whitened = np.linalg.pinv(root, rcond=1e-12) @ (x - centre[:, None])
    inside = float(np.mean(np.sum(whitened**2, axis=0) <= k2))
    return Ellipsoid(centre, u * size * np.sqrt(k2), probability, inside)


def circular_error(
    x: ArrayLike, y: ArrayLike, target: tuple[float, float] | None = None, share: float = 0.5
) -> Percentile:
    """The radius about the `target` (by default the mean) that contains a share of the runs; for
    one half it is the circular error probable.

    `x`, `y`: the two coordinates, each (runs,). A run with an infinite one is outside of any
    radius; one with NaN is excluded.

    **Arguments**

    - `x`, `y`: the coordinates, each (runs,), in the same unit.
    - `target`: a point; by default the mean.
    - `share`: of the runs, within 0 and 1."""
    x, y = np.asarray(x, float), np.asarray(y, float)
    # The mean leaves infinite values out; their distance is infinite, and counts.
    a, b = (np.mean(z[np.isfinite(z)]) for z in (x, y)) if target is None else target
    return percentile(np.hypot(x - a, y - b), share)


@printed()
class Convergence(NamedTuple):
    """Convergence of a statistic of an output with the number of runs; each array is (steps,).

    - `runs`: the successful runs used.
    - `mean`, `std`, `limit`: the mean, the standard deviation and the percentile of these. Infinite
      values count in the percentile only.
    - `low`, `high`: the confidence interval of that percentile."""

    runs: np.ndarray
    mean: np.ndarray
    std: np.ndarray
    limit: np.ndarray
    low: np.ndarray
    high: np.ndarray


def convergence(x: ArrayLike, share: float = 0.99, steps: int = 40) -> Convergence:
    """Mean, standard deviation and a percentile of the first 10, ... n runs, at `steps` counts that
    grow by a common factor.

    **Arguments**

    - `x`: an output, (runs,).
    - `share`: of the percentile, within 0 and 1.
    - `steps`: number of counts.

    **Returns** a `Convergence`.

    **Raises** `InputError` for a share outside (0, 1), and if no value is finite."""
    x = np.asarray(x, float)
    x = x[~np.isnan(x)]
    finite = np.isfinite(x)
    if not finite.any():
        raise InputError("x has no finite value: convergence is undefined.")
    # By a common factor, because errors fall as a power: even steps would crowd at the end.
    counts = np.unique(np.geomspace(min(10, x.size), x.size, steps).astype(int))
    limits = [percentile(x[:n], share) for n in counts]
    # Shifted by the first value: the squares of large numbers would lose the digits of a small
    # deviation.
    start = x[finite][0]
    shifted = np.where(finite, x, start) - start
    first, second = np.cumsum(shifted)[counts - 1], np.cumsum(shifted**2)[counts - 1]
    known = np.cumsum(finite)[counts - 1]
    # If none of the first runs is finite, they have no mean.
    some = np.where(known > 0, known, np.nan)
    variance = (second - first**2 / some) / np.maximum(some - 1, 1)
    return Convergence(
        counts,
        start + first / some,
        # Rounding may leave the variance of equal values below zero.
        np.sqrt(np.maximum(variance, 0.0)),
        *(np.array([getattr(p, field) for p in limits]) for field in ("value", "low", "high")),
    )


@suggests
@dataclasses.dataclass(frozen=True)
class StopRule:
    """Rule that ends a campaign: the percentile `share` of an output must be known, with this
    `confidence`, to `precision` times the distance of that percentile from the mean.

    - `output`: name of an output of the campaign.
    - `share`: of the percentile, between 0 and 1.
    - `precision`: half-width of its confidence interval over its distance from the mean, between 0
      and 1.
    - `confidence`: of the interval, between 0 and 1.

    `StopRule("apogee", 0.99, 0.01)` means "until the 99th percentile of apogee is known to 1 %".

    Raises `InputError` for other numbers."""

    output: str
    share: float = 0.99
    precision: float = 0.01
    confidence: float = 0.95

    def __post_init__(self):
        check_types(self)
        for name in ("share", "precision", "confidence"):
            check_share(f"StopRule.{name}", getattr(self, name))

    def error(self, x: ArrayLike) -> float:
        """Half-width of the confidence interval of the percentile over its distance from the mean;
        infinite with too few runs or an infinite percentile, zero without dispersion."""
        x = np.asarray(x, float)
        result = percentile(x, self.share, self.confidence)
        # However many runs there are, an infinite limit has no distance to be compared with.
        if not np.isfinite([result.value, result.low, result.high]).all():
            return np.inf
        distance = abs(result.value - float(np.mean(x[np.isfinite(x)])))
        half = 0.5 * (result.high - result.low)
        return half / distance if distance > 0.0 else (0.0 if half == 0.0 else np.inf)

    def text(self) -> str:
        """The rule as text."""
        return (
            f"until the {_ordinal(100.0 * self.share)} percentile of {self.output} is known to "
            f"{100.0 * self.precision:g} %"
        )

    def met(self, x: ArrayLike) -> bool:
        """Whether these runs are sufficient."""
        return self.error(x) <= self.precision

    def more(self, x: ArrayLike) -> int:
        """Estimate, from these runs, of the total number required; 0 if unknown."""
        error = self.error(x)
        runs = int((~np.isnan(np.asarray(x, float))).sum())
        # The interval shrinks as one over the root of the number of runs.
        return int(np.ceil(runs * (error / self.precision) ** 2)) if np.isfinite(error) else 0


def _ordinal(x: float) -> str:
    """The number with its English suffix, such as 99th, 97.5th or 51st."""
    text = f"{x:g}"
    if text.endswith(("11", "12", "13")):
        return f"{text}th"
    return text + {"1": "st", "2": "nd", "3": "rd"}.get(text[-1], "th")
