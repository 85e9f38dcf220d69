"""Phases in sequence, each with a system, an end, and a jump into the next phase.

The jump is any function (t, y) -> y, preferably an `equinox.Module` whose parameters are then part
of the mission; it may change the structure of the state. Runs of a batch may have phases of
different durations, and events at different times.

Where a phase has `branches`, the mission divides: each branch is a separate mission, which starts
at the end of that phase."""

import dataclasses
from collections.abc import Callable
from typing import Any, final

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from ..core import AbstractSystem, InputError, Scalar, State
from ..core.checks import check_finite, is_concrete
from ..core.field_types import check_types
from ..core.structure import HashedModule
from ..core.types import as_float
from ..integration.events import Event
from .runnable import AbstractRunnable


# A duration becomes an array; an event passes.
def _as_until(x: object) -> Array | Event:
    if isinstance(x, Event):
        return x
    # By types alone, because tree transformations put placeholders here.
    array = isinstance(x, Array | np.ndarray | np.generic)
    if isinstance(x, str | complex) or array and np.issubdtype(x.dtype, np.complexfloating):
        raise InputError(f"Phase.until is {x!r}: it must be a duration in s, or an Event.")
    return as_float(x)


def _as_jump(x: object, name: str = "Phase.then") -> Any:
    if x is not None and not callable(x):
        raise InputError(f"{name} is {x!r}: it must be a function (t, y) -> y, or None.")
    return x


def _as_branches(x: Any) -> tuple["Mission", ...]:
    branches: list[Any] = [x] if isinstance(x, Mission | Phase | AbstractSystem) else list(x)
    for branch in branches:
        if isinstance(branch, Phase | AbstractSystem):
            name = type(branch).__name__
            raise InputError(
                f"Phase.branches contains an object of type {name}: it must contain missions, "
                "Mission(...)."
            )
    return tuple(branches)


def _as_phases(x: Any) -> tuple["Phase", ...]:
    phases: list[Any] = [x] if isinstance(x, Phase | AbstractSystem) else list(x)
    for phase in phases:
        if isinstance(phase, AbstractSystem):
            name = type(phase).__name__
            raise InputError(
                f"Mission.phases contains an object of type {name}: it must contain phases, "
                "Phase(...)."
            )
    return tuple(_with_known_end(phase) for phase in phases)


def _with_known_end(phase: Any) -> Any:
    """The phase; a closed loop in it gets the longest time of the phase, if that is known here."""
    loop = getattr(phase, "system", None)
    if not isinstance(loop, AbstractRunnable) or loop.longest is not None:
        return phase
    duration = phase.until.within if isinstance(phase.until, Event) else phase.until
    # Traced, as in a campaign: its builder has to give the longest time.
    if not is_concrete(duration):
        return phase
    # Runs share the number of samples, so that the longest decides.
    known = loop.lasting(float(np.max(np.asarray(duration))))
    return dataclasses.replace(phase, system=known)


@final
class Phase(HashedModule):
    """One phase: its `system`, its end `until`, and the jump `then`.

    - `system`: any system, or a `ClosedLoop` of one, whose controller starts again with the phase.
    - `until`: a duration, s, zero for an immediate jump, or an `Event` that sets its limit
      `within`.
    - `then`: a function (t, y) -> y applied at the end; `None` leaves the state unchanged.
    - `name`: for tables and plots.
    - `branches`: missions that start at its end, from the state before its jump, in addition to the
      following phase.

    Raises `InputError` for an event without a time limit or that is not terminal, for a closed loop
    with an event that may have `passed`, for a duration that is not finite, for a jump that is not
    a function, and for a branch that is not a mission."""

    system: AbstractSystem | AbstractRunnable
    until: Float[Array, "*#runs"] | Event = eqx.field(converter=_as_until)
    then: Callable[[Scalar, State], State] | None = eqx.field(converter=_as_jump, default=None)
    name: str = eqx.field(static=True, default="phase")
    branches: tuple["Mission", ...] = eqx.field(converter=_as_branches, default=())

    def __check_init__(self):
        check_types(self)
        if isinstance(self.until, Event):
            if self.until.within is None:
                raise InputError(
                    f"Phase {self.name!r} ends at an event without a time limit: Event.within must "
                    "be a time in s."
                )
            if not self.until.terminal:
                raise InputError(
                    f"Phase {self.name!r} ends at an event with terminal=False: it must be a "
                    "terminal event."
                )
            if self.until.passed is not None and isinstance(self.system, AbstractRunnable):
                raise InputError(
                    f"Phase {self.name!r} is a closed loop and ends at an event with passed=True, "
                    "which is available for a system only, Phase(system, ...)."
                )
        else:
            check_finite(f"Phase {self.name!r}: until", self.until)

    @property
    def counts_from_start(self) -> bool:
        """Whether its system has times that count from the start of the phase."""
        return self.system.started_at(0.0) is not self.system

    @property
    def moving(self) -> AbstractSystem:
        """The system of the phase, without its controller."""
        system = self.system
        return system.system if isinstance(system, AbstractRunnable) else system


@final
class Mission(HashedModule):
    """Phases in sequence.

    - `phases`: the phases, in their order.
    - `start`: a function (t, y) -> y before the first phase: for a branch, the state of the part
      from that of the whole; `None` leaves the state unchanged.
    - `name`: name of a branch in the result.

    Raises `InputError` without phases, and for duplicate names of phases or branches."""

    phases: tuple[Phase, ...] = eqx.field(converter=_as_phases)
    start: Callable[[Scalar, State], State] | None = eqx.field(
        converter=lambda x: _as_jump(x, "Mission.start"), default=None
    )
    name: str = eqx.field(static=True, default="mission")

    def __check_init__(self):
        check_types(self)
        # Results are looked up by the names of their phases.
        names = [phase.name for phase in self.phases]
        if not names or len(set(names)) < len(names):
            raise InputError(
                f"Mission.phases are {names}: there must be at least one phase, and the names must "
                "be unique."
            )
        branches = [branch.name for phase in self.phases for branch in phase.branches]
        for number, name in enumerate(branches):
            # The key of a phase of a branch is both names, joined by a dot.
            taken = {other.split(".")[0] for other in names} | set(branches[:number])
            if not name or "." in name or name in taken:
                raise InputError(
                    f"Mission.name of a branch is {name!r}: it must be text without a dot and "
                    "differ from the names of its sibling phases and branches, "
                    f"{', '.join(sorted(taken))}."
                )


def check_system(name: str, system: object, other: str) -> None:
    """Raise `InputError` unless it is a system; for a mission the message names the `other` verb.

    `name` is that of the argument."""
    if isinstance(system, Mission):
        raise InputError(f"{name} is of type Mission: use {other} instead.")
    if not isinstance(system, AbstractSystem):
        raise InputError(
            f"{name} is of type {type(system).__name__}: it must be a system or a scene."
        )


def check_mission(name: str, mission: object, other: str) -> None:
    """Raise `InputError` unless it is a mission; for a system the message names the `other` verb.

    `name` is that of the argument."""
    if isinstance(mission, Mission):
        return
    kind = type(mission).__name__
    if isinstance(mission, AbstractSystem):
        raise InputError(f"{name} is of type {kind}, a system: use {other} instead.")
    raise InputError(f"{name} is of type {kind}: it must be a Mission.")
