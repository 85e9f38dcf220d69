"""Points of a thrust curve as given in the lines of a file, and the resulting curve."""

from itertools import groupby, pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..core import InputError, check
from ..core.files import finite_number


class Point(NamedTuple):
    """A time, s, and a thrust, N, and the number of their `line`."""

    line: int
    time: float
    thrust: float


def numbers(fields: list[str]) -> list[float] | None:
    """The numbers that the fields are; `None` where one is other text, or is not finite."""
    values = [value for field in fields if (value := finite_number(field)) is not None]
    return values if len(values) == len(fields) else None


def wrong_line(path: Path, number: int, line: str, what: str) -> InputError:
    """The error of a line that must be something else."""
    return InputError(f"{path}, line {number} is {line.strip()!r}: it must be {what}.")


def curve(path: Path, points: list[Point]) -> tuple[np.ndarray, np.ndarray]:
    """Ascending times, s, and thrusts, N; a time is repeated where the thrust jumps.

    At the first and the last time the side of the burn is taken, because the other one adds no
    impulse.

    **Arguments**

    - `path`: of the file, for sentences.
    - `points`: in the order of their lines.

    **Raises** `InputError` for fewer than two points, times that do not ascend, and values out of
    their range."""
    groups = [list(group) for _, group in groupby(points, lambda point: point.time)]
    for before, after in pairwise(groups):
        if not after[0].time > before[0].time:
            raise InputError(
                f"{path} has descending or repeated times: {after[0].time:.9g} s in line "
                f"{after[0].line} comes after {before[-1].time:.9g} s in line {before[-1].line}."
            )
    kept: list[Point] = []
    for k, group in enumerate(groups):
        first, last = group[0], group[-1]
        if k == 0:
            kept.append(last)
        elif k == len(groups) - 1 or first.thrust == last.thrust:
            kept.append(first)
        else:
            kept += [first, last]
    if len(kept) < 2:
        raise InputError(
            f"{path} has {len(kept)} points of a thrust curve: it must have at least two."
        )
    for point in kept:
        where = f"{path}, line {point.line}"
        check(point.time >= 0.0, f"{where}: time", point.time, "zero or positive, in s")
        check(point.thrust >= 0.0, f"{where}: thrust", point.thrust, "zero or positive, in N")
    times = np.array([point.time for point in kept])
    thrusts = np.array([point.thrust for point in kept])
    check(np.any(thrusts > 0.0), f"{path}: thrust", np.max(thrusts), "above zero somewhere, in N")
    return times, thrusts
