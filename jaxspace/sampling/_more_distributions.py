"""Skewed and discrete distributions, and those of measured values.

triangular    p(x) rises in a straight line from a to c, and falls to b
lognormal     ln x is normal:  s^2 = ln(1 + (d/m)^2),  ln x = ln m - s^2/2 + s z
discrete      x = v_k with the probability w_k / sum(w)
samples       x = one of the values of a list, each as likely

symbol   meaning                                     unit
a, b, c  least and greatest value, and the mode      that of the quantity
m, d     mean and standard deviation of x            that of the quantity
z        standard normal number                      1
"""

from typing import final

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import ndtr, ndtri
from jaxtyping import Array, Float, Int

from ..core import check, quantity
from ..core.checks import is_concrete
from ..core.types import SingleNumberField
from .distributions import (
    NOMINAL,
    OF_INPUT,
    SHARE_OF_INPUT,
    AbstractDistribution,
    _check_limits,
    _normal_share,
    _shown,
)


@final
class Triangular(AbstractDistribution):
    """A triangular distribution from `low` over its `mode` to `high`. Raises `InputError` unless
    low <= mode <= high and low < high."""

    mode: SingleNumberField = quantity(OF_INPUT, shared=NOMINAL, doc="the most frequent value")
    low: SingleNumberField = quantity(OF_INPUT, doc="lower limit")
    high: SingleNumberField = quantity(OF_INPUT, doc="upper limit")

    def __check_init__(self):
        super().__check_init__()
        _check_limits("Triangular", self.low, self.high)
        if is_concrete(self.mode) and is_concrete(self.low) and is_concrete(self.high):
            low, mode, high = (np.asarray(x) for x in (self.low, self.mode, self.high))
            check((low <= mode) & (mode <= high), "Triangular.mode", mode, f"{low:g} to {high:g}")

    @property
    def mean(self) -> Float[Array, ""]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """(a + b + c) / 3."""
        return (self.low + self.mode + self.high) / 3.0

    @property
    def deviation(self) -> Float[Array, ""]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """sqrt((a^2 + b^2 + c^2 - ab - ac - bc) / 18), as a sum of squares."""
        a, b, c = self.low, self.high, self.mode
        return jnp.sqrt(((a - b) ** 2 + (b - c) ** 2 + (c - a) ** 2) / 36.0)

    def sample(self, key: Array) -> Float[Array, ""]:
        return self.from_normal(jax.random.normal(key))

    def from_normal(self, z: Float[Array, "..."]) -> Float[Array, ""]:
        width = self.high - self.low
        below, above = ndtr(z), ndtr(-z)
        rising = below * width < self.mode - self.low
        # The root that is not taken gets one, because its slope at zero would be infinite.
        left = jnp.where(rising, below * width * (self.mode - self.low), 1.0)
        right = jnp.where(rising, 1.0, above * width * (self.high - self.mode))
        return jnp.where(rising, self.low + jnp.sqrt(left), self.high - jnp.sqrt(right))

    def outside(self, low: float, high: float) -> float:
        a = float(self.low)
        b = float(self.high)
        c = float(self.mode)

        left, right, at_mode = (b - a) * (c - a), (b - a) * (b - c), (c - a) / (b - a)

        def below(x: float) -> float:
            """The share from a to x, without a difference of shares about one."""
            if x >= b:
                return 1.0
            return (x - a) ** 2 / left if x < c else at_mode + (x - c) * (2.0 * b - c - x) / right

        def above(x: float) -> float:
            """The share from x to b."""
            if x <= a:
                return 1.0
            if x > c:
                return (b - x) ** 2 / right
            return (1.0 - at_mode) + (c - x) * (c + x - 2.0 * a) / left

        x, y = (min(max(v, a), b) for v in (low, high))
        return below(x) + above(y)

    def text(self) -> str:
        return "triangular, " + _shown(low=self.low, mode=self.mode, high=self.high)


@final
class Lognormal(AbstractDistribution):
    """A positive number whose logarithm is normal; `mean` and `deviation` refer to the number
    itself."""

    mean: SingleNumberField = quantity(OF_INPUT, positive=True, shared=NOMINAL, doc="mean")
    deviation: SingleNumberField = quantity(SHARE_OF_INPUT, positive=True, doc="standard deviation")

    def _logarithm(self) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """Mean and standard deviation of the logarithm."""
        square = jnp.log1p((self.deviation / self.mean) ** 2)
        return jnp.log(self.mean) - 0.5 * square, jnp.sqrt(square)

    def sample(self, key: Array) -> Float[Array, ""]:
        return self.from_normal(jax.random.normal(key))

    def from_normal(self, z: Float[Array, "..."]) -> Float[Array, ""]:
        _, spread = self._logarithm()
        # As a factor of the mean: in the logarithm of a large number a small spread is lost.
        return self.mean * jnp.exp(spread * (z - 0.5 * spread))

    def outside(self, low: float, high: float) -> float:
        centre, spread = (float(x) for x in self._logarithm())
        # The logarithm of zero is minus infinity, and the share below it zero.
        with np.errstate(divide="ignore"):
            places = [(float(np.log(max(x, 0.0))) - centre) / spread for x in (low, high)]
        return _normal_share(-np.inf, places[0]) + _normal_share(places[1], np.inf)

    def text(self) -> str:
        return "lognormal, " + _shown(mean=self.mean, deviation=self.deviation)


@final
class Discrete(AbstractDistribution):
    """One of the `values`, (n,), with probabilities as the `weights`, (n,)."""

    values: Float[Array, " n"] = quantity(OF_INPUT, shape=(None,), doc="possible values")
    weights: Float[Array, " n"] = quantity(
        "1", non_negative=True, shape=(None,), doc="relative frequencies, up to a common factor"
    )

    def __check_init__(self):
        super().__check_init__()
        if is_concrete(self.weights):
            same = np.shape(self.values) == np.shape(self.weights)
            one = np.ndim(self.values) == 1 and float(np.sum(np.asarray(self.weights))) > 0.0
            what = "one per value, and not all zero"
            check(same and one, "Discrete.weights", self.weights, what)

    @property
    def mean(self) -> Float[Array, ""]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """sum(w v) / sum(w)."""
        return jnp.sum(self.weights * self.values) / jnp.sum(self.weights)

    @property
    def deviation(self) -> Float[Array, ""]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The root of sum(w (v - mean)^2) / sum(w)."""
        square = self.weights * (self.values - self.mean) ** 2
        return jnp.sqrt(jnp.sum(square) / jnp.sum(self.weights))

    def sample(self, key: Array) -> Float[Array, ""]:
        share = jax.random.uniform(key)
        return self.values[_place(self.weights, share, 1.0 - share)]

    def from_normal(self, z: Float[Array, "..."]) -> Float[Array, ""]:
        return self.values[_place(self.weights, ndtr(z), ndtr(-z))]

    def searched(self, z: Float[Array, "..."]) -> tuple[Float[Array, ""], Float[Array, ""]]:
        shares, flat = self._searched_shares()
        place = _place(flat, ndtr(z), ndtr(-z))
        return self.values[place], shares[place] / flat[place]

    def spread(self, z: Float[Array, ""]) -> tuple[Float[Array, ""], Float[Array, ""]]:
        shares, flat = self._searched_shares()
        place = _place(flat, ndtr(z), ndtr(-z))
        factor = shares[place] / flat[place]

        def moved(tail: Array, order: int) -> Array:
            """The tail of the distribution beyond the number, counted from one end."""
            before = [(jnp.cumsum(x[::order])[::order] - x)[place] for x in (flat, shares)]
            inside = jnp.clip(tail - before[0], 0.0, flat[place])
            # A tail of zero would be an infinite number.
            return jnp.maximum(before[1] + factor * inside, jnp.finfo(tail.dtype).tiny)

        below, above = moved(ndtr(z), 1), moved(ndtr(-z), -1)
        # From the nearer end, at which the tail keeps its digits.
        near = ndtri(jnp.minimum(below, above))
        return jnp.where(below < above, near, -near), factor

    def _searched_shares(self) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
        """The probabilities of the values, and those in a search for rare events: one of five draws
        takes every value that may occur alike."""
        shares = self.weights / jnp.sum(self.weights)
        some = (shares > 0.0).astype(shares.dtype)
        return shares, 0.8 * shares + 0.2 * some / jnp.sum(some)

    def outside(self, low: float, high: float) -> float:
        values, weights = np.asarray(self.values), np.asarray(self.weights)
        return float(weights[(values < low) | (values > high)].sum() / weights.sum())

    def text(self) -> str:
        pairs = zip(np.asarray(self.values), np.asarray(self.weights), strict=True)
        return "discrete, " + ", ".join(f"{v:.9g} ({w:.4g})" for v, w in pairs)


def _place(
    weights: Float[Array, " n"], below: Float[Array, "*runs"], above: Float[Array, "*runs"]
) -> Int[Array, "*runs"]:
    """The index in a list with these weights such that the share `below` of all draws is before it,
    and `above` = 1 - `below` after it; never one with zero weight."""
    count = weights.size
    # From the nearer end: a small weight at the far end is lost in the sum of the others.
    ends, tails = jnp.cumsum(weights), jnp.cumsum(weights[::-1])
    early = jnp.searchsorted(ends, below * ends[-1], side="right").astype(int)
    late = jnp.searchsorted(tails, above * tails[-1], side="left").astype(int)
    place = jnp.where(below < 0.5, early, count - 1 - late)
    # At a share of zero or one, also by rounding, the first or the last one that may occur.
    some = weights > 0.0
    first, last = jnp.argmax(some), count - 1 - jnp.argmax(some[::-1])
    return jnp.clip(place, first.astype(int), last.astype(int))


@final
class Samples(AbstractDistribution):
    """One of the measured `values`, (n,), each as likely: as from a file of test firings."""

    values: Float[Array, " n"] = quantity(OF_INPUT, shape=(None,), doc="measured values")

    def __check_init__(self):
        super().__check_init__()
        if is_concrete(self.values):
            check(np.ndim(self.values) == 1 and np.size(self.values) > 0, "Samples.values",
                  self.values, "a list of one or more numbers")  # fmt: skip

    @property
    def mean(self) -> Float[Array, ""]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Mean of the values."""
        return jnp.mean(self.values)

    @property
    def deviation(self) -> Float[Array, ""]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Standard deviation of the values as a whole population: division by n, not n - 1."""
        return jnp.std(self.values)

    def sample(self, key: Array) -> Float[Array, ""]:
        return self.values[jax.random.randint(key, (), 0, self.values.size)]

    def from_normal(self, z: Float[Array, "..."]) -> Float[Array, ""]:
        # Sorted, so that neighbours of a hypercube are neighbours among the values.
        place = jnp.floor(ndtr(z) * self.values.size).astype(int)
        return jnp.sort(self.values)[jnp.clip(place, 0, self.values.size - 1)]

    def outside(self, low: float, high: float) -> float:
        values = np.asarray(self.values)
        return float(np.mean((values < low) | (values > high)))

    def text(self) -> str:
        return f"{self.values.size} samples, " + _shown(mean=self.mean, deviation=self.deviation)
