"""Flight logs as CSV files: columns with names and units over the time.

    time (s),altitude (m),vertical speed (m/s)
    0.00,0.0,0.2
    0.05,0.1,3.1

Fields are separated by commas, semicolons or tabs, and the heading may be a comment (`#`), as other
programs write it. A unit follows the name in brackets; a column without one is a pure number. A
field is missing where it is empty, `nan` or `NA`.
"""

__all__ = ["FlightLog", "read_log"]

import os
import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..core import InputError
from ..core.files import finite_number, read_text
from ..core.printing import printed
from ..core.separated import Row, Sheet, separated
from ..core.suggestions import nearest
from .units import in_unit

TIMES = ("time", "t", "timestamp", "elapsed time", "flight time")
MISSING = ("", "nan", "na", "n/a", "null", "none", "-")
HEAD = re.compile(r"(?P<name>.*?)\s*(?:[(\[](?P<unit>[^()\[\]]*)[)\]])?")


@printed(times="s")
class FlightLog(NamedTuple):
    """The content of a log.

    - `path`: of the file.
    - `times`: ascending, s, (samples,).
    - `columns`: the other columns by name, each (samples,), NaN where a field is missing.
    - `units`: of the columns, as in the file; empty for a pure number.
    - `lines`: the line of the file of each sample."""

    path: str
    times: np.ndarray
    columns: dict[str, np.ndarray]
    units: dict[str, str]
    lines: np.ndarray


def read_log(path: str | os.PathLike[str], *, time: str | None = None) -> FlightLog:
    """Read a flight log from a CSV file.

    **Arguments**

    - `path`: of the file, at most 64 MB.
    - `time`: name of the column with the times; by default "time" or "t", in any case.

    **Raises** `InputError` with the file, and the line if there is one: without a heading or a
    column of times with a unit of time, for a name that occurs twice, for a missing time, for times
    that do not increase, and for a field that is not a number. `OSError` for a file that cannot be
    opened."""
    sheet = _sheet(os.fspath(path), read_text(path).splitlines(), time)
    heads = [_head(text) for text in sheet.names]
    names = [name for name, _ in heads]
    for k, name in enumerate(names):
        if name in names[:k]:
            raise InputError(f"{path} has two columns {name!r}: names must differ.")
    place = _place_of_time(str(path), names, time)
    factor = _time_factor(str(path), *heads[place])
    lines = np.array([row.line for row in sheet.rows])
    times = factor * _column(str(path), sheet.rows, place, names[place])
    _check_times(str(path), times, lines)
    others = [k for k in range(len(names)) if k != place and names[k]]
    return FlightLog(
        str(path),
        times,
        {names[k]: _column(str(path), sheet.rows, k, names[k]) for k in others},
        {names[k]: heads[k][1] for k in others},
        lines,
    )


def _sheet(path: str, lines: list[str], time: str | None) -> Sheet:
    def is_heading(fields: list[str]) -> bool:
        names = [_head(field)[0] for field in fields]
        wanted = any(_is_time(name, time) for name in names)
        return len(fields) > 1 and wanted and all(finite_number(x) is None for x in fields if x)

    sheet = separated(path, lines, is_heading, lambda fields: False)
    if sheet is None:
        what = "time" if time is None else repr(time)
        raise InputError(
            f"{path} has no heading with a column {what} beside another one: it must have names "
            "and units such as time (s), altitude (m)."
        )
    if not sheet.rows:
        raise InputError(f"{path} has no rows below its heading.")
    return sheet


def _head(text: str) -> tuple[str, str]:
    """Name and unit of a column."""
    found = HEAD.fullmatch(text.strip())
    # Only a heading with unbalanced brackets does not match: its text is the name.
    if found is None:
        return text.strip(), ""
    unit = (found["unit"] or "").strip()
    return found["name"], "" if unit in ("1", "-") else unit


def _is_time(name: str, time: str | None) -> bool:
    return name == time if time is not None else name.lower().replace("_", " ") in TIMES


def _place_of_time(path: str, names: Sequence[str], time: str | None) -> int:
    places = [k for k, name in enumerate(names) if _is_time(name, time)]
    if len(places) > 1:
        which = ", ".join(repr(names[k]) for k in places)
        raise InputError(f"{path} has several columns of times: time must be one of {which}.")
    return places[0]


def _time_factor(path: str, name: str, unit: str) -> float:
    """Seconds in the unit of the times."""
    try:
        if unit:
            return 1.0 / in_unit("s", unit)
    except ValueError:
        pass
    given = f"is in {unit}" if unit else "has no unit"
    raise InputError(f'{path}: {name} {given}: it must be in a unit of time, such as "{name} (s)".')


def _column(path: str, rows: Sequence[Row], k: int, name: str) -> np.ndarray:
    return np.array([_number(path, row, k, name) for row in rows])


def _number(path: str, row: Row, k: int, name: str) -> float:
    # A comma within a field is a decimal one.
    text = row.fields[k].replace(",", ".")
    if text.lower() in MISSING:
        return np.nan
    value = finite_number(text)
    if value is None:
        raise InputError(
            f"{path}, line {row.line}: {name} is {text[:40]!r}: it must be a finite number."
        )
    return value


def _check_times(path: str, times: np.ndarray, lines: np.ndarray) -> None:
    missing = np.isnan(times)
    if missing.any():
        raise InputError(f"{path}, line {lines[np.argmax(missing)]} has no time.")
    wrong = np.diff(times) <= 0.0
    if wrong.any():
        k = int(np.argmax(wrong)) + 1
        raise InputError(
            f"{path}, line {lines[k]}: the time is {times[k]:.9g} s after {times[k - 1]:.9g} s: it "
            "must increase from row to row."
        )


def column_of(log: FlightLog, name: str) -> np.ndarray:
    """A column of a log by its name. Raises `InputError` for an unknown one."""
    if name not in log.columns:
        raise InputError(
            f"{log.path} has no column {name!r}: it has {', '.join(log.columns)}."
            + nearest(name, log.columns)
        )
    return log.columns[name]
