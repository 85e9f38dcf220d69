"""Thrust of a motor along the body's z axis, with misalignment and offset, and the mass it burns.

    F_B = F(t) (c_x, c_y, 1) / |(c_x, c_y, 1)|          m' = -F(t) / u
    M_B = (r_T - r_C(m)) x F_B                          u = I_sp g_0

    symbol    meaning                                                     unit
    F         thrust: mean thrust times the profile at t / burn time      N
    c_x, c_y  tangents of the misalignment of the thrust's line           1
    r_T, r_C  point of the thrust, centre of mass (construction axes)     m
    u, I_sp   exhaust velocity, specific impulse                          m/s, s

Source: Thomson 7.2 (thrust misalignment), 7.7-4 (rocket), 8.1.

The mass flow is proportional to the thrust: the exhaust velocity is constant. The profile is linear
between its points, so that the load has kinks at known times: these are its `breaks`.
"""

import os
from collections.abc import Sequence
from typing import Any, TypeAlias, final

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..bodies import AbstractBody, AbstractEffect, BodyState, Load
from ..bodies.random_signals import Fluctuation
from ..core import (
    FileName,
    InputError,
    NumberField,
    OptionalNumberField,
    Scalar,
    Vector,
    argument,
    constructor,
    known_time,
    quantity,
)
from ..core.limits import Limit
from ..core.shapes import with_rank
from ..core.square_roots import inverse_sqrt
from ..core.types import as_float, precision_of
from ..core.vectors import cross
from ._back_pressure import BackPressure
from ._ignition import check_ignition, delay_field, ignited, ignition_of
from ._motor_file import read_motor_file
from ._thrust_profile import ThrustProfile

Pair: TypeAlias = Float[Array, "2 *#runs"] | Sequence[Scalar]

# Shared by the constructors, so that a file finds the same words in both.
_STATION = argument(
    "m",
    optional=True,
    doc="z of the point of the thrust in the body's construction axes; without it no torque",
)
_OFFSET = argument("m", shape=(2,), default=(0.0, 0.0), doc="x and y of the point of the thrust")

# Of all motors that come from a file.
MOTOR_FILE = FileName(
    "with the thrust curve: RASP (.eng), RockSim (.rse), or columns of time and thrust"
)
FILE_PROPELLANT = argument(
    "kg", positive=True, optional=True, doc="burnt in the burn time; by default from the file"
)


def _point(station: Scalar | None, offset: Pair) -> dict[str, Vector]:
    """The field `point`, m, from its z and its (x, y); none without a `station`."""
    # No zero vector in its place: a thrust without a point must cost no torque.
    if station is None:
        return {}
    x, y = as_float(offset)
    return {"point": jnp.stack(jnp.broadcast_arrays(x, y, as_float(station)))}


@final
class Thrust(AbstractEffect):
    """A motor that burns from its ignition for its burn time; its thrust follows the `profile`,
    constant by default. A liquid engine has a `throttle`, and a `back_pressure` if its specific
    impulse at sea level differs from that in vacuum.

    With a burnout mass the end of the thrust depends on the state: end the phase with the event
    `PropellantDepletion`, without which derivatives omit the shift of that time."""

    mean_thrust: NumberField = quantity(
        "N", non_negative=True, doc="in vacuum, mean over the burn time"
    )
    exhaust_velocity: NumberField = quantity(
        "m/s", positive=True, doc="thrust over mass flow in vacuum"
    )
    burn_time: NumberField = quantity("s", positive=True, doc="from ignition to burnout")
    profile: ThrustProfile | None = eqx.field(
        default=None, metadata={"doc": "shape of the thrust; constant by default"}
    )
    ignition: NumberField = quantity("s", default=0.0, doc="time at which it ignites")
    point: Float[Array, "3 *#runs"] | None = quantity(
        "m",
        optional=True,
        doc="where the thrust acts, in the body's construction axes; without it there is no torque",
    )
    misalignment: Float[Array, "2 *#runs"] | None = quantity(
        "", optional=True, doc="tangents of the angles from z to the thrust, towards x and y"
    )
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
    fluctuation: Fluctuation | None = eqx.field(
        default=None, metadata={"doc": "random factor on thrust and mass flow; none by default"}
    )

    @classmethod
    @constructor(
        sets=("mean_thrust", "exhaust_velocity", "burn_time", "point"),
        total_impulse=argument("N s", positive=True, doc="mean thrust times burn time"),
        burn_time=argument("s", positive=True, doc="from ignition to burnout"),
        propellant_mass=argument(
            "kg", positive=True, shared="body.propellant_mass", doc="burnt in the burn time"
        ),
        station=_STATION,
        offset=_OFFSET,
    )
    def of_motor(
        cls,
        total_impulse: Scalar,
        burn_time: Scalar,
        propellant_mass: Scalar,
        station: Scalar | None = None,
        offset: Pair = (0.0, 0.0),
        **fields: Any,
    ) -> "Thrust":
        """A solid motor from its total impulse and propellant mass.

        **Arguments**

        - `total_impulse`, N s; `burn_time`, s; `propellant_mass`, kg.
        - `station`, m: z of the point of the thrust; `offset`, m, (2, *runs): its x and y.
        - `fields`: the other fields by name; `point` replaces station and offset.
        """
        thrust = total_impulse / burn_time
        # With it the burn takes the propellant exactly: its impulse over u is that mass.
        exhaust_velocity = total_impulse / propellant_mass
        fields |= _point(station, offset)
        return cls(thrust, exhaust_velocity, burn_time, **fields)

    @classmethod
    @constructor(
        sets=("exhaust_velocity", "point"),
        specific_impulse=argument("s", positive=True, doc="exhaust velocity over 9.80665 m/s^2"),
        station=_STATION,
        offset=_OFFSET,
    )
    def of_specific_impulse(
        cls,
        mean_thrust: Scalar,
        specific_impulse: Scalar,
        burn_time: Scalar,
        station: Scalar | None = None,
        offset: Pair = (0.0, 0.0),
        **fields: Any,
    ) -> "Thrust":
        """A motor from its specific impulse.

        **Arguments**

        - `mean_thrust`, N; `specific_impulse`, s, with the standard gravity that defines it;
          `burn_time`, s.
        - `station`, `offset`, `fields`: as in `of_motor`.
        """
        fields |= _point(station, offset)
        # Standard gravity by definition, whatever the gravity of the place.
        return cls(mean_thrust, 9.80665 * specific_impulse, burn_time, **fields)

    @classmethod
    @constructor(
        sets=("mean_thrust", "exhaust_velocity", "burn_time", "profile", "point"),
        motor_file=MOTOR_FILE,
        propellant_mass=FILE_PROPELLANT,
        station=_STATION,
        offset=_OFFSET,
    )
    def of_file(
        cls,
        motor_file: str | os.PathLike[str],
        propellant_mass: Scalar | None = None,
        station: Scalar | None = None,
        offset: Pair = (0.0, 0.0),
        **fields: Any,
    ) -> "Thrust":
        """A solid motor from its thrust curve in a file.

        **Arguments**

        - `motor_file`: path, as in `read_motor`.
        - `propellant_mass`: kg, instead of the value in the file.
        - `station`, `offset`, `fields`: as in `of_motor`.

        **Raises** `InputError` for a file that `read_motor` rejects, or without a propellant mass.
        """
        fields |= _point(station, offset)
        return cls(*read_motor_file(motor_file).parameters(propellant_mass), **fields)

    def started_at(self, t0: Scalar) -> "Thrust":
        return ignited(self, t0)

    def __check_init__(self):
        check_ignition(self)

    @known_time
    def burnout(self) -> Scalar:
        """The time, s, of the burnout."""
        return ignition_of(self) + self.burn_time

    def thrust(self, t: Scalar, mass: Scalar) -> Scalar:
        """The thrust in vacuum, N, at the time `t`, s, with the remaining `mass`, kg."""
        ignition = ignition_of(self)
        x = (t - ignition) / self.burn_time
        # Not by x >= 0, because the quotient of a short time before the ignition rounds to zero.
        burning = t >= ignition
        if self.profile is None:
            # Both ends count: a step that ends at the burnout still sees the motor burn.
            level = jnp.where(burning & (x <= 1.0), 1.0, 0.0)
        else:
            level = jnp.where(burning, self.profile.at(x), 0.0)
        thrust = self.mean_thrust * level
        if self.throttle is not None:
            thrust = self.throttle * thrust
        if self.fluctuation is not None:
            thrust = self.fluctuation.factor(t) * thrust
        if self.burnout_mass is None:
            return thrust
        # Compared with the state and not with the time, so that a low thrust burns longer.
        return jnp.where(mass > self.burnout_mass, thrust, 0.0)

    def mass_rate(self, t: Scalar, mass: Scalar) -> Scalar:
        """Rate of the mass, kg/s, negative while the motor burns."""
        return -self.thrust(t, mass) / self.exhaust_velocity

    def propellant_left(self, y: BodyState) -> Scalar:
        """Mass above the burnout mass, kg; its zero is the end of the burn.

        Raises `InputError` without a burnout mass."""
        if self.burnout_mass is None:
            raise InputError(
                "Thrust.burnout_mass is None: "
                "it must be a mass in kg for the propellant to run out."
            )
        assert y.mass is not None
        # The zero is some thousand units in the last place before the end of the thrust, so that
        # the last step of a phase that ends here does not see the jump of the thrust.
        return y.mass - self.burnout_mass * (1.0 + 4096.0 * jnp.finfo(y.mass.dtype).eps)

    def net_thrust(self, thrust: Scalar, y: BodyState) -> Scalar:
        """The net thrust, N, in the air of the state `y`, for a `thrust` in vacuum, N."""
        return thrust if self.back_pressure is None else self.back_pressure.net(thrust, y)

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        assert y.attitude is not None and y.mass is not None
        thrust = self.thrust(t, y.mass)
        force_B = self.net_thrust(thrust, y) * self._direction(thrust)
        # `None` and not zero: a thrust without a point costs no operation for a torque.
        torque = None
        if self.point is not None:
            point = with_rank(self.point, jnp.ndim(y.mass))
            torque = cross(point - body.centre_of_mass(y.mass), force_B)
        return Load(
            force_N=y.attitude.rotate(force_B),
            torque_B=torque,
            mass_rate=-thrust / self.exhaust_velocity,
        )

    def _direction(self, like: Scalar) -> Vector:
        """Unit vector of the thrust in body axes."""
        # With the runs of the thrust, so that a misalignment may be shared by all of them.
        one = jnp.ones_like(like)
        if self.misalignment is None:
            return jnp.stack([0.0 * one, 0.0 * one, one])
        c = self.misalignment
        length_squared = 1.0 + c[0] * c[0] + c[1] * c[1]
        return jnp.stack([c[0] * one, c[1] * one, one]) * inverse_sqrt(length_squared)

    def limits(self, t: Scalar, y: BodyState, body: AbstractBody) -> Sequence[Limit]:
        del y, body
        # The signal may end with the burn.
        burning = t <= self.burnout()
        return () if self.fluctuation is None else self.fluctuation.limits(t, burning)

    def switches(self) -> dict[str, str]:
        return {} if self.burnout_mass is None else {"Thrust.burnout_mass": "mass"}

    def breaks(self) -> Float[Array, "times *#runs"]:
        # With the batch axis after the points: each run has its own ignition and burn time.
        ignition = ignition_of(self)
        kind = precision_of(ignition, self.burn_time)
        x = jnp.array([0.0, 1.0], kind) if self.profile is None else self.profile.fraction
        runs = jnp.broadcast_shapes(x.shape[1:], self.burn_time.shape, ignition.shape)
        x = with_rank(x, len(runs))
        return ignition + self.burn_time * x
