"""Files of aerodynamic coefficients: CSV, known by the names of their columns.

    program          what it writes                       what is read
    RASAero II       aerodynamic data by Mach number      Mach, Alpha (deg), CA Power-Off and
                     and angle                            Power-On, CN, CNalpha, CP (inches behind
                                                          the tip); CD and CL where no CA is there
    Missile DATCOM   for042.csv of release 2011, and      MACH, ALPHA, PHI (deg), CA, CN, CM, CY,
                     tables with the names of for006      CLN, CLL, CMQ, CMAD, CLLP
    OpenRocket       data of a simulation, with a         Mach number, and drag coefficient of the
                     heading `# Time (s),...`             ascent, with and without thrust

A user-defined table may have any of these names. Columns in degrees are called so, all others are
as the programs write them: `CP (m)` and `CP (cm)` are not inches. Columns of other names are left
out. Separators are commas, semicolons or tabs; with the latter two, decimal commas are allowed.

Not read: `for006.dat`, which is a listing and not a table; a plain `CD` of RASAero, which refers to
zero angle in every row; normal forces of an OpenRocket flight, which contains one angle for each
Mach number: Barrowman's parts have them.

Derivatives of DATCOM are per radian, or per degree where a column `RAD?` is 0.
"""

import os
import re

import numpy as np

from ..core import InputError
from ..core.files import finite_number, read_text
from ..core.separated import Sheet, separated

DEGREE = np.pi / 180.0
INCH = 0.0254

# The keys of a table, with the meaning that `aerodynamic_table` gives them.
COEFFICIENTS = (
    *("axial", "axial_burning", "base", "drag", "drag_burning", "lift", "normal", "normal_slope"),
    *("centre", "pitch", "side", "yaw", "roll_moment", "pitch_damping", "roll_damping"),
)

# The key and the unit of each column, by its name in small letters.
NAMES = {
    "mach": ("mach", 1.0),
    "mach number": ("mach", 1.0),
    "alpha": ("angle", DEGREE),
    "alpha (deg)": ("angle", DEGREE),
    "phi": ("roll", DEGREE),
    "roll (deg)": ("roll", DEGREE),
    "beta": ("sideslip", 1.0),
    "reynolds number": ("reynolds", 1.0),
    "ca": ("axial", 1.0),
    "ca power-off": ("axial", 1.0),
    "ca power-on": ("axial_burning", 1.0),
    "ca base": ("base", 1.0),
    "cd power-off": ("drag", 1.0),
    "cd power-on": ("drag_burning", 1.0),
    "cl": ("lift", 1.0),
    "cn": ("normal", 1.0),
    "cnalpha (0 to 4 deg) (per rad)": ("normal_slope", 1.0),
    "cnalpha (per rad)": ("normal_slope", 1.0),
    "cp": ("centre", INCH),
    "cp (m)": ("centre", 1.0),
    "cp (cm)": ("centre", 0.01),
    "cp (0 to 4 deg)": ("centre_ahead", INCH),
    "cm": ("pitch", 1.0),
    "cy": ("side", 1.0),
    "cln": ("yaw", 1.0),
    "cll": ("roll_moment", 1.0),
    "cmq": ("pitch_damping", 1.0),
    "cmad": ("lag_damping", 1.0),
    "cllp": ("roll_damping", 1.0),
    "rad?": ("per_radian", 1.0),
}
TIME = "time (s)"
CLIMB = "vertical velocity"
HEIGHT = "altitude"
THRUST = "thrust"
# Mach numbers of a flight that are closer than this become one point. Time steps of a flight give
# thousands of points, which differ by noise only.
INTERVAL = 0.01
# Of a number in a table: the slopes between larger ones would overflow.
LARGEST = 1e100


def read_columns(path: str | os.PathLike[str]) -> dict[str, np.ndarray]:
    """The columns of a file by the keys of `AerodynamicTable.of_columns`, in SI and radians.

    **Raises** `InputError` as `read_aerodynamics` does."""
    sheet = _sheet(str(path), read_text(path))
    if TIME in sheet.names:
        return _of_flight(str(path), sheet)
    return _of_table(str(path), sheet)


def _sheet(path: str, text: str) -> Sheet:
    """The names of the columns and the rows below them."""

    def is_heading(fields: list[str]) -> bool:
        # A title such as "Mach" has no adjacent column.
        return len(fields) > 1 and any(_name(f) in ("mach", "mach number") for f in fields)

    def is_note(fields: list[str]) -> bool:
        # DATCOM gives the sizes of every block in a line of names and numbers.
        return "sizes" in fields[0].lower()

    sheet = separated(path, text.splitlines(), is_heading, is_note)
    if sheet is None:
        raise InputError(f"{path} has no heading with Mach: it must name its columns.")
    if not sheet.rows:
        raise InputError(f"{path} has no rows below its heading.")
    return Sheet([_name(name) for name in sheet.names], sheet.rows)


def _name(field: str) -> str:
    """The name of a column in small letters, without marks, quotes and a unit that is none."""
    # OpenRocket writes a space of no width for the unit of a pure number.
    name = re.sub(r"[\u200b'\"#]", "", field).strip().lower()
    return re.sub(r"\s*\(\W*\)$", "", name)


def _column(path: str, sheet: Sheet, k: int, gaps: bool = False) -> np.ndarray:
    """The numbers of one column; with `gaps`, NaN where the file has NaN."""
    result = np.empty(len(sheet.rows))
    for i, (line, fields) in enumerate(sheet.rows):
        text = fields[k]
        if gaps and text.lower() == "nan":
            result[i] = np.nan
            continue
        value = finite_number(text.replace(",", "."))
        if value is None or abs(value) > LARGEST:
            raise InputError(
                f"{path}, line {line}: {sheet.names[k]} is {text[:40]!r}: it must be a finite "
                "number."
            )
        result[i] = value
    return result


def _of_table(path: str, sheet: Sheet) -> dict[str, np.ndarray]:
    """The columns of a table by Mach number and angle."""
    result: dict[str, np.ndarray] = {}
    for k, name in enumerate(sheet.names):
        key, unit = NAMES.get(name, ("", 1.0))
        if key and key not in result:
            result[key] = unit * _column(path, sheet, k)
    if "ca power-off" in sheet.names:
        result = _with_last_row(result)
    if np.any(result.pop("sideslip", np.zeros(1)) != 0.0):
        raise InputError(f"{path} has angles of sideslip: it must have alpha and phi only.")
    if "centre_ahead" in result:
        # RASAero lists a centre for small angles in addition to that by angle: it belongs to the
        # slope of the normal force at zero.
        ahead = result.pop("centre_ahead")
        at_zero = result.get("angle", np.zeros(1)) == 0.0
        result["centre"] = np.where(at_zero, ahead, result.get("centre", ahead))
    per_radian = result.pop("per_radian", np.ones(1))
    if "lag_damping" in result:
        # Where the path hardly bends, alpha turns as fast as the body: both act as one damping.
        lag = result.pop("lag_damping")
        result["pitch_damping"] = result.get("pitch_damping", 0.0) + lag
    for key in ("pitch_damping", "roll_damping"):
        if key in result:
            # A flag of DATCOM indicates whether its derivatives are per radian or per degree.
            result[key] = result[key] / np.where(per_radian == 0.0, DEGREE, 1.0)
    return result


def _with_last_row(columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The columns of RASAero II with the row that it leaves out: that of the greatest Mach number
    at the greatest angle.

    The coefficients there change from the Mach number before as they do at the angle before. Any
    other row that is missing is left to the check of the grid."""
    machs, mach = np.unique(columns["mach"], return_inverse=True)
    angles, angle = np.unique(columns.get("angle", np.zeros(mach.size)), return_inverse=True)
    shape = machs.size, angles.size
    place = mach * angles.size + angle
    count = np.bincount(place, minlength=machs.size * angles.size)
    if min(shape) < 2 or count[-1] != 0 or np.any(count[:-1] != 1):
        return columns
    row = np.argsort(place)
    # Of the last Mach number at the angle before, and of the Mach number before at both.
    beside, before, both = row[-1], row[-angles.size], row[-angles.size - 1]
    last = {key: x[beside] + x[before] - x[both] for key, x in columns.items()}
    # Without the roundings of a sum, which would make another point of the grid.
    last |= {"mach": machs[-1], "angle": angles[-1]}
    return {key: np.append(x, last[key]) for key, x in columns.items()}


def _of_flight(path: str, sheet: Sheet) -> dict[str, np.ndarray]:
    """Mach number and axial coefficients of the ascent in simulation data of OpenRocket."""

    def column(start: str) -> np.ndarray | None:
        for k, name in enumerate(sheet.names):
            if name.startswith(start):
                return _column(path, sheet, k, gaps=True)
        return None

    mach = column("mach number")
    # Not the axial one, which is this times a polynomial of the angle of attack (1 at 0, 1.3 at 17
    # and 0 at 90 degrees, negative beyond): the table has no other angle than zero.
    coefficient = column("drag coefficient")
    thrust = column(THRUST)
    climb = column(CLIMB)
    height = column(HEIGHT)
    if mach is None or coefficient is None or thrust is None or (climb is None and height is None):
        raise InputError(
            f"{path} is an OpenRocket flight with a missing column: it must have Mach "
            f"number, Drag coefficient, Thrust, and Altitude or Vertical velocity."
        )
    if climb is not None:
        up = climb > 0.0
    else:
        assert height is not None  # one of the two is there
        # The descent hangs on a parachute, whose drag is not that of the rocket.
        up = np.arange(mach.size) < np.argmax(height)
    # OpenRocket has no coefficient before it moves.
    up = up & np.isfinite(mach) & np.isfinite(coefficient)
    # Two tables, because the jet fills the base.
    burning, coasting = up & (thrust > 0.0), up & (thrust <= 0.0)
    if not np.any(coasting):
        raise InputError(f"{path} has no ascent after the burnout, which is required.")
    nodes, off = _thinned(mach[coasting], coefficient[coasting])
    result = {"mach": nodes, "axial": off}
    if np.any(burning):
        points, on = _thinned(mach[burning], coefficient[burning])
        both = np.unique(np.concatenate([nodes, points]))
        # Points of both tables that nearly coincide would make slopes of noise.
        both = both[np.append(True, np.diff(both) > 0.5 * INTERVAL)]
        result = {
            "mach": both,
            "axial": np.interp(both, nodes, off),
            "axial_burning": np.interp(both, points, on),
        }
    return result


def _thinned(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The mean of the points in each interval of the length `INTERVAL`."""
    number = np.unique(np.round(x / INTERVAL), return_inverse=True)[1]
    count = np.bincount(number)
    return np.bincount(number, x) / count, np.bincount(number, y) / count
