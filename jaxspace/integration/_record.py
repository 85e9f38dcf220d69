"""What derivatives need of a run: the steps that it took, and states along them."""

from typing import NamedTuple

from jaxtyping import Array, Float, Int

from ..core import State
from ._loop import LoopState
from ._own_state import OwnLoop


class Record(NamedTuple):
    """What derivatives need of a run: the ends of its `count` steps, and the states after every
    `stride`-th one."""

    step_ends: Float[Array, " steps"]
    checkpoints: State
    stride: Int[Array, ""]
    count: Int[Array, ""]

    @classmethod
    def of(cls, loop: LoopState) -> "Record":
        """The record that a checkpointed loop leaves."""
        assert loop.step_ends is not None and loop.checkpoints is not None
        checkpoints = loop.checkpoints
        return cls(loop.step_ends, checkpoints.states, checkpoints.stride, loop.num_accepted)

    @classmethod
    def of_own(cls, loop: OwnLoop) -> "Record":
        """That of runs with steps of their own: the steps and landings in the place of the ends."""
        assert loop.steps is not None and loop.checkpoints is not None
        checkpoints = loop.checkpoints
        return cls(loop.steps, checkpoints.states, checkpoints.stride, loop.count)
