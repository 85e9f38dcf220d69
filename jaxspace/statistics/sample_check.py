"""Comparison of a mean and a standard deviation from few runs with those of a sample of runs.

    warning where  |m - m_s| > max(z e_m, a) s_s   or   |s/s_s - 1| > max(z e_s, a)

    symbol    meaning                                                        unit
    m, s      mean and deviation by a method without many runs               of the output
    m_s, s_s  those of the runs of a sample                                  of the output
    e_m, e_s  standard errors of the sample: of m_s over s_s, and of s_s/s   1
    z         how many of them are not due to chance: 4                      1
    a         difference that does not matter: 0.1                           1

Source: Kendall and Stuart, The Advanced Theory of Statistics, vol. 1, 10.9 (standard errors of a
mean and of a standard deviation). A small sample reveals only gross errors: for 256 normal values 4
e_m is 0.25, and 4 e_s is 0.18.
"""

import math

import numpy as np

from ._rounding import NOISE, rounded, scatters

SIGNIFICANT, MATTERS = 4.0, 0.1


def warning_of(mean: float, std: float, x: np.ndarray) -> str:
    """A message if mean or standard deviation of an output contradict a sample; empty if they
    agree.

    `x`: the output over the runs of a sample, (runs,), NaN where one failed."""
    # Too few runs for a comparison; the dispersion warns of them already.
    if x.size < 2:
        return ""
    finite = x[np.isfinite(x)]
    if finite.size < x.size:
        bad = f"{x.size - finite.size} of {x.size} runs fail, or are not finite"
        return f"{bad}, and are excluded from these numbers."
    sample_mean, spread = float(np.mean(x)), float(np.std(x, ddof=1))
    result = (
        f"{x.size} runs have the mean {rounded(sample_mean, spread)} and the standard deviation "
    )
    result += rounded(spread, spread)
    # The second-order moments of an output that is not smooth are NaN.
    if not math.isfinite(mean + std):
        return f"It is not smooth at the nominal run: {result}."
    if not scatters(x):
        grain = NOISE * float(np.finfo(float).eps) * float(np.max(np.abs(x)))
        same = max(abs(mean - sample_mean), std) <= grain
        return "" if same else f"{result}: no dispersion."
    off = (mean - sample_mean) / spread
    more = std / spread - 1.0
    error_of_mean, error_of_std = standard_errors(x)
    sound = abs(off) <= max(SIGNIFICANT * error_of_mean, MATTERS)
    sound = sound and abs(more) <= max(SIGNIFICANT * error_of_std, MATTERS)
    return (
        ""
        if sound
        else f"{result}: off by {off:+.2g} standard deviations and {100.0 * more:+.0f} %."
    )


def standard_errors(x: np.ndarray) -> tuple[float, float]:
    """Standard errors of a sample's mean, in standard deviations, and of its standard deviation,
    relative.

    They are 1/sqrt(n) and sqrt((k - 1)/(4 n)), with the kurtosis k: 3 for a normal distribution.
    Both are NaN for fewer than two values and for equal values."""
    n = x.size
    spread = float(np.std(x)) if x.size else 0.0
    if n < 2 or spread == 0.0:
        return math.nan, math.nan
    kurtosis = float(np.mean(((x - np.mean(x)) / spread) ** 4))
    return 1.0 / math.sqrt(n), math.sqrt((kurtosis - 1.0) / (4.0 * n))
