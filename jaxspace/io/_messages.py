"""What the messages of CCSDS share: entries with their lines, in both notations, and numbers whose
unit has a power of ten, without loss of a digit.

    notation     an entry
    KVN          keyword = value [unit]
    XML          <keyword units="unit">value</keyword>

Source: CCSDS 502.0-B-3, Orbit Data Messages, 7 (KVN); CCSDS 505.0-B-3, XML Specification.
"""

import re
from collections.abc import Sequence
from decimal import Decimal
from typing import NamedTuple
from xml.parsers import expat

import numpy as np

from ..core import InputError
from ..core.files import finite_number

STATE = ("X", "Y", "Z", "X_DOT", "Y_DOT", "Z_DOT")
# The lower triangle of a covariance by rows: CX_X, CY_X, CY_Y and so on.
TRIANGLE = tuple(f"C{a}_{b}" for i, a in enumerate(STATE) for b in STATE[: i + 1])
UNIT = re.compile(r"\s*\[[^\]]*\]$")
FEATURES = "it must have neither a document type nor entities"


class Entry(NamedTuple):
    """A keyword, its text and the number of its line; a keyword of an XML block has no text, and
    begins with "<" at its start and with "/" at its end."""

    key: str
    text: str
    line: int


def entries_of_keywords(path: object, text: str) -> list[Entry]:
    """The entries of a message in KVN, without comments."""
    result = []
    for number, line in enumerate(map(str.strip, text.splitlines()), 1):
        if not line or line.startswith("COMMENT"):
            continue
        key, equals, value = line.partition("=")
        if not equals:
            raise InputError(f"{path}, line {number} is {line!r}: it must be a keyword = value.")
        result.append(Entry(key.strip(), UNIT.sub("", value.strip()), number))
    return result


def entries_of_xml(path: object, text: str) -> list[Entry]:
    """The entries of a message in XML, and the starts and ends of its blocks."""
    result: list[Entry] = []
    content: list[str] = []
    parser = expat.ParserCreate()

    def start(name: str, attributes: dict[str, str]) -> None:
        del attributes
        content.clear()
        result.append(Entry(f"<{name.rpartition(':')[2]}", "", parser.CurrentLineNumber))

    def end(name: str) -> None:
        key, value = name.rpartition(":")[2], "".join(content).strip()
        last = result[-1]
        # An element without others in it is an entry.
        if last.key == f"<{key}":
            result[-1] = Entry(key, value, last.line)
        else:
            result.append(Entry(f"/{key}", "", parser.CurrentLineNumber))
        content.clear()

    def refuse(*_: object) -> None:
        # Entities may grow without bound, and may name other files.
        raise InputError(f"{path}, line {parser.CurrentLineNumber}: {FEATURES}.")

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = content.append
    parser.StartDoctypeDeclHandler = refuse
    try:
        # As text, whose encoding the declaration may no longer name.
        parser.Parse(re.sub(r"^\s*<\?xml.*?\?>", "", text, flags=re.DOTALL), True)
    except expat.ExpatError as error:
        where = f"{path}, line {error.lineno}"
        raise InputError(f"{where} is not XML: {expat.errors.messages[error.code]}.") from None
    return [entry for entry in result if entry.key != "COMMENT"]


def shifted(name: str, text: str, power: int) -> float:
    """The number of a text times a power of ten, rounded once.

    **Raises** `InputError` by the `name` of the field for one that is not finite."""
    # First in its own unit, because of the words that `Decimal` reads as numbers.
    if finite_number(text) is not None:
        value = float(Decimal(text.strip()).scaleb(power))
        if abs(value) < float("inf"):
            return value
    raise InputError(f"{name} is {text[:40]!r}: it must be a finite number.")


def text_of(value: float, power: int) -> str:
    """The shortest text of a number over a power of ten, which `shifted` reads as the same
    number."""
    return str(Decimal(repr(float(value))).scaleb(-power)).replace("E", "e")


def covariance_of(rows: Sequence[float]) -> np.ndarray:
    """The matrix, (6, 6), of a lower triangle by rows."""
    matrix = np.zeros((6, 6))
    matrix[np.tril_indices(6)] = rows
    return matrix + np.tril(matrix, -1).T


def triangle_of(matrix: np.ndarray) -> list[list[str]]:
    """The texts, km and s, of the rows of the lower triangle of a covariance, m and s."""
    return [[text_of(x, 6) for x in row[: i + 1]] for i, row in enumerate(np.asarray(matrix))]
