"""The event of the end of the propellant: m - m_b = 0, whatever the burn time was."""

from collections.abc import Callable
from typing import ClassVar, final

from ..bodies import AbstractCondition, BodyState
from ..core import Scalar, reference


@final
class PropellantDepletion(AbstractCondition):
    """The propellant of an engine is used up: its mass above the burnout mass, kg, falls to zero.

    Created as `PropellantDepletion(engine.propellant_left)` for an engine with a burnout mass.
    In a scene file the engine is found: the first effect of the phase that has propellant."""

    direction: ClassVar[int] = -1
    needs: ClassVar[frozenset[str]] = frozenset({"mass"})

    propellant_left: Callable[[BodyState], Scalar] = reference(
        "propellant_left", doc="of the engine: its propellant, kg, in a state"
    )

    def __call__(self, t: Scalar, y: BodyState) -> Scalar:
        """The mass of the propellant that is left, kg, in the state `y`."""
        del t
        return self.propellant_left(y)
