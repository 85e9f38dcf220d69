"""A thrust along the flow of the air: a gravity turn through a wind, without an angle of attack.

    d = (v - v_air)/|v - v_air|           v_air: `LocalAir`, by wind and rotation

Source: Thomson 8.5; the flow by Zipfel, Modeling and Simulation of Aerospace Vehicle Dynamics, 8.3.
"""

__all__ = ["AlongAir"]

from typing import final

import equinox as eqx

from ..bodies import BodyState
from ..core import NumberField, Scalar, Vector, quantity
from ..core.vectors import unit
from ..rockets.steering import AbstractSteering
from .local_air import LocalAir


@final
class AlongAir(AbstractSteering):
    """A thrust along the velocity relative to the air with its wind. At rest relative to the air
    the direction is undefined, and the thrust is zero."""

    air: LocalAir = eqx.field(metadata={"doc": "about the vehicle", "shared": "air"})
    sense: NumberField = quantity(
        "", low=-1.0, high=1.0, default=1.0, doc="1 along the flow, -1 against it"
    )

    def direction(self, t: Scalar, y: BodyState) -> Vector:
        del t
        return self.sense * unit(y.velocity - self.air.velocity(y.position))
