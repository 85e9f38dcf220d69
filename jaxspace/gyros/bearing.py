"""Friction of a bearing, and the motor of a rotor.

    M_f = -c r - M_d sign(r)          r != 0: the bearing slips
    |M_f| <= M_d                      r = 0:  it may stick, and balances the applied moment

    symbol   meaning                                              unit
    r        rate of the bearing                                  rad/s
    c, M_d   viscous friction; dry friction                       N m s, N m

Dry friction is smooth with a `creep` rate r_0, M_d tanh(r / r_0): a stuck bearing then creeps.
Without it slip is a part of the state (1, -1, and 0 where the bearing sticks) that events change:
where r falls to zero, and where the moment on a stuck bearing exceeds M_d. A run without these
events, in which friction would drive a bearing, has the status `OUTSIDE_MODEL`.

Source: Thomson 6.7 (viscous), 4.3 (dry); Filippov (1988), Differential Equations with Discontinuous
Righthand Sides, 2.
"""

__all__ = ["BearingFriction", "RotorMotor"]

from typing import final

import jax.numpy as jnp

from ..core import AbstractParameters, NumberField, OptionalNumberField, Scalar, quantity


@final
class BearingFriction(AbstractParameters):
    """Viscous and dry friction of a bearing."""

    viscous: NumberField = quantity(
        "N m s", non_negative=True, default=0.0, doc="c, moment per rate"
    )
    dry: NumberField = quantity(
        "N m", non_negative=True, default=0.0, doc="M_d, of a bearing that slips"
    )
    creep: OptionalNumberField = quantity(
        "rad/s",
        positive=True,
        optional=True,
        doc="r_0 of regularised dry friction; without it slip and stick are events",
    )

    @property
    def slips(self) -> bool:
        """Whether slip is a part of the state."""
        return self.creep is None

    def moment(self, rate: Scalar, slip: Scalar | None) -> Scalar:
        """The moment, N m, at a `rate`, rad/s, and with `slip` where that is a part of the
        state."""
        viscous = -self.viscous * rate
        if self.creep is None:
            return viscous - self.dry * (0.0 if slip is None else slip)
        # A smooth sign needs no slip in the state and no event; under load the bearing creeps.
        return viscous - self.dry * jnp.tanh(rate / self.creep)

    def margin(self, rate: Scalar, applied: Scalar, slip: Scalar) -> Scalar:
        """A margin that falls to zero where a slipping bearing stops, rad/s, and where a stuck one
        begins to slip, N m, under the moment `applied`, N m, without the friction."""
        # One number for both, so that the same event applies to a slipping and a sticking bearing.
        return jnp.where(slip == 0.0, self.dry - jnp.abs(applied), slip * rate)

    def slip_at_rest(self, applied: Scalar) -> Scalar:
        """The slip of a bearing at rest: the sign of the moment `applied`, N m, or 0 where the
        bearing sticks."""
        return jnp.where(jnp.abs(applied) < self.dry, 0.0, jnp.sign(applied))


@final
class RotorMotor(AbstractParameters):
    """A motor with the characteristic M = K (n_0 - r), which includes the bearing of the rotor.

    It is mounted on the inner gimbal, so that its torque changes the spin and not the total
    momentum."""

    gain: NumberField = quantity("N m s", non_negative=True, doc="K, torque per lack of speed")
    speed: NumberField = quantity("rad/s", doc="n_0, of the rotor in the inner gimbal without load")

    def torque(self, speed: Scalar) -> Scalar:
        """The torque on a rotor with the `speed`, rad/s, in the inner gimbal, N m."""
        return self.gain * (self.speed - speed)
