"""One output as named in its file: its function or path, location, unit and requirement.

An output is a declared function of a state (`jaxspace.core.output`), a declared method of an effect
(`drag.dynamic_pressure`), or the path of a number of the state, `final.omega.2`, in which the name
of a phase may replace `final`, and `run` denotes the whole run. The places of a branch have its
name before theirs: `booster.final.position.2`, `booster.fall`."""

import inspect
from collections.abc import Callable
from typing import NamedTuple

from ...statistics.requirements import Requirement
from .._catalog.catalog import OutputFunction

FINAL = "final"
NOMINAL = "nominal"
BEGAN = "began"
INITIAL = "initial"
# Arguments that come from the run; any other is a part of the state, or an entry of the file.
SPECIAL = ("self", "y", "t", "body", "scene", INITIAL, BEGAN, NOMINAL)


class OutputSpec(NamedTuple):
    """One output: its `name`, the phase at whose end it is taken (`at`), its `unit`, and the
    `factor` from SI to this unit. The end of the mission is at -1, those of its branches, in their
    order, at -2, -3 and so on.

    - `function` of a state, or `path` of a number of it; a method has the name of its `effect`.
    - `shared`: entries of the file for arguments of the function.
    - `required`: its requirement, in `unit`.
    - `take`: the extreme along these `phases`, or its time; of none at `at`."""

    name: str
    at: int
    unit: str
    factor: float
    function: OutputFunction | None
    path: tuple[str, ...]
    shared: tuple[tuple[str, str], ...]
    required: Requirement = Requirement()
    effect: str = ""
    take: str = ""
    phases: tuple[int, ...] = ()

    def arguments(self) -> tuple[str, ...]:
        """The names of the arguments of the function."""
        return () if self.function is None else arguments_of(self.function)


def arguments_of(function: Callable[..., object]) -> tuple[str, ...]:
    """The names of the arguments of a declared output."""
    return tuple(inspect.signature(function).parameters)


def needs(specs: tuple[OutputSpec, ...], name: str) -> bool:
    """Whether one of the outputs has an argument of this name."""
    return any(name in spec.arguments() for spec in specs)
