"""Rows of a CSV file, by the separator of its heading."""

import csv
from collections.abc import Iterator


def separated(lines: list[str], *words: str) -> Iterator[list[str]]:
    """The fields of each line, by what separates them in the heading.

    **Arguments**

    - `lines`: of the file.
    - `words`: the heading is the first line with one of them, in small letters. It has semicolons
      or tabulators, or else commas. Where the former separate, a comma is a decimal one."""
    heading = next((line for line in lines if any(word in line.lower() for word in words)), "")
    mark = next(mark for mark in ";\t," if mark in heading + ",")
    for line in lines:
        # Line by line, so that an unclosed quotation ends with its line.
        try:
            yield next(csv.reader([line], delimiter=mark), [])
        except csv.Error:
            yield line.split(mark)
