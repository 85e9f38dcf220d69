"""The sequences of phases of a mission, as its file gives them.

[[phase]]                    those of the mission itself
[branch.booster]             a part that leaves it: `after` which phase, with a `body` of its own
[[branch.booster.phase]]     those of this part

They have the order and the names of `simulation.legs.legs_of`, so that a number of a phase here is
that in the result.
"""

from collections.abc import Iterator
from typing import NamedTuple

from .._kinds.kind import Values


class Leg(NamedTuple):
    """A phase among all those of a file.

    - `number`, `name`: in the result of the mission: of a phase of a branch "booster.fall".
    - `path`: of its table.
    - `phase`: its values.
    - `body`: path of the table of its mass properties."""

    number: int
    name: str
    path: str
    phase: Values
    body: str


class Line(NamedTuple):
    """The phases of the mission itself, or of a branch.

    - `name`: of the branch in the result, prefixed by its parents; empty for the mission itself.
    - `key`: its name in the file.
    - `legs`: its phases.
    - `after`: number of the leg at whose end it starts; -1 for the mission itself."""

    name: str
    key: str
    legs: tuple[Leg, ...]
    after: int

    @property
    def path(self) -> str:
        """The path of its table; empty for the mission itself."""
        return f"branch.{self.key}" if self.key else ""

    def place(self, word: str) -> str:
        """The name in an output of a `word` of this line, such as the name of a phase."""
        return f"{self.name}.{word}" if self.name else word


def phase_tables(values: Values) -> dict[str, Values]:
    """The tables of all phases of a mission by their paths, those of the mission itself first."""
    branches: Values = values.get("branch") or {}
    lists = {"phase": values.get("phase") or []}
    # Flat, whatever a branch leaves: the tables of the file are, too.
    lists |= {f"branch.{key}.phase": branch["phase"] for key, branch in branches.items()}
    return {
        f"{path}.{k}": phase for path, phases in lists.items() for k, phase in enumerate(phases)
    }


def lines_of(values: Values) -> tuple[Line, ...]:
    """All sequences of phases of a mission. A branch after no phase is left out."""
    lines: list[Line] = []

    def add(key: str, prefix: str, after: int) -> None:
        first = sum(len(line.legs) for line in lines)
        legs = tuple(_legs(values, key, prefix, first))
        lines.append(Line(prefix.removesuffix("."), key, legs, after))
        for leg in legs:
            for other, branch in (values.get("branch") or {}).items():
                if branch["after"] == leg.name:
                    add(other, f"{prefix}{other}.", leg.number)

    # From the mission itself on; a branch follows the line that it leaves, as in the result.
    add("", "", -1)
    return tuple(lines)


def _legs(values: Values, key: str, prefix: str, first: int) -> Iterator[Leg]:
    """The legs of a branch, or of the mission itself (an empty `key`)."""
    owner = f"branch.{key}." if key else ""
    phases = values["branch"][key]["phase"] if key else values["phase"]
    body = f"{owner}body"
    for k, phase in enumerate(phases):
        path = f"{owner}phase.{k}"
        # A phase with mass properties gives them to those that follow it, too.
        if phase["body"] is not None:
            body = f"{path}.body"
        yield Leg(first + k, prefix + phase["name"], path, phase, body)
