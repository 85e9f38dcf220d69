"""Probability densities of the inputs of a campaign, for the weights of its runs under other
distributions.

A distribution defines its values from a standard normal number, x = F^-1(Phi(z)), so that its
density follows from the same function:

    p(x) = phi(z) / (dx/dz),   z = Phi^-1(F(x))

Normal, uniform and lognormal distributions have it in closed form; of others z is found by
bisection. A list of values has probabilities instead. Jointly normal numbers have

    ln p(x) = -|S^-1 (x - m)|^2/2 - ln |det S| - n ln(2 pi)/2

and a Gaussian copula the densities of its marginals times that of the copula.
"""

__all__ = ["is_listed", "log_density"]

import math

import jax
import jax.numpy as jnp
import numpy as np

from ..core import InputError
from ._correlated import Correlated, MultivariateNormal
from ._more_distributions import Discrete, Lognormal, Samples
from .distributions import AbstractDistribution, Constant, Normal, Uniform
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
    return _by_normals(distribution, x)[1]


def normals_of(distribution: AbstractDistribution, x: np.ndarray) -> np.ndarray:
    """The standard normal numbers of which a continuous distribution makes the values, (runs,)."""
    return _by_normals(distribution, x)[0]


def _check_spread(deviation: float) -> None:
    if not deviation > 0.0:
        raise InputError("A distribution without dispersion has no density.")


def _by_normals(distribution: AbstractDistribution, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The normal numbers of the values, and the logarithms of their densities, (runs,)."""
    x = np.asarray(x, float)

    def value(z: jax.Array) -> jax.Array:
        return jax.vmap(distribution.from_normal)(z)

    low, high = np.full(x.shape, -FAR), np.full(x.shape, FAR)
    first, last = (np.asarray(value(jnp.asarray(z))) for z in (low, high))
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        below = np.asarray(value(jnp.asarray(middle))) < x
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    z = 0.5 * (low + high)
    _, slope = jax.jvp(value, (jnp.asarray(z),), (jnp.ones(x.shape),))
    with np.errstate(divide="ignore"):
        log = -0.5 * z**2 - LOG_ROOT_2_PI - np.log(np.abs(np.asarray(slope)))
    # To rounding of the ends, which draws may have.
    margin = 1e-12 * np.maximum(np.abs(first), np.abs(last))
    outside = (x < first - margin) | (x > last + margin) | ~np.isfinite(log)
    return z, np.where(outside, -np.inf, log)


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
