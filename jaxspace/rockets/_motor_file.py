"""Files of solid motors: RASP (`.eng`), the format of thrustcurve.org, and two columns (`.csv`).

    ; comment
    NAME  diameter, mm  length, mm  delays  propellant, kg  loaded mass, kg  maker
    time, s   thrust, N              one line for each point, the last one with no thrust

The curve of a RASP file goes on up to the head of the next motor: points without thrust within it
are a pause between two pulses. In RASP a semicolon begins a comment anywhere.

A CSV file has a time, s, and a thrust, N, in each line. Columns are separated by commas or blanks;
where semicolons or tabulators separate them, a comma is a decimal one. Lines that begin with no
number are headings and comments, among them those that begin with `;` or `#`.

Both begin at the time zero with no thrust unless they say otherwise.

Source: RASP, as ThrustCurve.org documents it.
"""

import csv
import os
import re
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np

from ..core import InputError, Scalar, check
from ..core.checks import check_positive
from ..core.files import read_text
from ..core.types import as_float
from ._thrust_profile import ThrustProfile

Point: TypeAlias = tuple[float, float]

# Entries of a head without its last one, the maker, which some files leave out.
HEAD = 6


class MotorFile(NamedTuple):
    """Content of the file of a motor: the fields of `Motor`, which this module does not know,
    because the effects read files, too."""

    times: np.ndarray
    thrusts: np.ndarray
    propellant_mass: float | None = None
    loaded_mass: float | None = None
    diameter: float | None = None
    length: float | None = None
    name: str = ""

    @property
    def total_impulse(self) -> float:
        """N s, by trapezoids: exact for the polygon that is flown."""
        return float(np.sum(0.5 * (self.thrusts[1:] + self.thrusts[:-1]) * np.diff(self.times)))

    @property
    def burn_time(self) -> float:
        """s, from the first to the last point."""
        return float(self.times[-1] - self.times[0])

    def parameters(
        self, propellant_mass: Scalar | None = None
    ) -> tuple[Scalar, Scalar, Scalar, ThrustProfile]:
        """Mean thrust, N, exhaust velocity, m/s, burn time, s, and profile, for the effects.

        `propellant_mass`: kg, in place of what the file says."""
        mass = self.propellant_mass if propellant_mass is None else propellant_mass
        if mass is None:
            raise InputError(
                f"The file of the motor {self.name} gives no mass of its propellant: "
                "give propellant_mass, in kg."
            )
        # Here, too: a motor need not come from a file, and a quotient by zero names nothing.
        check_positive("Motor.propellant_mass", mass)
        check_positive("Motor.total_impulse", self.total_impulse)
        profile, burn_time, mean = ThrustProfile.tabulated(self.times, self.thrusts)
        u = self.total_impulse / mass
        return as_float(mean), as_float(u), as_float(burn_time), profile


def read_motor_file(path: str | os.PathLike[str]) -> MotorFile:
    """The content of the file; see `read_motor`."""
    lines = read_text(path).splitlines()
    path = Path(path)
    rasp = path.suffix.lower() == ".eng"
    head, points = _rasp(path, lines) if rasp else ([], _columns(path, lines))
    return _motor(path, head, points)


def _rasp(path: Path, lines: list[str]) -> tuple[list[str], list[Point]]:
    """Head and points of the first motor of a RASP file."""
    head: list[str] = []
    points: list[Point] = []
    for number, line in enumerate(lines, 1):
        fields = line.split(";")[0].split()
        if not fields or fields[0].startswith("#"):
            continue
        if not head:
            if len(fields) < HEAD:
                what = "a head: name, diameter, length, delays, propellant mass, mass, maker"
                raise _wrong_line(path, number, line, what)
            head = fields
        # By their number and not by what they are: the name of a motor may be a number.
        elif len(fields) >= HEAD or len(fields) > 2 and _numbers(fields[:1]) is None:
            break
        else:
            points.append(_point(path, number, line, fields))
    return head, points


def _columns(path: Path, lines: list[str]) -> list[Point]:
    """The points of a file of two columns."""
    points = []
    for number, line in enumerate(lines, 1):
        # A heading, a comment, or nothing; quoted numbers are numbers.
        if not re.match(r'[\s"]*[-+]?\.?\d', line):
            continue
        separator = next((mark for mark in ";\t," if mark in line), None)
        if separator is None:
            fields = line.split()
        else:
            (fields,) = csv.reader([line.strip()], delimiter=separator)
        # Where commas separate, none is left in a field but a decimal one in quotes.
        points.append(_point(path, number, line, [f.replace(",", ".") for f in fields]))
    return points


def _point(path: Path, number: int, line: str, fields: list[str]) -> Point:
    """Time and thrust of a line with these fields."""
    values = _numbers(fields[:2])
    # A RASP line of three numbers is no head: to take two of them might take the wrong ones.
    if values is None or len(values) < 2 or path.suffix.lower() == ".eng" and len(fields) > 2:
        raise _wrong_line(path, number, line, "a time, s, and a thrust, N")
    return values[0], values[1]


def _numbers(fields: list[str]) -> list[float] | None:
    """The numbers that the fields are; `None` where one is other text, or is not finite."""
    try:
        values = [float(field) for field in fields]
    except ValueError:
        return None
    return values if np.all(np.isfinite(values)) else None


def _wrong_line(path: Path, number: int, line: str, what: str) -> InputError:
    return InputError(f"{path}, line {number} is {line.strip()!r}: it must be {what}.")


def _motor(path: Path, head: list[str], points: list[Point]) -> MotorFile:
    # The curve of a RASP file begins at the time zero without saying so.
    if points and points[0][0] > 0.0:
        points = [(0.0, 0.0), *points]
    if len(points) < 2:
        raise InputError(f"{path} has {len(points)} points of a thrust curve: it must have two.")
    times, thrusts = np.asarray(points).T
    if not np.all(np.diff(times) > 0.0):
        raise InputError(f"{path} has times that do not ascend.")
    check(times[0] >= 0.0, f"{path}: time", times[0], "zero or positive, in s")
    check(thrusts >= 0.0, f"{path}: thrust", np.min(thrusts), "zero or positive, in N")
    check(np.any(thrusts > 0.0), f"{path}: thrust", np.max(thrusts), "above zero somewhere, in N")
    if not head:
        return MotorFile(times, thrusts, name=path.stem)
    numbers = _numbers([head[k] for k in (1, 2, 4, 5)])
    if numbers is None:
        raise InputError(f"{path} has the head {' '.join(head)!r}: it is not RASP.")
    diameter, length, propellant, loaded = numbers
    for name, value in (("diameter", diameter), ("length", length)):
        check(value >= 0.0, f"{path}: {name}", value, "zero or positive, in mm")
    check(propellant > 0.0, f"{path}: propellant mass", propellant, "above zero, in kg")
    check(loaded >= 0.0, f"{path}: loaded mass", loaded, "zero or positive, in kg")
    return MotorFile(times, thrusts, propellant, loaded, 1e-3 * diameter, 1e-3 * length, head[0])
