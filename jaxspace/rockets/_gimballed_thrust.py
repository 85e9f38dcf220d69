"""Thrust vector control: a motor in a gimbal, whose thrust turns the body's z axis into the
direction of a steering law.

    theta = k (z x d_B) - c omega,     s = theta/sqrt(1 + |theta|^2/tan^2(delta))       x and y only
    F_B = F (-s_y, s_x, 1)/sqrt(1 + s^2),     M_B = (r_T - r_C) x F_B

    symbol     meaning                                                          unit
    z, d_B     axis of the body, direction of the law in body axes              1
    k, c       gain of the attitude, of the angular velocity                    1, s
    s, delta   tangents of the angles of the nozzle, greatest angle             1, rad
    r_T, r_C   point of the thrust, which is behind the centre of mass          m
    omega      angular velocity in body axes                                    rad/s

With the lever l and the transverse inertia A small errors obey A theta'' + F l (c theta' + k theta)
= 0. The side force that turns the body is part of it: the flight first moves away from where it is
to go. One nozzle gives no roll.

Source: Greensite, Analysis and Design of Space Vehicle Flight Control Systems, 1970, 1.2.
"""

import os
from typing import Any, final

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..bodies import AbstractBody, AbstractEffect, BodyState, Load
from ..core import (
    AbstractParameters,
    NumberField,
    OptionalNumberField,
    Scalar,
    Vector,
    argument,
    constructor,
    known_time,
    quantity,
)
from ..core.shapes import with_rank
from ..core.square_roots import inverse_sqrt, sqrt
from ..core.vectors import cross
from ._back_pressure import BackPressure
from ._ignition import check_ignition, delay_field, ignited, ignition_of
from ._motor_file import read_motor_file
from ._thrust import FILE_PROPELLANT, MOTOR_FILE, Thrust
from ._thrust_profile import ThrustProfile
from .steering import AbstractSteering, joined_breaks


@final
class Gimbal(AbstractParameters):
    """Control of a nozzle by the error of the attitude."""

    steering: AbstractSteering = eqx.field(metadata={"doc": "target direction of the axis"})
    gain: NumberField = quantity(
        "", non_negative=True, doc="k, angle of the nozzle over the error of the axis"
    )
    damping: NumberField = quantity(
        "s", non_negative=True, doc="c, angle of the nozzle over the angular velocity"
    )
    limit: NumberField = quantity(
        "rad", low=0.0, high=1.5, strict=True, default=0.1, doc="delta, greatest angle"
    )

    def tangents(self, t: Scalar, y: BodyState) -> tuple[Scalar, Scalar]:
        """The tangents of the nozzle's angles about x and y, at the time `t`, s: smooth, and never
        beyond the limit."""
        # In body axes, where the error about x and y is what the nozzle can correct.
        direction = y.attitude.rotate_back(self.steering.direction(t, y))
        about_x = -self.gain * direction[1] - self.damping * y.omega[0]
        about_y = self.gain * direction[0] - self.damping * y.omega[1]
        # The commands count as tangents, so that the limit has to be one as well.
        most = jnp.tan(self.limit)
        # Smooth, because a hard stop would be a kink that step control has to resolve.
        held = sqrt(1.0 + (about_x * about_x + about_y * about_y) / (most * most))
        return about_x / held, about_y / held


@final
class GimballedThrust(AbstractEffect):
    """A motor in a gimbal: its thrust steers the body, whose attitude is a part of the state. A
    burnout mass is that of `Thrust`.

    The same flight as a point, with the thrust along the law, is that of `SteeredThrust`."""

    gimbal: Gimbal = eqx.field(metadata={"doc": "actuator of the nozzle"})
    mean_thrust: NumberField = quantity(
        "N", non_negative=True, doc="in vacuum, mean over the burn time"
    )
    exhaust_velocity: NumberField = quantity(
        "m/s", positive=True, doc="thrust over mass flow in vacuum"
    )
    burn_time: NumberField = quantity("s", positive=True, doc="from ignition to burnout")
    station: NumberField = quantity("m", doc="z of the gimbal in the body's construction axes")
    profile: ThrustProfile | None = eqx.field(
        default=None, metadata={"doc": "shape of the thrust; constant by default"}
    )
    ignition: NumberField = quantity("s", default=0.0, doc="time at which it ignites")
    burnout_mass: OptionalNumberField = quantity(
        "kg",
        non_negative=True,
        optional=True,
        doc="mass at which the thrust ends; by default it ends with the burn time",
    )
    throttle: OptionalNumberField = quantity(
        "", low=0.0, high=1.0, optional=True, doc="fraction of the full thrust; 1 by default"
    )
    back_pressure: BackPressure | None = eqx.field(
        default=None, metadata={"doc": "thrust lost to the ambient pressure; none by default"}
    )
    delay: OptionalNumberField = delay_field()

    @classmethod
    @constructor(
        sets=("mean_thrust", "exhaust_velocity", "burn_time"),
        mean_thrust=argument("N", positive=True, doc="in vacuum"),
        specific_impulse=argument("s", positive=True, doc="exhaust velocity over 9.80665 m/s^2"),
        propellant_mass=argument("kg", positive=True, doc="burnt from ignition to burnout"),
        throttle=argument("", low=0.0, high=1.0, optional=True, doc="fraction of the full thrust"),
    )
    def of_propellant(
        cls,
        gimbal: Gimbal,
        mean_thrust: Scalar,
        specific_impulse: Scalar,
        propellant_mass: Scalar,
        station: Scalar,
        throttle: Scalar | None = None,
        **fields: Any,
    ) -> "GimballedThrust":
        """A motor that burns a mass of propellant: its burn time follows.

        **Arguments**

        - `gimbal`; `mean_thrust`, N; `specific_impulse`, s; `propellant_mass`, kg; `station`, m;
          `throttle`.
        - `fields`: the other fields by name.
        """
        # Standard gravity by definition of the specific impulse.
        u = 9.80665 * specific_impulse
        # A throttled engine burns longer, because its flow falls with its thrust.
        flowing = mean_thrust if throttle is None else throttle * mean_thrust
        burn_time = propellant_mass * u / flowing
        return cls(gimbal, mean_thrust, u, burn_time, station, throttle=throttle, **fields)

    @classmethod
    @constructor(
        sets=("mean_thrust", "exhaust_velocity", "burn_time", "profile"),
        motor_file=MOTOR_FILE,
        propellant_mass=FILE_PROPELLANT,
    )
    def of_file(
        cls,
        gimbal: Gimbal,
        motor_file: str | os.PathLike[str],
        station: Scalar,
        propellant_mass: Scalar | None = None,
        **fields: Any,
    ) -> "GimballedThrust":
        """A solid motor from its thrust curve in a file.

        **Arguments**

        - `gimbal`; `station`, m.
        - `motor_file`, `propellant_mass`: as in `Thrust.of_file`.
        - `fields`: the other fields by name.

        **Raises** `InputError` for a file that `read_motor` rejects, or without a propellant mass.
        """
        thrust, u, time, profile = read_motor_file(motor_file).parameters(propellant_mass)
        return cls(gimbal, thrust, u, time, station, profile, **fields)

    @classmethod
    def of_thrust(cls, motor: Thrust, gimbal: Gimbal, station: Scalar) -> "GimballedThrust":
        """The motor of a body, put into a gimbal.

        **Arguments**

        - `motor`: its point and its misalignment play no role.
        - `gimbal`; `station`: z of the gimbal in construction axes, m.
        """
        return cls(
            gimbal,
            motor.mean_thrust,
            motor.exhaust_velocity,
            motor.burn_time,
            station,
            motor.profile,
            motor.ignition,
            motor.burnout_mass,
            motor.throttle,
            motor.back_pressure,
            motor.delay,
        )

    def started_at(self, t0: Scalar) -> "GimballedThrust":
        return ignited(self, t0)

    def __check_init__(self):
        check_ignition(self)

    @known_time
    def burnout(self) -> Scalar:
        """The time, s, at which the burn time is over."""
        return ignition_of(self) + self.burn_time

    def motor(self) -> Thrust:
        """The motor without its gimbal."""
        return Thrust(
            self.mean_thrust,
            self.exhaust_velocity,
            self.burn_time,
            self.profile,
            self.ignition,
            burnout_mass=self.burnout_mass,
            throttle=self.throttle,
            back_pressure=self.back_pressure,
            delay=self.delay,
        )

    def propellant_left(self, y: BodyState) -> Scalar:
        """Mass above the burnout mass, kg; its zero is the end of the burn. Raises `InputError`
        without a burnout mass."""
        return self.motor().propellant_left(y)

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        motor = self.motor()
        thrust = motor.thrust(t, y.mass)
        about_x, about_y = self.gimbal.tangents(t, y)
        # The nozzle turns the thrust without changing its length.
        length_squared = 1.0 + about_x * about_x + about_y * about_y
        along = motor.net_thrust(thrust, y) * inverse_sqrt(length_squared)
        force_B = jnp.stack([-along * about_y, along * about_x, along])
        return Load(
            force_N=y.attitude.rotate(force_B),
            torque_B=cross(self._lever(y.mass, body), force_B),
            # By the thrust in vacuum: the pressure of the air takes thrust, not mass.
            mass_rate=-thrust / self.exhaust_velocity,
        )

    def _lever(self, mass: Scalar, body: AbstractBody) -> Vector:
        """The vector from the centre of mass to the gimbal, m."""
        # A zero with the runs of both, so that the components can be stacked.
        zero = 0.0 * (self.station + mass)
        point = jnp.stack([zero, zero, self.station + zero])
        return with_rank(point, jnp.ndim(mass)) - body.centre_of_mass(mass)

    def switches(self) -> dict[str, str]:
        return {} if self.burnout_mass is None else {"GimballedThrust.burnout_mass": "mass"}

    def breaks(self) -> Float[Array, "times *#runs"]:
        # As those of the point's motor, whose law may have corners, too.
        motor_breaks = self.motor().breaks()
        law = self.gimbal.steering.breaks()
        return motor_breaks if law is None else joined_breaks(motor_breaks, law)
