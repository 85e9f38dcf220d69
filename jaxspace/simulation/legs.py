"""The phases of a mission and of all its branches, in one sequence."""

from collections.abc import Callable
from typing import NamedTuple

from ..core import InputError, Scalar, State
from ._mission import Mission, Phase


class Leg(NamedTuple):
    """A phase among all those of a mission and of its branches.

    - `name`: of the phase, after the names of the branches that contain it, joined by dots.
    - `phase`: the phase.
    - `line`: number of its sequence of phases: 0 for that of the mission, then its branches.
    - `after`: number of the leg at whose end it starts; `None` for the first leg.
    - `parted`: whether it starts a branch, from the state before the jump at that end.
    - `start`: the function that gives its initial state, or `None`."""

    name: str
    phase: Phase
    line: int
    after: int | None
    parted: bool
    start: Callable[[Scalar, State], State] | None


def legs_of(mission: Mission) -> tuple[tuple[Leg, ...], tuple[str, ...]]:
    """All phases of a mission, followed by those of its branches; and the names of the branches,
    joined by dots where they are nested."""
    legs: list[Leg] = []
    names: list[str] = []

    def add(mission: Mission, prefix: str, line: int, after: int | None) -> None:
        first = len(legs)
        for number, phase in enumerate(mission.phases):
            begins = number == 0
            before = after if begins else len(legs) - 1
            start = mission.start if begins else None
            legs.append(Leg(prefix + phase.name, phase, line, before, begins and line > 0, start))
        # After all phases of this sequence, so that a leg follows the one at whose end it starts.
        for number, phase in enumerate(mission.phases, first):
            for branch in phase.branches:
                names.append(prefix + branch.name)
                add(branch, f"{prefix}{branch.name}.", len(names), number)

    add(mission, "", 0, None)
    return tuple(legs), tuple(names)


def check_one_line(mission: Mission, what: str) -> None:
    """Raise `InputError` for a mission with branches or with a `start`, because `what` requires a
    single sequence of phases."""
    _, names = legs_of(mission)
    if names:
        raise InputError(
            f"{what} requires a single sequence of phases, and the mission has the branches "
            f"{', '.join(names)}: pass it without branches, Phase(branches=())."
        )
    if mission.start is not None:
        raise InputError(
            f"{what} starts from y0 itself: Mission.start must be None, and it is a function."
        )
