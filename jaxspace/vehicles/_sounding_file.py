"""Sounding files: measurements of a balloon at its levels.

    University of Wyoming   the page or the text of a sounding as it comes (TEXT:LIST); or its CSV
                            with `pressure_hPa`, `geopotential height_m`, ...
    SPC, SHARPpy            a file with %RAW%
    IGRA, version 2         the lines of one sounding
    any CSV                 `height (m)`, `pressure (hPa)`, `temperature (C)`, `direction (deg)`,
                            `speed (m/s)`; also Pa, mbar, K, knot, km/h, kft, ft

Columns with other names are ignored; without pressure and temperature, or without direction and
speed, a file contains only a wind or an atmosphere. The direction is that from which the wind
blows, from north over east: 270 degrees is a wind from the west, which moves the air eastwards.

`_sounding_lists` has the forms of the lists. A field is missing where it is empty, `nan`, `NA` or
the like, or -9999: its level is left out of the profile that needs it. Lists of the services have
such levels below the ground and where only a wind was measured. Their levels that do not rise above
all before, where the balloon swung, are left out, too; in any other CSV they are errors. Heights of
the services are geopotential ones, and become geometric here.

The pressures of two levels may be equal where they are so close that rounding to a whole hPa can
make them so. A gap without levels is an error only for the quantities concerned: if the wind ends
below the air, the air can still be used.
"""

import os
import re
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ..bodies.atmosphere import GAS_CONSTANT, GRAVITY, MOLAR_MASS
from ..bodies.standard_atmosphere import geometric_height
from ..core import InputError
from ..core.files import finite_number, read_text
from ..core.separated import Row, separated
from ._sounding_lists import read_list

# A list with a longer gap has lost levels: interpolation between them would be meaningless.
LARGEST_GAP = 6e3
"""m, between two levels: of the mandatory ones none are so far apart."""
FASTEST = 150.0
"""m/s: no wind has been measured that is faster."""
FREEZING = 273.15
ROUNDING = 200.0
"""Pa: services round or truncate each pressure to a whole hPa, or less."""
# Of a missing value: no quantity can have one of these numbers.
MISSING = ("", "nan", "na", "n/a", "null", "none", "-", "--", "---", "/", "//", "///", "////")
MISSING_NUMBERS = (-9999.0, -8888.0, -999.0)

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
    "pressure": ("above 0 and at most 120 kPa", lambda x: (x > 0.0) & (x <= 1.2e5)),
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
    air_fault: str = ""
    wind_fault: str = ""

    def air_levels(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Heights, pressures and temperatures. Raises `InputError` for fewer than two levels or a
        gap."""
        if self.air_fault:
            raise InputError(self.air_fault)
        return self.heights, self.pressure, self.temperature

    def wind_levels(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Heights and winds. Raises `InputError` for fewer than two levels or a gap."""
        if self.wind_fault:
            raise InputError(self.wind_fault)
        return self.wind_heights, self.east, self.north


class Levels(NamedTuple):
    """The rows of a file: `columns` in SI units and degrees, NaN for empty fields; their `lines`;
    and whether they come from a weather service, whose fields may be empty."""

    columns: dict[str, np.ndarray]
    lines: np.ndarray
    service: bool


def read_sounding_file(path: str | os.PathLike[str]) -> SoundingFile:
    """The content of the file; see `read_sounding`."""
    lines = read_text(path).splitlines()
    listed = read_list(str(path), lines)
    levels = _csv(str(path), lines) if listed is None else _levels(str(path), *listed, True)
    for name, x in levels.columns.items():
        what, within = ALLOWED[name]
        # NaN is a missing value.
        bad = ~np.isnan(x) & ~within(np.nan_to_num(x))
        if np.any(bad):
            k = int(np.argmax(bad))
            raise InputError(
                f"{path}, line {levels.lines[k]}: {name} is {x[k]:.6g}: it must be {what}."
            )
    air = _profile(str(path), levels, "pressure", "temperature")
    wind = _profile(str(path), levels, "direction", "speed")
    _check_pressures(str(path), air)
    heights, pressure, temperature = air.levels
    above, direction, speed = wind.levels
    if heights.size == 0 and above.size == 0:
        raise InputError(
            f"{path} has no level of an atmosphere or a wind: it must have heights with pressure "
            f"and temperature, or with direction and speed."
        )
    # The direction is where the wind comes from: the air moves the other way.
    angle = np.radians(direction)
    east, north = -speed * np.sin(angle), -speed * np.cos(angle)
    faults = (
        _fault(str(path), air, "a pressure and a temperature"),
        _fault(str(path), wind, "a direction and a speed"),
    )
    return SoundingFile(heights, pressure, temperature, above, east, north, *faults)


def _csv(path: str, lines: list[str]) -> Levels:
    """The levels of a CSV file with a heading."""

    def is_heading(fields: list[str]) -> bool:
        # A title with the word has no adjacent column.
        return len(fields) > 1 and any(_meaning(field)[0] == "height" for field in fields)

    def is_note(fields: list[str]) -> bool:
        # The page about a list.
        return fields[0].startswith("<")

    sheet = separated(path, lines, is_heading, is_note)
    if sheet is None:
        raise InputError(
            f"{path} has no heading with a height: it must be a list of Wyoming, SPC or IGRA, or a "
            f"CSV with names and units such as height (m), pressure (hPa)."
        )
    heads = sheet.names
    service = any(head.strip().lower() == "geopotential height_m" for head in heads)
    return _levels(path, heads, sheet.rows, service)


def _meaning(head: str) -> tuple[str, str, str]:
    """Meaning of a column, its name, and its unit as written; empty for an unknown column."""
    bracket = re.fullmatch(r"(.*?)\s*[(\[]([^()\[\]]*)[)\]]?", head.strip())
    if bracket:
        name, unit = bracket[1], bracket[2]
    else:
        # `geopotential height_m`, as Wyoming writes it, or a name alone.
        name, _, unit = head.rpartition("_") if "_" in head else (head, "", "")
    name = name.replace("_", " ").strip().lower()
    for key, (starts, _) in QUANTITIES.items():
        if name in starts:
            return key, name, unit.strip().lower()
    return "", name, unit


def _levels(path: str, heads: list[str], rows: list[Row], service: bool) -> Levels:
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
        # Overflowing values are rejected by their range.
        with np.errstate(over="ignore"):
            x = units[unit] * np.array([_number(path, row, k, name) for row in rows])
        if key == "temperature" and unit != "k":
            x = x + FREEZING
        if key == "height" and name in ("geopotential height", "hght"):
            # A geopotential height is smaller, by 140 m at 30 km.
            # A scene file is built within a trace, where a result would be traced, too.
            with jax.ensure_compile_time_eval():
                x = np.asarray(geometric_height(jnp.asarray(x)))
        columns[key] = x
    if "height" not in columns:
        raise InputError(f"{path} has no column of heights.")
    return Levels(columns, np.array([row.line for row in rows]), service)


def _number(path: str, row: Row, k: int, name: str) -> float:
    """The number of a field, NaN where it is missing."""
    # Semicolons part the fields of a file with decimal commas, so that a comma here is a point.
    text = row.fields[k].replace(",", ".")
    if text.lower() in MISSING:
        return np.nan
    value = finite_number(text)
    if value is None:
        raise InputError(
            f"{path}, line {row.line}: {name} is {text[:40]!r}: it must be a finite number."
        )
    return np.nan if value in MISSING_NUMBERS else value


class Profile(NamedTuple):
    """Heights and two quantities, (3, levels), and their `lines`."""

    levels: np.ndarray
    lines: np.ndarray


def _profile(path: str, levels: Levels, first: str, second: str) -> Profile:
    """Heights and two quantities, of the levels that have them; the heights ascend."""
    columns = levels.columns
    if first not in columns or second not in columns:
        return Profile(np.empty((3, 0)), np.empty(0, int))
    x = np.stack([columns["height"], columns[first], columns[second]])
    # A level without one of both has no information on this profile, but may be complete for the
    # other.
    whole = np.all(np.isfinite(x), axis=0)
    x, lines = x[:, whole], levels.lines[whole]
    if levels.service and x.shape[1] > 0:
        # Above all levels before, and not the last one alone: a balloon that has swung down rises
        # again through heights that it has passed.
        rising = np.append(True, x[0, 1:] > np.maximum.accumulate(x[0])[:-1])
        x, lines = x[:, rising], lines[rising]
    profile = Profile(x, lines)
    wrong = _step(path, profile, np.diff(x[0]) <= 0.0, "above that of the previous row")
    if wrong:
        raise InputError(wrong)
    return profile


def _fault(path: str, profile: Profile, quantities: str) -> str:
    """Why a profile cannot be used, too few levels or a gap between them; nothing if it can."""
    count = profile.lines.size
    if count < 2:
        return f"{path} has {count} levels with {quantities}: it must have at least two."
    what = f"at most {LARGEST_GAP:g} m above that of the previous row"
    return _step(path, profile, np.diff(profile.levels[0]) > LARGEST_GAP, what)


def _step(path: str, profile: Profile, wrong: np.ndarray, what: str) -> str:
    """The message for the first wrong step of the height."""
    if not np.any(wrong):
        return ""
    k = int(np.argmax(wrong)) + 1
    height = profile.levels[0]
    return (
        f"{path}, line {profile.lines[k]}: height is {height[k]:.6g} after {height[k - 1]:.6g}: it "
        f"must be {what}."
    )


def _check_pressures(path: str, air: Profile) -> None:
    """Raise `InputError` for a pressure that does not fall as that of air must."""
    height, pressure, temperature = air.levels
    fall = -np.diff(pressure)
    # The decrease of pressure in equilibrium, which rounding may hide.
    scale = GAS_CONSTANT / (GRAVITY * MOLAR_MASS) * temperature[1:]
    hidden = (fall == 0.0) & (pressure[:-1] * -np.expm1(-np.diff(height) / scale) <= ROUNDING)
    wrong = (fall <= 0.0) & ~hidden
    if np.any(wrong):
        k = int(np.argmax(wrong)) + 1
        raise InputError(
            f"{path}, line {air.lines[k]}: pressure is {pressure[k]:.6g} Pa after "
            f"{pressure[k - 1]:.6g}: it must decrease with the height."
        )
