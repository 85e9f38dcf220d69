"""Ephemerides: states of one body at times, and the CCSDS Orbit Ephemeris Message that carries
them.

Source: CCSDS 502.0-B-3, Orbit Data Messages, 5 (OEM) and 7 (keyword = value notation). Of an OEM
the states are read and written; covariances and accelerations are passed over, and each segment of
a file is one ephemeris. Messages in XML are refused.
"""

__all__ = ["Ephemeris", "read_oem", "write_oem"]

import os
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..bodies import BodyState
from ..core import InputError
from ..core.files import read_text
from ..core.printing import printed
from ..orbits import TabulatedPath

# The keys of the metadata that a message must have, and the field of each; the rest are in the
# times.
_KEYS = {
    "OBJECT_NAME": "name",
    "OBJECT_ID": "identifier",
    "CENTER_NAME": "centre",
    "REF_FRAME": "frame",
    "TIME_SYSTEM": "time_system",
}
_TIMES = ("START_TIME", "STOP_TIME")


@printed(times="s", position="m", velocity="m/s")
class Ephemeris(NamedTuple):
    """States of a body at times, in NumPy.

    - `epoch`: the time zero, as text of ISO 8601, in the `time_system`.
    - `times`: s after the epoch, ascending, (times,).
    - `position`, m, and `velocity`, m/s: (3, times), relative to the `centre` in the axes of the
      `frame`.
    - `name`, `identifier`: of the body, such as "ISS" and "1998-067A"."""

    epoch: str
    times: Float[np.ndarray, " times"]
    position: Float[np.ndarray, "3 times"]
    velocity: Float[np.ndarray, "3 times"]
    name: str = ""
    identifier: str = ""
    centre: str = "EARTH"
    frame: str = "EME2000"
    time_system: str = "UTC"

    def path(self) -> TabulatedPath:
        """The positions as a path for effects, whose time zero is the epoch."""
        return TabulatedPath(self.times, self.position)

    def state(self, index: int = 0) -> BodyState:
        """The state at one of the times, to begin a run with."""
        return BodyState(self.position[:, index], self.velocity[:, index])


def read_oem(path: str | os.PathLike[str]) -> list[Ephemeris]:
    """The ephemerides of a CCSDS Orbit Ephemeris Message in keyword = value notation.

    **Arguments**

    - `path`: of the file.

    **Returns** one `Ephemeris` for each segment; the first time of a segment is its epoch. Seconds
    of a leap are not counted: a segment in UTC should not span one.

    **Raises** `InputError` with the line of what is not as the standard has it."""
    text = read_text(path)
    lines = [line.strip() for line in text.splitlines()]
    # Refused here, where XML and other messages can still be told by what they are.
    if not text.lstrip().startswith("CCSDS_OEM_VERS"):
        raise InputError(
            f"{path} is no orbit ephemeris message: it must begin with CCSDS_OEM_VERS."
        )
    result: list[Ephemeris] = []
    meta: dict[str, str] = {}
    rows: list[list[str]] = []
    part = "header"
    for number, line in enumerate(lines, 1):
        if not line or line.startswith("COMMENT"):
            continue
        if line in ("META_START", "META_STOP", "COVARIANCE_START", "COVARIANCE_STOP"):
            # A segment has no keyword at its end: the metadata of the next one closes it.
            if line == "META_START" and rows:
                result.append(_segment(path, meta, rows))
                meta = {}
                rows = []
            # Both keywords that close a block lead back to the states.
            part = {"META_START": "meta", "COVARIANCE_START": "covariance"}.get(line, "data")
        elif part == "meta":
            key, _, value = line.partition("=")
            meta[key.strip()] = value.strip()
        elif part == "data":
            columns = line.split()
            # Ten with accelerations, which are passed over.
            if len(columns) not in (7, 10):
                raise InputError(
                    f"{path}, line {number}: {line!r} has {len(columns)} columns: it must be a "
                    f"time and six numbers, or nine."
                )
            rows.append(columns)
    if not rows:
        raise InputError(f"{path} has no states: it must have a line for each of them.")
    return [*result, _segment(path, meta, rows)]


def _segment(path: object, meta: dict[str, str], rows: list[list[str]]) -> Ephemeris:
    missing = [key for key in (*_KEYS, *_TIMES) if key not in meta]
    if missing:
        raise InputError(f"{path} lacks {missing[0]} in the metadata of a segment.")
    start = _instant(rows[0][0])
    times = np.array([_seconds(start, _instant(row[0])) for row in rows])
    if np.any(np.diff(times) <= 0.0):
        raise InputError(f"{path} has times that do not ascend.")
    try:
        # The standard has km and km/s.
        states = 1e3 * np.array([[float(x) for x in row[1:7]] for row in rows]).T
    except ValueError as error:
        raise InputError(f"{path} has a state that is no number: {error}.") from error
    fields = {field: meta[key] for key, field in _KEYS.items()}
    return Ephemeris(rows[0][0].rstrip("Z"), times, states[:3], states[3:], **fields)


def write_oem(
    path: str | os.PathLike[str],
    ephemerides: list[Ephemeris],
    originator: str = "JAXSPACE",
    created: str | None = None,
) -> None:
    """Write ephemerides as a CCSDS Orbit Ephemeris Message, version 2.0.

    **Arguments**

    - `path`: of the file.
    - `ephemerides`: a segment each.
    - `originator`: who sends the message.
    - `created`: its date, text of ISO 8601; now by default.

    Numbers are written with the digits that give them back."""
    made = created or datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S")
    lines = ["CCSDS_OEM_VERS = 2.0", f"CREATION_DATE = {made}", f"ORIGINATOR = {originator}"]
    for one in ephemerides:
        start = _instant(one.epoch)
        stamps = [_text(start, float(t)) for t in one.times]
        lines += ["", "META_START"]
        lines += [f"{key} = {getattr(one, field) or 'UNKNOWN'}" for key, field in _KEYS.items()]
        lines += [f"START_TIME = {stamps[0]}", f"STOP_TIME = {stamps[-1]}", "META_STOP"]
        states = np.concatenate([one.position, one.velocity]).T / 1e3
        rows = zip(stamps, states, strict=True)
        # `repr` is the shortest text that reads back as the same number.
        lines += [f"{stamp} {' '.join(repr(float(x)) for x in row)}" for stamp, row in rows]
    Path(path).write_text("\n".join(lines) + "\n", encoding="utf-8")


def _instant(text: str) -> tuple[datetime, float]:
    """Date and time to the second, and the fraction of it, from a calendar date or a day of the
    year."""
    whole, _, fraction = text.rstrip("Z").partition(".")
    for form in ("%Y-%m-%dT%H:%M:%S", "%Y-%jT%H:%M:%S"):
        try:
            return datetime.strptime(whole, form), float(f"0.{fraction or 0}")
        except ValueError:
            continue
    raise InputError(f"{text!r} is no time: it must be like 2026-03-01T12:00:00.5.")


def _seconds(start: tuple[datetime, float], end: tuple[datetime, float]) -> float:
    # The whole seconds first, so that the fractions keep their digits.
    return (end[0] - start[0]).total_seconds() + (end[1] - start[1])


def _text(start: tuple[datetime, float], after: float) -> str:
    """The time `after` the start, s, to a nanosecond."""
    whole = int(np.floor(after))
    # Whole from here on, so that a fraction that rounds up carries into the second.
    nanoseconds = round((after - whole + start[1]) * 1e9)
    second = start[0] + timedelta(seconds=whole + nanoseconds // 10**9)
    return f"{second:%Y-%m-%dT%H:%M:%S}.{nanoseconds % 10**9:09d}"
