"""The states of a file: their class, the parts that they have, and those that a maker of an initial
state needs."""

import inspect

from ...bodies import BodyState
from ...core.quantities import quantities
from .._catalog.catalog import state_class
from .._kinds.kind import Maker
from .parsed import Parsed


def state_of(file: Parsed) -> type:
    """The class of the states of the file."""
    if file.kind != "system":
        return BodyState
    return state_class(file.catalog.systems[file.values["system"]["name"]])


def parts_of_state(file: Parsed, place: int = -1) -> set[str]:
    """The parts of the states of a run of the file, at the place of an output."""
    cls = state_of(file)
    if cls is not BodyState or "initial" in file.makers:
        parts = set(quantities(cls))
        # The state constructor of a system does not describe the parts; those of a body do.
        return parts if cls is not BodyState else {"attitude", "omega"}
    line = file.line_at(place) if file.kind == "mission" else None
    return file.parts(line) | ({"mass"} if file.changes_mass else set())


def needed_parts(maker: Maker) -> list[str]:
    """The parts of the state that a maker of other parts needs: its undeclared arguments."""
    declared = set(maker.arguments.values())
    return [
        name
        for name, p in inspect.signature(maker.make).parameters.items()
        if name not in declared and p.kind is not inspect.Parameter.VAR_KEYWORD
    ]
