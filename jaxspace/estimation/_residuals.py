"""Tests of residuals against the assumed noise, with p-values.

    spread     sum r^2 ~ chi^2 with m - n degrees of freedom       (the noise as stated)
    mean       sqrt(m) mean(r) / s ~ normal                        (no bias left)
    whiteness  m (m + 2) sum_k rho_k^2 / (m - k) ~ chi^2(k max)    (nothing left in time)
    normality  m/6 (skewness^2 + excess^2 / 4) ~ chi^2(2)          (no outliers)

    symbol  meaning
    r       residual over its standard deviation
    rho_k   autocorrelation of the residuals at lag k
    m, n    number of readings and of parameters

A p-value is the probability of a larger statistic by chance: below 0.01, look at the residuals.

Source: Ljung and Box (Biometrika 65, 1978); Jarque and Bera (Econ. Lett. 6, 1980).
"""

from typing import NamedTuple

import jax.numpy as jnp
from jax.scipy.special import erfc, gammaincc
from jaxtyping import Array, Bool, Float

from ..core.printing import printed

LAGS = 10


@printed()
class ResidualTests(NamedTuple):
    """p-values of the residuals of one instrument: of `mean`, `whiteness` and `normality`."""

    mean: Float[Array, ""]
    whiteness: Float[Array, ""]
    normality: Float[Array, ""]


def chi_squared_tail(value: Array, degrees: Array | float) -> Array:
    """The probability that chi^2 with these degrees of freedom exceeds the value."""
    half = 0.5 * jnp.asarray(degrees, value.dtype)
    return gammaincc(half, 0.5 * value)


def residual_tests(r: Float[Array, "..."], seen: Bool[Array, "..."]) -> ResidualTests:
    """The tests of residuals whose last axis is the time.

    **Arguments**

    - `r`: residuals over their standard deviations, times on the last axis.
    - `seen`: whether each reading is used."""
    r, seen = jnp.asarray(r), jnp.asarray(seen)
    r, seen = r.reshape(-1, r.shape[-1]), seen.reshape(-1, r.shape[-1])
    weight = seen.astype(r.dtype)
    m = jnp.sum(weight)
    mean = jnp.sum(weight * r) / m
    off = jnp.where(seen, r - mean, 0.0)
    variance = jnp.sum(off**2) / m
    # Residuals that are all zero pass every test.
    s = jnp.where(variance > 0.0, variance, 1.0) ** 0.5
    off = off / s
    # At longer lags there are few pairs, and their correlation is not normal.
    lags = min(LAGS, max(1, r.shape[-1] // 5))
    q = jnp.zeros((), r.dtype)
    for k in range(1, lags + 1):
        pairs = jnp.sum(weight[:, k:] * weight[:, :-k])
        rho = jnp.sum(off[:, k:] * off[:, :-k]) / m
        # Number of pairs instead of m - k: the rows of one instrument are separate times.
        q += jnp.where(pairs > 0.0, rho**2 * m * (m + 2.0) / jnp.maximum(pairs, 1.0), 0.0)
    skewness = jnp.sum(off**3) / m
    excess = jnp.where(variance > 0.0, jnp.sum(off**4) / m - 3.0, 0.0)
    jarque_bera = m / 6.0 * (skewness**2 + 0.25 * excess**2)
    return ResidualTests(
        erfc(jnp.abs(mean) / s * jnp.sqrt(0.5 * m)),
        chi_squared_tail(q, float(lags)),
        chi_squared_tail(jarque_bera, 2.0),
    )
