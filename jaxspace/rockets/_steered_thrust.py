"""Thrust along a steering law: the flight of a rocket as a point, without any rotation.

    a = F d/m,   F = s F_m f(x) - p A,   m' = -s F_m f(x)/u,   s = s_0 s_1(t - t_0)

    symbol  meaning                                                           unit
    F_m, f  mean thrust in vacuum, profile over the burn                      N, 1
    s, u    throttle, exhaust velocity in vacuum                              1, m/s
    s_0     constant part of the throttle                                     1
    s_1     its table over the time since the ignition t_0                    1
    p, A    pressure of the air, area of the nozzle's exit                    Pa, m^2
    d       direction of the thrust by its law                                1

Source: Thomson 8.1, 8.3, 8.5; Sutton, Rocket Propulsion Elements, 2.2 (pressure thrust).
"""

import os
from typing import Any, ClassVar, final

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..bodies import AbstractBody, AbstractEffect, AbstractJump, BodyState, Load
from ..core import (
    NumberField,
    OptionalNumberField,
    Scalar,
    argument,
    constructor,
    known_time,
    quantity,
)
from ..core.shapes import with_rank
from ..core.types import as_float
from ._back_pressure import BackPressure
from ._ignition import check_ignition, delay_field, ignited, ignition_of
from ._motor_file import read_motor_file
from ._throttle_table import ThrottleTable
from ._thrust import FILE_PROPELLANT, MOTOR_FILE, Thrust
from ._thrust_profile import ThrustProfile
from .steering import AbstractSteering, joined_breaks


@final
class SteeredThrust(AbstractEffect):
    """A motor whose thrust points along a steering law; the body is a point. A burnout mass is that
    of `Thrust`."""

    steering: AbstractSteering = eqx.field(metadata={"doc": "direction of the thrust"})
    mean_thrust: NumberField = quantity(
        "N", non_negative=True, doc="in vacuum, mean over the burn time"
    )
    exhaust_velocity: NumberField = quantity(
        "m/s", positive=True, doc="thrust over mass flow in vacuum"
    )
    burn_time: NumberField = quantity("s", positive=True, doc="from ignition to burnout")
    ignition: NumberField = quantity("s", default=0.0, doc="time at which it ignites")
    throttle: NumberField = quantity(
        "", low=0.0, high=1.0, default=1.0, doc="fraction of the full thrust"
    )
    profile: ThrustProfile | None = eqx.field(
        default=None, metadata={"doc": "shape of the thrust; constant by default"}
    )
    back_pressure: BackPressure | None = eqx.field(
        default=None, metadata={"doc": "thrust lost to the ambient pressure; none by default"}
    )
    burnout_mass: OptionalNumberField = quantity(
        "kg",
        non_negative=True,
        optional=True,
        doc="mass at which the thrust ends; by default it ends with the burn time",
    )
    delay: OptionalNumberField = delay_field()
    schedule: ThrottleTable | None = eqx.field(
        default=None, metadata={"doc": "factor on the throttle over the burn; 1 by default"}
    )

    @classmethod
    @constructor(
        sets=("mean_thrust", "exhaust_velocity", "burn_time"),
        mean_thrust=argument("N", positive=True, doc="in vacuum"),
        specific_impulse=argument(
            "s", positive=True, doc="in vacuum: exhaust velocity over 9.80665 m/s^2"
        ),
        propellant_mass=argument("kg", positive=True, doc="burnt from ignition to burnout"),
        throttle=argument("", low=0.0, high=1.0, default=1.0, doc="fraction of the full thrust"),
    )
    def of_propellant(
        cls,
        steering: AbstractSteering,
        mean_thrust: Scalar,
        specific_impulse: Scalar,
        propellant_mass: Scalar,
        throttle: Scalar = 1.0,
        **fields: Any,
    ) -> "SteeredThrust":
        """An engine that burns a mass of propellant: its burn time follows.

        **Arguments**

        - `steering`: the law.
        - `mean_thrust`, N; `specific_impulse`, s; `propellant_mass`, kg; `throttle`.
        - `fields`: the other fields by name.
        """
        # Standard gravity by definition of the specific impulse, whatever the gravity of the place.
        u = 9.80665 * as_float(specific_impulse)
        burn_time = propellant_mass * u / (mean_thrust * throttle)
        return cls(steering, mean_thrust, u, burn_time, throttle=throttle, **fields)

    @classmethod
    @constructor(
        sets=("mean_thrust", "exhaust_velocity", "burn_time", "profile"),
        motor_file=MOTOR_FILE,
        propellant_mass=FILE_PROPELLANT,
    )
    def of_file(
        cls,
        steering: AbstractSteering,
        motor_file: str | os.PathLike[str],
        propellant_mass: Scalar | None = None,
        **fields: Any,
    ) -> "SteeredThrust":
        """A solid motor from its thrust curve in a file, which is taken for that in vacuum.

        **Arguments**

        - `steering`: the law.
        - `motor_file`, `propellant_mass`: as in `Thrust.of_file`.
        - `fields`: the other fields by name.

        **Raises** `InputError` for a file that `read_motor` rejects, or without a propellant mass.
        """
        # Makers measure on the ground; the exit area, by which vacuum differs, is rarely given.
        thrust, u, time, profile = read_motor_file(motor_file).parameters(propellant_mass)
        return cls(steering, thrust, u, time, profile=profile, **fields)

    @classmethod
    def of_thrust(cls, motor: Thrust, steering: AbstractSteering) -> "SteeredThrust":
        """The motor of a 6-DOF flight for use in a 3-DOF flight: the same thrust and mass flow
        along a steering law; point and misalignment are ignored.

        **Arguments**

        - `motor`: of the body that rotates.
        - `steering`: where its axis is to point.
        """
        # A motor without a throttle burns at its full thrust, which is a throttle of one.
        return cls(
            steering,
            motor.mean_thrust,
            motor.exhaust_velocity,
            motor.burn_time,
            motor.ignition,
            as_float(1.0 if motor.throttle is None else motor.throttle),
            motor.profile,
            motor.back_pressure,
            motor.burnout_mass,
            motor.delay,
        )

    def started_at(self, t0: Scalar) -> "SteeredThrust":
        return ignited(self, t0)

    def __check_init__(self):
        check_ignition(self)

    @known_time
    def burnout(self) -> Scalar:
        """The time, s, at which the burn time is over."""
        return ignition_of(self) + self.burn_time

    def thrust(self, t: Scalar, mass: Scalar) -> Scalar:
        """The thrust in vacuum, N, at the time `t`, s, with `mass`, kg, left."""
        return self._share(t) * self._motor().thrust(t, mass)

    def mass_rate(self, t: Scalar, mass: Scalar) -> Scalar:
        """Rate of the mass, kg/s, negative while the motor burns."""
        return self._share(t) * self._motor().mass_rate(t, mass)

    def propellant_left(self, y: BodyState) -> Scalar:
        """Mass above the burnout mass, kg; its zero is the end of the burn. Raises `InputError`
        without a burnout mass."""
        return self._motor().propellant_left(y)

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        del body
        # The flow follows the thrust in vacuum: the pressure of the air takes thrust, not mass.
        motor = self._motor()
        thrust = self._share(t) * motor.thrust(t, y.mass)
        return Load(
            force_N=motor.net_thrust(thrust, y) * self.steering.direction(t, y),
            mass_rate=-thrust / self.exhaust_velocity,
        )

    def switches(self) -> dict[str, str]:
        # Only a burnout mass ends the thrust by the state; the burn time is among the breaks.
        return {} if self.burnout_mass is None else {"SteeredThrust.burnout_mass": "mass"}

    def breaks(self) -> Float[Array, "times *#runs"]:
        breaks = self._motor().breaks()
        if self.schedule is not None:
            lit = ignition_of(self)
            # At each of them the slope of the factor jumps.
            times = with_rank(self.schedule.times, jnp.ndim(lit))
            breaks = joined_breaks(breaks, lit + times)
        law = self.steering.breaks()
        return breaks if law is None else joined_breaks(breaks, law)

    def _share(self, t: Scalar) -> Scalar | float:
        """The factor of the schedule."""
        return 1.0 if self.schedule is None else self.schedule.at(t - ignition_of(self))

    def _motor(self) -> Thrust:
        # A throttle that is always there is a factor; the flow falls with the thrust.
        return Thrust(
            self.throttle * self.mean_thrust,
            self.exhaust_velocity,
            self.burn_time,
            self.profile,
            self.ignition,
            burnout_mass=self.burnout_mass,
            back_pressure=self.back_pressure,
            delay=self.delay,
        )


@final
class Separation(AbstractJump):
    """Mass that is dropped between two phases, without an impulse: an empty stage, a fairing."""

    needs: ClassVar[frozenset[str]] = frozenset({"mass"})

    dropped: NumberField = quantity("kg", non_negative=True, doc="mass that is dropped")

    def __call__(self, t: Scalar, y: BodyState) -> BodyState:
        del t
        return eqx.tree_at(lambda y: y.mass, y, y.mass - self.dropped)
