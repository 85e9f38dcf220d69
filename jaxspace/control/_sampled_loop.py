"""The interface of a closed loop for its run, defined at a higher level."""

import equinox as eqx
from jaxtyping import Array, Float, Key, PyTree

from ..core import AbstractSystem
from ..simulation.runnable import AbstractRunnable
from ._controller import AbstractController
from ._sensors import AbstractSensor
from .commands import Actuate


class AbstractSampledLoop(AbstractRunnable):
    """A system under a controller that acts at samples; the fields are those of `ClosedLoop`."""

    system: eqx.AbstractVar[AbstractSystem]
    controller: eqx.AbstractVar[AbstractController]
    sensors: eqx.AbstractVar[dict[str, AbstractSensor] | None]
    period: eqx.AbstractVar[float]
    hold: eqx.AbstractVar[str]
    delay: eqx.AbstractVar[float]
    limit: eqx.AbstractVar[Float[Array, "..."] | None]
    quantum: eqx.AbstractVar[Float[Array, "..."] | None]
    actuate: eqx.AbstractVar[Actuate]
    steps: eqx.AbstractVar[int]
    key: eqx.AbstractVar[Key[Array, "*#runs"] | None]

    @property
    def numbers(self) -> PyTree:
        """The parts that contain numbers."""
        return self.system, self.controller, self.sensors, self.limit, self.quantum
