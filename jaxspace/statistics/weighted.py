"""Statistics of runs with weights: those of a campaign whose inputs had other distributions.

    m = sum w x,   s^2 = sum w (x - m)^2 n_e/(n_e - 1),   p = sum w 1[x violates]
    n_e = 1 / sum w^2,   var(p) = sum w^2 (1 - p)^2 of violations + sum w^2 p^2 of the others

    symbol  meaning                                       unit
    w       weights of the runs, of which the sum is one  1
    n_e     effective number of runs (Kish)               1

An interval of a probability is the one of Clopper and Pearson for p (1 - p)/var(p) runs; that of a
quantile contains the values at which the weighted distribution has such a probability. Without a
violation each unseen one may have the largest weight, so that there are 1/max(w) runs. Source:
Korn and Graubard, Survey Methodology 24 (1998), 193; Owen, Monte Carlo theory, methods and examples
(2013), 9.3.
"""

__all__ = ["MeanInterval", "WeightedDispersion", "weighted"]

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..core import InputError
from ..core.printing import printed
from ..core.suggestions import suggests
from ..core.text import aligned
from ._dispersion import Dispersion
from ._rounding import rounded
from .limits import Percentile, Probability, check_share
from .requirements import Requirement, Verdict, requirement_of, verdict_of
from .table import LIMITS, Row

# With fewer a standard deviation has an error of 7 %, and single runs decide.
FEWEST = 100


@printed()
class MeanInterval(NamedTuple):
    """A mean, with its confidence interval from `low` to `high`."""

    value: float
    low: float
    high: float
    confidence: float


@suggests
class WeightedDispersion(NamedTuple):
    """The runs of a campaign, weighted by how likely they are under other distributions of the
    inputs; printing it shows the table of outputs.

    - `result`: the runs.
    - `weights`: of all of them, (runs,), of which the sum is one.
    - `effective_runs`: the number of runs without weights that would be as accurate.
    - `changes`: a text about each changed input."""

    result: Dispersion
    weights: np.ndarray
    effective_runs: float
    changes: tuple[str, ...] = ()

    def mean(self, name: str, confidence: float = 0.95) -> MeanInterval:
        """The mean of a quantity over the successful runs in which it is finite, with a normal
        interval.

        **Arguments**

        - `name`: of an input or output.
        - `confidence`: of the interval.

        **Raises** `InputError` for an unknown name, and for a confidence outside (0, 1)."""
        from scipy.special import ndtri

        check_share("confidence", confidence)
        x, w = self._finite(name)
        if x.size == 0:
            return MeanInterval(math.nan, math.nan, math.nan, confidence)
        m = float(w @ x)
        half = float(ndtri(0.5 + 0.5 * confidence)) * math.sqrt(float(w**2 @ (x - m) ** 2))
        return MeanInterval(m, m - half, m + half, confidence)

    def std(self, name: str) -> float:
        """The standard deviation of a quantity over the successful runs in which it is finite."""
        x, w = self._finite(name)
        if x.size < 2:
            return math.nan
        few = 1.0 / float(w @ w)
        return math.sqrt(float(w @ (x - w @ x) ** 2) * few / (few - 1.0)) if few > 1.0 else 0.0

    def percentile(self, name: str, share: float, confidence: float = 0.95) -> Percentile:
        """The quantile `share` over the successful runs, with a confidence interval that assumes no
        distribution. Infinite values count; NaN is excluded.

        **Arguments**

        - `name`: of an input or output.
        - `share`, `confidence`: from 0 to 1, exclusive.

        **Raises** `InputError` for an unknown name, for other shares, and without values."""
        check_share("share", share)
        check_share("confidence", confidence)
        x, w = self._some(name, ~np.isnan(self.result.values(name).astype(float)))
        if x.size == 0:
            raise InputError(f"{name} has no value: a percentile requires at least one number.")
        order = np.argsort(x)
        x, w = x[order], w[order]
        ends = np.cumsum(w)
        value = _quantile(x, w, ends, share)
        below = x <= value
        square = float(w**2 @ (below - share) ** 2)
        low, high = _interval(share, square, float(w.max()), confidence)
        # The largest value that is certainly below, and the smallest that is above.
        first = int(np.searchsorted(ends, low, side="right")) - 1
        last = int(np.searchsorted(ends - w, high, side="left"))
        return Percentile(
            share,
            value,
            float(x[first]) if first >= 0 else -math.inf,
            float(x[last]) if last < x.size else math.inf,
            confidence,
        )

    def violation(
        self,
        name: str,
        *,
        at_least: float = -np.inf,
        at_most: float = np.inf,
        confidence: float = 0.95,
    ) -> Probability:
        """The probability that a requirement on an output is violated; a failed run counts as a
        violation, as does an output that is NaN.

        **Arguments**, **Raises**: as of `Dispersion.violation`.

        **Returns** a `Probability`, whose `count` is the number of stored runs that violate the
        requirement."""
        if at_least == -np.inf and at_most == np.inf:
            raise InputError("at_least and at_most are both missing: a requirement needs a limit.")
        check_share("confidence", confidence)
        x = self.result.values(name)
        lost = ~(self.result.good & (x >= at_least) & (x <= at_most))
        p = float(self.weights @ lost)
        square = float(self.weights**2 @ (lost - p) ** 2)
        low, high = _interval(p, square, float(self.weights.max()), confidence)
        return Probability(p, low, high, int(np.count_nonzero(lost)), self.result.runs, confidence)

    def violations(self) -> dict[str, Probability]:
        """The probability, for each output with a requirement, that it is violated."""
        return {
            name: self.violation(
                name,
                at_least=-np.inf if low is None else low,
                at_most=np.inf if high is None else high,
                confidence=self._requirement(name).confidence,
            )
            for name, (low, high) in self.result.requirements.items()
        }

    @property
    def verdicts(self) -> dict[str, Verdict]:
        """Whether the runs show that a requirement is satisfied, for each output with an allowed
        share of violations."""
        found = {}
        for name, violation in self.violations().items():
            allowed = self._requirement(name).allowed
            if allowed is not None:
                # More runs of the stored law have other weights: no number of them is promised.
                found[name] = verdict_of(violation, allowed)._replace(runs_needed=None)
        return found

    def _requirement(self, name: str) -> Requirement:
        return requirement_of(self.result.attributes["requirements"][name])

    def table(self, of: str = "outputs") -> list[Row]:
        """A `Row` for each of the "outputs" or "inputs", over the successful runs; least and
        greatest are those of the stored runs. Raises `InputError` for any other value."""
        rows = []
        for row in self.result.table(of):
            limits = (
                (self.percentile(row.name, share).value for share in LIMITS)
                if row.runs + row.above + row.below
                else (math.nan, math.nan)
            )
            low, high = limits
            m = self.mean(row.name).value
            rows.append(row._replace(mean=m, std=self.std(row.name), low=low, high=high))
        return rows

    def _finite(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        return self._some(name, np.isfinite(self.result.values(name).astype(float)))

    def _some(self, name: str, used: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """A quantity over the successful runs that are `used`, and their weights."""
        used = used & self.result.good & (self.weights > 0.0)
        w = self.weights[used]
        return self.result.values(name)[used].astype(float), w / max(float(w.sum()), 1e-300)

    def __repr__(self) -> str:
        head = (
            f"{self.result.runs} runs with weights, as accurate as {self.effective_runs:.0f} "
            "without"
        )
        rows: list[tuple[str, ...]] = [
            ("output", "unit", "mean", "before", "interval", "std dev", "before", "99.5 %")
        ]
        for before, row in zip(self.result.table(), self.table(), strict=True):
            m = self.mean(row.name)
            half = 0.5 * (m.high - m.low)
            numbers = [rounded(x, half) for x in (m.value, before.mean)]
            interval = f"{rounded(m.low, half)} to {rounded(m.high, half)}"
            spreads = [rounded(x, x) for x in (row.std, before.std)]
            rows.append((row.name, row.unit, *numbers, interval, *spreads, row.shown(row.high)))
        parts = [head, *self.changes, "", aligned(rows, left=2)]
        violations, verdicts = self.violations(), self.verdicts
        if violations:
            heads = ("requirement", "violated", "before", "interval")
            lines: list[tuple[str, ...]] = [(*heads, "verdict") if verdicts else heads]
            was = self.result.violations()
            for name, p in violations.items():
                shares = [f"{100.0 * x:.3g} %" for x in (p.value, was[name].value)]
                cells = (name, *shares, f"{100.0 * p.low:.3g} % to {100.0 * p.high:.3g} %")
                word = verdicts[name].word if name in verdicts else ""
                lines.append((*cells, word) if verdicts else cells)
            parts += ["", aligned(lines, left=1)]
        return "\n".join(parts)


def weighted(result: Dispersion, weights: ArrayLike) -> WeightedDispersion:
    """The runs of a campaign with given weights, such as those of an importance sampling.

    **Arguments**

    - `result`: the runs.
    - `weights`: of the runs up to a common factor, (runs,), zero or positive.

    **Returns** a `WeightedDispersion`.

    **Raises** `InputError` for weights of another shape, for weights that are negative or not
    finite, without a positive one, and for an effective number of runs below 100."""
    w = np.asarray(weights, float)
    if w.shape != (result.runs,):
        raise InputError(f"weights has the shape {w.shape}: it must be ({result.runs},).")
    bad = int(np.count_nonzero(~(np.isfinite(w) & (w >= 0.0))))
    if bad:
        raise InputError(
            f"weights is negative or not finite in {bad} of {result.runs} runs: all weights must "
            "be finite, and zero or positive."
        )
    if not w.any():
        raise InputError("weights is zero in all runs: at least one must be positive.")
    # Scaled by the largest, so that neither sums nor squares leave the range of numbers.
    w = w / w.max()
    w = w / w.sum()
    effective = 1.0 / float(w @ w)
    check_effective(effective, result.runs, "the weights differ too much")
    return WeightedDispersion(result, w, effective)


def check_effective(effective: float, runs: int, cause: str) -> None:
    """Raise `InputError` for too few effective runs; `cause`: why, as a clause."""
    if not effective >= FEWEST:
        raise InputError(
            f"The effective number of runs is {effective:.3g} of {runs}, and at least {FEWEST} are "
            f"required, because otherwise a few runs with large weights decide: {cause}."
        )


def _quantile(x: np.ndarray, w: np.ndarray, ends: np.ndarray, share: float) -> float:
    """The weighted quantile of sorted values: linear between the middles of their steps, and a step
    next to infinite ones."""
    if np.isfinite(x).all():
        return float(np.interp(share, ends - 0.5 * w, x))
    return float(x[min(int(np.searchsorted(ends, share)), x.size - 1)])


def _interval(p: float, square: float, most: float, confidence: float) -> tuple[float, float]:
    """The interval of a probability whose estimate has the variance `square`; `most` is the largest
    weight."""
    from scipy.special import betaincinv

    tail = 0.5 * (1.0 - confidence)
    one_sided = p <= 0.0 or p >= 1.0 or square <= 0.0
    runs = 1.0 / most if one_sided else p * (1.0 - p) / square
    count = min(max(p, 0.0), 1.0) * runs
    low = float(betaincinv(count, runs - count + 1.0, tail)) if count > 0.0 else 0.0
    high = float(betaincinv(count + 1.0, runs - count, 1.0 - tail)) if p < 1.0 else 1.0
    return low, high
