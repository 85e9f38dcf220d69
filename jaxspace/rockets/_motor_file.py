"""Files of solid motors: RASP (`.eng`) and RockSim (`.rse`), the formats of thrustcurve.org, and
columns (`.csv`).

    ; comment
    NAME  diameter, mm  length, mm  delays  propellant, kg  loaded mass, kg  maker
    time, s   thrust, N              one line for each point, the last one with no thrust

The curve of a RASP file begins at t = 0 with zero thrust unless the file has a point there, and
extends to the header of the next motor: points without thrust within it are a pause between two
pulses. In RASP a semicolon begins a comment anywhere. A header whose masses cannot be in kilograms
is rejected. `_motor_xml` has the format of RockSim, whose curve begins as that of RASP.

Any other file is one of columns: see `_motor_columns`. Its curve begins at its first point, at any
time, because the clock of the test stand need not start with the motor.

Source: RASP, as ThrustCurve.org documents it.
"""

import os
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..core import InputError, Scalar, check
from ..core.checks import check_positive
from ..core.files import read_text
from ..core.types import as_float
from ._motor_columns import read_columns
from ._motor_curve import Point, curve, numbers, wrong_line
from ._motor_xml import read_engine
from ._thrust_profile import ThrustProfile

# Entries of a head without its last one, the maker, which some files leave out.
HEAD = 6
SLOWEST = 10.0
"""m/s: of any motor the exhaust is faster, and one whose propellant is in grams has 3 m/s."""
HEAVIEST = 100.0
"""The largest loaded mass by that of the propellant; real motors have at most about 20."""


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

        `propellant_mass`: kg, instead of the value in the file."""
        mass = self.propellant_mass if propellant_mass is None else propellant_mass
        if mass is None:
            raise InputError(
                f"The file of the motor {self.name} does not contain the propellant mass: give "
                "propellant_mass, in kg."
            )
        # Here, too: a motor need not come from a file, and a quotient by zero names nothing.
        check_positive("Motor.propellant_mass", mass)
        check_positive("Motor.total_impulse", self.total_impulse)
        profile, burn_time, mean = ThrustProfile.tabulated(self.times, self.thrusts)
        # Of the whole burn: no maker measures the flow itself, so that it is taken in proportion to
        # the thrust.
        u = self.total_impulse / mass
        return as_float(mean), as_float(u), as_float(burn_time), profile


def read_motor_file(path: str | os.PathLike[str]) -> MotorFile:
    """The content of the file; see `read_motor`."""
    text = read_text(path)
    lines = text.splitlines()
    path = Path(path)
    if path.suffix.lower() == ".eng":
        head, points = _rasp(path, lines)
        motor = MotorFile(*curve(path, _from_zero(points)))
        return _with_head(path, head, motor) if head.fields else motor._replace(name=path.stem)
    if path.suffix.lower() == ".rse":
        engine = read_engine(path, text)
        motor = MotorFile(*curve(path, _from_zero(engine.points)), name=engine.code or path.stem)
        masses = 1e-3 * engine.propellant, 1e-3 * engine.loaded
        where = f"{path}, line {engine.line}"
        return _with_measures(where, motor, engine.diameter, engine.length, *masses)
    return MotorFile(*curve(path, read_columns(path, lines)), name=path.stem)


class Head(NamedTuple):
    """The `fields` of the head of a RASP file and the number of its `line`."""

    line: int
    fields: list[str]


def _rasp(path: Path, lines: list[str]) -> tuple[Head, list[Point]]:
    """Head and points of the first motor of a RASP file."""
    head = Head(0, [])
    points: list[Point] = []
    for number, line in enumerate(lines, 1):
        # A comment of RASP begins with a semicolon, also behind a point.
        fields = line.split(";")[0].split()
        if not fields or fields[0].startswith("#"):
            continue
        if not head.fields:
            if len(fields) < HEAD:
                what = (
                    "a header: name, diameter, length, delays, propellant mass, mass, manufacturer"
                )
                raise wrong_line(path, number, line, what)
            head = Head(number, fields)
        # By their number and not by what they are: the name of a motor may be a number.
        elif len(fields) >= HEAD or len(fields) > 2 and numbers(fields[:1]) is None:
            break
        else:
            values = numbers(fields)
            # Three numbers are not a header: picking two of them might pick the wrong ones.
            if values is None or len(values) != 2:
                raise wrong_line(path, number, line, "a time, s, and a thrust, N")
            points.append(Point(number, *values))
    return head, points


def _from_zero(points: list[Point]) -> list[Point]:
    """The points of a curve that begins at the time zero without saying so."""
    # RASP and RockSim leave out the point at ignition, where the thrust is zero.
    if points and points[0].time > 0.0:
        return [Point(points[0].line, 0.0, 0.0), *points]
    return points


def _with_head(path: Path, head: Head, motor: MotorFile) -> MotorFile:
    """The motor with the validated header of its RASP file."""
    where = f"{path}, line {head.line}"
    values = numbers([head.fields[k] for k in (1, 2, 4, 5)])
    if values is None:
        raise InputError(f"{where} has the header {' '.join(head.fields)!r}: it is not RASP.")
    return _with_measures(where, motor._replace(name=head.fields[0]), *values)


def _with_measures(
    where: str,
    motor: MotorFile,
    diameter: float,
    length: float,
    propellant: float,
    loaded: float,
) -> MotorFile:
    """The motor with its diameter and length, given in mm, and its masses, kg, checked."""
    for name, value in (("diameter", diameter), ("length", length)):
        check(value >= 0.0, f"{where}: {name}", value, "zero or positive, in mm")
    check(propellant > 0.0, f"{where}: propellant mass", propellant, "above zero, in kg")
    check(loaded >= 0.0, f"{where}: loaded mass", loaded, "zero or positive, in kg")
    allowed = f"at most the loaded mass, {loaded:.6g} kg"
    check(propellant <= loaded, f"{where}: propellant mass", propellant, allowed)
    allowed = f"at most {HEAVIEST:g} times the propellant, {propellant:.6g} kg"
    check(loaded <= HEAVIEST * propellant, f"{where}: loaded mass", loaded, allowed)
    allowed = (
        f"below {motor.total_impulse / SLOWEST:.6g}, in kg, so that an impulse of "
        f"{motor.total_impulse:.6g} N s has an exhaust above {SLOWEST:g} m/s"
    )
    # Masses in grams in the place of kilograms pass every other check.
    fast = motor.total_impulse > SLOWEST * propellant
    check(fast, f"{where}: propellant mass", propellant, allowed)
    return motor._replace(
        propellant_mass=propellant,
        loaded_mass=loaded,
        diameter=1e-3 * diameter,
        length=1e-3 * length,
    )
