"""Lists of soundings as weather services write them: headings with units, and rows of text.

    University of Wyoming   TEXT:LIST, columns of seven characters below PRES HGHT TEMP ... DRCT
                            SKNT (or SPED, m/s)
    SPC, SHARPpy            between %RAW% and %END%: pressure, hPa, height, m, temperature, C, dew
                            point, C, direction, deg, and speed, knots, with commas; -9999 is empty
    IGRA, version 2         a head that begins with # and the station, then rows of fixed columns:
                            pressure, Pa, height, m, temperature, 0.1 C, direction, deg, and speed,
                            0.1 m/s; -9999 and -8888 are empty

Their heights are geopotential ones. A field may be empty.

Source: sharppy.io.spc_decoder; IGRA v2.2 Format Description, NOAA (2023).
"""

import re

from ..core import InputError
from ..core.separated import Row, Sheet

# Characters of a column in lists of Wyoming, which part empty fields by their place alone.
WIDTH = 7
# The columns have no heading in the file.
SPC = ("PRES (hPa)", "HGHT (m)", "TEMP (C)", "DWPT (C)", "DRCT (deg)", "SKNT (knot)")
IGRA_HEAD = re.compile(r"#[A-Z0-9-]{11} \d{4} ")
IGRA_COLUMNS = (
    ("PRES (Pa)", slice(9, 15), False),
    ("HGHT (m)", slice(16, 21), False),
    ("TEMP (C)", slice(22, 27), True),
    ("DRCT (deg)", slice(40, 45), False),
    ("SPED (m/s)", slice(46, 51), True),
)
"""Heading of a column, its position in a row, and whether it is in tenths."""
IGRA_MISSING = ("-9999", "-8888")


def read_list(path: str, lines: list[str]) -> Sheet | None:
    """The rows of a list; `None` for a file that is none of these.

    **Arguments**

    - `path`: of the file, for sentences; `lines`: its text.

    **Raises** `InputError` for a list of several soundings, or of another form."""
    for number, line in enumerate(lines):
        if line.split()[:2] == ["PRES", "HGHT"]:
            return _wyoming(path, lines, number)
        if line.strip() == "%RAW%":
            return _spc(path, lines, number)
        if IGRA_HEAD.match(line):
            return _igra(path, lines, number)
    return None


def _wyoming(path: str, lines: list[str], head: int) -> Sheet:
    names = [lines[head][k : k + WIDTH].strip() for k in range(0, len(lines[head]), WIDTH)]
    # A page that ends with its heading has no units.
    below = lines[head + 1] if head + 1 < len(lines) else ""
    units = [below[k : k + WIDTH].strip() for k in range(0, len(names) * WIDTH, WIDTH)]
    heads = [f"{name} ({unit})" for name, unit in zip(names, units, strict=True)]
    result = Sheet(heads, [])
    for number, line in enumerate(lines[head + 2 :], head + 3):
        if not line.strip() or set(line.strip()) == {"-"}:
            if result.rows:
                break
            continue
        # The page continues with indices of its station.
        if not re.match(r"[\s\d.+-]+$", line):
            if "<" in line or line.lstrip()[:7] == "Station":
                break
        if "\t" in line:
            raise InputError(
                f"{path}, line {number} contains tabs: its columns must be {WIDTH} characters wide."
            )
        row = [line[k : k + WIDTH].strip() for k in range(0, len(names) * WIDTH, WIDTH)]
        result.rows.append(Row(number, row))
    return result


def _spc(path: str, lines: list[str], start: int) -> Sheet:
    result = Sheet(list(SPC), [])
    for number, line in enumerate(lines[start + 1 :], start + 2):
        if line.strip() == "%END%":
            return result
        if not line.strip():
            continue
        fields = [field.strip() for field in line.rstrip(" ,\r").split(",")]
        if len(fields) != len(SPC):
            raise InputError(
                f"{path}, line {number} has {len(fields)} numbers: it must have {len(SPC)}, "
                "pressure, height, temperature, dew point, direction and speed, with commas."
            )
        result.rows.append(Row(number, fields))
    raise InputError(f"{path} has no line %END%: it must end the levels.")


def _igra(path: str, lines: list[str], head: int) -> Sheet:
    result = Sheet([name for name, _, _ in IGRA_COLUMNS], [])
    for number, line in enumerate(lines[head + 1 :], head + 2):
        if line.startswith("#"):
            # Files of a station contain all soundings of its history.
            count = sum(bool(IGRA_HEAD.match(line)) for line in lines)
            raise InputError(
                f"{path}, line {number} begins another sounding, of {count} in total: the file "
                "must contain only one. Keep the lines of one sounding, from its # to the next one."
            )
        if line.strip():
            # Fields touch each other where they are full: they are found by their places.
            fields = [(line[place].strip(), tenths) for _, place, tenths in IGRA_COLUMNS]
            row = [_tenth(text) if tenths else text for text, tenths in fields]
            result.rows.append(Row(number, row))
    return result


def _tenth(field: str) -> str:
    """An integer number of tenths as a number; other or missing entries are unchanged."""
    if field in IGRA_MISSING or not re.fullmatch(r"-?[0-9]+", field):
        return field
    return f"{field[:-1]}.{field[-1]}"
