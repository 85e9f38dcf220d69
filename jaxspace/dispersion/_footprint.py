"""Where the runs of a campaign land: its footprint on the ground, with ellipses.

The runs have the outputs `east` and `north`, from the point that they started at.
"""

from typing import NamedTuple

import numpy as np

from ._moments import Ellipsoid

LANDING = ("east", "north")
"""The outputs that say where a run lands."""
SHARES = (0.5, 0.9, 0.99)
"""Those of the runs that the ellipses hold, where the landings are normally distributed."""


class Footprint(NamedTuple):
    """The landings of the good runs.

    - `points`: to the east and to the north, (2, runs).
    - `unit`: theirs.
    - `ellipses`: of 50, 90 and 99 % of a normal distribution, in this order."""

    points: np.ndarray
    unit: str
    ellipses: tuple[Ellipsoid, ...]


def semi_axes(ellipse: Ellipsoid) -> tuple[float, float]:
    """The long and the short semi-axis of an ellipse, in its unit."""
    long, short = np.linalg.norm(ellipse.axes, axis=0)
    return float(long), float(short)


def bearing(ellipse: Ellipsoid) -> float:
    """The direction of the long axis of an ellipse of (east, north), deg from north towards east,
    from 0 to 180."""
    east, north = ellipse.axes[:, 0]
    return float(np.degrees(np.arctan2(east, north)) % 180.0)
