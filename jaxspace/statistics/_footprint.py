"""Footprint of a campaign on the ground, with ellipses of its landings.

The runs have the outputs `east` and `north`, from the point that they started at.
"""

from typing import NamedTuple

import numpy as np

from ..core.printing import printed
from .spread import Ellipsoid

LANDING = ("east", "north")
"""The outputs that contain the landing point of a run."""
SHARES = (0.5, 0.9, 0.99)
"""Shares of the runs within the ellipses, for normally distributed landings."""


@printed()
class Footprint(NamedTuple):
    """The landings of the successful runs.

    - `points`: to the east and to the north, (2, runs).
    - `unit`: theirs.
    - `ellipses`: of 50, 90 and 99 % of a normal distribution, in this order.
    - `required`: the largest distance from the origin that the campaign allows, in `unit`; `None`
      without such a requirement, and if its unit cannot be converted."""

    points: np.ndarray
    unit: str
    ellipses: tuple[Ellipsoid, ...]
    required: float | None = None

    @property
    def rows(self) -> list[tuple[float, ...]]:
        """For each ellipse its probability, its centre to the east and to the north, its long and
        its short semi-axis, the bearing of the long one, deg from north towards east, from 0 to
        180, and the share of the runs inside."""
        rows = []
        for ellipse in self.ellipses:
            long, short = np.linalg.norm(ellipse.axes, axis=0)
            east, north = ellipse.axes[:, 0]
            bearing = np.degrees(np.arctan2(east, north)) % 180.0
            numbers = (ellipse.probability, *ellipse.centre, long, short, bearing, ellipse.inside)
            rows.append(tuple(map(float, numbers)))
        return rows

    @property
    def words(self) -> list[tuple[str, ...]]:
        """The same as the lines of a table, below their headings; lengths to a hundredth of the
        short semi-axis, which is less than the sampling error of a campaign."""
        unit = f" [{self.unit}]" if self.unit else ""
        heads = ("east", "north", "long semi-axis", "short")
        lines = [("ellipse", *(f"{x}{unit}" for x in heads), "bearing [deg]", "runs inside")]
        for share, east, north, long, short, bearing, inside in self.rows:
            digits = max(0, 2 - int(np.floor(np.log10(short)))) if short > 0.0 else 0
            lengths = (f"{x:.{digits}f}" for x in (east, north, long, short))
            ends = (f"{bearing:.0f}", f"{100.0 * inside:.3g} %")
            lines.append((f"{100.0 * share:.3g} %", *lengths, *ends))
        return lines
