"""Solid motors from files: RASP (`.eng`), the format of thrustcurve.org, and two columns (`.csv`).

    ; comment
    NAME  diameter, mm  length, mm  delays  propellant, kg  loaded mass, kg  maker
    time, s   thrust, N              one line for each point, the last one with no thrust

A CSV file has a time, s, and a thrust, N, in each line; lines that begin with no number are left
out. Both begin at the time zero with no thrust unless they say otherwise.

Source: RASP, as ThrustCurve.org documents it.
"""

import os
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..core import InputError, as_float
from ._thrust import Thrust
from ._thrust_profile import ThrustProfile


class Motor(NamedTuple):
    """What a file says of a motor; `None` for what it does not say.

    - `times`, s, and `thrusts`, N: the points of the curve.
    - `propellant_mass`, `loaded_mass`: kg; `diameter`, `length`: m; `name`."""

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

    def thrust(self, propellant_mass: float | None = None, **fields: Any) -> Thrust:
        """The motor as an effect, with its exhaust velocity from impulse and propellant.

        **Arguments**

        - `propellant_mass`: kg, where the file does not give it.
        - `fields`: other fields of `Thrust`, such as `ignition` or `point`.

        **Raises** `InputError` without a mass of the propellant."""
        mass = self.propellant_mass if propellant_mass is None else propellant_mass
        if mass is None:
            raise InputError(
                f"The file of the motor {self.name} gives no mass of its propellant: "
                "give propellant_mass, in kg."
            )
        profile, burn_time, mean = ThrustProfile.tabulated(self.times, self.thrusts)
        exhaust_velocity = self.total_impulse / mass
        thrust, u, time = (as_float(x) for x in (mean, exhaust_velocity, burn_time))
        return Thrust(thrust, u, time, profile, **fields)


def read_motor(path: str | os.PathLike[str]) -> Motor:
    """The motor of a file: RASP where its name ends in `.eng`, else two columns.

    **Arguments**

    - `path`: of the file. Of several motors in one file, the first.

    **Raises** `InputError` for a file without a thrust curve, or with times that do not ascend.
    """
    path = Path(path)
    lines = [line.split(";")[0].strip() for line in path.read_text(errors="replace").splitlines()]
    lines = [line for line in lines if line]
    head: list[str] = []
    if path.suffix.lower() == ".eng":
        head, lines = (lines[0].split() if lines else []), lines[1:]
    points: list[tuple[float, float]] = []
    for line in lines:
        point = _numbers(line)
        if point is None:
            # In RASP the head of the next motor; else a heading or a comment.
            if points and head:
                break
            continue
        points.append(point)
        if head and point[1] == 0.0 and point[0] > 0.0:
            break
    return _motor(path, head, points)


def _numbers(line: str) -> tuple[float, float] | None:
    """Time and thrust of a line; `None` where it has no two numbers."""
    parts = line.replace(",", " ").replace(";", " ").split()
    try:
        return float(parts[0]), float(parts[1])
    except (ValueError, IndexError):
        return None


def _motor(path: Path, head: list[str], points: list[tuple[float, float]]) -> Motor:
    # The curve of a RASP file begins at the time zero without saying so.
    if points and points[0][0] > 0.0:
        points = [(0.0, 0.0), *points]
    if len(points) < 2:
        raise InputError(f"{path} has {len(points)} points of a thrust curve: it must have two.")
    times, thrusts = np.asarray(points).T
    if not np.all(np.diff(times) > 0.0):
        raise InputError(f"{path} has times that do not ascend.")
    if len(head) < 6:
        return Motor(times, thrusts, name=path.stem)
    try:
        diameter, length, propellant, loaded = (float(head[k]) for k in (1, 2, 4, 5))
    except ValueError:
        raise InputError(f"{path} has the head {' '.join(head)!r}: it is not RASP.") from None
    return Motor(times, thrusts, propellant, loaded, 1e-3 * diameter, 1e-3 * length, head[0])
