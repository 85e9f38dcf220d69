"""Files of soundings: what a balloon has measured at its levels.

    University of Wyoming   the page or the text of a sounding as it comes (TEXT:LIST); or its CSV
                            with `pressure_hPa`, `geopotential height_m`, ...
    SPC, SHARPpy            a file with %RAW%
    IGRA, version 2         the lines of one sounding
    any CSV                 `height (m)`, `pressure (hPa)`, `temperature (C)`, `direction (deg)`,
                            `speed (m/s)`; also Pa, mbar, K, knot, km/h, kft, ft

Columns of other names are left out; without pressure and temperature, or without direction and
speed, a file is one of a wind or of an atmosphere alone. The direction is that from which the wind
blows, from north over east: 270 degrees is a wind from the west, which moves the air eastwards.

`_sounding_lists` has the forms of the lists. Levels of these services with an empty field are left
out of what the field is for, as their lists have them below the ground and where only a wind was
measured; so are levels that do not rise above all before, where the balloon swung. In any other CSV
both are errors. Heights of the services are geopotential ones, and become geometric here.
"""

import os
import re
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from ..bodies.standard_atmosphere import geometric_height
from ..core import InputError
from ..core.files import read_text
from ._separated import separated
from ._sounding_lists import read_list

# A list with a longer gap has lost levels: between them no interpolation would tell the air.
LARGEST_GAP = 6e3
"""m, between two levels: of the mandatory ones none are so far apart."""
FASTEST = 150.0
"""m/s: no wind has been measured that is faster."""
FREEZING = 273.15

# The quantity of a column and its units, by the beginning of the name.
PRESSURES = {"hpa": 100.0, "mbar": 100.0, "mb": 100.0, "pa": 1.0}
HEIGHTS = {"m": 1.0, "km": 1e3, "ft": 0.3048, "kft": 304.8}
SPEEDS = {
    "m/s": 1.0,
    "knot": 1852 / 3600,
    "knots": 1852 / 3600,
    "kn": 1852 / 3600,
    "kt": 1852 / 3600,
}
SPEEDS |= {"km/h": 1 / 3.6}
TEMPERATURES = {"c": 1.0, "degc": 1.0, "°c": 1.0, "k": 1.0}
DIRECTIONS = {"deg": 1.0, "degree": 1.0, "°": 1.0}
QUANTITIES = {
    "pressure": (("pressure", "pres"), PRESSURES),
    "height": (("geopotential height", "height", "altitude", "hght"), HEIGHTS),
    "temperature": (("temperature", "temp"), TEMPERATURES),
    "direction": (("wind direction", "direction", "drct"), DIRECTIONS),
    "speed": (("wind speed", "speed", "sknt", "sped"), SPEEDS),
}
ALLOWED = {
    "pressure": ("above 0", lambda x: x > 0.0),
    "height": ("from -500 m to 100 km", lambda x: (x >= -500.0) & (x <= 1e5)),
    "temperature": ("from 100 to 350 K", lambda x: (x >= 100.0) & (x <= 350.0)),
    "direction": ("from 0 to 360 deg", lambda x: (x >= 0.0) & (x <= 360.0)),
    "speed": (f"from 0 to {FASTEST:g} m/s", lambda x: (x >= 0.0) & (x <= FASTEST)),
}


class SoundingFile(NamedTuple):
    """Content of a file of a sounding: the fields of `Sounding`, which this module does not know,
    because the atmosphere and the wind read files, too."""

    heights: np.ndarray
    pressure: np.ndarray
    temperature: np.ndarray
    wind_heights: np.ndarray
    east: np.ndarray
    north: np.ndarray

    def air_levels(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Heights, pressures and temperatures. Raises `InputError` for fewer than two levels."""
        return _two("a pressure and a temperature", self.heights, self.pressure, self.temperature)

    def wind_levels(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Heights and winds. Raises `InputError` for fewer than two levels."""
        return _two("a direction and a speed", self.wind_heights, self.east, self.north)


def _two(what: str, *levels: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    heights, first, second = levels
    if heights.size < 2:
        raise InputError(
            f"The sounding has {heights.size} levels with {what}: it must have two or more."
        )
    return heights, first, second


class Levels(NamedTuple):
    """The rows of a file: `columns` in SI and degrees, NaN for what is empty; the `lines` that they
    stand in; and whether they are of a weather service, whose fields may be empty."""

    columns: dict[str, np.ndarray]
    lines: np.ndarray
    service: bool


def read_sounding_file(path: str | os.PathLike[str]) -> SoundingFile:
    """The content of the file; see `read_sounding`."""
    lines = read_text(path).splitlines()
    listed = read_list(str(path), lines)
    levels = _csv(str(path), lines) if listed is None else _levels(str(path), *listed, service=True)
    for name, x in levels.columns.items():
        what, within = ALLOWED[name]
        # NaN is an empty field, which is left out or refused by itself.
        bad = np.isfinite(x) & ~within(np.nan_to_num(x))
        if np.any(bad):
            k = int(np.argmax(bad))
            raise InputError(
                f"{path}, line {levels.lines[k]}: {name} is {x[k]:.6g}: it must be {what}."
            )
    heights, pressure, temperature = _profile(str(path), levels, "pressure", "temperature")
    above, direction, speed = _profile(str(path), levels, "direction", "speed")
    if heights.size == 0 and above.size == 0:
        raise InputError(
            f"{path} has no level of an atmosphere or a wind: it must have heights with pressure "
            f"and temperature, or with direction and speed."
        )
    # The direction is where the wind comes from: the air moves the other way.
    angle = np.radians(direction)
    return SoundingFile(
        heights, pressure, temperature, above, -speed * np.sin(angle), -speed * np.cos(angle)
    )


def _csv(path: str, lines: list[str]) -> Levels:
    """The levels of a CSV file with a heading."""
    heads: list[str] = []
    # The numbers of the lines, by which errors name a row, although notes and empty lines lie
    # between.
    rows, numbers = [], []
    for number, fields in enumerate(separated(lines, "height", "altitude"), 1):
        if not heads:
            known = [_meaning(field)[0] for field in fields]
            # What stands above the heading (a title, notes) names no height.
            heads = fields if "height" in known else []
        elif any(field.strip() for field in fields) and not fields[0].startswith(("#", "<")):
            rows.append([field.strip() for field in fields])
            numbers.append(number)
    if not heads:
        raise InputError(
            f"{path} has no heading with a height: it must be a list of Wyoming, SPC or IGRA, or a "
            f"CSV with names and units such as height (m), pressure (hPa)."
        )
    service = any(head.strip().lower() == "geopotential height_m" for head in heads)
    return _levels(path, heads, rows, numbers, service)


def _meaning(head: str) -> tuple[str, str, str]:
    """Meaning of a column, its name, and its unit as written; empty for an unknown column."""
    match = re.match(r"\s*([^(_]*?)\s*(?:[(_]\s*([^)]*?)\s*\)?)?\s*$", head)
    name, unit = (part or "" for part in match.groups()) if match else ("", "")
    name = name.lower()
    for key, (starts, _) in QUANTITIES.items():
        if name in starts:
            return key, name, unit.lower()
    return "", name, unit


def _levels(
    path: str, heads: list[str], rows: list[list[str]], numbers: list[int], service: bool
) -> Levels:
    """The columns in SI units."""
    columns: dict[str, np.ndarray] = {}
    for k, head in enumerate(heads):
        key, name, unit = _meaning(head)
        # The first column of a meaning counts: a file may repeat a quantity in other units.
        if not key or key in columns:
            continue
        units = QUANTITIES[key][1]
        if unit not in units:
            raise InputError(
                f"{path}: the unit of {name} is {unit!r}: it must be one of {', '.join(units)}."
            )
        x = np.array([_number(path, row, k, name, n) for row, n in zip(rows, numbers, strict=True)])
        if not service and np.any(np.isnan(x)):
            line = numbers[int(np.argmax(np.isnan(x)))]
            raise InputError(f"{path}, line {line}: {name} is empty: it must be a number.")
        x = x * units[unit]
        if key == "temperature" and unit != "k":
            x = x + FREEZING
        if key == "height" and name in ("geopotential height", "hght"):
            # A geopotential height is smaller, by 140 m at 30 km.
            x = np.asarray(geometric_height(jnp.asarray(x)))
        columns[key] = x
    if "height" not in columns:
        raise InputError(f"{path} has no column of heights: it must have one.")
    return Levels(columns, np.array(numbers), service)


def _number(path: str, row: list[str], k: int, name: str, line: int) -> float:
    # Semicolons part the fields of a file with decimal commas, so that a comma here is a point.
    text = row[k].replace(",", ".") if k < len(row) else ""
    if not text:
        return np.nan
    try:
        value = float(text)
    except ValueError:
        # As the text "inf", which `float` reads: one sentence refuses both.
        value = np.inf
    if not np.isfinite(value):
        raise InputError(
            f"{path}, line {line}: {name} is {text[:40]!r}: it must be a finite number."
        )
    return value


def _profile(
    path: str, levels: Levels, first: str, second: str
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Heights and two quantities, of the levels that have them; checked."""
    columns = levels.columns
    if first not in columns or second not in columns:
        return np.empty(0), np.empty(0), np.empty(0)
    x = np.stack([columns["height"], columns[first], columns[second]])
    # A level without one of both says nothing of this profile, and may say all of the other.
    whole = np.all(np.isfinite(x), axis=0)
    x, lines = x[:, whole], levels.lines[whole]
    if levels.service and x.shape[1] > 0:
        # Above all levels before, and not the last one alone: a balloon that has swung down rises
        # again through heights that it has passed.
        rising = np.append(True, x[0, 1:] > np.maximum.accumulate(x[0])[:-1])
        x, lines = x[:, rising], lines[rising]
    steps = np.diff(x[0])
    for wrong, what in (
        (steps <= 0.0, "above that of the row before"),
        (steps > LARGEST_GAP, f"at most {LARGEST_GAP:g} m above that of the row before"),
    ):
        if np.any(wrong):
            k = int(np.argmax(wrong)) + 1
            raise InputError(
                f"{path}, line {lines[k]}: height is {x[0, k]:.6g} after {x[0, k - 1]:.6g}: it "
                f"must be {what}."
            )
    if first == "pressure" and np.any(np.diff(x[1]) >= 0.0):
        k = int(np.argmax(np.diff(x[1]) >= 0.0)) + 1
        raise InputError(
            f"{path}, line {lines[k]}: pressure is {x[1, k]:.6g} Pa after {x[1, k - 1]:.6g}: it "
            f"must fall with the height."
        )
    return x[0], x[1], x[2]
