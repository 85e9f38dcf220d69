"""Jumps of the state of a body between two phases of a mission."""

from abc import abstractmethod

from equinox import AbstractClassVar

from ..core import AbstractParameters, Scalar
from .state import BodyState


class AbstractJump(AbstractParameters):
    """A jump of the state at the end of a phase. A concrete jump is final.

    - `needs`: the parts of the state that it reads or changes."""

    needs: AbstractClassVar[frozenset[str]]

    @abstractmethod
    def __call__(self, t: Scalar, y: BodyState) -> BodyState:
        """The state after the jump, from the state `y` at the time `t`, s, before it."""
