"""Distributions of an input. Every parameter is in the unit of the quantity, and traced: changing
it causes no new compilation.

normal             p(x) ~ exp(-(x - m)^2 / (2 s^2))
truncated normal   the same between a and b, zero outside
uniform            p(x) = 1 / (b - a) between a and b

symbol  meaning                                    unit
m       mean of the (untruncated) normal           that of the quantity
s       its standard deviation                     that of the quantity
a, b    limits                                     that of the quantity
"""

__all__ = ["NOMINAL", "OF_INPUT", "SHARE_OF_INPUT"]

import math
from abc import abstractmethod
from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.lax import erf_inv
from jax.scipy.special import erf, ndtr, ndtri
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from ..core import AbstractParameters, check, quantity
from ..core.checks import is_concrete
from ..core.types import SingleNumberField

OF_INPUT = "unit of the input"
"""The unit of a field whose number is a value of the input."""

SHARE_OF_INPUT = "unit of the input, or % of its nominal value"
"""The unit of a field whose number is a difference of two values of the input."""

NOMINAL = "nominal"
"""Location of the nominal value of an input in a scene file: `shared` of a field."""


class AbstractDistribution(AbstractParameters):
    """A distribution of one number. A concrete one is final and offers `mean` (the value of the
    nominal run) and `deviation` as fields or properties."""

    mean: eqx.AbstractVar[Float[Array, ""]]
    deviation: eqx.AbstractVar[Float[Array, ""]]

    @property
    def variance(self) -> Float[Array, ""]:
        """Variance of a draw, which differs from the squared `deviation` for a truncated
        distribution."""
        return self.deviation**2

    @property
    def expectation(self) -> Float[Array, ""]:
        """Mean of a draw; that of a truncated distribution differs from its `mean`."""
        return self.mean

    @property
    def source(self) -> str:
        """The name of a draw shared by several inputs; empty for a separate draw."""
        return ""

    @property
    def dimensions(self) -> int:
        """Number of standard normal numbers required for one draw."""
        return 1

    @abstractmethod
    def sample(self, key: Array) -> Float[Array, ""]:
        """One draw, determined by the random `key` only."""

    @abstractmethod
    def from_normal(self, z: Float[Array, "..."]) -> Float[Array, ""]:
        """The value with the same quantile in this distribution as `z` in the standard normal one,
        F^-1(Phi(z)), as used by Latin hypercubes, Sobol points and rare events.

        `z`: (), or (dimensions,) where one draw uses several."""

    def searched(self, z: Float[Array, "..."]) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """The value at `z` in a search for rare events, and its likelihood ratio relative to the
        search: one, except where a single value is rare and must be drawn by the search."""
        value = self.from_normal(z)
        return value, jnp.ones_like(value)

    def spread(self, z: Float[Array, ""]) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """The standard normal number that a search for rare events uses instead of `z`, and how
        likely it is in comparison with that search; of a distribution with one number per draw."""
        return z, jnp.ones_like(z)

    @abstractmethod
    def outside(self, low: float, high: float) -> float:
        """The share of all draws, from 0 to 1, that fall below `low` or above `high`."""

    @abstractmethod
    def text(self) -> str:
        """A description of the distribution, for records."""


def fixed(value: ArrayLike) -> "Constant":
    """The constant value as a distribution."""
    # The abstract fields of the base are properties here, and not arguments.
    return Constant(value=value)  # pyright: ignore[reportCallIssue, reportArgumentType]


def _normal_share(low: float, high: float) -> float:
    """The share of a standard normal distribution from `low` to `high`."""
    if low > 0.0:
        low, high = -high, -low
    low, high = low / math.sqrt(2.0), high / math.sqrt(2.0)
    # In the tails a difference of two values of erfc is accurate, near the middle one of erf.
    if low > -0.5:
        return 0.5 * (math.erf(high) - math.erf(low))
    return 0.5 * (math.erfc(-high) - math.erfc(-low))


def _uniform_share(start: float, end: float, low: float, high: float) -> float:
    """The share of the interval from `start` to `end` that is between `low` and `high`."""
    # Zero and not negative where the two intervals are disjoint.
    return max(0.0, min(end, high) - max(start, low)) / (end - start)


def _shown(**numbers: ArrayLike) -> str:
    return ", ".join(f"{name} {float(np.asarray(value)):.9g}" for name, value in numbers.items())


def _check_limits(name: str, low: object, high: object) -> None:
    if is_concrete(low) and is_concrete(high):
        check(
            np.asarray(high) > np.asarray(low),
            f"{name}.high",
            high,
            f"above low, which is {float(np.asarray(low)):.6g}",
        )


@final
class Normal(AbstractDistribution):
    """The normal distribution."""

    mean: SingleNumberField = quantity(OF_INPUT, shared=NOMINAL, doc="mean")
    deviation: SingleNumberField = quantity(
        SHARE_OF_INPUT, non_negative=True, doc="standard deviation"
    )

    def sample(self, key: Array) -> Float[Array, ""]:
        return self.mean + self.deviation * jax.random.normal(key)

    def from_normal(self, z: Float[Array, "..."]) -> Float[Array, ""]:
        return self.mean + self.deviation * z

    def outside(self, low: float, high: float) -> float:
        mean, deviation = float(self.mean), float(self.deviation)
        # Allowed, so that a study can switch one input off; without a tail to integrate.
        if deviation == 0.0:
            return float(not low <= mean <= high)
        below, above = (mean - low) / deviation, (high - mean) / deviation
        return _normal_share(-math.inf, -below) + _normal_share(above, math.inf)

    def text(self) -> str:
        return "normal, " + _shown(mean=self.mean, deviation=self.deviation)


@final
class Uniform(AbstractDistribution):
    """The uniform distribution from `low` to `high`. Raises `InputError` unless `high` is above
    `low`."""

    low: SingleNumberField = quantity(OF_INPUT, doc="lower limit")
    high: SingleNumberField = quantity(OF_INPUT, doc="upper limit")

    def __check_init__(self):
        super().__check_init__()
        _check_limits("Uniform", self.low, self.high)

    @property
    def mean(self) -> Float[Array, ""]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """(a + b) / 2."""
        return 0.5 * (self.low + self.high)

    @property
    def deviation(self) -> Float[Array, ""]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """(b - a) / sqrt(12)."""
        return (self.high - self.low) / 12.0**0.5

    def sample(self, key: Array) -> Float[Array, ""]:
        drawn = self.low + (self.high - self.low) * jax.random.uniform(key)
        # The sum may round to beyond the limit, which a class may reject.
        return jnp.minimum(drawn, self.high)

    def from_normal(self, z: Float[Array, "..."]) -> Float[Array, ""]:
        # From the nearer end: a limit of zero is approached in relative steps. Not by -|z|, whose
        # slope at zero is zero.
        step = (self.high - self.low) * ndtr(jnp.where(z > 0.0, -z, z))
        return jnp.where(z > 0.0, self.high - step, self.low + step)

    def outside(self, low: float, high: float) -> float:
        a, b = float(self.low), float(self.high)
        # The sum of both ends: one minus the share inside loses the digits of a rare rejection.
        return _uniform_share(a, b, a, low) + _uniform_share(a, b, high, b)

    def text(self) -> str:
        return "uniform, " + _shown(low=self.low, high=self.high)


@final
class TruncatedNormal(AbstractDistribution):
    """A normal distribution restricted to values from `low` to `high`.

    `mean` and `deviation` refer to the normal distribution before truncation, which shifts the mean
    and reduces the standard deviation. Raises `InputError` unless low <= mean <= high and low <
    high."""

    mean: SingleNumberField = quantity(OF_INPUT, shared=NOMINAL, doc="mean before the cut")
    deviation: SingleNumberField = quantity(
        SHARE_OF_INPUT, positive=True, doc="standard deviation before the cut"
    )
    low: SingleNumberField = quantity(OF_INPUT, doc="lower limit")
    high: SingleNumberField = quantity(OF_INPUT, doc="upper limit")

    def __check_init__(self):
        super().__check_init__()
        _check_limits("TruncatedNormal", self.low, self.high)
        if is_concrete(self.mean) and is_concrete(self.low) and is_concrete(self.high):
            low, mean, high = (np.asarray(x) for x in (self.low, self.mean, self.high))
            check(
                (low <= mean) & (mean <= high),
                "TruncatedNormal.mean",
                mean,
                f"within {low:.6g} and {high:.6g}",
            )

    @property
    def expectation(self) -> Float[Array, ""]:
        """Mean after truncation."""
        weights, x = self._rule()
        return self.mean + jnp.sum(weights * x)

    @property
    def variance(self) -> Float[Array, ""]:
        """Variance after truncation."""
        weights, x = self._rule()
        return jnp.sum(weights * (x - jnp.sum(weights * x)) ** 2)

    def _rule(self) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
        """Weights of the trapezoidal rule, which is exact to rounding for smooth integrands, and
        differences from the mean before truncation, in which a small standard deviation is
        accurate."""
        z = jnp.linspace(-8.5, 8.5, 2001, dtype=jnp.result_type(self.mean))
        weights = jnp.exp(-0.5 * z * z)
        return weights / jnp.sum(weights), jax.vmap(self.from_normal)(z) - self.mean

    def sample(self, key: Array) -> Float[Array, ""]:
        a, b = (self.low - self.mean) / self.deviation, (self.high - self.mean) / self.deviation
        drawn = self.mean + self.deviation * jax.random.truncated_normal(key, a, b)
        # The product may round to beyond a limit, which a class may reject.
        return jnp.clip(drawn, self.low, self.high)

    def from_normal(self, z: Float[Array, "..."]) -> Float[Array, ""]:
        a, b = (self.low - self.mean) / self.deviation, (self.high - self.mean) / self.deviation
        root = math.sqrt(2.0)
        width = erf(b / root) - erf(a / root)
        # From the nearer end, because one minus a small share loses the digits of the upper tail.
        share = ndtr(jnp.where(z > 0.0, -z, z))
        lower, upper = ndtr(a) + 0.5 * share * width, ndtr(-b) + 0.5 * share * width
        # Near the middle by erf: a narrow range has no digits left of shares about one half.
        middle = jnp.where(z > 0.0, erf(b / root) - share * width, erf(a / root) + share * width)
        near = jnp.abs(middle) < 0.5
        away = jnp.where(near, 0.25, jnp.where(z > 0.0, upper, lower))
        place = jnp.where(z > 0.0, -ndtri(away), ndtri(away))
        place = jnp.where(near, root * erf_inv(jnp.where(near, middle, 0.0)), place)
        return jnp.clip(self.mean + self.deviation * place, self.low, self.high)

    def outside(self, low: float, high: float) -> float:
        mean, deviation = float(self.mean), float(self.deviation)
        a, b = (float(self.low) - mean) / deviation, (float(self.high) - mean) / deviation
        below, above = (low - mean) / deviation, (high - mean) / deviation
        # The sum of the tails: one minus the share inside loses the digits of a rare rejection.
        lost = _normal_share(a, min(b, below)) if below > a else 0.0
        lost += _normal_share(max(a, above), b) if above < b else 0.0
        return lost / _normal_share(a, b)

    def text(self) -> str:
        return "truncated normal, " + _shown(
            mean=self.mean, deviation=self.deviation, low=self.low, high=self.high
        )


@final
class Constant(AbstractDistribution):
    """A constant value."""

    value: SingleNumberField = quantity(OF_INPUT, doc="value")

    @property
    def mean(self) -> Float[Array, ""]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The value itself."""
        return self.value

    @property
    def deviation(self) -> Float[Array, ""]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Zero."""
        return jnp.zeros_like(self.value)

    def sample(self, key: Array) -> Float[Array, ""]:
        del key
        return self.value

    def from_normal(self, z: Float[Array, "..."]) -> Float[Array, ""]:
        # Plus zero, for the shape and the derivative of z.
        return self.value + 0.0 * z

    def outside(self, low: float, high: float) -> float:
        return float(not low <= float(self.value) <= high)

    def text(self) -> str:
        return "constant, " + _shown(value=self.value)
