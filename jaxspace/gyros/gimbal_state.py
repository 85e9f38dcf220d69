"""The state of a gyro in two gimbals, and the condition of gimbal lock."""

__all__ = ["near_gimbal_lock"]

from typing import final

import equinox as eqx
import jax.numpy as jnp

from ..core import NumberField, OptionalNumberField, Scalar, quantity
from ..core.formula import formula
from ..core.printing import printed

LOCK = 1e-3  # rad


@final
@printed()
class GimbalState(eqx.Module):
    """Angles of both gimbals, rate of the inner one, momentum of the outer one; also their rates.

    The momentum replaces the rate of psi: it is constant or grows linearly, so that integration
    errors do not add to the drift of the outer gimbal, which is 1e-5 of the nutation rates.
    """

    theta: NumberField = quantity(
        "rad", doc="angle of the rotor's axis from the outer gimbal's axis"
    )
    psi: NumberField = quantity("rad", doc="angle of the outer gimbal about its axis")
    theta_rate: NumberField = quantity("rad/s", doc="rate of theta")
    angular_momentum: NumberField = quantity(
        "kg m^2/s", doc="h_Z, of everything about the outer gimbal's axis"
    )
    spin_momentum: OptionalNumberField = quantity(
        "kg m^2/s", optional=True, doc="H, of a rotor with a motor"
    )
    slip_inner: OptionalNumberField = quantity(
        "", optional=True, doc="1, -1, or 0 where the inner bearing sticks"
    )
    slip_outer: OptionalNumberField = quantity(
        "", optional=True, doc="likewise of the outer bearing"
    )


@formula
def near_gimbal_lock(t: Scalar, y: GimbalState) -> Scalar:
    """|sin(theta)| - 1e-3: zero where the rotor's axis is almost along the outer gimbal's: the
    condition of an event with `direction=-1`.

    **Arguments**

    - `t`: time, s, not used.
    - `y`: the state of the gyro."""
    del t
    return jnp.abs(jnp.sin(y.theta)) - LOCK
