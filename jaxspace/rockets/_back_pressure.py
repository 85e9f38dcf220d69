"""Loss of thrust by the pressure of the air on the exit of the nozzle.

    F_net = F - p A,   A = F_m (1 - I_0/I)/p_0

    symbol  meaning                                               unit
    F, F_m  thrust in vacuum, mean over the burn                  N
    p, A    pressure of the air, area of the nozzle's exit        Pa, m^2
    I, I_0  specific impulse in vacuum, at sea level              s
    p_0     standard pressure at sea level, 101325                Pa

Source: Sutton, Rocket Propulsion Elements, 2.2 (pressure thrust).
"""

from typing import final

import equinox as eqx
import jax.numpy as jnp

from ..bodies import AbstractAtmosphere, BodyState
from ..core import (
    AbstractParameters,
    NumberField,
    OptionalNumberField,
    Scalar,
    argument,
    constructor,
    quantity,
)
from ..core.types import as_float
from ..core.vectors import norm


@final
class BackPressure(AbstractParameters):
    """Loss of thrust by the pressure of the air on the exit of the nozzle: the pressure of an
    atmosphere, or one that falls exponentially with the height."""

    exit_area: NumberField = quantity("m^2", non_negative=True, doc="of all nozzles")
    radius: OptionalNumberField = quantity(
        "m",
        non_negative=True,
        optional=True,
        doc="of the planet, from which heights count; without it z is up from flat ground",
    )
    surface_pressure: NumberField = quantity(
        "Pa", non_negative=True, default=101325.0, doc="of the air at the height zero"
    )
    scale_height: NumberField = quantity(
        "m", positive=True, default=7000.0, doc="climb over which it falls by the factor e"
    )
    atmosphere: AbstractAtmosphere | None = eqx.field(
        default=None, metadata={"doc": "whose pressure is used instead of the exponential one"}
    )

    @classmethod
    @constructor(
        sets=("exit_area", "surface_pressure", "scale_height"),
        mean_thrust=argument("N", positive=True, doc="in vacuum"),
        vacuum_impulse=argument("s", positive=True, doc="specific impulse in vacuum"),
        sea_level_impulse=argument("s", positive=True, doc="specific impulse at sea level"),
    )
    def of_impulses(
        cls,
        mean_thrust: Scalar,
        vacuum_impulse: Scalar,
        sea_level_impulse: Scalar,
        radius: Scalar | None = None,
        atmosphere: AbstractAtmosphere | None = None,
    ) -> "BackPressure":
        """The exit of an engine from its specific impulses: A = F (1 - I_0/I)/p_0.

        **Arguments**

        - `mean_thrust`: in vacuum, N; `vacuum_impulse`, `sea_level_impulse`: s.
        - `radius`, m, and `atmosphere`: as the fields.
        """
        # The flow is the same in both, so that the thrusts are as the impulses.
        area = as_float(mean_thrust) * (1.0 - sea_level_impulse / as_float(vacuum_impulse))
        return cls(area / 101325.0, radius, atmosphere=atmosphere)

    def loss(self, y: BodyState) -> Scalar:
        """The thrust lost, N, in the state `y`."""
        if self.radius is None:
            height = y.position[2]
        else:
            height = norm(y.position) - self.radius
        # The exponential pressure is the default, because it needs no tables.
        if self.atmosphere is not None:
            return self.exit_area * self.atmosphere.air_at(height).pressure
        return self.exit_area * self.surface_pressure * jnp.exp(-height / self.scale_height)

    def net(self, thrust: Scalar, y: BodyState) -> Scalar:
        """The net thrust, N, for a `thrust` in vacuum, N, in the state `y`; zero for a motor that
        is off, which has no pressure thrust."""
        # A motor that is off has no jet against which the air could press.
        return jnp.where(thrust > 0.0, thrust - self.loss(y), 0.0)
