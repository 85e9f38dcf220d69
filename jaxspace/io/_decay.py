"""Decay by SGP4: the first time, counted from the epoch, at which the theory has no state.

SGP4 evaluates each time separately: it reports an orbit below the ground only while the satellite
is there, and an eccentricity or a semi-latus rectum out of range only while its drag polynomials
are. Later they may return to their ranges, so that a satellite that decayed years ago is again
given a state. Here every revolution between the epoch and a time is searched, including its
perigee, because an eccentric orbit reaches the ground only there.

Source: Vallado et al., Revisiting Spacetrack Report 3, AIAA 2006-6753 (errors of SGP4).
"""

__all__ = ["first_failure", "states_by_sgp4"]

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

# The library has no types, and is imported where elements are read.
Record: TypeAlias = Any

SECONDS = 86400.0

ANOMALIES = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
"""The true anomalies, rad, at which a revolution is searched, one of them the perigee; and the mean
ones, because an orbit of great eccentricity spends its time near the apogee."""

MOST_REVOLUTIONS = 40_000
"""The greatest number of revolutions that are searched. A longer time, seven years of a low orbit,
is searched at as many equal distances: a decay by the drag fills much of the time since the
epoch."""

NEAR = 1.02
"""The distance of the perigee, in radii of the earth, below which more samples are taken there."""

MOST_IN_GAP = 10
"""The greatest number of revolutions that are searched from one start on."""

BLOCK = 1000
"""The number of revolutions that are searched at once."""


def states_by_sgp4(record: Record, ts: NDArray[np.float64]) -> tuple[NDArray, NDArray, NDArray]:
    """The error code of SGP4, (times,), the position, km, and the velocity, km/s, both (times, 3),
    at `ts`, s after the epoch of the `record`."""
    # Day and fraction stay apart: in one double a Julian date is known to 40 microseconds only.
    days = np.full(ts.shape, record.jdsatepoch)
    return record.sgp4_array(days, record.jdsatepochF + ts / SECONDS)


def first_failure(record: Record, reach: float) -> tuple[float, int] | None:
    """The time, s, closest to the epoch from which on SGP4 has no state, and the error code there;
    `None` without one up to `reach`, s after the epoch (negative: before it).

    **Arguments**

    - `record`: of the library `sgp4`."""
    mean_motion = record.no_kozai / 60.0
    # Less than a revolution apart, so that no perigee falls between two of them.
    turns = abs(reach) * mean_motion / (2.0 * np.pi) / 0.9
    # A mean motion of zero or NaN has no revolutions; the theory rejects its epoch.
    count = int(np.clip(np.ceil(turns), 1, MOST_REVOLUTIONS)) if np.isfinite(turns) else 1
    # One revolution more, so that there are samples on both sides of the last perigee.
    starts = np.linspace(0.0, reach, count + 1)
    apart = abs(reach) / count if count < MOST_REVOLUTIONS else 0.0
    for first in range(0, count + 1, BLOCK):
        some = starts[first : first + BLOCK]
        ts = _of_revolutions(record, some, -1.0 if reach < 0.0 else 1.0, apart)
        status, r, v = states_by_sgp4(record, ts)
        lowest = _near_lowest(ts, r, v, record)
        ts = np.concatenate([ts, lowest])
        status = np.concatenate([status, states_by_sgp4(record, lowest)[0]])
        order = np.argsort(np.abs(ts))
        ts, status = ts[order], status[order]
        failed = np.flatnonzero(status)
        if failed.size:
            k = int(failed[0])
            return _bisected(record, ts[k - 1] if k else ts[0], ts[k], int(status[k]))
    return None


def _of_revolutions(record: Record, starts: NDArray, side: float, apart: float) -> NDArray:
    """The times, s, to search in the revolutions from `starts`, s, on, in their order from the
    epoch on, on its `side`: 1 after it, -1 before it; in as many revolutions as fill the time
    `apart`, s, between two starts."""
    _, r, v = states_by_sgp4(record, starts)
    with np.errstate(all="ignore"):
        a, e, now = _orbit(r, v, record.mu)
        half = np.sqrt((1.0 - e) / (1.0 + e)) * np.tan(0.5 * ANOMALIES[:, None])
        eccentric = 2.0 * np.arctan(half)
        mean = eccentric - e * np.sin(eccentric)
        places = np.concatenate([mean, ANOMALIES[:, None] + 0.0 * mean])
        ahead = (places - now) * side
        rate = np.sqrt(record.mu / (a * a * a))
        # The drag shortens the revolutions, of an eccentric orbit to a fraction of the first.
        shortest = np.nanmin(2.0 * np.pi / rate, initial=np.inf)
        more = 2.0 * np.pi * np.arange(np.clip(np.ceil(apart / shortest), 1, MOST_IN_GAP))
        after = (np.mod(ahead, 2.0 * np.pi) + more[:, None, None]) / rate
        after = after.reshape(-1, len(starts))
    # States beyond a decay may not be on an ellipse: their own time is sufficient.
    after = np.where(np.isfinite(after), after, 0.0) * side
    ts = np.concatenate([starts[None], starts + after]).ravel()
    return ts[np.argsort(np.abs(ts))]


def _near_lowest(ts: NDArray, r: NDArray, v: NDArray, record: Record) -> NDArray:
    """Times, s, about those of `ts` where the satellite is lowest, on orbits whose perigee is near
    the ground: the times of perigee of a revolution that follow from elements far from it are
    good to some degrees only."""
    distance = np.linalg.norm(r, axis=1)
    with np.errstate(all="ignore"):
        a, e, _ = _orbit(r, v, record.mu)
        near = a * (1.0 - e) < NEAR * record.radiusearthkm
    low = (distance[1:-1] <= distance[:-2]) & (distance[1:-1] <= distance[2:]) & near[1:-1]
    k = np.flatnonzero(low) + 1
    return np.linspace(ts[k - 1], ts[k + 1], 34)[1:-1].ravel()


def _orbit(r: NDArray, v: NDArray, mu: float) -> tuple[NDArray, NDArray, NDArray]:
    """Semi-major axis, km, eccentricity and mean anomaly, rad, of states, (times, 3)."""
    distance = np.linalg.norm(r, axis=1)
    a = 1.0 / (2.0 / distance - np.sum(v * v, axis=1) / mu)
    # e cos(E) and e sin(E).
    along, across = 1.0 - distance / a, np.sum(r * v, axis=1) / np.sqrt(mu * a)
    e = np.hypot(along, across)
    anomaly = np.arctan2(across, along)
    return a, e, anomaly - e * np.sin(anomaly)


def _bisected(record: Record, good: float, bad: float, code: int) -> tuple[float, int]:
    """The first time of an error between a `good` and a `bad` time, s, and its code, from the
    `code` at the bad one."""
    for _ in range(40):
        middle = 0.5 * (good + bad)
        status = int(states_by_sgp4(record, np.array([middle]))[0][0])
        if status:
            bad, code = middle, status
        else:
            good = middle
    return bad, code
