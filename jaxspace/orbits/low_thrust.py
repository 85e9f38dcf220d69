"""A small thrust along the path, and the slow spiral that results from a circular orbit.

    v' = ... + a(t) v/|v|,      a(t) = a_0 / (1 - a_0 t / u)
    r = mu / (v_0 - dv)^2       quasi-circular, dv = a_0 t, or -u ln(1 - a_0 t/u)

    symbol   meaning                                                        unit
    a_0, a   acceleration at t = 0 and at the time t                        m/s^2
    u        exhaust velocity: the mass falls as exp(-dv/u)                 m/s
    v_0, r   speed on the first circle, radius of the spiral                m/s, m
    dv       increment of speed spent                                       m/s

Source: the energy of a circle under a tangential acceleration, d(-mu/2r)/dt = a v, to first order
in a r^2/mu; the spiral is no longer quasi-circular near escape.
"""

__all__ = ["spiral_radius"]

from typing import final

import jax.numpy as jnp

from ..bodies import AbstractBody, AbstractEffect, BodyState, Load
from ..core import NumberField, OptionalNumberField, Scalar, quantity
from ..core.formula import POSITIVE, formula
from ..core.vectors import scale, unit
from .burnout import circular_speed


@final
class LowThrust(AbstractEffect):
    """A small thrust along the velocity, or against it, from t = 0 on; for any body and mass."""

    acceleration: NumberField = quantity(
        "m/s^2", doc="along the velocity at t = 0; negative against it"
    )
    exhaust_velocity: OptionalNumberField = quantity(
        "m/s",
        positive=True,
        optional=True,
        doc="from which mass loss and growth of the acceleration follow; without it both are "
        "constant",
    )

    def acceleration_at(self, t: Scalar) -> Scalar:
        """The acceleration, m/s^2, at the time `t`, s."""
        if self.exhaust_velocity is None:
            return self.acceleration
        # The mass falls whichever way the thrust points.
        return self.acceleration / (1.0 - jnp.abs(self.acceleration) * t / self.exhaust_velocity)

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        del body
        assert y.velocity is not None
        # With the runs of the state.
        size = self.acceleration_at(t) * jnp.ones_like(y.velocity[0])
        return Load(acceleration_N=scale(size, unit(y.velocity)))

    def scaled(self, factor: Scalar) -> "LowThrust | None":
        # With an exhaust velocity the load is not a multiple of the acceleration.
        if self.exhaust_velocity is not None:
            return None
        return LowThrust(factor * self.acceleration)


@formula(radius=POSITIVE, mu=POSITIVE)
def spiral_radius(radius: Scalar, increment: Scalar, mu: Scalar) -> Scalar:
    """Radius of a slow spiral after an increment of speed has been spent along the path.

    **Arguments**, each (*runs,)

    - `radius`: of the circle at the start, m.
    - `increment`: spent since, m/s; negative against the motion.
    - `mu`: gravitational parameter, m^3/s^2.

    **Returns** the radius, m, to first order in the acceleration over that of gravity.
    """
    speed = circular_speed(radius, mu) - increment
    return mu / (speed * speed)
