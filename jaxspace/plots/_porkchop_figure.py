"""The porkchop plot: the delta-v of a transfer over its departure and its arrival."""

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import ArrayLike

from ..core.extras import extra
from ._style import BAD, dress

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Relative to the least total: values above the last level are left white.
LEVELS = np.array([1.0, 1.02, 1.05, 1.1, 1.2, 1.35, 1.5, 1.75, 2.0, 2.5, 3.0, 4.0])


def porkchop_figure(
    departures: ArrayLike,
    arrivals: ArrayLike,
    total: ArrayLike,
    *,
    unit: float = 86400.0,
    unit_name: str = "d",
    title: str = "",
) -> "Figure":
    """Lines of equal total velocity over departure and arrival, the least one marked, and lines of
    equal duration.

    **Arguments**

    - `departures`, `arrivals`: times, s.
    - `total`: velocities, m/s, (departures, arrivals), as of `orbits.interception.porkchop`; NaN
      where there is no transfer.
    - `unit`, `unit_name`: of the times on the axes, s, and its name.
    - `title`: of the figure.

    **Raises** `ImportError` where matplotlib is not installed.
    """
    with extra("app"):
        from matplotlib.figure import Figure
    x, y = np.asarray(departures, float) / unit, np.asarray(arrivals, float) / unit
    # Transposed, because contours take the vertical axis first.
    values = 1e-3 * np.asarray(total, float).T
    figure = Figure(figsize=(7.0, 5.6), layout="constrained")
    axes = figure.subplots()
    dress(axes, title, f"departure [{unit_name}]", f"arrival [{unit_name}]")
    if np.any(np.isfinite(values)):
        least = np.nanmin(values)
        filled = axes.contourf(x, y, values, levels=least * LEVELS, cmap="viridis_r")
        axes.contour(x, y, values, levels=least * LEVELS, colors="white", linewidths=0.4)
        bar = figure.colorbar(filled, ax=axes)
        bar.set_label("total velocity [km/s]", fontsize=9)
        row, column = np.unravel_index(np.nanargmin(values), values.shape)
        axes.plot(x[column], y[row], "+", color=BAD, markersize=11)
        axes.annotate(
            f"{least:.3f} km/s",
            (x[column], y[row]),
            (6, 6),
            textcoords="offset points",
            color=BAD,
            fontsize=9,
        )
    durations = axes.contour(x, y, y[:, None] - x, levels=6, colors="#707070", linewidths=0.6)
    axes.clabel(durations, fmt=f"%g {unit_name}", fontsize=7)
    return figure
