"""Thrust curves in the columns of a text file, found by their headings.

    time (s),thrust (N)      a heading for each column, with its unit in brackets, after a blank, a
    0.00,0                   stroke or an underscore, or in a line of units of its own
    0.05,4.5                 a time, s, and a thrust, N, where no unit stands

Columns are separated by commas, semicolons, tabulators or blanks; where semicolons or tabulators
separate them, a comma is a decimal one. The headings may begin with `#` or `;`, as comments do.
So the exports of openMotor, OpenRocket and pandas are read, whatever other columns they have. In a
file without headings, or with two columns whose headings are none of these words, the first column
is the time and the second one the thrust.
"""

import csv
import re
from pathlib import Path
from typing import NamedTuple

from ..core import InputError
from ._motor_curve import Point, numbers, wrong_line

POUND = 4.4482216152605  # N
KILOPOND = 9.80665  # N

SECONDS = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), 1.0),
    **dict.fromkeys(("ms", "msec", "millisecond", "milliseconds"), 1e-3),
    **dict.fromkeys(("us", "µs", "μs", "microsecond", "microseconds"), 1e-6),
    **dict.fromkeys(("min", "minute", "minutes"), 60.0),
}
# A load-cell reading in kg is the weight of that mass.
NEWTONS = {
    **dict.fromkeys(("n", "newton", "newtons"), 1.0),
    **dict.fromkeys(("kn", "kilonewton", "kilonewtons"), 1e3),
    **dict.fromkeys(("lbf", "lb", "lbs", "pound", "pounds"), POUND),
    **dict.fromkeys(("ozf", "oz", "ounce", "ounces"), POUND / 16.0),
    **dict.fromkeys(("kgf", "kp", "kg"), KILOPOND),
    **dict.fromkeys(("gf", "p", "g", "gram", "grams"), 1e-3 * KILOPOND),
}


class Kind(NamedTuple):
    """The content of a column: its `names`, the `word` that longer names contain, and its units in
    SI."""

    names: tuple[str, ...]
    word: str
    units: dict[str, float]


TIME = Kind(("time", "t"), "time", SECONDS)
THRUST = Kind(("thrust", "force", "f"), "thrust", NEWTONS)


class Heading(NamedTuple):
    """Name and unit of a column in lower case; the unit is `None` where none is given."""

    name: str
    unit: str | None


class Head(NamedTuple):
    """A line before the first point: its number and text, whether it is a comment, and the fields
    that it has if it is one of headings."""

    number: int
    line: str
    comment: bool
    fields: list[str]


class Layout(NamedTuple):
    """Columns of the time and of the thrust, and their units in s and in N."""

    columns: tuple[int, int] = (0, 1)
    units: tuple[float, float] = (1.0, 1.0)


def read_columns(path: Path, lines: list[str]) -> list[Point]:
    """The points of a file of columns, in the order of their lines.

    **Arguments**

    - `path`: of the file, for sentences; `lines`: its text.

    **Raises** `InputError` for a line without a time and a thrust, and for headings that do not
    identify these columns."""
    entries = [(k, line) for k, line in enumerate(lines, 1) if line.strip()]
    first = next((k for k, (_, line) in enumerate(entries) if _is_row(line)), None)
    if first is None:
        return []
    separator = _separator(entries[first][1])
    heads = []
    for number, line in entries[:first]:
        text = line.strip().lstrip("#;% ")
        heads.append(Head(number, line, _is_comment(line), _split(text, separator)))
    layout = _layout(path, heads, len(_fields(entries[first][1])))
    if layout == Layout() and separator == ",":
        _check_commas(path, entries[first:])
    return [
        _point(path, number, line, layout)
        for number, line in entries[first:]
        if not _is_comment(line)
    ]


def _check_commas(path: Path, entries: list[tuple[int, str]]) -> None:
    """Raise `InputError` for ambiguous rows such as `0,5,10,2`, whose commas may be separators or
    decimal commas, in a file without headings."""
    rows = [(number, line) for number, line in entries if not _is_comment(line)]
    wide = [(number, line) for number, line in rows if len(_fields(line)) > 2]
    if wide and not any("." in line for _, line in rows):
        what = "two columns, or columns with headings: its commas may be decimal commas"
        raise wrong_line(path, *wide[0], what)


def _is_row(line: str) -> bool:
    """Whether a line begins with a number, which may be quoted."""
    return re.match(r'[\s"]*[-+]?\.?\d', line) is not None


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(("#", ";", "%"))


def _separator(line: str) -> str | None:
    return next((mark for mark in ";\t," if mark in line), None)


def _split(line: str, separator: str | None) -> list[str]:
    """The fields of a line without those that are empty at its end."""
    if separator is None:
        # A unit in brackets belongs to the name before it.
        return re.split(r"\s+(?![(\[])", line.strip())
    try:
        (fields,) = csv.reader([line.strip("\r\n ")], delimiter=separator, skipinitialspace=True)
    except csv.Error:
        # A field longer than any line of numbers, such as a hundred thousand characters: rejected
        # later.
        fields = line.split(separator)
    while fields and not fields[-1].strip():
        fields.pop()
    return fields


def _fields(line: str) -> list[str]:
    # Where commas separate, none is left in a field but a decimal one in quotes.
    return [field.replace(",", ".") for field in _split(line, _separator(line))]


def _point(path: Path, number: int, line: str, layout: Layout) -> Point:
    """Time and thrust of a line."""
    fields = _fields(line)
    entries = [fields[k] for k in layout.columns if k < len(fields)]
    values = numbers(entries) if len(entries) == 2 else None
    if values is None:
        raise wrong_line(path, number, line, "a time, s, and a thrust, N")
    return Point(number, layout.units[0] * values[0], layout.units[1] * values[1])


def _layout(path: Path, heads: list[Head], width: int) -> Layout:
    """The columns of time and thrust in rows of `width` columns, from the lines before them."""
    # The last line other than a comment, then the last comment.
    for head in sorted(reversed(heads), key=lambda head: head.comment):
        headings = [_heading(field) for field in head.fields]
        columns = _column(headings, TIME), _column(headings, THRUST)
        if columns[0] is None or columns[1] is None or columns[0] == columns[1]:
            continue
        if len(headings) == width:
            at = (columns[0], columns[1])
            return Layout(at, _units(path, head, headings, at, _units_alone(heads, at)))
        if not head.comment:
            what = f"{width} headings, one for each column"
            raise wrong_line(path, head.number, head.line, what)
    named = [head for head in heads if not head.comment and len(head.fields) == width]
    return _by_place(path, named[-1], width) if named and width > 1 else Layout()


def _by_place(path: Path, head: Head, width: int) -> Layout:
    """The first two columns below headings that name no time and thrust."""
    headings = [_heading(field) for field in head.fields]
    found = [_column(headings, kind) for kind in (TIME, THRUST)]
    # Where one of two headings is known, the other one is a word for something else.
    if width > 2 or any(column is not None for column in found):
        what = "headings of which one is 'time' and one 'thrust'"
        raise wrong_line(path, head.number, head.line, what)
    return Layout((0, 1), _units(path, head, headings, (0, 1), None))


def _heading(text: str) -> Heading:
    """Name and unit of a heading such as `Thrust (N)`, `time_ms`, `F / lbf` or `s`."""
    text = text.strip().strip('"').strip().lower()
    bracket = re.fullmatch(r"(.*?)\s*[(\[]([^()\[\]]*)[)\]]", text)
    if bracket:
        return Heading(bracket[1], bracket[2].strip())
    units = SECONDS | NEWTONS
    if text in units:
        return Heading("", text)
    last = re.fullmatch(r"(.*?)(?:\s+in\s+|[\s_,/]+)([^\s_,/]+)", text)
    return Heading(last[1], last[2]) if last and last[2] in units else Heading(text, None)


def _column(headings: list[Heading], kind: Kind) -> int | None:
    """The one column of a kind: by its name, by a longer name with its word, or by its unit."""
    by_name = [k for k, heading in enumerate(headings) if heading.name in kind.names]
    if by_name:
        # The same quantity in several units.
        return by_name[0]
    fit = [
        k
        for k, heading in enumerate(headings)
        if heading.unit is None or heading.unit in kind.units
    ]
    by_word = [k for k in fit if kind.word in re.findall(r"[^\W_]+", headings[k].name)]
    by_unit = [k for k in fit if not headings[k].name and headings[k].unit is not None]
    found = by_word or by_unit
    return found[0] if len(found) == 1 else None


def _units_alone(heads: list[Head], columns: tuple[int, int]) -> list[Heading] | None:
    """The entries of a line with units only, such as `(s),(N)`."""
    for head in heads:
        entries = [_heading(field) for field in head.fields]
        if len(entries) > max(columns) and all(
            entries[k].name == "" and entries[k].unit in kind.units
            for k, kind in zip(columns, (TIME, THRUST), strict=True)
        ):
            return entries
    return None


def _units(
    path: Path,
    head: Head,
    headings: list[Heading],
    columns: tuple[int, int],
    alone: list[Heading] | None,
) -> tuple[float, float]:
    """The units of both columns, in s and N."""
    values = []
    for column, kind, plain in zip(columns, (TIME, THRUST), ("s", "N"), strict=True):
        unit = headings[column].unit
        if unit is None and alone is not None:
            unit = alone[column].unit
        if unit is not None and unit not in kind.units:
            raise InputError(
                f"{path}, line {head.number} has the heading {head.fields[column].strip()!r}: its "
                f"unit must be {plain}, or one of {', '.join(kind.units)}."
            )
        values.append(1.0 if unit is None else kind.units[unit])
    return values[0], values[1]
