"""The inputs that contribute to the variance of an output.

They follow from a regression on the standardised inputs and on their squares, made orthogonal to
them:

    u = (y - mean(y)) / s_y = sum_j f_j + rest,      f_j = beta_j z_j + gamma_j q_j
    z_j = (x_j - mean(x_j)) / s_j,      q_j = z_j^2 - 1 - mean(z_j^3) z_j
    share_j = mean(u f_j),      sum_j share_j = R^2

The shares add up to R^2 exactly; of independent inputs share_j is
beta_j^2 + gamma_j^2 mean(q_j^2). For dependent inputs a share cannot be attributed to a single
input: contributions may cancel, and share_j may be negative. They are listed as a group, whose
share is the sum of theirs: the reduction of the variance if the whole group is fixed.

The rest, 1 - R^2, is due to products of inputs, to higher powers and to influences other than
inputs. The squares matter for outputs that are magnitudes (a pointing error, a cone angle), which
no linear law describes.

    symbol           meaning                                  unit
    y                output over the successful runs          that of the output
    x_j              input over the same runs                 that of the input
    s                standard deviation                       that of its quantity
    f_j              the part of u that depends on input j    1
    beta_j, gamma_j  regression coefficients                  1

A share smaller than about 1 / (number of runs) cannot be distinguished from none. Where all inputs
together explain no more than as many random columns would (an F test at 0.1 %), there are none.
"""

__all__ = ["Contributors"]

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ..core import InputError
from ..core.printing import printed
from ._rounding import scatters

LEAST_CORRELATION = 0.1
"""Inputs that correlate by less count as independent."""


@printed()
class Contributors(NamedTuple):
    """The contributors to the variance of an output.

    - `shares`: of the variance, by input, largest first; of inputs that depend on each other one
      share, by all their names, "a + b".
    - `r_squared`: the part of the variance that all inputs explain together.
    """

    output: str
    shares: dict[str, float]
    r_squared: float


def contributors(
    output: str,
    inputs: Mapping[str, np.ndarray],
    values: np.ndarray,
    good: np.ndarray,
) -> Contributors:
    """The shares of all inputs in the variance of `values`, those of `output` in all runs, over the
    runs that are `good`: see `Dispersion.contributors`."""
    y = values.astype(float)
    # One infinite value of an input would leave no number in the regression either.
    good = good & np.isfinite(y) & np.all([np.isfinite(x) for x in inputs.values()], axis=0)
    y = y[good]
    chosen = {name: x[good].astype(float) for name, x in inputs.items()}
    # A constant input explains nothing, and has zero standard deviation.
    columns = {name: x for name, x in chosen.items() if x.size and np.ptp(x) > 0.0}
    # The rounding of a constant output correlates with inputs by chance only.
    if not columns or not scatters(values[good]):
        return Contributors(output, {}, float("nan"))
    # Two coefficients for each input; with so few runs any output would be explained.
    needed = 2 * len(columns) + 1
    if y.size <= needed:
        raise InputError(
            f"{y.size} successful runs are too few to determine contributors: more than {needed} "
            "are required."
        )
    z = np.stack([_standard(x) for x in columns.values()])
    # Orthogonal to z, so that the shares of an input's two terms add.
    squares = z**2 - 1.0 - np.mean(z**3, axis=1, keepdims=True) * z
    u = _standard(y)
    regressors = np.concatenate([z, squares])
    products = regressors @ u
    coefficients = _coefficients(regressors, u)
    r_squared = 1.0 - float(np.mean((u - coefficients @ regressors) ** 2))
    if not _significant(r_squared, 2 * len(columns), y.size):
        return Contributors(output, {}, r_squared)
    # Covariances with what each input does, which add up to R^2, while squares of coefficients
    # do not in a sample, where the regressors are not quite orthogonal.
    parts = coefficients * products / u.size
    each = parts[: len(columns)] + parts[len(columns) :]
    names = list(columns)
    shares = {
        " + ".join(names[k] for k in group): float(np.sum(each[group]))
        for group in dependent_groups(regressors)
    }
    order = sorted(shares.items(), key=lambda pair: -pair[1])
    return Contributors(output, dict(order), r_squared)


def _coefficients(regressors: np.ndarray, u: np.ndarray) -> np.ndarray:
    """The coefficients of a least-squares fit of `u` by the `regressors`, (terms, runs): those of
    least squares among them, where regressors depend on each other exactly."""
    # Products of the regressors would lose the digits of inputs that differ by less than the root
    # of the rounding. The triangular factor of all runs is small, and keeps them.
    factor = np.linalg.qr(np.concatenate([regressors, u[None]]).T, mode="r")
    least = np.finfo(float).eps * max(regressors.shape)
    return np.linalg.lstsq(factor[:-1, :-1], factor[:-1, -1], rcond=least)[0]


def dependent_groups(regressors: np.ndarray) -> list[np.ndarray]:
    """The inputs in groups of those that depend on each other, by their numbers.

    - `regressors`: of n inputs, z_j and then q_j, (2 n, runs); both have the mean zero."""
    count, runs = len(regressors) // 2, regressors.shape[1]
    # An input with two values has constant squares, which depend on nothing.
    size = np.sqrt(np.mean(regressors**2, axis=1))
    scaled = regressors / np.where(size > 1e-9, size, np.inf)[:, None]
    correlation = np.abs(scaled @ scaled.T) / runs
    blocks = correlation.reshape(2, count, 2, count).max(axis=(0, 2))
    # Four standard deviations of a correlation by chance; a smaller true one moves a share by less
    # than its square.
    linked = blocks > max(LEAST_CORRELATION, 4.0 / np.sqrt(runs))
    if not np.any(linked & ~np.eye(count, dtype=bool)):
        return list(np.arange(count)[:, None])
    # SciPy is slow to import.
    from scipy.sparse.csgraph import connected_components

    _, labels = connected_components(linked, directed=False)
    return [np.flatnonzero(labels == label) for label in dict.fromkeys(labels)]


def _significant(r_squared: float, regressors: int, runs: int) -> bool:
    """Whether as many random columns would explain less, except in one case of a thousand."""
    rest = runs - regressors - 1
    # A relation that is exact to rounding leaves no residual to compare with.
    if r_squared >= 1.0 - 1e-12:
        return True
    # The part that random columns explain on average. R^2 has a beta distribution, whose tail has
    # Chernoff's bound: where it decides, SciPy, which is slow to import, is not needed.
    mean = regressors / (regressors + rest)
    if r_squared <= mean:
        return False
    bound = regressors * math.log(r_squared / mean)
    bound += rest * math.log((1.0 - r_squared) / (1.0 - mean))
    if bound < 2.0 * math.log(1e-3):
        return True
    from scipy.special import fdtrc

    statistic = (r_squared / regressors) / ((1.0 - r_squared) / rest)
    return bool(fdtrc(regressors, rest, statistic) < 1e-3)


def _standard(x: np.ndarray) -> np.ndarray:
    """The values shifted and scaled to zero mean and unit standard deviation."""
    return (x - np.mean(x)) / np.std(x)
