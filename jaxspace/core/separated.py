"""Rows of a CSV file below its heading, by the separator of the heading.

Fields are separated by semicolons, tabulators or commas. Where one of the first two separates them,
a comma is a decimal one. Empty lines and comments (`#`, `;`, `%`) are left out; the heading itself
may be a comment.
"""

import csv
from collections.abc import Callable
from typing import NamedTuple

from .checks import InputError

MARKS = ";\t,"
COMMENTS = ("#", ";", "%")


class Row(NamedTuple):
    """The number of a `line`, and its `fields` without the blanks around them, as many as the
    heading has: empty ones where the line ends before."""

    line: int
    fields: list[str]


class Sheet(NamedTuple):
    """A heading, as many `names` as it has columns, and the `rows` below it."""

    names: list[str]
    rows: list[Row]


def separated(
    path: str,
    lines: list[str],
    is_heading: Callable[[list[str]], bool],
    is_note: Callable[[list[str]], bool],
) -> Sheet | None:
    """The heading and the rows of a file; `None` without a heading.

    **Arguments**

    - `path`: of the file, for errors; `lines`: its text.
    - `is_heading`: of fields, whether they are the heading; the first such line is. Lines above it
      are notes, and a heading that is repeated is left out.
    - `is_note`: of the fields of a line below it, whether they are left out.

    **Raises** `InputError` for a row with more fields than the heading, or another heading."""
    found = next(
        (
            (k, mark)
            for k, line in enumerate(lines)
            for mark in MARKS
            if is_heading(_heading(line, mark))
        ),
        None,
    )
    if found is None:
        return None
    start, mark = found
    names = _heading(lines[start], mark)
    result = Sheet(names, [])
    for number, line in enumerate(lines[start + 1 :], start + 2):
        fields = _split(line, mark)
        if not any(fields) or is_note(fields):
            continue
        again = _heading(line, mark)
        if is_heading(again):
            # DATCOM repeats its heading before every block.
            if again != names:
                raise InputError(
                    f"{path}, line {number} is a second heading: only the first line may be one."
                )
            continue
        # A comment, unless it separates: a row may begin with an empty field.
        if line.lstrip().startswith(tuple(c for c in COMMENTS if c != mark)):
            continue
        result.rows.append(Row(number, _fitted(path, number, fields, len(names))))
    return result


def _heading(line: str, mark: str) -> list[str]:
    """The fields of a line that may be a comment, without those that are empty at its end."""
    fields = _split(line.lstrip("".join(c for c in COMMENTS if c != mark) + " "), mark)
    while fields and not fields[-1]:
        fields.pop()
    return fields


def _split(line: str, mark: str) -> list[str]:
    # Line by line, so that an unclosed quotation ends with its line.
    try:
        fields = next(csv.reader([line], delimiter=mark, skipinitialspace=True), [])
    except csv.Error:
        fields = line.split(mark)
    return [field.strip() for field in fields]


def _fitted(path: str, number: int, fields: list[str], width: int) -> list[str]:
    """The fields of a row, as many as the heading has: a decimal comma in a file that separates by
    commas would shift all that follow it."""
    if any(fields[width:]):
        raise InputError(
            f"{path}, line {number} has {len(fields)} fields: it must have {width}, as many as its "
            "heading."
        )
    return fields[:width] + [""] * (width - len(fields))
