"""Checks that a verb is given a system or a mission as it requires; the error names the other
verb."""

from ..core import AbstractSystem, InputError
from ._mission import Mission


def check_system(name: str, system: object, other: str) -> None:
    """Raise `InputError` unless it is a system, for a mission with the `other` verb that runs it.

    `name` is that of the argument."""
    if isinstance(system, Mission):
        raise InputError(f"{name} is of type Mission: {other} runs it.")
    if not isinstance(system, AbstractSystem):
        raise InputError(
            f"{name} is of type {type(system).__name__}: it must be a system or a scene."
        )


def check_mission(name: str, mission: object, other: str) -> None:
    """Raise `InputError` unless it is a mission, for a system with the `other` verb that runs it.

    `name` is that of the argument."""
    if isinstance(mission, Mission):
        return
    kind = type(mission).__name__
    if isinstance(mission, AbstractSystem):
        raise InputError(f"{name} is of type {kind}, a system: {other} runs it.")
    raise InputError(f"{name} is of type {kind}: it must be a Mission.")
