"""Violations of a requirement among normal numbers that scatter more widely than the inputs do.

    z = s u,   t z with the least t in (0, 1] for which g(t z) < 0

    symbol  meaning                                                   unit
    u       standard normal numbers                                   1
    s       scale of the search, 1.5 to 4                             1
    z       standard normal numbers behind the inputs                 1
    g       margin of the requirement, negative where it is violated  of the output

Chains of a subset simulation descend from few runs, and lose regions on their way. The violations
of this search are independent of one another, and regions of violation that are about equally far
off are found equally often: of k violations, a region with the share a is missed with the
probability (1 - a)^k. They are not distributed as violations are, so that they only show where to
draw.
Source: Bucher, Struct. Saf. 31 (2009), 2 (asymptotic sampling).
"""

import numpy as np

from ._subset import Margin

SCALES = (1.5, 2.0, 2.5, 3.0, 4.0)
# A scale at which so many of the runs violate the requirement is wide enough.
FREQUENT = 0.1
# Halvings of the interval for t.
HALVINGS = 4


def search_widely(
    margin: Margin, wanted: int, n: int, rng: np.random.Generator
) -> tuple[np.ndarray, int]:
    """About so many violations as are `wanted`, (runs, n), or none; and number of runs used."""
    made = 0
    z = np.zeros((0, n))
    for scale in SCALES:
        z = scale * rng.standard_normal((wanted, n))
        z = z[margin(z) < 0.0]
        made += wanted
        if len(z) >= FREQUENT * wanted:
            more = int((wanted - len(z)) * wanted / len(z))
            trial = scale * rng.standard_normal((more, n))
            made += more
            return np.concatenate([z, trial[margin(trial) < 0.0]]), made
    return z, made


def pulled_in(margin: Margin, z: np.ndarray) -> tuple[np.ndarray, int]:
    """The violations z, (runs, n), moved towards zero until the requirement is almost met there;
    and number of runs used."""
    if len(z) == 0:
        return z, 0
    low, high = np.zeros(len(z)), np.ones(len(z))
    for _ in range(HALVINGS):
        t = 0.5 * (low + high)
        violated = margin(t[:, None] * z) < 0.0
        low, high = np.where(violated, low, t), np.where(violated, t, high)
    return high[:, None] * z, HALVINGS * len(z)
