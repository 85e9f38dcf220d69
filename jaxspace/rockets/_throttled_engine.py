"""A liquid engine that is throttled and turned by commands, within the limits of valve and servos.

    F = s F_m - p A,      m' = -s F_m/u,      s_min <= s <= 1
    F_B = F (-tan b, tan a, 1)/sqrt(1 + tan^2 a + tan^2 b),     M_B = (r_T - r_C) x F_B

    symbol     meaning                                                             unit
    s, F_m     throttle, full thrust in vacuum                                     1, N
    p A        pressure of the air times the exit of the nozzle                    N
    u          exhaust velocity in vacuum                                          m/s
    a, b       angles of the nozzle: from behind the centre of mass positive ones  rad
               turn the body about its +x and +y axes
    r_T, r_C   gimbal, centre of mass, in construction axes                        m

Throttle and angles follow their commands as `servo_rate` has it. One nozzle gives no roll.

Source: Greensite, Analysis and Design of Space Vehicle Flight Control Systems, 1970, 1.2; Sutton,
Rocket Propulsion Elements, 2.2 (pressure thrust).
"""

from typing import ClassVar, final

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..bodies import AbstractBody, AbstractEffect, BodyState, Load
from ..core import NumberField, Scalar, State, quantity
from ..core.shapes import with_rank
from ..core.square_roots import inverse_sqrt
from ..core.vectors import cross
from ._back_pressure import BackPressure
from .servo import servo_rate


@final
class ThrottledEngine(AbstractEffect):
    """An engine in a gimbal, whose throttle and angles follow a command (throttle, a, b).

    It burns from the start of its phase, at no less than `least_throttle`, until the propellant is
    consumed. `Scene.start` adds the part `engine` to a state: throttle and angles, (3, *runs),
    which start at the command that the effect is given."""

    PART: ClassVar[str] = "engine"

    full_thrust: NumberField = quantity("N", positive=True, doc="F_m, in vacuum")
    exhaust_velocity: NumberField = quantity(
        "m/s", positive=True, doc="thrust over mass flow in vacuum"
    )
    burnout_mass: NumberField = quantity(
        "kg", non_negative=True, doc="mass of the body without propellant"
    )
    station: NumberField = quantity("m", doc="z of the gimbal in the body's construction axes")
    least_throttle: NumberField = quantity(
        "", low=0.0, high=1.0, default=0.0, doc="s_min, below which it does not burn"
    )
    throttle_rate: NumberField = quantity(
        "1/s", positive=True, default=1.0, doc="greatest change of the throttle"
    )
    angle_limit: NumberField = quantity(
        "rad", low=0.0, high=1.5, strict=True, default=0.1, doc="greatest angle about each axis"
    )
    angle_rate: NumberField = quantity(
        "rad/s", positive=True, default=0.5, doc="greatest rate of an angle"
    )
    time_constant: NumberField = quantity(
        "s", positive=True, default=0.05, doc="of the servos and of the valve"
    )
    back_pressure: BackPressure | None = eqx.field(
        default=None, metadata={"doc": "thrust lost to the ambient pressure; none by default"}
    )
    command: Float[Array, "3 *#runs"] = quantity(
        "", default=(0.0, 0.0, 0.0), doc="throttle and angles, rad, before the first command"
    )

    def _limits(self) -> tuple[Array, Array, Array]:
        """Stops and greatest rates of throttle and angles, (3, *runs) each."""
        angle, rate = self.angle_limit, self.angle_rate
        return (
            jnp.stack(jnp.broadcast_arrays(self.least_throttle, -angle, -angle)),
            jnp.stack(jnp.broadcast_arrays(jnp.ones_like(angle), angle, angle)),
            jnp.stack(jnp.broadcast_arrays(self.throttle_rate, rate, rate)),
        )

    def start(self, y: BodyState, body: AbstractBody) -> dict[str, State]:
        del body
        low, high, _ = self._limits()
        rank = y.omega.ndim - 1
        # Within the stops, because a servo would leave a place beyond them by a jump.
        first = jnp.clip(*(with_rank(x, rank) for x in (self.command, low, high)))
        return {self.PART: first + 0.0 * y.omega}

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        del t
        rank = y.omega.ndim - 1
        command, low, high, rate = (with_rank(x, rank) for x in (self.command, *self._limits()))
        engine = y.part(self.PART)
        throttle, about_x, about_y = engine
        # A dry engine has no thrust and no flow, whatever its throttle.
        burning = y.mass > self.burnout_mass
        thrust = jnp.where(burning, throttle * self.full_thrust, 0.0)
        net = thrust
        if self.back_pressure is not None:
            net = jnp.where(burning, self.back_pressure.net(thrust, y), 0.0)
        # By the tangents the angles about both axes are those of the projected nozzle.
        side_x, side_y = jnp.tan(about_x), jnp.tan(about_y)
        along = net * inverse_sqrt(1.0 + side_x * side_x + side_y * side_y)
        force = jnp.stack([-along * side_y, along * side_x, along])
        zero = jnp.zeros_like(along)
        gimbal = jnp.stack([zero, zero, self.station + zero])
        return Load(
            force_N=y.attitude.rotate(force),
            torque_B=cross(gimbal - body.centre_of_mass(y.mass), force),
            # The flow follows the thrust in vacuum: the pressure of the air takes thrust, not mass.
            mass_rate=-thrust / self.exhaust_velocity,
            parts_rate={
                self.PART: servo_rate(command, engine, low, high, rate, self.time_constant)
            },
        )
