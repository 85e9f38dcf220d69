"""Points of a thrust curve as they stand in the lines of a file, and the curve that they make."""

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
    """Ascending times, s, and thrusts, N.

    A point that stands twice is taken once. Where the thrust jumps at the first or the last time,
    the side of the burn is taken, because the other one adds no impulse.

    **Arguments**

    - `path`: of the file, for sentences.
    - `points`: in the order of their lines.

    **Raises** `InputError` for fewer than two points, times that do not ascend, and values out of
    their range."""
    kept: list[Point] = []
    for point in points:
        same = bool(kept) and point.time == kept[-1].time
        if same and len(kept) == 1:
            # At the ignition the second of two points is the side of the burn.
            kept = [point]
        # At the burnout the first one is; a jump between them has no side, and is refused below.
        elif same and (point.thrust == kept[-1].thrust or point.time == points[-1].time):
            continue
        elif kept and point.time <= kept[-1].time:
            raise InputError(
                f"{path} has times that do not ascend: {point.time:.9g} s in line {point.line} "
                f"comes after {kept[-1].time:.9g} s in line {kept[-1].line}."
            )
        else:
            kept.append(point)
    if len(kept) < 2:
        raise InputError(f"{path} has {len(kept)} points of a thrust curve: it must have two.")
    times = np.array([point.time for point in kept])
    thrusts = np.array([point.thrust for point in kept])
    check(times[0] >= 0.0, f"{path}: time", times[0], "zero or positive, in s")
    check(thrusts >= 0.0, f"{path}: thrust", np.min(thrusts), "zero or positive, in N")
    check(np.any(thrusts > 0.0), f"{path}: thrust", np.max(thrusts), "above zero somewhere, in N")
    return times, thrusts
