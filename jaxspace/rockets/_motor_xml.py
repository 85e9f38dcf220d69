"""Files of motors of RockSim (`.rse`): XML, of which the first engine is read.

    <engine code="M1670" mfg="..." dia="75." len="757." initWt="5231." propWt="3101." ...>
      <data>
        <eng-data t="0." f="0." m="3101." cg="378."/>        one for each point
      </data>
    </engine>

Diameter and length are in mm, the masses `initWt` and `propWt` in g, `t` in s and `f` in N. Mass
and centre of mass at each point (`m`, `cg`) are left out: propellant leaves in proportion to the
thrust.

Source: RockSim, as ThrustCurve.org documents it.
"""

from pathlib import Path
from typing import NamedTuple
from xml.parsers import expat

from ..core import InputError
from ._motor_curve import Point, numbers

HEAD = ("dia", "len", "propWt", "initWt")
POINT = ("t", "f")


class Engine(NamedTuple):
    """The first engine of a file: the number of its `line`; its `code`; diameter and length, mm;
    propellant and loaded mass, g; its `points`."""

    line: int
    code: str
    diameter: float
    length: float
    propellant: float
    loaded: float
    points: list[Point]


class _Reader:
    """Handlers of the parser, up to the end of the first engine."""

    def __init__(self, path: Path):
        self.path = path
        self.head: tuple[int, str, list[float]] | None = None
        self.points: list[Point] = []
        self.done = False
        # The parser itself and not a tree: it stops at an entity, and a tree would contain every
        # engine.
        self.parser = expat.ParserCreate("utf-8")
        self.parser.StartElementHandler = self.start
        self.parser.EndElementHandler = self.end
        self.parser.EntityDeclHandler = self.entity

    def start(self, name: str, attributes: dict[str, str]) -> None:
        if self.done:
            return
        if name == "engine":
            values = self.values(name, attributes, HEAD)
            self.head = self.parser.CurrentLineNumber, attributes.get("code", ""), values
        elif name == "eng-data" and self.head is not None:
            values = self.values(name, attributes, POINT)
            self.points.append(Point(self.parser.CurrentLineNumber, *values))

    def end(self, name: str) -> None:
        # Text after the first engine is not read, and may be malformed.
        self.done = self.done or name == "engine"

    def entity(self, name: str, *rest: object) -> None:
        # No motor needs one, and nested ones make much of little.
        del rest
        raise InputError(
            f"{self.path}, line {self.parser.CurrentLineNumber} declares the entity {name!r}, "
            "which is not allowed in a RockSim file."
        )

    def values(self, name: str, attributes: dict[str, str], keys: tuple[str, ...]) -> list[float]:
        """The numbers of an element by their keys."""
        result = []
        for key in keys:
            found = numbers([attributes[key]]) if key in attributes else None
            if found is None:
                has = f"is {attributes[key]!r}" if key in attributes else "is missing"
                raise InputError(
                    f"{self.path}, line {self.parser.CurrentLineNumber}: {key} of <{name}> {has}: "
                    "it must be a finite number."
                )
            result += found
        return result


def read_engine(path: Path, text: str) -> Engine:
    """The first engine of a file of RockSim.

    **Arguments**

    - `path`: of the file, for sentences; `text`: its content.

    **Raises** `InputError` for invalid XML, a missing engine, or an engine without its numbers."""
    reader = _Reader(path)
    try:
        # As UTF-8 bytes, independent of the encoding declared in the file.
        reader.parser.Parse(text.encode(), True)
    except expat.ExpatError as error:
        # Broken behind the first engine, of which all is there.
        if not reader.done:
            raise InputError(
                f"{path}, line {error.lineno} is not valid XML ({expat.ErrorString(error.code)}): "
                "it must be a RockSim file."
            ) from None
    if reader.head is None:
        raise InputError(f"{path} has no element <engine>: it must be a RockSim file.")
    line, code, (diameter, length, propellant, loaded) = reader.head
    return Engine(line, code, diameter, length, propellant, loaded, reader.points)
