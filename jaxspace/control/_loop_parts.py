"""The components of a closed loop, for the program that simulates it."""

import equinox as eqx
from jaxtyping import PyTree

from ..core import AbstractSystem
from ..integration.events import Event
from ..solvers import FixedSteps
from ..solvers.tolerances import Tolerance
from ._controller import AbstractController
from ._sensors import AbstractSensor
from .commands import Actuate


class LoopParts(eqx.Module):
    """The parts of a loop for one program, arrays and static ones.

    - `elapsed`: the time between the readings of each sensor, s.
    - `waiting`: number of delayed commands at a sample."""

    system: AbstractSystem
    controller: AbstractController
    sensors: dict[str, AbstractSensor] | None
    limit: PyTree
    quantum: PyTree
    events: tuple[Event, ...]
    tolerance: Tolerance
    method: FixedSteps = eqx.field(static=True)
    actuate: Actuate = eqx.field(static=True)
    period: float = eqx.field(static=True)
    elapsed: tuple[float, ...] = eqx.field(static=True)
    line: bool = eqx.field(static=True)
    waiting: int = eqx.field(static=True)
    run_axes: int = eqx.field(static=True)
