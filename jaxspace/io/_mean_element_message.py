"""Orbit mean-elements messages of CCSDS: their entries, with line numbers, and their validated
numbers.

    notation     begins with        satellites
    XML          <                  one for each element <segment>, also of a catalogue <ndm>
    KVN          CCSDS_OMM_VERS     one: keyword = value [unit]
    CSV          the keywords       one for each row, as CelesTrak and Space-Track write them

Source: CCSDS 502.0-B-3, Orbit Data Messages, 4 (OMM); CCSDS 505.0-B-3, XML Specification. Optional
entries default to the value that a two-line set would have.
"""

import csv
import math
import re
from collections.abc import Iterator
from datetime import datetime
from typing import NamedTuple
from xml.parsers import expat

from ..core import InputError
from ..core.files import finite_number
from ._epochs import ALLOWED, instant
from ._two_line import FASTEST

DEGREE = math.pi / 180.0
# Revolutions per day and its derivatives, to radians and minutes.
MOTION = 2.0 * math.pi / 1440.0
EPOCH_ZERO = datetime(1949, 12, 31)
# Greatest number that the library `sgp4` takes, Z9999 of a two-line set; it computes nothing by it.
GREATEST = 339999


class Element(NamedTuple):
    """The range of a number, its unit in SGP4, and its value where a message may leave it out."""

    low: float
    high: float
    what: str
    unit: float = 1.0
    default: float | None = None
    strict: bool = False


# In the order in which SGP4 takes them.
ELEMENTS = {
    "BSTAR": Element(-1e9, 1e9, "from -1e9 to 1e9"),
    "MEAN_MOTION_DOT": Element(-1e9, 1e9, "from -1e9 to 1e9", MOTION / 1440.0, 0.0),
    "MEAN_MOTION_DDOT": Element(-1e9, 1e9, "from -1e9 to 1e9", MOTION / 1440.0**2, 0.0),
    "ECCENTRICITY": Element(0.0, math.nextafter(1.0, 0.0), "at least 0 and below 1"),
    "ARG_OF_PERICENTER": Element(-360.0, 360.0, "from -360 to 360 degrees", DEGREE),
    "INCLINATION": Element(0.0, 180.0, "from 0 to 180 degrees", DEGREE),
    "MEAN_ANOMALY": Element(-360.0, 360.0, "from -360 to 360 degrees", DEGREE),
    "MEAN_MOTION": Element(
        0.0,
        FASTEST,
        f"above 0 and at most {FASTEST:g} revolutions per day",
        MOTION,
        strict=True,
    ),
    "RA_OF_ASC_NODE": Element(-360.0, 360.0, "from -360 to 360 degrees", DEGREE),
}
COUNTS = ("NORAD_CAT_ID", "ELEMENT_SET_NO", "REV_AT_EPOCH", "EPHEMERIS_TYPE")
# Elements of another theory, in other axes or by another clock would give another orbit.
WORDS = {
    "CENTER_NAME": ("EARTH",),
    "REF_FRAME": ("TEME",),
    "TIME_SYSTEM": ("UTC",),
    "MEAN_ELEMENT_THEORY": ("SGP4", "SGP", "SGP/SGP4"),
}
TEXTS = ("OBJECT_NAME", "OBJECT_ID", "CLASSIFICATION_TYPE", "EPOCH")
KEYS = frozenset((*ELEMENTS, *COUNTS, *WORDS, *TEXTS))


class Entry(NamedTuple):
    """The text of an entry and the number of its line."""

    text: str
    line: int


class Satellite(NamedTuple):
    """The entries of a satellite by their keywords, and the `line` where it begins."""

    line: int
    entries: dict[str, Entry]

    def add(self, path: str, key: str, text: str, line: int) -> None:
        """Add an entry; those of other keywords are left out."""
        if key not in KEYS:
            return
        if key in self.entries:
            raise InputError(f"{path}, line {line} repeats {key}: it must occur once.")
        self.entries[key] = Entry(text.strip(), line)


def satellites(path: str, text: str) -> list[Satellite]:
    """The satellites of a message.

    **Arguments**

    - `path`: of the file, for errors; `text`: its content.

    **Raises** `InputError` for anything but a message in one of the notations."""
    start = text.lstrip()
    if start.startswith("<"):
        return _of_xml(path, text)
    if start.startswith("CCSDS_OMM_VERS"):
        return _of_keywords(path, text)
    return list(_of_csv(path, text))


def _of_keywords(path: str, text: str) -> list[Satellite]:
    result = Satellite(1, {})
    for number, line in enumerate(map(str.strip, text.splitlines()), 1):
        if not line or line.startswith("COMMENT"):
            continue
        key, equals, value = line.partition("=")
        if not equals:
            raise InputError(f"{path}, line {number} is {line!r}: it must be a keyword = value.")
        # A unit may follow in brackets.
        result.add(path, key.strip(), re.sub(r"\s*\[[^\]]*\]$", "", value.strip()), number)
    return [result]


def _of_csv(path: str, text: str) -> Iterator[Satellite]:
    reader = csv.reader(text.splitlines())
    try:
        heads = [head.strip() for head in next(reader, [])]
        if not {"EPOCH", "MEAN_MOTION"} <= set(heads):
            raise InputError(
                f"{path} is not a mean-elements message: it must begin with < (XML), with "
                "CCSDS_OMM_VERS or with a heading of keywords such as EPOCH,MEAN_MOTION (CSV)."
            )
        for fields in reader:
            number = reader.line_num
            if not any(field.strip() for field in fields):
                continue
            if len(fields) != len(heads):
                raise InputError(
                    f"{path}, line {number} has {len(fields)} fields: it must have {len(heads)}, "
                    "as many as its heading."
                )
            result = Satellite(number, {})
            for key, field in zip(heads, fields, strict=True):
                result.add(path, key, field, number)
            yield result
    except csv.Error as error:
        raise InputError(
            f"{path}, line {reader.line_num} cannot be read as CSV: {error}."
        ) from None


def _of_xml(path: str, text: str) -> list[Satellite]:
    result: list[Satellite] = []
    # Text of the element that is open, and whether it is within a segment.
    content: list[str] = []
    within: list[bool] = []
    parser = expat.ParserCreate("utf-8")

    def start(name: str, attributes: dict[str, str]) -> None:
        del attributes
        content.clear()
        # A name may have the prefix of its space of names.
        if name.rpartition(":")[2] == "segment":
            within.append(True)
            result.append(Satellite(parser.CurrentLineNumber, {}))

    def end(name: str) -> None:
        key = name.rpartition(":")[2]
        if key == "segment":
            within.pop()
        elif within:
            result[-1].add(path, key, "".join(content), parser.CurrentLineNumber)
        content.clear()

    def entity(name: str, *rest: object) -> None:
        del rest
        raise InputError(
            f"{path}, line {parser.CurrentLineNumber} declares the entity {name!r}, which is not "
            "allowed in a message."
        )

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.CharacterDataHandler = content.append
    parser.EntityDeclHandler = entity
    try:
        # As UTF-8 bytes, independent of the encoding declared in the file.
        parser.Parse(text.encode(), True)
    except expat.ExpatError as error:
        reason = expat.ErrorString(error.code)
        raise InputError(
            f"{path}, line {error.lineno} is not a mean-elements message: it is not valid XML "
            f"({reason})."
        ) from None
    return result


class Elements(NamedTuple):
    """The `numbers` of SGP4 in its order, starting with that of the satellite; and the other
    entries of a record."""

    numbers: tuple[float, ...]
    counts: dict[str, int]
    texts: dict[str, str]


def elements(path: str, number: int, satellite: Satellite) -> Elements:
    """The elements of a satellite, checked.

    **Arguments**

    - `path`: of the file, for errors; `number`: of the satellite in it.

    **Raises** `InputError` for an entry that is missing or out of its range."""
    entries = satellite.entries
    for key, words in WORDS.items():
        if key in entries and entries[key].text.upper() not in words:
            raise _wrong(path, key, entries[key], " or ".join(words))
    numbers = []
    for key, element in ELEMENTS.items():
        if not entries.get(key, Entry("", 0)).text and element.default is not None:
            numbers.append(element.default)
            continue
        entry = _needed(path, number, satellite, key)
        value = finite_number(entry.text)
        if value is None or not element.low <= value <= element.high:
            raise _wrong(path, key, entry, element.what)
        if element.strict and value == element.low:
            raise _wrong(path, key, entry, element.what)
        numbers.append(element.unit * value)
    counts = {key: _count(path, key, entries.get(key, Entry("", 0))) for key in COUNTS}
    epoch = _needed(path, number, satellite, "EPOCH")
    time = instant(epoch.text)
    if time is None:
        raise _wrong(path, "EPOCH", epoch, ALLOWED)
    name = entries.get("OBJECT_NAME", Entry("", 0)).text
    kind = entries.get("CLASSIFICATION_TYPE", Entry("", 0)).text or "U"
    identifier = _needed(path, number, satellite, "OBJECT_ID").text
    texts = {"OBJECT_NAME": name, "OBJECT_ID": identifier, "CLASSIFICATION_TYPE": kind}
    days = time.since(EPOCH_ZERO) / 86400.0
    satellite_number = counts["NORAD_CAT_ID"] if counts["NORAD_CAT_ID"] <= GREATEST else 0
    return Elements((satellite_number, days, *numbers), counts, texts)


def _count(path: str, key: str, entry: Entry) -> int:
    """A whole number; zero where it is left out."""
    if not re.fullmatch(r"[0-9]{0,9}", entry.text):
        raise _wrong(path, key, entry, "a whole number, zero or positive")
    count = int(entry.text or "0")
    if key == "EPHEMERIS_TYPE" and count > 3:
        raise _wrong(path, key, entry, "at most 3, because higher types belong to another theory")
    return count


def _needed(path: str, number: int, satellite: Satellite, key: str) -> Entry:
    entry = satellite.entries.get(key)
    if entry is None or not entry.text:
        line = satellite.line if entry is None else entry.line
        raise InputError(f"{path}, line {line}: satellite {number} has no {key}.")
    return entry


def _wrong(path: str, key: str, entry: Entry, what: str) -> InputError:
    shown = entry.text[:40]
    return InputError(f"{path}, line {entry.line}: {key} is {shown!r}: it must be {what}.")
