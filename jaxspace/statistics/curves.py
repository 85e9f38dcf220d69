"""Whether a measured curve is a plausible one of many: Hotelling's test on their main modes.

    X - mean = U S V^T / sqrt(n - 1),   c = V_k^T (y - mean)
    T^2 = sum_i c_i^2 / (s_i^2 + noise^2),   i = 1 ... k
    T^2 n (n - k) / ((n^2 - 1) k) ~ F(k, n - k)                         without noise

    symbol   meaning                                                    unit
    X        curves of n runs, a row each                               its own
    y        the measured curve                                         its own
    s_i      standard deviation of the runs along mode i                its own
    k        number of modes                                            1

With as many points as a log has, the covariance of a few hundred runs is singular: the modes are
those along which the runs differ. With a noise of the measurement T^2 has the chi-square
distribution instead, with k degrees of freedom, to the accuracy to which the runs give s_i.

Source: Anderson, An Introduction to Multivariate Statistical Analysis, 5.2 and 11.2.
"""

__all__ = ["CurveTest", "curve_test"]

from typing import NamedTuple

import numpy as np

from ..core import InputError
from ..core.printing import printed

SHARE = 0.99
"""Share of the variance of the runs that the modes contain."""
MOST_MODES = 8
RUNS_PER_MODE = 10
LEAST_RUNS = 20


@printed(chi_square="", modes="", probability="", share="")
class CurveTest(NamedTuple):
    """How a curve compares with those of many runs.

    - `chi_square`: T^2, about as large as `modes` for a plausible curve.
    - `modes`: its degrees of freedom.
    - `probability`: that a run of the campaign has a greater value.
    - `share`: of the variance of the runs that the modes contain.
    - `runs`: that the test is based on."""

    chi_square: float
    modes: int
    probability: float
    share: float
    runs: int


def curve_test(curve: np.ndarray, curves: np.ndarray, noise: float = 0.0) -> CurveTest:
    """Test whether a curve is plausible as one of many.

    **Arguments**

    - `curve`: the measured one, (points,).
    - `curves`: those of the runs at the same points, (runs, points).
    - `noise`: standard deviation of independent errors of each point of `curve`.

    **Raises** `InputError` for fewer than 20 runs, for numbers that are not finite, and for runs
    that do not differ."""
    from scipy.special import fdtrc, gammaincc

    runs = curves.shape[0]
    if runs < LEAST_RUNS:
        raise InputError(f"curves has {runs} runs: it must have at least {LEAST_RUNS}.")
    if not (np.all(np.isfinite(curves)) and np.all(np.isfinite(curve))):
        raise InputError("curves and curve must be finite.")
    mean = curves.mean(axis=0)
    _, s, modes = np.linalg.svd((curves - mean) / np.sqrt(runs - 1.0), full_matrices=False)
    part = np.cumsum(s**2) / max(np.sum(s**2), np.finfo(float).tiny)
    # Those of the order of rounding are no modes.
    alive = int(np.sum(s > 1e-9 * np.max(np.abs(curves), initial=0.0)))
    if not alive:
        raise InputError("The curves of all runs are equal: they do not scatter.")
    most = min(MOST_MODES, runs // RUNS_PER_MODE, alive)
    k = min(int(np.searchsorted(part, SHARE)) + 1, most)
    c = modes[:k] @ (curve - mean)
    square = float(np.sum(c**2 / (s[:k] ** 2 + noise**2)))
    if noise > 0.0:
        probability = float(gammaincc(0.5 * k, 0.5 * square))
    else:
        f = square * runs * (runs - k) / ((runs**2 - 1.0) * k)
        probability = float(fdtrc(k, runs - k, f))
    return CurveTest(square, k, probability, float(part[k - 1]), runs)
