"""Interface of a scene for its capabilities and tables."""

from abc import abstractmethod
from collections.abc import Sequence

from equinox import AbstractVar

from ..bodies import AbstractBody, AbstractEffect, BodyState, Load
from ..core import AbstractSystem, Scalar, Vector
from .reading import Reading


class AbstractScene(AbstractSystem):
    """A body under effects; `Scene` is the one that exists.

    - `effects`, `body`, `carry`: as in `Scene`."""

    effects: AbstractVar[tuple[AbstractEffect, ...]]
    body: AbstractVar[AbstractBody]
    carry: AbstractVar[tuple[str, ...]]

    @property
    @abstractmethod
    def parts(self) -> tuple[str, ...]:
        """The parts of a state of this scene, in the order of `BodyState`."""

    @property
    @abstractmethod
    def readings(self) -> tuple[Reading, ...]:
        """The parts that each effect reads and adds."""

    @abstractmethod
    def loads(self, t: Scalar, y: BodyState) -> Load:
        """The sum of the loads of all effects at the time `t`, s, in the state `y`."""

    @abstractmethod
    def proper_acceleration(self, t: Scalar, y: BodyState) -> Vector:
        """Reading of an accelerometer at the centre of mass, m/s^2, (3, *runs), in inertial axes:
        the acceleration without that of the effects that are `uniform`."""

    @abstractmethod
    def start(self, y: BodyState) -> BodyState:
        """The state `y` with the extra parts that the effects integrate, as they start."""

    @abstractmethod
    def mass(self, y: BodyState) -> Scalar | None:
        """The mass of the body, kg: from the state where it changes, else that of the body; `None`
        if it has none."""

    @abstractmethod
    def with_effects(
        self, effects: Sequence[AbstractEffect], carry: Sequence[str] = ()
    ) -> "AbstractScene":
        """The scene of the same body under other `effects`, with other parts to `carry`."""
