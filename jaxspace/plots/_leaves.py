"""The arrays of a state by name, as figures and pages read them."""

import dataclasses
from typing import TYPE_CHECKING

from jaxtyping import PyTree

from ..core.quantities import quantities
from ..rotations import Quaternion

if TYPE_CHECKING:
    from ..core import State


def state_leaves(state: "State", name: str = "", unit: str = "") -> list[tuple[str, str, PyTree]]:
    """Name, declared unit and value of every array or quaternion of a state, in order."""
    if state is None:
        return []
    if dataclasses.is_dataclass(state) and not isinstance(state, Quaternion):
        declared = quantities(type(state))
        children = [
            (field.name, declared[field.name].unit if field.name in declared else "")
            for field in dataclasses.fields(state)
        ]
        members = [(key, unit, getattr(state, key)) for key, unit in children]
    elif isinstance(state, dict):
        members = [(str(key), "", value) for key, value in state.items()]
    elif isinstance(state, tuple | list):
        members = [(str(k), "", value) for k, value in enumerate(state)]
    else:
        return [(name or "state", unit, state)]
    result = []
    for key, unit, value in members:
        # "parts" only collects what effects add: its members have separate names.
        path = " ".join(word for word in (name, key) if word and word != "parts")
        result += state_leaves(value, path, unit)
    return result
