"""The offset between the clock of a flight log and that of a run: known, of an event, or fitted."""

import re
from typing import NamedTuple, TypeAlias

import numpy as np

from ..core import InputError
from ._channels import Curve
from .flight_logs import FlightLog
from .units import in_unit, split

FIT = "fit"
GRID = 400
"""Offsets that are tried before the best of them is refined."""
MOST_POINTS = 2000
EXTREME = re.compile(r"(greatest|least)\s+(.+)")
CROSSING = re.compile(r"(.+?)\s*([<>])\s*(.+)")

Samples: TypeAlias = tuple[np.ndarray, np.ndarray]
"""Times, s, and values of a column, without missing ones."""


def clock_offset(
    align: str | float, log: FlightLog, measured: dict[str, Samples], predicted: dict[str, Curve]
) -> tuple[float, str]:
    """The offset of the clocks, s, and how it was determined."""
    if not isinstance(align, str):
        offset = float(align)
        if not np.isfinite(offset):
            raise InputError(f"align is {offset}: it must be a finite number of seconds.")
        return offset, "given" if offset else "the same clock"
    if align == FIT:
        return _fitted(log, measured, predicted), "by least squares"
    event = _event(align, log, measured)
    times = {}
    for what, points in (
        ("log", measured[event.column]),
        ("run", predicted[event.column].points),
    ):
        time = event.time(*points)
        if time is None:
            raise InputError(f"align is {align!r}, which does not occur in the {what}.")
        times[what] = time
    return times["run"] - times["log"], align


class _Event(NamedTuple):
    """An event of a column: where `sign` times it is greatest, or first exceeds `sign * level`."""

    column: str
    sign: float
    level: float | None

    def time(self, t: np.ndarray, x: np.ndarray) -> float | None:
        """Its time in a curve; `None` if it does not occur."""
        x = self.sign * x
        if self.level is None:
            return peak(t, x)[0]
        above = x > self.sign * self.level
        # It must be crossed: a curve that starts above it has no such time.
        if not above.any() or above[0]:
            return None
        k = int(np.argmax(above))
        share = (self.sign * self.level - x[k - 1]) / (x[k] - x[k - 1])
        return float(t[k - 1] + share * (t[k] - t[k - 1]))


def _event(align: str, log: FlightLog, measured: dict[str, Samples]) -> _Event:
    extreme, crossing = EXTREME.fullmatch(align), CROSSING.fullmatch(align)
    if extreme is not None:
        event = _Event(extreme[2], 1.0 if extreme[1] == "greatest" else -1.0, None)
    elif crossing is not None:
        level = _level(align, crossing[3], log.units.get(crossing[1], ""))
        event = _Event(crossing[1], 1.0 if crossing[2] == ">" else -1.0, level)
    else:
        raise InputError(
            f'align is {align!r}: it must be a number of seconds, "fit", or an event such as '
            '"greatest altitude" or "altitude > 30 m".'
        )
    if event.column not in measured:
        raise InputError(
            f"align names {event.column!r}: it must be a column that is compared, one of "
            f"{', '.join(measured)}."
        )
    return event


def _level(align: str, text: str, unit: str) -> float:
    """A value in the unit of its column."""
    try:
        number, given = split(text, "a number with a unit")
        return number / in_unit(unit, given) if given else number
    except ValueError:
        raise InputError(
            f"align is {align!r}: {text} must be a number, alone or with a unit such as "
            f"{unit or '1'}."
        ) from None


def peak(t: np.ndarray, x: np.ndarray) -> tuple[float, float]:
    """Time and value of the greatest sample, by the parabola through it and its neighbours."""
    k = int(np.argmax(x))
    if not 0 < k < x.size - 1 or t[k - 1] >= t[k] or t[k] >= t[k + 1]:
        return float(t[k]), float(x[k])
    a, b = t[k - 1] - t[k], t[k + 1] - t[k]
    # Of x(s) = x_k + p s + q s^2 through both neighbours.
    left, right = (x[k - 1] - x[k]) / a, (x[k + 1] - x[k]) / b
    q = (right - left) / (b - a)
    p = left - a * q
    s = float(np.clip(-0.5 * p / q, a, b)) if q < 0.0 else 0.0
    return float(t[k] + s), float(x[k] + s * (p + q * s))


def _fitted(log: FlightLog, measured: dict[str, Samples], predicted: dict[str, Curve]) -> float:
    """The offset of least squares, s."""
    from scipy.optimize import minimize_scalar

    curves = []
    for name, (t, x) in measured.items():
        spread = float(np.std(x))
        if spread > 0.0:
            every = max(t.size // MOST_POINTS, 1)
            curves.append((t[::every], x[::every], spread, predicted[name]))
    if not curves:
        raise InputError('align is "fit": a column that changes with the time is required.')
    first, last = zip(*((c.points[0][0], c.points[0][-1]) for c in predicted.values()), strict=True)
    start, end = min(first), max(last)
    # Half of the shorter one must remain common, or a few samples could match by chance.
    least = 0.5 * min(end - start, log.times[-1] - log.times[0])

    def misfit(offset: float) -> float:
        total = 0.0
        for t, x, spread, curve in curves:
            difference = (curve.at(t + offset)[0] - x) / spread
            known = np.isfinite(difference)
            if not known.any():
                return np.inf
            total += float(np.mean(difference[known] ** 2))
        return total

    low = start - log.times[-1] + least
    high = end - log.times[0] - least
    grid = np.linspace(low, high, GRID)
    values = np.array([misfit(d) for d in grid])
    k = int(np.argmin(values))
    if not np.isfinite(values[k]):
        raise InputError(no_common_time(log, float(grid[k]), predicted))
    bounds = float(grid[max(k - 1, 0)]), float(grid[min(k + 1, GRID - 1)])
    found = minimize_scalar(misfit, bounds=bounds, method="bounded", options={"xatol": 1e-9})
    return float(found.x)


def no_common_time(log: FlightLog, offset: float, predicted: dict[str, Curve]) -> str:
    """The message for a log that, moved by the `offset`, s, has no time in common with the run."""
    times = [curve.points[0] for curve in predicted.values()]
    return (
        f"{log.path} covers {log.times[0] + offset:.6g} s to {log.times[-1] + offset:.6g} s on the "
        f"clock of the run, which covers {min(t[0] for t in times):.6g} s to "
        f"{max(t[-1] for t in times):.6g} s: they have no time in common. Align them by an event "
        'or with "fit".'
    )
