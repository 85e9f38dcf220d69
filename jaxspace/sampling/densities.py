"""Probability densities of the inputs of a campaign, for the weights of its runs under other
distributions.

A distribution defines its values from a standard normal number, x = F^-1(Phi(z)), so that its
density follows from the same function:

    p(x) = phi(z) / (dx/dz),   z = Phi^-1(F(x))

The distributions of this package have it in closed form; of others z is found by bisection. A list
of values has probabilities instead. Jointly normal numbers have

    ln p(x) = -|S^-1 (x - m)|^2/2 - ln |det S| - n ln(2 pi)/2

and a Gaussian copula the densities of its marginals times that of the copula.
"""

__all__ = ["is_listed", "log_density"]

import math

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from ..core import InputError
from ..core.jit import jit_quickly
from ._correlated import Correlated, MultivariateNormal
from ._more_distributions import Discrete, Lognormal, Samples, Triangular
from .distributions import AbstractDistribution, Constant, Normal, TruncatedNormal, Uniform
from .joint import AbstractJoint

# Normal numbers of draws: a probability of 1e-19 beyond.
FAR = 9.0
HALVINGS = 60
LOG_ROOT_2_PI = 0.5 * math.log(2.0 * math.pi)


def is_listed(distribution: AbstractDistribution | AbstractJoint) -> bool:
    """Whether the values of a distribution are those of a list, which have probabilities."""
    return isinstance(distribution, Discrete | Samples | Constant)


def log_density(distribution: AbstractDistribution | AbstractJoint, x: np.ndarray) -> np.ndarray:
    """The logarithm of the probability density, or of the probability of a value of a list.

    **Arguments**

    - `distribution`: of one number, or of n together.
    - `x`: the values, (runs,), or (n, runs).

    **Returns** (runs,); minus infinity where a value cannot occur.

    **Raises** `InputError` for joint distributions without a density, such as directions on a
    sphere and singular covariances."""
    if isinstance(distribution, AbstractJoint):
        return _joint(distribution, x)
    if is_listed(distribution):
        return _listed(distribution, x)
    with np.errstate(divide="ignore", invalid="ignore"):
        if isinstance(distribution, Normal):
            mean, deviation = float(distribution.mean), float(distribution.deviation)
            _check_spread(deviation)
            return -0.5 * ((x - mean) / deviation) ** 2 - math.log(deviation) - LOG_ROOT_2_PI
        if isinstance(distribution, Uniform):
            low, high = float(distribution.low), float(distribution.high)
            return np.where((low <= x) & (x <= high), -math.log(high - low), -np.inf)
        if isinstance(distribution, Lognormal):
            m, s = (float(y) for y in (distribution.mean, distribution.deviation))
            square = math.log1p((s / m) ** 2)
            z = (np.log(np.maximum(x, 0.0) / m) + 0.5 * square) / math.sqrt(square)
            log = -0.5 * z**2 - np.log(x) - 0.5 * math.log(square) - LOG_ROOT_2_PI
            return np.where(x > 0.0, log, -np.inf)
        if isinstance(distribution, TruncatedNormal):
            inside = (float(distribution.low) <= x) & (x <= float(distribution.high))
            mean, deviation = distribution.mean, distribution.deviation
            whole = Normal(mean, deviation)
            # The share that the cut leaves, by the tails beyond it.
            share = 1.0 - whole.outside(float(distribution.low), float(distribution.high))
            return np.where(inside, log_density(whole, x) - math.log(share), -np.inf)
        if isinstance(distribution, Triangular):
            a, c, b = (float(y) for y in (distribution.low, distribution.mode, distribution.high))
            # A side of no width has no values.
            left, right = (x - a) / max(c - a, 1e-300), (b - x) / max(b - c, 1e-300)
            height = np.where(x < c, left, np.where(x > c, right, 1.0))
            return np.where((a <= x) & (x <= b), np.log(2.0 * height / (b - a)), -np.inf)
    return _by_normals(distribution, x)[1]


def normals_of(distribution: AbstractDistribution, x: np.ndarray) -> np.ndarray:
    """The standard normal numbers of which a continuous distribution makes the values, (runs,)."""
    if isinstance(distribution, Normal):
        return (x - float(distribution.mean)) / float(distribution.deviation)
    return _by_normals(distribution, x)[0]


def _check_spread(deviation: float) -> None:
    if not deviation > 0.0:
        raise InputError("A distribution without dispersion has no density.")


def _by_normals(distribution: AbstractDistribution, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The normal numbers of the values, and the logarithms of their densities, (runs,)."""
    x = np.asarray(x, float)
    z, slope, first, last = (np.asarray(y) for y in _bisected(distribution, jnp.asarray(x)))
    with np.errstate(divide="ignore"):
        log = -0.5 * z**2 - LOG_ROOT_2_PI - np.log(np.abs(slope))
    # To rounding of the ends, which draws may have.
    margin = 1e-12 * max(abs(first), abs(last))
    outside = (x < first - margin) | (x > last + margin) | ~np.isfinite(log)
    return z, np.where(outside, -np.inf, log)


@jit_quickly
def _bisected(
    distribution: AbstractDistribution, x: Float[Array, " runs"]
) -> tuple[Float[Array, " runs"], Float[Array, " runs"], Float[Array, ""], Float[Array, ""]]:
    """The normal numbers of the values, the slopes of the values there, and the values at both
    ends."""

    def value(z: Float[Array, " runs"]) -> Float[Array, " runs"]:
        return jax.vmap(distribution.from_normal)(z)

    def halve(_: ArrayLike, ends: tuple[Array, Array]) -> tuple[Array, Array]:
        low, high = ends
        middle = 0.5 * (low + high)
        below = value(middle) < x
        return jnp.where(below, middle, low), jnp.where(below, high, middle)

    ends = jnp.full(x.shape, -FAR), jnp.full(x.shape, FAR)
    low, high = jax.lax.fori_loop(0, HALVINGS, halve, ends)
    z = 0.5 * (low + high)
    _, slope = jax.jvp(value, (z,), (jnp.ones_like(z),))
    first, last = (distribution.from_normal(jnp.asarray(end)) for end in (-FAR, FAR))
    return z, slope, first, last


def _listed(distribution: AbstractDistribution, x: np.ndarray) -> np.ndarray:
    """The logarithm of the probability of each value."""
    if isinstance(distribution, Discrete):
        values, weights = np.asarray(distribution.values), np.asarray(distribution.weights, float)
    elif isinstance(distribution, Samples):
        values = np.asarray(distribution.values)
        weights = np.ones(values.shape)
    else:
        values, weights = np.asarray(distribution.mean).reshape(1), np.ones(1)
    known, place = np.unique(values, return_inverse=True)
    shares = np.bincount(place.ravel(), weights) / weights.sum()
    at = np.clip(np.searchsorted(known, x), 0, known.size - 1)
    with np.errstate(divide="ignore"):
        return np.where(known[at] == x, np.log(shares[at]), -np.inf)


def _joint(joint: AbstractJoint, x: np.ndarray) -> np.ndarray:
    """The logarithm of the density of numbers that are drawn together, x of (n, runs)."""
    if isinstance(joint, MultivariateNormal):
        mean, factor = np.asarray(joint.centre), np.asarray(joint.factor)
        return _normal(x - mean[:, None], factor @ factor.T)
    if isinstance(joint, Correlated):
        if any(is_listed(d) for d in joint.marginals):
            raise InputError("Correlated values of a list have no density.")
        z = np.stack([normals_of(d, row) for d, row in zip(joint.marginals, x, strict=True)])
        factor = np.asarray(joint.factor)
        log = _normal(z, factor @ factor.T) - np.sum(-0.5 * z**2 - LOG_ROOT_2_PI, axis=0)
        with np.errstate(invalid="ignore"):
            each = [log_density(d, row) for d, row in zip(joint.marginals, x, strict=True)]
            return log + np.sum(each, axis=0)
    raise InputError(f"A {type(joint).__name__} has no density that weights could use.")


def _normal(away: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """The logarithm of the density of jointly normal numbers."""
    scale = np.sqrt(np.diag(covariance))
    _check_spread(float(scale.min()))
    sizes, axes = np.linalg.eigh(covariance / np.outer(scale, scale))
    if sizes[0] < 1e-12:
        raise InputError("Numbers with a singular covariance have no density.")
    u = (axes.T @ (away / scale[:, None])) / np.sqrt(sizes)[:, None]
    logs = 0.5 * np.sum(np.log(sizes)) + np.sum(np.log(scale)) + len(scale) * LOG_ROOT_2_PI
    return -0.5 * np.sum(u**2, axis=0) - logs
