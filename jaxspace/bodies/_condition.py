"""Conditions with parameters, at which a phase of a mission may end."""

from abc import abstractmethod

from equinox import AbstractClassVar

from ..core import AbstractParameters, Scalar
from .state import BodyState


class AbstractCondition(AbstractParameters):
    """A condition whose zero ends a phase, for an `Event` and for scene files. A concrete one is
    final. A condition without parameters is a function, declared by `core.event`.

    - `direction`: 1 for a rise, -1 for a fall, 0 for both.
    - `needs`: the parts of the state that it reads."""

    direction: AbstractClassVar[int]
    needs: AbstractClassVar[frozenset[str]]

    @abstractmethod
    def __call__(self, t: Scalar, y: BodyState) -> Scalar:
        """The value of the condition in the state `y` at the time `t`, s."""
