"""Run a system or a mission, whichever is given, for one run or many."""

from collections.abc import Sequence
from typing import Any

from jaxtyping import ArrayLike, Float, PyTree, Real

from ..core import AbstractSystem, InputError
from ..integration.accuracy import Accuracy
from ..integration.events import Event
from ._batch import simulate_batch
from ._final_error import FinalError
from ._mission import Mission
from ._mission_batch import simulate_mission_batch
from ._simulate import simulate
from ._simulate_mission import simulate_mission
from .batch_layout import InAxes
from .mission_result import Simulated


def simulate_any(
    system: AbstractSystem | Mission,
    y0: PyTree,
    ts: Real[ArrayLike, "*times"],
    *,
    accuracy: Accuracy | FinalError | Float[ArrayLike, ""] | None = None,
    events: Sequence[Event] = (),
    dense: bool = False,
    num_saved: int | None = None,
    batch: bool = False,
    in_axes: InAxes = None,
    throw: bool | None = None,
) -> Simulated:
    """Run one of the four verbs, and return its result.

    **Arguments**

    - `system`, `y0`: a system or a mission, and its initial state.
    - `ts`: the save times of a system, or the time at which a mission starts, s.
    - `batch`: whether the runs are on the last axis; `in_axes` as in `simulate_batch`.
    - `accuracy`, `events`, `dense`, `num_saved`: as in the verb for a system or for a mission.
    - `throw`: as in the verbs; by default of one run, not of a batch.

    **Raises** `InputError` as the verb does, and for an argument of the other verb."""
    # A failed run of a batch is marked in its own status, and must not cost the others.
    throw = not batch if throw is None else throw
    given: dict[str, Any] = {"accuracy": accuracy, "throw": throw}
    if batch:
        # The verbs for one run have no such argument.
        given["in_axes"] = in_axes
    if isinstance(system, Mission):
        if events or dense:
            raise InputError(
                f"{'events' if events else 'dense'} is not available for a mission: its phases "
                "define their own events and store no steps."
            )
        run = simulate_mission_batch if batch else simulate_mission
        return run(system, y0, ts, num_saved=2 if num_saved is None else num_saved, **given)
    if num_saved is not None:
        raise InputError(
            f"num_saved is {num_saved}: for a system the states are saved at ts; leave it out."
        )
    run = simulate_batch if batch else simulate
    return run(system, y0, ts, events=events, dense=dense, **given)
