"""Ephemerides: states of one body at times, and the CCSDS Orbit Ephemeris Message that carries
them.

Source: CCSDS 502.0-B-3, Orbit Data Messages, 5 (OEM) and 7 (KVN); CCSDS 505.0-B-3, XML
Specification. States and covariances are read in both notations and written as keyword = value;
accelerations are skipped, and each segment of a file is one ephemeris.
"""

__all__ = ["Ephemeris", "StateCovariance", "check_epoch", "read_oem", "write_oem"]

import os
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..bodies import BodyState
from ..core import InputError
from ..core.checks import check_finite
from ..core.files import read_text
from ..core.printing import printed
from ..orbits import TabulatedPath
from ..sampling import MultivariateNormal
from ..simulation import Trajectory
from ._covariance import distribution_of
from ._epochs import ALLOWED, Instant, instant
from ._messages import (
    STATE,
    TRIANGLE,
    covariance_of,
    entries_of_xml,
    shifted,
    text_of,
    triangle_of,
)

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


@printed(time="s")
class StateCovariance(NamedTuple):
    """The covariance of position and velocity, m and s, (6, 6), at a `time`, s after the epoch of
    the ephemeris, in the axes of the `frame`; those of the states if empty."""

    time: float
    matrix: Float[np.ndarray, "6 6"]
    frame: str = ""


@printed(times="s", position="m", velocity="m/s")
class Ephemeris(NamedTuple):
    """States of a body at times, in NumPy.

    - `epoch`: the time zero, as text of ISO 8601, in the `time_system`.
    - `times`: s after the epoch, ascending, (times,).
    - `position`, m, and `velocity`, m/s: (3, times), relative to the `centre` in the axes of the
      `frame`.
    - `name`, `identifier`: of the body, such as "ISS" and "1998-067A".
    - `covariances`: of the states, at times of their own."""

    epoch: str
    times: Float[np.ndarray, " times"]
    position: Float[np.ndarray, "3 times"]
    velocity: Float[np.ndarray, "3 times"]
    name: str = ""
    identifier: str = ""
    centre: str = "EARTH"
    frame: str = "EME2000"
    time_system: str = "UTC"
    covariances: tuple[StateCovariance, ...] = ()

    @classmethod
    def of_run(
        cls,
        run: Trajectory,
        epoch: str,
        name: str = "",
        centre: str = "EARTH",
        frame: str = "EME2000",
        time_system: str = "UTC",
    ) -> "Ephemeris":
        """The states of a run.

        **Arguments**

        - `run`: a single one, of a body with position and velocity; its states that are not finite
          and its times after an event are left out.
        - `epoch`: of the time zero, text of ISO 8601.
        - `name`, `centre`, `frame`, `time_system`: as in the class.

        **Raises** `InputError` for an epoch that is not a time, and for another run."""
        check_epoch("epoch", epoch)
        r, v = (getattr(run.states, part, None) for part in ("position", "velocity"))
        if r is None or v is None or run.run_axes:
            raise InputError(
                "The run has no ephemeris: it must be a single run of a body with position and "
                "velocity."
            )
        ts, r, v = (np.asarray(x, float) for x in (run.ts, r, v))
        # After an event the time of the event is repeated.
        later = np.concatenate([[True], ts[1:] > np.maximum.accumulate(ts)[:-1]])
        kept = later & np.all(np.isfinite(np.concatenate([r, v])), axis=0)
        states = cls(epoch, ts[kept], r[:, kept], v[:, kept], name)
        return states._replace(centre=centre, frame=frame, time_system=time_system)

    def path(self) -> TabulatedPath:
        """The positions as a path for effects, whose time zero is the epoch."""
        return TabulatedPath(self.times, self.position)

    def state(self, index: int = 0) -> BodyState:
        """The state at one of the times, to begin a run with."""
        return BodyState(self.position[:, index], self.velocity[:, index])

    def distribution(self, index: int = 0) -> MultivariateNormal:
        """The distribution of position and velocity, m and m/s, (6,), at the time of one of the
        covariances, in the axes of the states.

        **Raises** `InputError` without a state at that time, for a covariance in axes that do not
        follow from the state, and for one that is not positive semidefinite."""
        if not self.covariances:
            raise InputError("Ephemeris.covariances is empty: it must have a covariance.")
        time, matrix, axes = self.covariances[index]
        # The epochs of a message may have different digits.
        (places,) = np.nonzero(np.abs(self.times - time) < 1e-6)
        if not places.size:
            raise InputError(
                f"Ephemeris.covariances has a time of {time:g} s: it must be one of the states."
            )
        r, v = self.position[:, places[0]], self.velocity[:, places[0]]
        return distribution_of(r, v, matrix, axes or self.frame, self.frame)


def read_oem(path: str | os.PathLike[str]) -> list[Ephemeris]:
    """The ephemerides of a CCSDS Orbit Ephemeris Message, in keyword = value notation or in XML.

    **Arguments**

    - `path`: of the file.

    **Returns** one `Ephemeris` for each segment; the first time of a segment is its epoch. Seconds
    of a leap are not counted: a segment in UTC should not span one.

    **Raises** `InputError` with the line that violates the standard: an invalid time, a number that
    is not finite, times that do not ascend, or a segment without its metadata or states."""
    text = read_text(path)
    if text.lstrip().startswith("<"):
        return _of_xml(path, text)
    # Rejected here, where other messages can still be identified.
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
                segments.append(_Segment(where, {}, [], [], []))
            # Both keywords that close a block lead back to the states.
            part = {"META_START": "meta", "COVARIANCE_START": "covariance"}.get(line, "data")
            if line == "COVARIANCE_START" and not segments:
                raise InputError(f"{where} is {line!r}: META_START must precede it.")
        elif part == "covariance":
            segments[-1].add_covariance_line(where, line)
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


_ACCELERATION = ("X_DDOT", "Y_DDOT", "Z_DDOT")


def _of_xml(path: str | os.PathLike[str], text: str) -> list[Ephemeris]:
    """The ephemerides of a message in XML."""
    entries = entries_of_xml(path, text)
    if not any(entry.key == "<oem" for entry in entries):
        raise InputError(f"{path} is not an orbit ephemeris message: it must have <oem>.")
    segments: list[_Segment] = []
    block, values = "", {}
    for key, value, line in entries:
        where = f"{path}, line {line}"
        if key == "<segment":
            segments.append(_Segment(where, {}, [], [], []))
        elif key in ("<metadata", "<stateVector", "<covarianceMatrix"):
            block, values = key[1:], {}
        elif key == "/stateVector":
            names = ["EPOCH", *STATE, *[name for name in _ACCELERATION if name in values]]
            for name in names:
                if name not in values:
                    raise InputError(f"{where} ends a state without {name}.")
            segments[-1].add_state(where, " ".join(values[name] for name in names))
        elif key == "/covarianceMatrix":
            segments[-1].add_covariance(where, values)
        elif key[0] not in "</" and block and segments:
            if block == "metadata":
                segments[-1].add_entry(where, key, value)
            elif key in values:
                raise InputError(f"{where} repeats {key}: it must occur once.")
            values[key] = value
        if key[0] == "/":
            block = ""
    if not segments:
        raise InputError(f"{path} has no states: it must have a segment.")
    return [segment.ephemeris() for segment in segments]


class _Covariance(NamedTuple):
    """A covariance that is being read: where it begins, its epoch, its axes and its numbers, km and
    s, as text."""

    where: str
    epoch: Instant
    frame: str
    numbers: list[str]


class _Segment(NamedTuple):
    """A segment of a message that is being read: where it begins, its metadata, the times and
    states of its lines, m and m/s, and its covariances."""

    where: str
    meta: dict[str, str]
    epochs: list[tuple[str, Instant]]
    states: list[list[float]]
    covariances: list[_Covariance]

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
        # The standard has km and km/s.
        names = (*STATE, *_ACCELERATION)
        state = [shifted(f"{where}: {n}", x, 3) for n, x in zip(names, columns, strict=False)]
        self.epochs.append((epoch, time))
        self.states.append(state[:6])

    def add_covariance_line(self, where: str, line: str) -> None:
        """Add a line of a covariance block: an epoch, axes, or a row of the lower triangle."""
        key, equals, value = (field.strip() for field in line.partition("="))
        if key == "EPOCH" and equals:
            self.covariances.append(_Covariance(where, _time(f"{where}: EPOCH", value), "", []))
            return
        if not self.covariances:
            raise InputError(f"{where} is {line!r}: EPOCH must precede it.")
        last = self.covariances[-1]
        if key == "COV_REF_FRAME" and equals:
            self.covariances[-1] = last._replace(frame=value)
        elif equals:
            raise InputError(f"{where} is {line!r}: it must be EPOCH, COV_REF_FRAME or a row.")
        else:
            for text in line.split():
                shifted(f"{where}: the covariance", text, 6)
            last.numbers.extend(line.split())

    def add_covariance(self, where: str, values: dict[str, str]) -> None:
        """Add a covariance whose numbers have keywords."""
        for name in ("EPOCH", *TRIANGLE):
            if name not in values:
                raise InputError(f"{where} ends a covariance without {name}.")
        for name in TRIANGLE:
            shifted(f"{where}: {name}", values[name], 6)
        numbers = [values[name] for name in TRIANGLE]
        frame = values.get("COV_REF_FRAME", "")
        self.covariances.append(_Covariance(where, _time(where, values["EPOCH"]), frame, numbers))

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
        covariances = tuple(self._covariance(one, start) for one in self.covariances)
        return Ephemeris(
            *(text.rstrip("Z"), times, states[:3], states[3:]), **fields, covariances=covariances
        )

    def _covariance(self, one: _Covariance, start: Instant) -> StateCovariance:
        if len(one.numbers) != len(TRIANGLE):
            raise InputError(
                f"{one.where} begins a covariance of {len(one.numbers)} numbers: it must have "
                f"{len(TRIANGLE)}, a lower triangle."
            )
        rows = [shifted(f"{one.where}: the covariance", x, 6) for x in one.numbers]
        return StateCovariance(one.epoch.since(start), covariance_of(rows), one.frame)


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

    `read_oem` reads the same numbers, to the last digit; times are written to a nanosecond.

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
        states = np.concatenate([one.position, one.velocity]).T
        rows = zip(stamps, states, strict=True)
        lines += [f"{stamp} {' '.join(text_of(x, 3) for x in row)}" for stamp, row in rows]
        if one.covariances:
            lines.append("COVARIANCE_START")
            for time, matrix, frame in one.covariances:
                check_finite("Ephemeris.covariances", np.asarray(matrix))
                lines.append(f"EPOCH = {_text(start, float(time))}")
                lines.append(f"COV_REF_FRAME = {frame or one.frame}")
                lines += [" ".join(row) for row in triangle_of(matrix)]
            lines.append("COVARIANCE_STOP")
    Path(path).write_text("\n".join(lines) + "\n", encoding="utf-8")


def check_epoch(name: str, text: str) -> None:
    """Check a time.

    **Arguments**

    - `name`: of the field.
    - `text`: a time of ISO 8601.

    **Raises** `InputError`, by the name of the field, if the text is not such a time."""
    _time(name, text)


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
