"""Air brakes: plates that a servo opens into the flow, by a share from 0 (shut) to 1 (open).

    F = -rho/2 |w| C_D(M) A s w          w = v - v_air,   M = |w|/c

    symbol   meaning                                            unit
    w, M     velocity relative to the air, Mach number          m/s, 1
    rho, c   density, speed of sound                            kg/m^3, m/s
    C_D, A   drag coefficient, area of the open brake           1, m^2
    s        share that is open, as `servo_rate` moves it       1

Source: Hoerner, Fluid-Dynamic Drag, 3 (plates across the flow). The drag acts along the flow at the
centre of mass, as that of plates spread evenly about a rocket at a small angle of attack.
"""

from typing import ClassVar, final

import equinox as eqx
import jax.numpy as jnp

from ..bodies import AbstractBody, AbstractEffect, BodyState, Load
from ..core import NumberField, Scalar, State, quantity
from ..core.vectors import norm
from ..rockets.servo import servo_rate
from .air_drag import drag_force
from .coefficient import MachTable, as_coefficient
from .local_air import LocalAir, air_about


@final
class AirBrake(AbstractEffect):
    """A brake whose open share follows its command, between 0 and 1.

    `Scene.start` adds the part `air_brake` to a state: the share, (*runs,), which starts at the
    command that the effect is given."""

    PART: ClassVar[str] = "air_brake"

    area: NumberField = quantity("m^2", positive=True, doc="A, of the open brake")
    # The checker takes the quantity above for a default.
    coefficient: MachTable = eqx.field(  # pyright: ignore[reportGeneralTypeIssues]
        converter=as_coefficient, metadata={"doc": "C_D by the Mach number"}
    )
    rate_limit: NumberField = quantity(
        "1/s", positive=True, default=2.0, doc="greatest change of the share"
    )
    time_constant: NumberField = quantity("s", positive=True, default=0.05, doc="of the servo")
    air: LocalAir | None = eqx.field(
        default=None,
        metadata={"doc": "about the vehicle; calm standard air by default", "shared": "air"},
    )
    command: NumberField = quantity("", default=0.0, doc="share before the first command")

    def start(self, y: BodyState, body: AbstractBody) -> dict[str, State]:
        del body
        # The zero carries the runs and the precision of the state.
        return {self.PART: jnp.clip(self.command, 0.0, 1.0) + 0.0 * y.velocity[0]}

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        del t, body
        air, moving = air_about(self.air).at(y.position)
        w = y.velocity - moving
        share = y.part(self.PART)
        drag_area = self.area * self.coefficient(norm(w) / air.sound_speed)
        rate = servo_rate(self.command, share, 0.0, 1.0, self.rate_limit, self.time_constant)
        return Load(
            force_N=drag_force(w, air.density, share * drag_area), parts_rate={self.PART: rate}
        )

    def ground(self) -> Scalar | None:
        return None if self.air is None else self.air.radius
