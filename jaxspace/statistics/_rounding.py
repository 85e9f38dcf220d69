"""One rule for the digits of every number of a campaign, in tables, figures and pages."""

import math

import numpy as np

# Differences up to this many units of rounding are not dispersion: they come from sums over the
# steps.
NOISE = 4096.0


def rounded(value: float, deviation: float) -> str:
    """The value rounded to a hundredth of the first digit of the standard deviation: 84795, 1953,
    0.0214.

    Without dispersion, six significant digits. Very large and very small numbers have an exponent,
    and digits to the same place."""
    if not math.isfinite(value):
        return "∞" if value > 0.0 else "-∞" if value < 0.0 else "none"
    if value == 0.0:
        return "0"
    # A deviation of the order of rounding does not decide the number of digits.
    if not (math.isfinite(deviation) and deviation > 1e-12 * abs(value)):
        return f"{value:.6g}"
    place = math.floor(math.log10(deviation)) - 2
    size = math.floor(math.log10(abs(value)))
    # Below the last digit shown: 7e-13 is irrelevant next to 0.0031.
    if size < place:
        return "0"
    if not -6 < size < 9:
        # At most the precision of float64.
        return f"{value:.{min(max(size - place, 0), 14)}e}"
    text = f"{value:.{max(-place, 0)}f}"
    # Not "-0.00", which a rounded negative number gives.
    return text.lstrip("-") if float(text) == 0.0 else text


def scatters(x: np.ndarray) -> bool:
    """Whether the values differ by more than the rounding of their size."""
    if x.size < 2:
        return False
    spread = float(np.max(x)) - float(np.min(x))
    eps = float(np.finfo(x.dtype).eps) if x.dtype.kind == "f" else 0.0
    return spread > NOISE * eps * float(np.max(np.abs(x)))
