"""Solid motors from files, as data and as effects; `_motor_file` has the formats."""

import os
from typing import Any

from ..core import Scalar
from ..core.printing import printed
from ._motor_file import MotorFile, read_motor_file
from ._thrust import Thrust


@printed(times="s", thrusts="N", propellant_mass="kg", loaded_mass="kg", diameter="m", length="m")
class Motor(MotorFile):
    """Content of the file of a motor; `None` for values that are not in it.

    - `times`, s, and `thrusts`, N: the points of the curve.
    - `propellant_mass`, `loaded_mass`: kg; `diameter`, `length`: m; `name`.

    From these follow `total_impulse`, N s, and `burn_time`, s."""

    __slots__ = ()

    def thrust(self, propellant_mass: Scalar | None = None, **fields: Any) -> Thrust:
        """The motor as an effect, with its exhaust velocity from impulse and propellant.

        **Arguments**

        - `propellant_mass`: kg, instead of the value in the file.
        - `fields`: other fields of `Thrust`, such as `ignition` or `point`.

        **Raises** `InputError` without a mass of the propellant above zero, or without an impulse.
        """
        return Thrust(*self.parameters(propellant_mass), **fields)


def read_motor(path: str | os.PathLike[str]) -> Motor:
    """The motor of a file: RASP where its name ends in `.eng`, RockSim where it ends in `.rse`,
    else columns of time and thrust.

    Columns are found by their headings and units, as openMotor, OpenRocket and pandas write them;
    without headings the first two are a time, s, and a thrust, N. The curve of columns begins at
    its first point, those of RASP and RockSim at the time zero.

    **Arguments**

    - `path`: of the file. Of several motors in one file, the first.

    **Raises** `InputError` with the offending line or value: for a line that violates the format,
    times that do not ascend, a negative thrust or mass, a curve without impulse, or headings
    without time and thrust; for a RASP or RockSim header without propellant, with more propellant
    than the loaded mass, or with implausible masses; and for anything but a regular file of at most
    64 MB.
    """
    return Motor(*read_motor_file(path))
