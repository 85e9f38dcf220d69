"""Footprint of a campaign on the ground, and the rose of the wind."""

__all__ = ["wind_rose"]

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeAlias, cast

import numpy as np
from numpy.typing import ArrayLike

from ..core import InputError
from ..core.common_units import factor_between
from ..core.extras import extra
from ._style import BAD, COLOURS, GRID, dress, headline

# A function of the numbers along an axis.
Scaling: TypeAlias = Callable[[np.ndarray], np.ndarray]

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.projections.polar import PolarAxes

    from ..statistics import Dispersion, Footprint

SECTORS = 16
"""Directions of the rose: those of a compass with names such as NNE."""
CLASSES = 4
"""Classes of the wind speed."""


def wind_rose(east: ArrayLike, north: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Frequency of the directions of the wind, by its speed.

    **Arguments**

    - `east`, `north`: components towards these directions, m/s, of any number of samples.

    **Returns** the shares of all samples, (classes, sectors), of which the first sector is that
    about the north and the next ones follow towards the east; and the speeds that bound the
    classes, m/s, (classes + 1,)."""
    east, north = (np.asarray(x, float).reshape(-1) for x in (east, north))
    speed = np.hypot(east, north)
    # Of 1, 2, 2.5 and 5 times a power of ten, so that the legend has round numbers.
    least = max(float(speed.max(initial=0.0)), 1e-3) / CLASSES
    power = 10.0 ** np.floor(np.log10(least))
    step = next(power * x for x in (1.0, 2.0, 2.5, 5.0, 10.0) if power * x >= least)
    edges = step * np.arange(CLASSES + 1)
    # The wind is called by where it comes from.
    angle = np.degrees(np.arctan2(-east, -north)) % 360.0
    width = 360.0 / SECTORS
    sector = ((angle + 0.5 * width) // width).astype(int) % SECTORS
    shares = np.zeros((CLASSES, SECTORS))
    # A calm comes from nowhere.
    blows = speed > 0.0
    kind = np.minimum((speed / step).astype(int), CLASSES - 1)
    np.add.at(shares, (kind[blows], sector[blows]), 1.0 / max(speed.size, 1))
    return shares, edges


def footprint_figure(
    dispersion: "Dispersion",
    *,
    wind: tuple[ArrayLike, ArrayLike] | None = None,
    title: str = "",
    nominal: tuple[float, float] | None = None,
) -> "Figure":
    """A matplotlib figure of where the runs land: points, ellipses of 50, 90 and 99 %, the rail,
    and the circle of a requirement on the `distance`, converted to the unit of the landings; with
    latitude and longitude where they are outputs (`landing_latitude`, `landing_longitude`).

    **Arguments**

    - `dispersion`: the result of a campaign with the outputs `east` and `north`.
    - `wind`: components to the east and to the north, m/s, for a wind rose next to it, in the form
      of `LaunchSite.winds`.
    - `title`: of the figure.
    - `nominal`: landing point of the nominal run, to the east and north, in the unit of the
      landings.

    **Raises** `InputError` for fewer than three successful runs with landings.
    """
    with extra("app"):
        from matplotlib.figure import Figure

    result = dispersion.footprint()
    if result is None:
        raise InputError(
            "dispersion has no footprint: east and north must be outputs with the same unit, "
            "finite in at least three successful runs."
        )
    figure = Figure(figsize=(8.0 if wind is None else 11.0, 6.2), layout="constrained")
    headline(figure, title or "Landings")
    grid = figure.add_gridspec(
        1, 1 if wind is None else 2, width_ratios=[2.4, 1.0][: 1 + bool(wind)]
    )
    axes = figure.add_subplot(grid[0, 0])
    _footprint(axes, dispersion, result, nominal)
    if wind is not None:
        _rose(cast("PolarAxes", figure.add_subplot(grid[0, 1], projection="polar")), *wind)
    return figure


def _footprint(
    axes: "Axes",
    dispersion: "Dispersion",
    footprint: "Footprint",
    nominal: tuple[float, float] | None,
) -> None:
    east, north = footprint.points
    size, alpha = (14.0, 0.6) if east.size < 500 else (5.0, 0.3)
    axes.scatter(
        *(east, north, size),
        color=COLOURS[5],
        alpha=alpha,
        linewidths=0.0,
        # In a vector file many points would be slow to draw.
        rasterized=east.size > 5000,
        label=f"{east.size} landings",
    )
    for ellipse, style in zip(footprint.ellipses, ("-", "--", ":"), strict=True):
        share, inside = (f"{100.0 * x:.3g} %" for x in (ellipse.probability, ellipse.inside))
        label = f"ellipse of {share} ({inside} of the runs)"
        axes.plot(*ellipse.outline(), color=COLOURS[0], linestyle=style, linewidth=1.6, label=label)
    axes.plot(*footprint.ellipses[0].centre, "+", color=COLOURS[0], markersize=11, label="mean")
    if nominal is not None:
        axes.plot(*nominal, "D", color=COLOURS[2], fillstyle="none", label="nominal run")
    axes.plot(0.0, 0.0, "^", color=COLOURS[1], markersize=10, label="rail")
    radius = footprint.required
    if radius is not None:
        turn = np.linspace(0.0, 2.0 * np.pi, 241)
        circle = radius * np.sin(turn), radius * np.cos(turn)
        label = f"required: within {radius:g} {footprint.unit}"
        axes.plot(*circle, color=BAD, linewidth=1.2, linestyle="-.", label=label)
    unit = f" [{footprint.unit}]" if footprint.unit else ""
    dress(axes, "", f"east of the rail{unit}", f"north of the rail{unit}")
    # A metre is a metre in both directions.
    axes.set_aspect("equal", adjustable="datalim")
    _geography(axes, dispersion)
    axes.legend(fontsize=8, loc="upper left", bbox_to_anchor=(0.0, -0.13), ncols=2, frameon=False)


def degrees_by_length(dispersion: "Dispersion") -> list[tuple[float, float]] | None:
    """For longitude over east and latitude over north the value at the rail, deg, and the slope;
    `None` where the campaign has no such outputs, in a unit of angles.

    A straight line through the landings: over 20 km it is off by some metres."""
    names = ("landing_longitude", "landing_latitude")
    if not set(names) <= set(dispersion.outputs):
        return None
    lines = []
    for across, name in zip(("east", "north"), names, strict=True):
        x, y = dispersion.together(across, name)
        # An output without a unit is in SI.
        factor = factor_between(dispersion.units.get(name) or "rad", "deg")
        if np.ptp(x) == 0.0 or factor is None:
            return None
        slope, start = np.polyfit(x, factor * y, 1)
        lines.append((float(start), float(slope)))
    return lines


def _geography(axes: "Axes", dispersion: "Dispersion") -> None:
    """Longitude above, latitude on the right."""
    lines = degrees_by_length(dispersion)
    if lines is None:
        return
    longitude, latitude = lines
    # Late, with the library of the figure itself.
    from matplotlib.ticker import ScalarFormatter

    above = axes.secondary_xaxis("top", functions=_line(*longitude))
    beside = axes.secondary_yaxis("right", functions=_line(*latitude))
    above.set_xlabel("longitude [deg]", fontsize=9)
    beside.set_ylabel("latitude [deg]", fontsize=9)
    for panel, axis in ((above, above.xaxis), (beside, beside.yaxis)):
        panel.tick_params(labelsize=8)
        # Never as a difference from a number at the end of the axis.
        axis.set_major_formatter(ScalarFormatter(useOffset=False))
    above.locator_params(axis="x", nbins=5)


def _line(start: float, slope: float) -> tuple[Callable[[Any], Any], Callable[[Any], Any]]:
    """A straight line and its inverse."""
    return lambda x: start + slope * x, lambda y: (y - start) / slope


def _rose(axes: "PolarAxes", east: ArrayLike, north: ArrayLike) -> None:
    """Bars that point to where the wind comes from, by its speed."""
    shares, edges = wind_rose(east, north)
    axes.set_theta_zero_location("N")
    axes.set_theta_direction(-1)
    turn = 2.0 * np.pi * np.arange(SECTORS) / SECTORS
    low = np.zeros(SECTORS)
    for k, row in enumerate(100.0 * shares):
        label = f"{edges[k]:g} to {edges[k + 1]:g} m/s"
        axes.bar(
            turn, row, 0.85 * 2.0 * np.pi / SECTORS, low,
            color=COLOURS[(5, 0, 4, 1)[k]], label=label,
        )  # fmt: skip
        low = low + row
    axes.set_xticks(0.25 * np.pi * np.arange(8), ["N", "NE", "E", "SE", "S", "SW", "W", "NW"])
    axes.tick_params(labelsize=8)
    axes.grid(color=GRID)
    axes.set_title("Wind by height:\ndirection of origin, in % of the heights", fontsize=9, pad=12)
    axes.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.12), frameon=False)
