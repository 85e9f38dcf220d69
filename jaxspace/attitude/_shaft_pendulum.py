"""A body that is pinned to a turning shaft: a relative of the top, and the plane pendulum.

    A theta'' = [(A - C) Omega^2 cos(theta) - W l] sin(theta)
    Omega_c^2 = W l/(A - C),   cos(theta) = (Omega_c/Omega)^2     deflected above Omega_c

    symbol     meaning                                                       unit
    A, C       moments of inertia about the pin: across and along the axis   kg m^2
    theta      angle of the axis with the downward vertical                  rad
    Omega      rate of the shaft, Omega_c the critical one                   rad/s
    W, l       weight; distance of the mass centre                           N, m

Source: Thomson Problem 5.14-12; at rest 5.12-7.
"""

import math
from typing import final

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from ..core import AbstractSystem, NumberField, Scalar, argument, constructor, quantity
from ..core.elliptic import complete_elliptic
from ..core.printing import printed
from ..core.safe import end_sqrt
from ..core.squares import quotient
from ..core.types import as_float


@final
@printed()
class TiltState(eqx.Module):
    """The angle of a pinned body, and its rate; also the rates of both."""

    tilt: NumberField = quantity("rad", doc="theta, from the downward vertical")
    tilt_rate: NumberField = quantity("rad/s", doc="theta'")


@final
class ShaftPendulum(AbstractSystem):
    """A body of revolution that is pinned to a vertical shaft with a constant rotation rate, such
    as a disk on a stem. At the rate zero it is the plane pendulum. State: `TiltState`."""

    transverse_inertia: NumberField = quantity("kg m^2", positive=True, doc="A, about the pin")
    axial_inertia: NumberField = quantity("kg m^2", non_negative=True, doc="C, about the stem")
    weight_moment: NumberField = quantity(
        "N m", positive=True, doc="W l, weight times distance of the mass centre from the pin"
    )
    shaft_rate: NumberField = quantity("rad/s", default=0.0, doc="Omega, of the shaft")

    def vector_field(self, t: Scalar, y: TiltState) -> TiltState:
        del t
        A, C, Wl, Omega = self._letters()
        pull = (A - C) * Omega * Omega * jnp.cos(y.tilt) - Wl
        return TiltState(y.tilt_rate, pull * jnp.sin(y.tilt) / A)

    def invariants(self, t: Scalar, y: TiltState) -> dict[str, Array]:
        del t
        A, C, Wl, Omega = self._letters()
        s, c = jnp.sin(y.tilt), jnp.cos(y.tilt)
        turning = (A - C) * Omega * Omega * s * s
        # Jacobi's integral: the motor of the shaft does work.
        return {"jacobi_integral": 0.5 * (A * y.tilt_rate * y.tilt_rate - turning) - Wl * c}

    @staticmethod
    @constructor(
        tilt=argument("rad", low=-math.pi, high=math.pi, doc="theta, from the downward vertical"),
        tilt_rate=argument("rad/s", default=0.0, doc="theta'"),
    )
    def state(tilt: Scalar, tilt_rate: Scalar = 0.0) -> TiltState:
        """The state from the angle `tilt`, rad, and its rate, rad/s."""
        tilt, tilt_rate = jnp.broadcast_arrays(as_float(tilt), as_float(tilt_rate))
        return TiltState(tilt, tilt_rate)

    @property
    def critical_rate(self) -> Scalar:
        """Omega_c, rad/s, beyond which the pendulum deflects from the shaft; NaN for A <= C, which
        always hangs."""
        A, C, Wl, _ = self._letters()
        return jnp.sqrt(Wl / (A - C))

    @property
    def equilibrium(self) -> Scalar:
        """The stable angle, rad: zero below the critical rate. At that rate its slope is infinite
        (endpoint derivative convention of `core/safe.py`)."""
        A, C, Wl, Omega = self._letters()

        def sine_of_half_squared(A, C, Wl, Omega):
            turning = (A - C) * Omega * Omega
            out = turning > Wl
            # sin^2(theta/2) and not cos(theta), whose digits are lost near the critical rate.
            return 0.5 * jnp.where(out, turning - Wl, 0.0) / jnp.where(out, turning, 1.0)

        letters = jnp.broadcast_arrays(A, C, Wl, Omega)
        return 2.0 * jnp.arcsin(end_sqrt(sine_of_half_squared, *letters))

    def frequency(self, tilt: Scalar) -> Scalar:
        """Angular frequency, rad/s, of small oscillations about an equilibrium at `tilt`, rad; NaN
        where it is unstable."""
        A, C, Wl, Omega = self._letters()
        turning = (A - C) * Omega * Omega
        return jnp.sqrt((Wl * jnp.cos(tilt) - turning * jnp.cos(2.0 * tilt)) / A)

    def plane_period(self, amplitude: Scalar) -> Scalar:
        """Period, s, of the swing through `amplitude`, rad, on both sides of a shaft at rest
        (Thomson 5.12-P7)."""
        A, _, Wl, _ = self._letters()
        complement = jnp.cos(0.5 * as_float(amplitude)) ** 2
        return 4.0 * jnp.sqrt(quotient(A, Wl)) * complete_elliptic(complement)

    def _letters(self) -> tuple[Scalar, Scalar, Scalar, Scalar]:
        return self.transverse_inertia, self.axial_inertia, self.weight_moment, self.shaft_rate
