"""Lines of two-line element sets, rejected where they violate the format.

    columns   line 1                                   columns   line 2
    1         1                                        1         2
    3-7       number in the catalogue                  3-7       the same number
    19-32     epoch: year, day of the year             9-16      inclination, degrees
    34-43     n'/2, revolutions per day squared        18-25     ascending node, degrees
    45-52     n''/6, with an exponent                  27-33     eccentricity, after its point
    54-61     drag term B*, with an exponent           35-42     argument of perigee, degrees
    63        type of the ephemeris                    44-51     mean anomaly, degrees
    65-68     number of the set                        53-63     n, revolutions per day
    69        check sum                                64-68     revolution at the epoch
                                                       69        check sum

Source: Vallado et al., Revisiting Spacetrack Report 3, AIAA 2006-6753, appendix B. Programs that
read these columns accept any numbers: a truncated or shifted line results in another orbit. So they
do of an angle or a day that is out of its range, and of elements of type 4, which belong to another
theory (SGP4-XP).
"""

import re
from collections.abc import Iterator
from typing import NamedTuple, TypeAlias

from ..core import InputError

# The least number of columns: some sources leave out the check sum, in column 69.
COLUMNS = 68
# How a line of a set begins, cut or not: with its number and a blank.
BEGINNING = re.compile(r"[12](\s|$)")

DECIMAL = r" *[-+]?[0-9]*\.[0-9]+ *"
# A mantissa after its decimal point, and a power of ten.
POWER = r" *[-+]?\.?[0-9]+[-+ ][0-9]"
COUNT = r" *[0-9]* *"
# A letter represents the numbers 10 to 33, without I and O: "alpha-5".
CATALOGUE = r"[ 0-9A-HJ-NP-Z][ 0-9]{3}[0-9]"

# The fastest satellite about the earth: at its surface 17 revolutions per day.
FASTEST = 18.0

# By line: the name of a field, its first and last column, and its content.
Field: TypeAlias = tuple[str, int, int, str]
FIELDS: dict[str, tuple[Field, ...]] = {
    "1": (
        ("number in the catalogue", 3, 7, CATALOGUE),
        ("year of the epoch", 19, 20, r"[ 0-9][0-9]"),
        ("day of the epoch", 21, 32, DECIMAL),
        ("first derivative of the mean motion", 34, 43, DECIMAL),
        ("second derivative of the mean motion", 45, 52, POWER),
        ("drag term", 54, 61, POWER),
        ("type of the ephemeris", 63, 63, r"[ 0-9]"),
        ("number of the set", 65, 68, COUNT),
    ),
    "2": (
        ("number in the catalogue", 3, 7, CATALOGUE),
        ("inclination", 9, 16, DECIMAL),
        ("ascending node", 18, 25, DECIMAL),
        ("eccentricity", 27, 33, r"[ 0-9]*[0-9]"),
        ("argument of perigee", 35, 42, DECIMAL),
        ("mean anomaly", 44, 51, DECIMAL),
        ("mean motion", 53, 63, DECIMAL),
        ("revolution at the epoch", 64, 68, COUNT),
    ),
}
# Of some fields the range, their unit, and whether the lower end is excluded.
RANGES: dict[str, tuple[float, float, str, bool]] = {
    "type of the ephemeris": (0.0, 3.0, "(others belong to another theory)", False),
    "inclination": (0.0, 180.0, "degrees", False),
    "ascending node": (0.0, 360.0, "degrees", False),
    "argument of perigee": (0.0, 360.0, "degrees", False),
    "mean anomaly": (0.0, 360.0, "degrees", False),
    "mean motion": (0.0, FASTEST, "revolutions per day", True),
}
# Columns without an entry, by line.
BLANKS = {"1": (9, 18, 33, 44, 53, 62, 64), "2": (8, 17, 26, 34, 43, 52)}


class ElementLines(NamedTuple):
    """The two lines of a set, checked, and the `name` of the line before them."""

    name: str
    first: str
    second: str


def element_lines(text: str, source: str) -> Iterator[ElementLines]:
    """The sets of a text.

    **Arguments**

    - `text`: with any number of sets; a line before a set is its name.
    - `source`: name of the text in messages.

    **Raises** `InputError` for a line that is truncated, is not a line of a set, or belongs to
    another one."""
    lines = [(k, line.strip()) for k, line in enumerate(text.splitlines(), 1) if line.strip()]
    name, first = "", ""
    for number, line in lines:
        where = f"{source}, line {number} is {line!r}"
        if first:
            if not line.startswith("2 "):
                raise InputError(f"{where}: it must be the second line of {first!r}.")
            check_line(line, where)
            if catalogue_number(line) != catalogue_number(first):
                raise InputError(f"{where}: it must belong to the satellite of {first!r}.")
            yield ElementLines(name, first, line)
            name, first = "", ""
        elif not BEGINNING.match(line):
            # Some catalogues mark the line of the name by a zero.
            name = line.removeprefix("0 ").strip()
        elif line.startswith("1"):
            check_line(line, where)
            first = line
        else:
            raise InputError(f"{where}: a first line, which begins with 1, must precede it.")
    if first:
        raise InputError(f"{source}, line {lines[-1][0]} is {first!r}: a second line must follow.")


def catalogue_number(line: str) -> str:
    """The number of the satellite of a line, without the zeros that fill it."""
    return line[2:7].strip().lstrip("0")


def check_line(line: str, where: str) -> None:
    """Raise `InputError` unless all columns of a line conform to the format.

    **Arguments**

    - `line`: begins with its number, 1 or 2.
    - `where`: the beginning of the message."""
    if len(line) < COLUMNS:
        raise InputError(f"{where}: it has {len(line)} columns and must have at least {COLUMNS}.")
    # First, because in a line that is shifted the fields are wrong in their turn.
    for column in BLANKS[line[0]]:
        if line[column - 1] != " ":
            raise InputError(f"{where}: column {column} must be blank.")
    for name, begin, end, form in FIELDS[line[0]]:
        entry = line[begin - 1 : end]
        if not re.fullmatch(form, entry):
            raise InputError(f"{where}: its {name}, columns {begin} to {end}, is {entry!r}.")
        if allowed := _out_of_range(name, entry, line):
            raise InputError(
                f"{where}: its {name}, columns {begin} to {end}, is {entry.strip()}: it must be "
                f"{allowed}."
            )
    expected = check_sum(line)
    if line[COLUMNS:].strip() and line[COLUMNS] != expected:
        raise InputError(
            f"{where}: its check sum, column 69, is {line[COLUMNS]!r} and must be {expected}."
        )


def _out_of_range(name: str, entry: str, line: str) -> str:
    """Description of the allowed values of an invalid entry; empty for a valid one."""
    if name == "day of the epoch":
        # Every fourth year of the two digits, from 1957 to 2056, is a leap year.
        days = 366 if int(line[18:20]) % 4 == 0 else 365
        return "" if 1.0 <= float(entry) < days + 1 else f"from 1 to the end of day {days}"
    if name not in RANGES:
        return ""
    low, high, unit, strict = RANGES[name]
    x = float(entry.strip() or 0.0)
    within = x <= high and (x > low if strict else x >= low)
    start = f"above {low:g} and at most" if strict else f"from {low:g} to"
    return "" if within else f"{start} {high:g} {unit}"


def check_sum(line: str) -> str:
    """The last digit of the sum of all digits and minus signs of the first 68 columns."""
    counted = line[:COLUMNS]
    digits = sum(int(c) for c in re.findall("[0-9]", counted))
    return str((digits + counted.count("-")) % 10)
