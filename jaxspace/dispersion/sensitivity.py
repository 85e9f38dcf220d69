"""Sensitivity of an output to the inputs of a campaign: Sobol indices, from further runs.

    S_j  = V(E[y | x_j]) / V(y)            first order: x_j alone
    S_Tj = E[V(y | x without x_j)] / V(y)  total: x_j with all its products

From two independent samples A and B, and A with the column j of B (A_j), n runs each:

    S_j  = mean(f(B) (f(A_j) - f(A))) / V   Saltelli et al., Comput. Phys. Commun. 181 (2010), 259
    S_Tj = mean((f(A) - f(A_j))^2) / (2 V)  Jansen, Comput. Phys. Commun. 117 (1999), 35

The samples are scrambled Sobol points, on which the errors fall nearly as 1/n.
"""

__all__ = ["SobolIndices", "sobol_indices"]

from typing import NamedTuple

import numpy as np

from ..core import InputError, Scalar
from ..core.printing import printed
from ..integration.accuracy import Accuracy
from ..sampling.designs import map_normals, normal_columns
from ._campaign import Campaign
from ._whole import check_whole
from .evaluate import Evaluator


@printed()
class SobolIndex(NamedTuple):
    """First-order and total index of an input, each with its standard error."""

    first: float
    first_error: float
    total: float
    total_error: float


@printed()
class SobolIndices(NamedTuple):
    """Sobol indices by output and input.

    - `indices[output][input]`: a `SobolIndex`.
    - `runs`: all runs made; `failed`: those that failed. A point of which one run failed is left
      out of all the means."""

    indices: dict[str, dict[str, SobolIndex]]
    runs: int
    failed: int


def sobol_indices(
    campaign: Campaign,
    points: int = 512,
    *,
    seed: int = 0,
    accuracy: Accuracy | Scalar | None = None,
) -> SobolIndices:
    """The Sobol indices of every output in every independent input.

    **Arguments**

    - `campaign`: what runs. Inputs that belong together (a correlated group, a direction) have one
      index, by the name of the first of them.
    - `points`: a power of two. There are (inputs + 2) runs for each.
    - `seed`: of the scrambling; `accuracy`: as in `disperse`.

    **Raises** `InputError` unless `points` is a power of two."""
    from scipy.special import ndtri
    from scipy.stats import qmc

    check_whole("points", points, 2)
    check_whole("seed", seed, 0)
    # Sobol points are balanced in powers of two alone.
    if points & (points - 1):
        raise InputError(f"points is {points}: it must be a power of two, 2 or more.")
    columns = normal_columns(campaign.inputs)
    d = sum(len(group) for group in columns.values())
    u = qmc.Sobol(2 * d, rng=np.random.default_rng(seed)).random(points)
    # A point on the border of the unit cube has no finite normal value.
    z = ndtri(np.clip(u, 1e-12, 1.0 - 1e-12))
    a, b = z[:, :d], z[:, d:]
    samples = [a, b]
    for group in columns.values():
        mixed = a.copy()
        # A group as a whole: one column of it alone would break its correlation.
        mixed[:, group] = b[:, group]
        samples.append(mixed)
    run = Evaluator(campaign, campaign.accuracy_for(accuracy))
    # All samples in one call, which fills its blocks across them.
    result = run(map_normals(campaign.inputs, np.concatenate(samples)))
    good = result.good.reshape(len(samples), points).all(axis=0)
    names = list(columns)
    indices = {}
    for output, y in result.outputs.items():
        values = y.astype(float).reshape(len(samples), points)[:, good]
        indices[output] = _indices(names, values)
    return SobolIndices(indices, len(result.status), int(np.count_nonzero(~result.good)))


def _indices(names: list[str], values: np.ndarray) -> dict[str, SobolIndex]:
    """The indices of one output from its values on A, B and every A_j, (inputs + 2, points)."""
    f_a, f_b, *f_mixed = values
    # The estimator of the first order multiplies by f(B): without the mean it scatters less.
    centre = 0.5 * (f_a.mean() + f_b.mean())
    f_a, f_b = f_a - centre, f_b - centre
    variance = 0.5 * float(np.mean(f_a**2) + np.mean(f_b**2))
    # An output without variance has the indices zero.
    if variance == 0.0 or f_a.size < 2:
        return {name: SobolIndex(0.0, 0.0, 0.0, 0.0) for name in names}
    root = np.sqrt(f_a.size)
    result = {}
    for name, f_j in zip(names, f_mixed, strict=True):
        first = f_b * (f_j - centre - f_a) / variance
        total = 0.5 * (f_a - (f_j - centre)) ** 2 / variance
        result[name] = SobolIndex(
            float(first.mean()),
            float(first.std(ddof=1) / root),
            float(total.mean()),
            float(total.std(ddof=1) / root),
        )
    return result
