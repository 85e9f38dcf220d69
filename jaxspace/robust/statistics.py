"""Statistics of an output over the runs of a campaign, as objectives and constraints of a search.

    mean, mean + k std   m,  m + k sqrt(sum (x_i - m)^2 / n)
    violation of a       (1/n) sum Phi((x_i - a)/h),   h = 1.63 n^(-1/3) (1/n) sum |x_i - m|
    quantile c of q      (1/n) sum G((x_i - c)/b) = 1 - q
    mean beyond c        c + (1/n) sum b H((x_i - c)/b) / (1 - q)

    symbol    meaning                                               unit
    x_i, n    values of the successful runs, their number           that of the output, 1
    m         their mean                                            that of the output
    a         limit                                                 that of the output
    q         share of the runs below the quantile                  1
    h, b      smoothing widths of each run                          that of the output
    Phi       normal distribution function                          1
    G, H      distribution of a finite kernel, and its integral     1

Counts and order statistics have no useful derivative: it is zero, or that of a single run, and
jumps. The last three are therefore those of a smoothed sample (`_smoothed.py`), whose widths fall
below the error of the sample: h is the best for the distribution function of a normal law, b
follows the error of the quantile. The quantile c makes the mean beyond it stationary (Rockafellar
and Uryasev's auxiliary number), so that its derivative there is stopped.

A failed run has no value and is excluded, except in the share of violations, where it counts as a
violation. With its `influence` a run has a part in the error: the variance of a statistic is the
sum of their squares (Hampel et al., Robust Statistics, 2.1). Sources: Azzalini, Biometrika 68
(1981), 326 (kernel); Rockafellar and Uryasev, J. Risk 2 (2000), 21.
"""

__all__ = [
    "AbstractStatistic",
    "CVaR",
    "Constraint",
    "Mean",
    "MeanPlus",
    "Quantile",
    "Violation",
    "Worst",
]

from abc import abstractmethod
from typing import NamedTuple, final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.scipy.special import ndtr
from jaxtyping import Array, Bool, Float

from ..core import InputError
from ..core.safe import safe_sqrt
from ..core.structure import HashedModule
from ..statistics.limits import check_share, quantile
from ..statistics.requirements import Requirement
from ._smoothed import count, hinge, smoothed_quantile, width_of_all

# Runs beyond a quantile from which on its error is known to a quarter.
TAIL = 20


class Measured(NamedTuple):
    """A statistic of concrete runs.

    - `value`: of the statistic.
    - `influence`: the influence of each run on the value, (runs,), zero for excluded runs; NaN if
      unknown."""

    value: float
    influence: np.ndarray

    @property
    def error(self) -> float:
        """The standard error of the value."""
        return float(np.sqrt(np.sum(self.influence**2)))


class AbstractStatistic(HashedModule):
    """A statistic of one `output` of a campaign. A concrete one is final."""

    output: eqx.AbstractVar[str]

    @abstractmethod
    def value(self, x: Float[Array, " runs"], good: Bool[Array, " runs"]) -> Float[Array, ""]:
        """The statistic of the values `x` of the `good` runs; differentiable. NaN if no run is
        good."""

    @abstractmethod
    def measured(self, x: Float[np.ndarray, " runs"], good: Bool[np.ndarray, " runs"]) -> Measured:
        """The statistic of concrete runs as a count or an order statistic, with its error."""

    @abstractmethod
    def text(self) -> str:
        """The statistic as text."""

    def at_nominal(self, x: Float[Array, ""]) -> Float[Array, ""]:
        """The value of the statistic without dispersion, for the output `x`."""
        return x

    @property
    def tail(self) -> float | None:
        """The share of the runs that determine it; `None` if all of them do."""
        return None

    @property
    def of_few(self) -> bool:
        """Whether its derivative depends on few of the runs only."""
        return False

    @property
    def fewest_runs(self) -> int:
        """Minimum number of runs."""
        # Rounding of 1 - 0.99 must not ask for another run.
        return 1 if self.tail is None else int(np.ceil(TAIL / self.tail * (1.0 - 1e-12)))

    def requirement(self, limit: float, upper: bool) -> Requirement | None:
        """The requirement of a limit of the statistic on each run; `None` if it requires nothing.

        **Arguments**

        - `limit`: of the statistic; `upper`: whether it is the greatest value."""
        del limit, upper
        return None

    def at_most(self, limit: float) -> "Constraint":
        """The constraint that the statistic is at most this."""
        return Constraint(self, limit, True)

    def at_least(self, limit: float) -> "Constraint":
        """The constraint that the statistic is at least this."""
        return Constraint(self, limit, False)


@final
class Constraint(HashedModule):
    """A limit of a statistic, created with its `at_most` and `at_least`.

    - `statistic`: the constrained statistic.
    - `limit`: the greatest allowed value if `upper`, otherwise the least.
    - `upper`: whether the limit is an upper one.

    Raises `InputError` for a limit that is not finite."""

    statistic: AbstractStatistic
    limit: float = eqx.field(static=True, converter=float)
    upper: bool = eqx.field(static=True)

    def __check_init__(self):
        if not np.isfinite(self.limit):
            raise InputError(f"The limit of {self.text()} must be a finite number.")
        if isinstance(self.statistic, Violation):
            check_share(f"The limit of the {self.statistic.text()}", self.limit)

    def margin(self, x: Float[Array, " runs"], good: Bool[Array, " runs"]) -> Float[Array, ""]:
        """The margin of the limit; negative where it is violated."""
        over = self.statistic.value(x, good) - self.limit
        return -over if self.upper else over

    def margin_at_nominal(self, x: Float[Array, ""]) -> Float[Array, ""]:
        """The same without dispersion, for the output `x`."""
        alone = self.statistic.at_nominal(x)
        # A share of violations: the run itself must not be one.
        limit = 0.0 if isinstance(self.statistic, Violation) else self.limit
        return limit - alone if self.upper else alone - limit

    @property
    def requirement(self) -> Requirement | None:
        """The requirement of the constraint on each run; `None` if it requires nothing."""
        return self.statistic.requirement(self.limit, self.upper)

    def text(self) -> str:
        """The constraint as text."""
        return f"{self.statistic.text()} {self._side} {self.limit:g}"

    def label(self) -> str:
        """The same for a table, where the value of the statistic follows."""
        return f"{self.statistic.text()} ({self._side} {self.limit:g})"

    @property
    def _side(self) -> str:
        return "at most" if self.upper else "at least"


@final
class Mean(AbstractStatistic):
    """The mean.

    - `output`: name of an output of the campaign."""

    output: str = eqx.field(static=True)

    def value(self, x: Float[Array, " runs"], good: Bool[Array, " runs"]) -> Float[Array, ""]:
        return _moments(x, good)[0]

    def measured(self, x: Float[np.ndarray, " runs"], good: Bool[np.ndarray, " runs"]) -> Measured:
        mean, off, n = _known_moments(x, good)
        return Measured(mean, off / n)

    def text(self) -> str:
        return f"mean of {self.output}"


@final
class MeanPlus(AbstractStatistic):
    """The mean plus `k` standard deviations, minus for a negative `k`.

    - `output`: name of an output of the campaign.
    - `k`: number of standard deviations, of either sign."""

    output: str = eqx.field(static=True)
    k: float = eqx.field(static=True, converter=float)

    def value(self, x: Float[Array, " runs"], good: Bool[Array, " runs"]) -> Float[Array, ""]:
        mean, deviation, _ = _moments(x, good)
        return mean + self.k * deviation

    def measured(self, x: Float[np.ndarray, " runs"], good: Bool[np.ndarray, " runs"]) -> Measured:
        mean, off, n = _known_moments(x, good)
        variance = float(np.sum(off**2)) / n
        deviation = np.sqrt(variance)
        # The influence of a run on a standard deviation s: ((x - m)^2 - s^2)/(2 s). Where all runs
        # are equal both are zero.
        widening = np.where(good, off**2 - variance, 0.0) / (2.0 * deviation or 1.0)
        return Measured(mean + self.k * deviation, (off + self.k * widening) / n)

    def text(self) -> str:
        sign = "+" if self.k >= 0.0 else "-"
        return f"mean {sign} {abs(self.k):g} std of {self.output}"


@final
class Quantile(AbstractStatistic):
    """The quantile `share` of the runs.

    - `output`: name of an output of the campaign.
    - `share`: between 0 and 1.

    Raises `InputError` unless the share is between 0 and 1."""

    output: str = eqx.field(static=True)
    share: float = eqx.field(static=True, converter=float)

    def __check_init__(self):
        check_share("Quantile.share", self.share)

    def value(self, x: Float[Array, " runs"], good: Bool[Array, " runs"]) -> Float[Array, ""]:
        return smoothed_quantile(x, good, self.share)[0]

    def measured(self, x: Float[np.ndarray, " runs"], good: Bool[np.ndarray, " runs"]) -> Measured:
        known = x[good]
        value, n, q = quantile(known, self.share), known.size, self.share
        # The density there, from the quantiles at a standard error of the rank on each side.
        width = float(np.sqrt(q * (1.0 - q) / n))
        low, high = max(q - width, 0.0), min(q + width, 1.0)
        sparsity = (quantile(known, high) - quantile(known, low)) / (high - low)
        return Measured(value, np.where(good, q - (x <= value), 0.0) * sparsity / n)

    def text(self) -> str:
        return f"{100.0 * self.share:g} % quantile of {self.output}"

    @property
    def tail(self) -> float | None:
        # The error follows from the rarer side.
        return min(self.share, 1.0 - self.share)

    @property
    def of_few(self) -> bool:
        return True

    def requirement(self, limit: float, upper: bool) -> Requirement | None:
        if upper:
            return Requirement(high=limit, allowed=1.0 - self.share)
        return Requirement(low=limit, allowed=self.share)


@final
class CVaR(AbstractStatistic):
    """The mean of the runs above the quantile of a `share`: the conditional value at risk.

    - `output`: name of an output of the campaign.
    - `share`: between 0 and 1.
    - `lower`: whether small values are unfavourable: the mean of as many runs with the lowest ones.

    Raises `InputError` unless the share is between 0 and 1."""

    output: str = eqx.field(static=True)
    share: float = eqx.field(static=True, converter=float)
    lower: bool = eqx.field(static=True, default=False)

    def __check_init__(self):
        check_share("CVaR.share", self.share)

    def value(self, x: Float[Array, " runs"], good: Bool[Array, " runs"]) -> Float[Array, ""]:
        x = self._sign * x
        c, half, n = smoothed_quantile(x, good, self.share)
        # The sum is stationary in c, so that a derivative by it would add roundings alone.
        c = lax.stop_gradient(c)
        z = (jnp.where(good, x, c) - c) / half
        beyond = jnp.where(good, half * hinge(z), 0.0)
        return self._sign * (c + jnp.sum(beyond) / (n * (1.0 - self.share)))

    def measured(self, x: Float[np.ndarray, " runs"], good: Bool[np.ndarray, " runs"]) -> Measured:
        sign, x = self._sign, self._sign * x
        # Of the sharp quantile, which counts as constant, as in `value`.
        value, n = quantile(x[good], self.share), np.count_nonzero(good)
        beyond = np.where(good, np.maximum(x - value, 0.0), 0.0) / (1.0 - self.share)
        mean = float(np.sum(beyond)) / n
        return Measured(sign * (value + mean), sign * np.where(good, beyond - mean, 0.0) / n)

    def text(self) -> str:
        if self.lower:
            return f"mean of the lowest {100.0 * (1.0 - self.share):g} % of {self.output}"
        return f"mean of {self.output} beyond its {100.0 * self.share:g} % quantile"

    @property
    def _sign(self) -> float:
        return -1.0 if self.lower else 1.0

    @property
    def tail(self) -> float | None:
        return 1.0 - self.share

    @property
    def of_few(self) -> bool:
        return True


@final
class Violation(AbstractStatistic):
    """The share of the runs, from 0 to 1, in which the output is above `high` or below `low`.

    - `output`: name of an output of the campaign.
    - `high`, `low`: the limit, in the unit of the output.

    A failed run counts as a violation. Raises `InputError` without exactly one of the two."""

    output: str = eqx.field(static=True)
    high: float | None = eqx.field(static=True, default=None)
    low: float | None = eqx.field(static=True, default=None)

    def __check_init__(self):
        if (self.high is None) == (self.low is None):
            raise InputError(
                f"Violation has high = {self.high} and low = {self.low}: it must have exactly one "
                "of them."
            )

    @property
    def _limit(self) -> tuple[float, float]:
        """The limit, and the sign of its violation."""
        if self.high is not None:
            return self.high, 1.0
        assert self.low is not None
        return self.low, -1.0

    def value(self, x: Float[Array, " runs"], good: Bool[Array, " runs"]) -> Float[Array, ""]:
        limit, sign = self._limit
        width, n = width_of_all(x, good)
        beyond = sign * (jnp.where(good, x, limit) - limit) / width
        # A count has no derivative: each run is smoothed by a normal distribution of this width.
        bad = jnp.sum(jnp.where(good, ndtr(beyond), 1.0))
        return jnp.where(n > 0.0, bad / x.size, jnp.nan)

    def measured(self, x: Float[np.ndarray, " runs"], good: Bool[np.ndarray, " runs"]) -> Measured:
        limit, sign = self._limit
        # In this form, so that NaN counts as a violation, too.
        bad = ~(good & (sign * (x - limit) <= 0.0))
        share = float(np.mean(bad))
        return Measured(share, (bad - share) / x.size)

    def at_nominal(self, x: Float[Array, ""]) -> Float[Array, ""]:
        limit, sign = self._limit
        return sign * (x - limit)

    def text(self) -> str:
        limit, sign = self._limit
        return f"share of runs with {self.output} {'above' if sign > 0.0 else 'below'} {limit:g}"

    def requirement(self, limit: float, upper: bool) -> Requirement | None:
        # A least share of violations requires nothing of a run.
        return Requirement(self.low, self.high, limit) if upper else None


@final
class Worst(AbstractStatistic):
    """The greatest value of all runs.

    - `output`: name of an output of the campaign.
    - `lower`: whether small values are unfavourable; the statistic is then the least value.

    Its derivative is that of one run, and switches between runs: `CVaR` is easier to minimise."""

    output: str = eqx.field(static=True)
    lower: bool = eqx.field(static=True, default=False)

    def value(self, x: Float[Array, " runs"], good: Bool[Array, " runs"]) -> Float[Array, ""]:
        # A failed run must not be the worst, whatever its number is.
        if self.lower:
            worst = jnp.min(jnp.where(good, x, jnp.inf))
        else:
            worst = jnp.max(jnp.where(good, x, -jnp.inf))
        return jnp.where(jnp.any(good), worst, jnp.nan)

    def measured(self, x: Float[np.ndarray, " runs"], good: Bool[np.ndarray, " runs"]) -> Measured:
        worst = np.min(x[good]) if self.lower else np.max(x[good])
        # The tail beyond the extreme value of a sample is unknown.
        return Measured(float(worst), np.full(x.shape, np.nan))

    @property
    def of_few(self) -> bool:
        return True

    def text(self) -> str:
        return f"{'least' if self.lower else 'greatest'} {self.output}"


def _moments(x: Float[Array, " runs"], good: Bool[Array, " runs"]) -> tuple[Array, Array, Array]:
    """Mean, standard deviation and number of the successful runs."""
    n = count(x, good)
    mean = jnp.sum(jnp.where(good, x, 0.0)) / n
    off = jnp.where(good, x - mean, 0.0)
    return mean, safe_sqrt(jnp.sum(off * off) / n), n


def _known_moments(x: np.ndarray, good: np.ndarray) -> tuple[float, np.ndarray, int]:
    """The mean of the successful runs, the distance of each from it, and their number."""
    mean = float(np.mean(x[good]))
    return mean, np.where(good, x - mean, 0.0), int(np.count_nonzero(good))
