"""The scene file of an optimum: the text of the file with new values of the design variables, and
otherwise unchanged."""

from collections.abc import Mapping
from typing import Any

from ...core import InputError
from ...core.extras import extra
from .._file_content import FileContent
from .._requests.optimize_table import Free, Task
from ..units import read_number


def with_numbers(file: FileContent, task: Task, values: Mapping[str, float]) -> str:
    """The text of the `file` with the design variables of the `task` replaced by the `values`, SI,
    by path."""
    # Only this function needs the library that preserves comments.
    with extra("app"):
        import tomlkit

    document = tomlkit.parse(file.text)
    for free in task.free:
        # A bare number is in SI, whatever the unit of the report.
        factor = free.factor if free.start.unit else 1.0
        _put(document, free.path.split("."), _written(values[free.path], free, factor))
    # The text may be written into another folder, where a relative name would find nothing.
    for path, named in file.files.entries.items():
        _put(document, path.split("."), str(named.path))
    return tomlkit.dumps(document)


def _written(value: float, free: Free, factor: float) -> str | float:
    """A number as the file writes it: with its unit where it had one."""
    value = min(max(value, free.low), free.high)
    written = 0.0
    # More digits than the accuracy of a search, and fewer than the rounding by a change of unit.
    # All digits at a bound, beyond which the file could not be read again.
    for digits in (12, 15, 16, 17):
        number = float(f"{factor * value:.{digits}g}")
        written = f"{number!r} {free.start.unit}" if free.start.unit else number
        if free.low <= read_number(written, free.start.quantity)[0] <= free.high:
            break
    return written


def _put(table: Any, path: list[str], value: str | float) -> None:
    """Set the entry at a path of a document; tables on the way are made where there are none."""
    for step, following in zip(path[:-1], path[1:], strict=True):
        # A step of digits is an index in lists alone: a table may have such a key.
        key: Any = int(step) if step.isdigit() and isinstance(table, list) else step
        if not isinstance(table, list) and key not in table:
            if following.isdigit():
                raise InputError(f"{'.'.join(path)} has its default: write the list into the file.")
            table[key] = {}
        table = table[key]
    last: Any = int(path[-1]) if isinstance(table, list) else path[-1]
    if not isinstance(table, list | dict):
        raise InputError(
            f"{'.'.join(path)} cannot be written: its table is given as a single number."
        )
    table[last] = value
