"""Cold-gas thrusters in pairs, which turn a body about its axes and blow their gas away.

    M_B = clip(u, -M, M),     m' = -(|M_x| + |M_y| + |M_z|)/(l u_e)

    symbol   meaning                                          unit
    u, M     command, greatest torque about an axis           N m
    l, u_e   distance of a thruster from the axis, exhaust    m, m/s
             velocity of the gas

A pair gives no force. Valves that only open and shut are pulses whose mean a sample commands; the
`quantum` of a loop is the shortest one.

Source: Wie, Space Vehicle Dynamics and Control, 7.4; Sutton, Rocket Propulsion Elements, 6.8.
"""

from typing import final

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..bodies import AbstractBody, AbstractEffect, BodyState, Load
from ..core import NumberField, Scalar, quantity
from ..core.shapes import with_rank


@final
class ColdGasThrusters(AbstractEffect):
    """A commanded torque about the body axes within a limit, until the gas is consumed."""

    torque_limit: NumberField = quantity("N m", positive=True, doc="M, about each axis")
    lever: NumberField = quantity("m", positive=True, doc="l, of each pair")
    exhaust_velocity: NumberField = quantity("m/s", positive=True, doc="u_e, of the gas")
    empty_mass: NumberField = quantity(
        "kg", non_negative=True, default=0.0, doc="mass of the body without gas"
    )
    command: Float[Array, "3 *#runs"] = quantity(
        "N m", default=(0.0, 0.0, 0.0), doc="torque in body axes before the first command"
    )

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        del t, body
        command = with_rank(self.command, y.omega.ndim - 1) + 0.0 * y.omega
        torque = jnp.clip(command, -self.torque_limit, self.torque_limit)
        # Without gas a command has no effect.
        torque = jnp.where(y.mass > self.empty_mass, torque, 0.0)
        # Each axis has a separate pair, so that the flows add up.
        blown = jnp.sum(jnp.abs(torque), axis=0)
        return Load(torque_B=torque, mass_rate=-blown / (self.lever * self.exhaust_velocity))
