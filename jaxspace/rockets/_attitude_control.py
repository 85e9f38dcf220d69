"""Control of the attitude: a torque that turns the body's z axis into the direction of a steering
law.

    M_B = k (z x d_B) - c omega

    symbol    meaning                                                unit
    z, d_B    axis of the body, direction of the law in body axes    1
    k, c      stiffness, damping                                     N m, N m s
    omega     angular velocity in body axes                          rad/s

With the transverse inertia A small errors obey A theta'' + c theta' + k theta = 0: critical damping
is c = 2 sqrt(k A). The torque saturates as the sine of the error; opposite to the law it vanishes.

Source: Thomson 5.6 (Euler's equations); Bryson, Control of Spacecraft and Aircraft, 1.
"""

from typing import final

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..bodies import AbstractBody, AbstractEffect, BodyState, Load
from ..core import NumberField, Scalar, quantity
from ..core.vectors import axis, cross
from .steering import AbstractSteering


@final
class AttitudeControl(AbstractEffect):
    """Holds the body's z axis along a steering law by a torque with stiffness and damping."""

    steering: AbstractSteering = eqx.field(metadata={"doc": "target direction of the axis"})
    stiffness: NumberField = quantity(
        "N m", non_negative=True, doc="k, torque over the sine of the error"
    )
    damping: NumberField = quantity(
        "N m s", non_negative=True, doc="c, torque over angular velocity"
    )

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        del body
        direction = y.attitude.rotate_back(self.steering.direction(t, y))
        # The sine of the error, smooth everywhere; a body that points backwards gets no torque.
        error = cross(axis(2, jnp.ones_like(direction[0])), direction)
        return Load(torque_B=self.stiffness * error - self.damping * y.omega)

    def breaks(self) -> Float[Array, "times *#runs"] | None:
        return self.steering.breaks()
