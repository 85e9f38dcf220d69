"""Actuators: effects and motors with a field `command`, which a loop sets.

    M_B = u                                     torque: thrusters, magnetic rods
    torque on wheel i = u_i                     motors of reaction wheels
    F = T,  m' = -|T|/u_e,  |T| <= T_max        engine that can be throttled and turned

    symbol  meaning                                   unit
    u       command: torque in body axes; of a motor  N m
    T       command: thrust in inertial axes          N
    u_e     exhaust velocity                          m/s

Source: Hughes, Spacecraft Attitude Dynamics, 6 (wheels); Thomson 8.1 (rocket equation).
"""

from typing import final

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..attitude.motors import AbstractMotor
from ..bodies import AbstractBody, AbstractEffect, BodyState, Load
from ..core import NumberField, Scalar, Vector, quantity
from ..core.safe import safe_divide
from ..core.shapes import with_rank
from ..core.vectors import norm


@final
class CommandedTorque(AbstractEffect):
    """A torque on the body, in body axes, as a controller commands it."""

    command: Float[Array, "3 *#runs"] = quantity(
        "N m", default=(0.0, 0.0, 0.0), doc="torque in body axes before the first command"
    )

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        del t, body
        return Load(torque_B=with_rank(self.command, y.omega.ndim - 1) + 0.0 * y.omega)


@final
class CommandedAcceleration(AbstractEffect):
    """An acceleration of the body in inertial axes, as a controller commands it."""

    command: Float[Array, "3 *#runs"] = quantity(
        "m/s^2", default=(0.0, 0.0, 0.0), doc="acceleration before the first command"
    )

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        del t, body
        return Load(acceleration_N=with_rank(self.command, y.velocity.ndim - 1) + 0.0 * y.velocity)


@final
class CommandedMotor(AbstractMotor):
    """The motors of wheels, each with the torque that a controller commands.

    The limits of torque and speed are those of the wheels."""

    command: Float[Array, "wheels *#runs"] = quantity(
        "N m", default=(0.0, 0.0, 0.0), doc="on each wheel before the first command"
    )

    def torque(self, t: Scalar, y: BodyState, axes: Array, speed: Array) -> Array:
        del t, y, axes
        return with_rank(self.command, speed.ndim - 1) + 0.0 * speed


@final
class CommandedEngine(AbstractEffect):
    """An engine whose thrust is gimballed and throttled by a controller; it consumes propellant,
    and stops when it is empty.

    The command is the thrust in inertial axes. If longer than `max_thrust`, it is shortened along
    its direction."""

    max_thrust: NumberField = quantity("N", positive=True, doc="greatest thrust")
    exhaust_velocity: NumberField = quantity("m/s", positive=True, doc="thrust over mass flow")
    burnout_mass: NumberField = quantity("kg", non_negative=True, doc="mass without propellant")
    command: Float[Array, "3 *#runs"] = quantity(
        "N", default=(0.0, 0.0, 0.0), doc="thrust before the first command"
    )

    def thrust(self, mass: Scalar) -> Vector:
        """The thrust, N, (3, *runs), with `mass`, kg, left."""
        command = with_rank(self.command, jnp.ndim(mass))
        size = norm(command)
        # 1 where the command is allowed, also for a command of zero.
        share = jnp.where(size > self.max_thrust, safe_divide(self.max_thrust, size), 1.0)
        return jnp.where(mass > self.burnout_mass, share, 0.0) * command

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        del t, body
        thrust = self.thrust(y.mass)
        return Load(force_N=thrust, mass_rate=-norm(thrust) / self.exhaust_velocity)
