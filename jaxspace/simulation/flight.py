"""Interface of an object that a mission phase runs in place of a system: it integrates itself."""

from abc import abstractmethod

import equinox as eqx
from jaxtyping import PyTree

from ..core import AbstractSystem, Scalar, State
from ..integration.accuracy import Accuracy
from ..integration.config import IntegrationConfig
from ..integration.events import Event
from .run_result import RunResult


class AbstractFlight(eqx.Module):
    """A flight, such as that of a closed loop, whose samples are known before it starts.

    - `system`: what moves.
    - `longest`: how long the flight may take, s; `None` where it is not known yet."""

    system: eqx.AbstractVar[AbstractSystem]
    longest: eqx.AbstractVar[float | None]

    @abstractmethod
    def lasting(self, longest: float) -> "AbstractFlight":
        """The flight with that time as the longest one."""

    @abstractmethod
    def config(self, y0: PyTree, accuracy: Accuracy) -> IntegrationConfig:
        """How the flight from a state of the shapes of `y0` is integrated."""

    @abstractmethod
    def fly(
        self,
        until: Scalar | Event,
        y0: State,
        t0: Scalar,
        num_saved: int,
        config: IntegrationConfig,
        run_axes: int,
    ) -> RunResult:
        """The flight from the state `y0` at the time `t0`, s, with `num_saved` states.

        `until` is the end, as of a `Phase`."""


def moving(system: AbstractSystem | AbstractFlight) -> AbstractSystem:
    """The system that moves in a phase."""
    return system.system if isinstance(system, AbstractFlight) else system
