"""Interface of an object that integrates itself, for use in a mission phase instead of a system."""

from abc import abstractmethod

import equinox as eqx
from jaxtyping import PyTree

from ..core import AbstractSystem, Scalar, State
from ..core.structure import HashedModule
from ..integration.accuracy import Accuracy
from ..integration.config import IntegrationConfig
from ..integration.events import Event
from .trajectory import Trajectory


class AbstractRunnable(HashedModule):
    """An object that a phase runs in place of a system, such as a closed loop: it integrates
    itself, with sample times that are known before it starts.

    - `system`: the underlying system.
    - `longest`: longest duration of the run, s; `None` where it is not known yet."""

    system: eqx.AbstractVar[AbstractSystem]
    longest: eqx.AbstractVar[float | None]

    @abstractmethod
    def lasting(self, longest: float) -> "AbstractRunnable":
        """The same object with this `longest` time, s."""

    def started_at(self, t0: Scalar) -> "AbstractRunnable":
        """The same object in a phase that starts at `t0`, s (`AbstractSystem.started_at`)."""
        started = self.system.started_at(t0)
        if started is self.system:
            return self
        return eqx.tree_at(lambda x: x.system, self, started)

    @abstractmethod
    def config(self, y0: PyTree, accuracy: Accuracy) -> IntegrationConfig:
        """The configuration of a run from a state with the shapes of `y0`."""

    @abstractmethod
    def run(
        self,
        until: Scalar | Event,
        y0: State,
        t0: Scalar,
        num_saved: int,
        config: IntegrationConfig,
        run_axes: int,
    ) -> Trajectory:
        """The run from the state `y0` at the time `t0`, s, with `num_saved` states.

        `until` is the end, as of a `Phase`."""
