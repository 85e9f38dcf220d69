"""Bins of a histogram, also for values that differ by rounding only."""

import numpy as np

MOST_BINS = 60


def bins(x: np.ndarray) -> tuple[float, np.ndarray, float]:
    """Bins of a histogram: their starts, counts and width.

    One bin where the values differ by rounding only, which cannot be divided."""
    x = x.astype(float)
    low, high = float(x.min()), float(x.max())
    # Narrower bins than this have edges that are the same number.
    least = 1e3 * float(np.spacing(max(abs(low), abs(high), 1e-300)))
    if high - low <= least:
        width = max(1e-3 * abs(low), least)
        return low - 0.5 * width, np.array([x.size]), width
    # As many bins as the square root of the runs, within what a reader can see.
    number = int(np.clip(np.sqrt(x.size), 8, MOST_BINS))
    counts, _ = np.histogram(x, number, (low, high))
    return low, counts, (high - low) / number
