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
from ..sampling.designs import check_sobol_dimensions, map_normals, normal_columns
from ..statistics.sample_check import scatters
from ._campaign import Campaign, check_no_sweep
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
    - `runs`: all runs made; `failed`: those that failed, or that have an output which is not
      finite. A point of which one run failed is left out of all means.
    - `left_out[output]`: number of points that the means of an output leave out, because it is not
      finite in one of their runs, or because one failed: its indices are those of the others."""

    indices: dict[str, dict[str, SobolIndex]]
    runs: int
    failed: int
    left_out: dict[str, int]


def sobol_indices(
    campaign: Campaign,
    points: int = 512,
    *,
    seed: int = 0,
    accuracy: Accuracy | Scalar | None = None,
) -> SobolIndices:
    """The Sobol indices of every output in every independent input.

    **Arguments**

    - `campaign`: of the runs. Inputs that belong together (a correlated group, a direction) have
      one index, by the name of the first of them.
    - `points`: a power of two. There are (inputs + 2) runs for each.
    - `seed`: of the scrambling; `accuracy`: as in `disperse`.

    **Returns** a `SobolIndices`; an output without dispersion has zero indices, and one that
    is finite at fewer than two points has NaN.

    **Raises** `InputError` unless `points` is a power of two, and for inputs behind which there are
    more than 10600 standard normal numbers, half of the dimensions that Sobol points have."""
    from scipy.special import ndtri
    from scipy.stats import qmc

    check_whole("points", points, 2)
    check_whole("seed", seed, 0)
    # Sobol points are balanced in powers of two alone.
    if points & (points - 1):
        raise InputError(f"points is {points}: it must be a power of two, 2 or more.")
    check_no_sweep(campaign, "sobol_indices")
    columns = normal_columns(campaign.inputs)
    d = sum(len(group) for group in columns.values())
    check_sobol_dimensions(2 * d)
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
    names = list(columns)
    indices, left_out = {}, {}
    failed = ~result.good
    for output, y in result.outputs.items():
        # One infinite value would make every mean infinite.
        usable = result.good & np.isfinite(y)
        failed = failed | ~usable
        points_used = usable.reshape(len(samples), points).all(axis=0)
        values = y.reshape(len(samples), points)[:, points_used]
        indices[output] = _indices(names, values)
        left_out[output] = int(np.count_nonzero(~points_used))
    return SobolIndices(indices, len(failed), int(np.count_nonzero(failed)), left_out)


def _indices(names: list[str], values: np.ndarray) -> dict[str, SobolIndex]:
    """The indices of one output from its values on A, B and every A_j, (inputs + 2, points)."""
    # An output whose variance is only rounding depends on nothing.
    if values.shape[1] > 1 and not scatters(values):
        return {name: SobolIndex(0.0, 0.0, 0.0, 0.0) for name in names}
    f_a, f_b, *f_mixed = values.astype(float)
    # With one point, or where only the mixed runs differ, the variance is zero.
    if values.shape[1] < 2 or not (np.ptp(f_a) > 0.0 or np.ptp(f_b) > 0.0 or f_a[0] != f_b[0]):
        return {name: SobolIndex(*(float("nan"),) * 4) for name in names}
    # The estimator of the first order multiplies by f(B): without the mean its variance is smaller.
    centre = 0.5 * (f_a.mean() + f_b.mean())
    f_a, f_b = f_a - centre, f_b - centre
    variance = 0.5 * float(np.mean(f_a**2) + np.mean(f_b**2))
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
