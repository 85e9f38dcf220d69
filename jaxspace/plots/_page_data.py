"""The data of a dispersion for its page: binned and thinned, so that the page of a
million runs is no larger than that of a thousand."""

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..core.record import Record
from ._bins import bins
from ._dispersion_figure import chosen_pair, contributors_or_none, explained, shown, summary
from .footprint import degrees_by_length, wind_rose

if TYPE_CHECKING:
    from ..dispersion import RunPaths
    from ..statistics import Dispersion
    from ..statistics.table import Row

MOST_POINTS = 2000
"""Maximum number of runs in the scatter plots: more would overlap."""
HELD = 0.99
"""The share of the runs within an ellipse."""
MOST_OUTPUTS = 5
"""Outputs of the scatter matrix."""


def page_data(
    dispersion: "Dispersion",
    nominal: Mapping[str, float],
    count: int,
    paths: "RunPaths | None",
    wind: tuple[ArrayLike, ArrayLike] | None = None,
) -> Record:
    """Data for the script of the page: points, bins, contributors, convergence, times."""
    outputs = list(dispersion.outputs)
    # Inputs that do not vary would be lines.
    names = [*outputs, *(n for n, x in dispersion.inputs.items() if np.ptp(x) > 0.0)]
    good = np.flatnonzero(dispersion.good)
    chosen = good[:MOST_POINTS]
    rows = {row.name: row for of in ("outputs", "inputs") for row in dispersion.table(of)}
    required = dispersion.requirements
    means = {n: rows[n].mean for n in names if rows[n].runs}
    pair = chosen_pair(dispersion, outputs) or (names[-1], names[0])
    histograms = {
        n: _histogram(dispersion, rows[n], nominal.get(n), required.get(n, ())) for n in outputs
    }
    return {
        "names": names,
        "units": {n: u for n in names if (u := dispersion.units.get(n, "")) not in ("", "1")},
        "pair": pair,
        "numbers": chosen.tolist(),
        "points": {n: _listed(dispersion.values(n)[chosen], rows[n].std) for n in names},
        "ellipses": _ellipses(dispersion, names, good),
        "mean": means,
        "nominal": {n: x for n, x in nominal.items() if n in names and np.isfinite(x)},
        "histograms": histograms,
        "contributors": {n: _contributors(dispersion, n, count) for n in outputs},
        "convergence": {n: _convergence(dispersion, n, rows[n]) for n in outputs},
        # Values that differ by rounding only have one bin, which shows no correlation with the
        # others.
        "matrix": [n for n, h in histograms.items() if h and len(h["counts"]) > 1][:MOST_OUTPUTS],
        "time": time_budget(dispersion),
        "trajectories": _trajectories(paths),
        "footprint": _footprint(dispersion),
        "rose": None if wind is None else _rose(*wind),
    }


def _footprint(dispersion: "Dispersion") -> Record | None:
    """The ellipses of the landings and their annotations; the points are among the others."""
    result = dispersion.footprint()
    if result is None:
        return None
    return {
        "ellipses": [
            {
                "x": np.round(ellipse.outline()[0], 3).tolist(),
                "y": np.round(ellipse.outline()[1], 3).tolist(),
                "name": f"ellipse of {100.0 * ellipse.probability:.3g} % "
                f"({100.0 * ellipse.inside:.3g} % of the runs)",
            }
            for ellipse in result.ellipses
        ],
        "radius": result.required,
        "degrees": degrees_by_length(dispersion),
    }


def _rose(east: ArrayLike, north: ArrayLike) -> Record:
    """The bars of the rose of the wind, in percent, and the names of their classes."""
    shares, edges = wind_rose(east, north)
    names = [f"{low:g} to {high:g} m/s" for low, high in itertools.pairwise(edges)]
    return {"names": names, "shares": np.round(100.0 * shares, 3).tolist()}


def time_budget(dispersion: "Dispersion") -> dict[str, float]:
    """The seconds of wall time of each part of the campaign, by its name."""
    record = dispersion.attributes
    ahead = float(record.get("preparation_seconds", 0.0))
    parts = {
        "compilation and start-up": ahead,
        "running": dispersion.seconds - ahead,
        # The seconds of a dispersion are without it.
        "storing": float(record.get("storing_seconds", 0.0)),
    }
    # A time that is not known is NaN, which is not greater than zero.
    return {name: seconds for name, seconds in parts.items() if seconds > 0.0}


def processor_words(dispersion: "Dispersion") -> str:
    """A message about the utilisation of the cores while the runs were computed; empty if it is
    unknown.

    Processor time is the sum over all cores: it is listed next to the wall time, and not part of
    it.
    """
    share = 100.0 * dispersion.utilisation
    if np.isnan(share):
        return ""
    running, busy = time_budget(dispersion)["running"], dispersion.attributes["cpu_seconds"]
    return (
        f"The runs took {running:.3g} s and {busy:.3g} s of processor time: "
        f"{share:.0f} % of {dispersion.cores} cores."
    )


def _listed(values: np.ndarray, deviation: float) -> list[float | None]:
    """The values with three digits beyond the first one of their standard deviation."""
    deviation = deviation if np.isfinite(deviation) else 0.0
    decimals = 3 - int(np.floor(np.log10(deviation))) if deviation > 0.0 else 15
    # With more decimals NumPy's factor 10^decimals is infinite.
    rounded = np.round(values.astype(float), min(decimals, 300))
    # JSON has no NaN.
    return [x if np.isfinite(x) else None for x in rounded.tolist()]


def _ellipses(dispersion: "Dispersion", names: list[str], good: np.ndarray) -> Record | None:
    """The ellipses of 99 % of any two quantities, of a normal law with the same covariance:

        x = m_x + a_x cos(t),   y = m_y + a_y cos(t - p_xy)
        a = k s,   cos(p_xy) = r_xy,   k^2 = 2 ln(1 / (1 - P))

    with mean m, standard deviation s and correlation r of the runs; `centre`, `half` (widths a) and
    `phase` (p, a row for each x) are in the order of the names, `None` without dispersion."""
    # The ellipse of two runs is a line.
    if good.size < 3:
        return None
    x = np.stack([dispersion.values(n)[good].astype(float) for n in names])
    x[~np.isfinite(x)] = np.nan
    whole = ~np.isnan(x).any(axis=1)
    phase = np.full((len(names), len(names)), np.nan)
    phase[np.ix_(whole, whole)] = _phase(x[whole])
    # Runs in which a quantity is not finite are left out of its own ellipses, and of no other.
    for i in np.flatnonzero(~whole):
        for j in range(len(names)):
            pair = x[[i, j]]
            both = ~np.isnan(pair).any(axis=0)
            phase[i, j] = phase[j, i] = _phase(pair[:, both])[0, 1]
    scale = float(np.sqrt(2.0 * np.log(1.0 / (1.0 - HELD))))
    centre, half = [], []
    for row in x:
        finite = row[~np.isnan(row)]
        width = scale * float(np.std(finite, ddof=1)) if finite.size > 2 else 0.0
        centre.append(float(finite.mean()) if finite.size else None)
        half.append(width if width > 0.0 else None)
    return {
        "centre": centre,
        "half": half,
        "one_sided": [name for name, row in zip(names, x, strict=True) if _one_sided(row)],
        "phase": [[p if np.isfinite(p) else None for p in row] for row in phase.tolist()],
    }


def _one_sided(values: np.ndarray) -> bool:
    """Skewness of the available runs: 1 for the absolute value of a normal variable, 2 for an
    exponential law."""
    finite = values[~np.isnan(values)]
    deviation = np.std(finite) if finite.size else 0.0
    if not deviation > 0.0:
        return False
    skewness = float(np.mean(((finite - finite.mean()) / deviation) ** 3))
    # For a normal law its standard deviation is sqrt(6/n): random excursions are ignored.
    return abs(skewness) > max(0.6, 4.0 * math.sqrt(6.0 / finite.size))


def _phase(x: np.ndarray) -> np.ndarray:
    """The angles whose cosines are the correlations, (d, d), of x, (d, runs); NaN without
    dispersion."""
    if len(x) == 0 or x.shape[1] < 3:
        return np.full((len(x), len(x)), np.nan)
    c = np.atleast_2d(np.cov(x))
    s = np.sqrt(np.diag(c))
    with np.errstate(invalid="ignore", divide="ignore"):
        # Rounding may leave a correlation beyond one.
        return np.arccos(np.clip(c / np.outer(s, s), -1.0, 1.0))


def _histogram(
    dispersion: "Dispersion",
    row: "Row",
    nominal: float | None,
    required: Sequence[float | None],
) -> Record | None:
    """Bins over the successful runs, with their lines."""
    if row.runs == 0:
        return None
    start, counts, width = bins(dispersion.values(row.name)[shown(dispersion, row.name)])
    return {
        "start": start,
        "width": width,
        "counts": counts.tolist(),
        "mean": row.mean,
        "low": _finite(row.low),
        "high": _finite(row.high),
        "nominal": None if nominal is None else _finite(nominal),
        "required": [x for x in required if x is not None],
        "words": summary(row),
    }


def _finite(value: float) -> float | None:
    """A number for JSON, which supports finite ones only."""
    return float(value) if np.isfinite(value) else None


def _contributors(dispersion: "Dispersion", name: str, count: int) -> Record:
    result = contributors_or_none(dispersion, name, count)
    if result is None:
        return {"inputs": [], "shares": [], "words": "Too few runs, or no dispersion."}
    return {
        "inputs": list(result.shares),
        "shares": [float(s) for s in result.shares.values()],
        "words": explained(result),
    }


def _convergence(dispersion: "Dispersion", name: str, row: "Row") -> Record | None:
    if row.runs < 2:
        return None
    result = dispersion.convergence(name)
    # An interval without an end is none: the band begins where there are enough runs.
    known = np.isfinite(result.low) & np.isfinite(result.high)
    low, high = (np.where(known, x, result.limit) for x in (result.low, result.high))
    words = "too few runs for an interval"
    # With infinite runs, an infinite end is correct.
    if known[-1] or row.above or row.below:
        ends = (row.shown(x) for x in (result.limit[-1], result.low[-1], result.high[-1]))
        words = "99th percentile {}, 95 % confidence interval {} to {}".format(*ends)
    return {
        "runs": result.runs.tolist(),
        **{
            name: [_finite(x) for x in values]
            for name, values in (
                ("mean", result.mean),
                ("limit", result.limit),
                ("low", low),
                ("high", high),
            )
        },
        "words": f"{words}.",
    }


def _trajectories(paths: "RunPaths | None") -> Record | None:
    """The trajectories in km, or in m where they are short; `None` without any."""
    if paths is None or not np.isfinite(paths.positions).any():
        return None
    x = np.asarray(paths.positions, float)
    factor, unit = (1e-3, "km") if np.nanmax(np.abs(x)) > 1e4 else (1.0, "m")
    digits = 6 - int(np.ceil(np.log10(max(factor * float(np.nanmax(np.abs(x))), 1e-6))))
    rounded = np.round(factor * x, digits)
    # Between two branches of a mission no run has a place; a failed run has no path.
    gaps = np.all(np.isnan(x), axis=(0, 2))
    good = [k for k in range(x.shape[-1]) if np.all(np.isfinite(x[:, ~gaps, k]))]
    if not good:
        return None
    # The script reads null where a line ends.
    rounded = np.where(gaps[:, None], None, rounded)
    return {
        "unit": unit,
        # The first one is the nominal run.
        "numbers": [int(paths.numbers[k]) for k in good if k > 0],
        "runs": [rounded[..., k].tolist() for k in good if k > 0],
        "nominal": rounded[..., 0].tolist() if 0 in good else None,
    }
