"""Ephemerides: states of one body at times, and the CCSDS Orbit Ephemeris Message that carries
them.

Source: CCSDS 502.0-B-3, Orbit Data Messages, 5 (OEM) and 7 (keyword = value notation). Of an OEM
the states are read and written; covariances and accelerations are skipped, and each segment of
a file is one ephemeris. Messages in XML are rejected.
"""

__all__ = ["Ephemeris", "read_oem", "write_oem"]

import math
import os
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..bodies import BodyState
from ..core import InputError
from ..core.checks import check_finite
from ..core.files import finite_number, read_text
from ..core.printing import printed
from ..orbits import TabulatedPath
from ._epochs import ALLOWED, Instant, instant

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

    **Raises** `InputError` with the line that violates the standard: an invalid time, a number that
    is not finite, times that do not ascend, or a segment without its metadata or states."""
    text = read_text(path)
    # Rejected here, where XML and other messages can still be identified.
    if not text.lstrip().startswith("CCSDS_OEM_VERS"):
        raise InputError(
            f"{path} is not an orbit ephemeris message: it must begin with CCSDS_OEM_VERS."
        )
    segments: list[_Segment] = []
    part = "header"
    for number, line in enumerate(map(str.strip, text.splitlines()), 1):
        where = f"{path}, line {number}"
        if not line or line.startswith("COMMENT"):
            continue
        if line in ("META_START", "META_STOP", "COVARIANCE_START", "COVARIANCE_STOP"):
            # A segment has no keyword at its end: the metadata of the next one closes it.
            if line == "META_START":
                segments.append(_Segment(where, {}, [], []))
            # Both keywords that close a block lead back to the states.
            part = {"META_START": "meta", "COVARIANCE_START": "covariance"}.get(line, "data")
        elif part in ("header", "meta"):
            key, equals, value = (field.strip() for field in line.partition("="))
            if not equals:
                raise InputError(f"{where} is {line!r}: it must be a keyword = value.")
            if part == "meta":
                segments[-1].add_entry(where, key, value)
        elif part == "data":
            if not segments:
                raise InputError(f"{where} is {line!r}: META_START must precede it.")
            segments[-1].add_state(where, line)
    if not segments:
        raise InputError(f"{path} has no states: it must have one line per state.")
    return [segment.ephemeris() for segment in segments]


_STATE = ("X", "Y", "Z", "X_DOT", "Y_DOT", "Z_DOT", "X_DDOT", "Y_DDOT", "Z_DDOT")


class _Segment(NamedTuple):
    """A segment of a message that is being read: where it begins, its metadata, and the times and
    states of its lines, m and m/s."""

    where: str
    meta: dict[str, str]
    epochs: list[tuple[str, Instant]]
    states: list[list[float]]

    def add_entry(self, where: str, key: str, value: str) -> None:
        """Add a line of the metadata."""
        if key in self.meta:
            raise InputError(f"{where} repeats {key}: it must occur once per segment.")
        if key in _TIMES:
            _time(f"{where}: {key}", value)
        self.meta[key] = value

    def add_state(self, where: str, line: str) -> None:
        """Add a line with a time and a state."""
        epoch, *columns = line.split()
        # Nine numbers with accelerations, which are skipped.
        if len(columns) not in (6, 9):
            raise InputError(
                f"{where}: {line!r} has {1 + len(columns)} columns: it must have a time followed "
                "by six or nine numbers."
            )
        time = _time(f"{where}: the epoch", epoch)
        if self.epochs and not time.since(self.epochs[-1][1]) > 0.0:
            raise InputError(
                f"{where}: the epoch is {epoch} after {self.epochs[-1][0]}: epochs must ascend."
            )
        state = []
        for name, column in zip(_STATE, columns, strict=False):
            value = finite_number(column)
            # The standard has km and km/s.
            if value is None or not math.isfinite(1e3 * value):
                raise InputError(f"{where}: {name} is {column[:40]!r}: it must be a finite number.")
            state.append(1e3 * value)
        self.epochs.append((epoch, time))
        self.states.append(state[:6])

    def ephemeris(self) -> Ephemeris:
        missing = [key for key in (*_KEYS, *_TIMES) if key not in self.meta]
        if missing:
            raise InputError(f"{self.where} begins a segment without {missing[0]}.")
        if not self.epochs:
            raise InputError(
                f"{self.where} begins a segment without states: it must have one line per state."
            )
        text, start = self.epochs[0]
        times = np.array([time.since(start) for _, time in self.epochs])
        states = np.array(self.states).T
        fields = {field: self.meta[key] for key, field in _KEYS.items()}
        return Ephemeris(text.rstrip("Z"), times, states[:3], states[3:], **fields)


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

    Numbers are written with the digits that give them back.

    **Raises** `InputError` for an epoch that is not a time, and for numbers that are not finite."""
    made = created or datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S")
    lines = ["CCSDS_OEM_VERS = 2.0", f"CREATION_DATE = {made}", f"ORIGINATOR = {originator}"]
    for one in ephemerides:
        start = _time("Ephemeris.epoch", one.epoch)
        for name in ("times", "position", "velocity"):
            check_finite(f"Ephemeris.{name}", np.asarray(getattr(one, name)))
        stamps = [_text(start, float(t)) for t in one.times]
        lines += ["", "META_START"]
        lines += [f"{key} = {getattr(one, field) or 'UNKNOWN'}" for key, field in _KEYS.items()]
        lines += [f"START_TIME = {stamps[0]}", f"STOP_TIME = {stamps[-1]}", "META_STOP"]
        states = np.concatenate([one.position, one.velocity]).T / 1e3
        rows = zip(stamps, states, strict=True)
        # `repr` is the shortest text that reads back as the same number.
        lines += [f"{stamp} {' '.join(repr(float(x)) for x in row)}" for stamp, row in rows]
    Path(path).write_text("\n".join(lines) + "\n", encoding="utf-8")


def _time(name: str, text: str) -> Instant:
    """The time of a text. Raises `InputError` by the `name` of its field."""
    time = instant(text)
    if time is None:
        raise InputError(f"{name} is {text[:40]!r}: it must be {ALLOWED}.")
    return time


def _text(start: Instant, after: float) -> str:
    """The time `after` the start, s, to a nanosecond."""
    whole = int(np.floor(after))
    # Whole from here on, so that a fraction that rounds up carries into the second.
    nanoseconds = round((after - whole + start.fraction) * 1e9)
    second = start.second + timedelta(seconds=whole + nanoseconds // 10**9)
    return f"{second:%Y-%m-%dT%H:%M:%S}.{nanoseconds % 10**9:09d}"
