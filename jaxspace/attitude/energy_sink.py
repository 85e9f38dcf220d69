"""An energy sink: a torque that models the friction of moving parts inside a body, such as a
liquid.

    M = -c w_h,   w_h = omega - (omega . h) h/(h . h)           h = J omega
    T' = -c w_h . w_h,   (h . h)' = 0
    tan(theta) = tan(theta_0) e^(c (1/C - 1/A) t)                of a symmetric body

    symbol    meaning                                                            unit
    c         damping constant of the sink                                       N m s
    w_h       rate across the angular momentum                                   rad/s
    h, T      angular momentum, energy of rotation                               kg m^2/s, J
    A, C      moments across and along the axis of symmetry                      kg m^2
    theta     angle between that axis and h                                      rad

Source: Thomson 7.6 (the energy falls at a given angular momentum); Hughes, Spacecraft Attitude
Dynamics, 5.3 (energy sinks). The size of h is conserved exactly, its direction on average: as an
external torque, M makes h circle about its mean by c w_h/(h psi'), small compared with theta for a
slow sink.
"""

__all__ = ["energy_sink_angle"]

from typing import ClassVar, final

import jax.numpy as jnp

from ..bodies import AbstractBody, AbstractEffect, BodyState, Load
from ..core import NumberField, Scalar, quantity
from ..core.formula import NOT_NEGATIVE, POSITIVE, formula
from ..core.safe import safe_divide
from ..core.vectors import dot, scale


@formula(A=POSITIVE, C=POSITIVE, damping=NOT_NEGATIVE)
def energy_sink_angle(
    theta: Scalar, duration: Scalar, A: Scalar, C: Scalar, damping: Scalar
) -> Scalar:
    """The angle between the axis of a symmetric body and the angular momentum, a time later.

    **Arguments**, each (*runs,)

    - `theta`: at first, rad, from 0 to pi.
    - `duration`: s.
    - `A`, `C`: kg m^2.
    - `damping`: c, N m s.

    **Returns** theta, rad: towards zero for C > A, towards a right angle for C < A.
    """
    grown = jnp.exp(damping * (1.0 / C - 1.0 / A) * duration)
    # Not by the tangent itself, which is infinite at a right angle.
    return jnp.arctan2(jnp.sin(theta) * grown, jnp.cos(theta))


@final
class EnergySink(AbstractEffect):
    """Loss of energy at a constant size of the angular momentum, for a body of any inertia."""

    keeps: ClassVar[frozenset[str]] = frozenset({"angular_momentum", "axial_angular_momentum"})

    damping: NumberField = quantity("N m s", non_negative=True, doc="c, of the sink")

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        del t
        h = body.inertia(y.mass).times(y.omega)
        # A body at rest has no angular momentum, and no torque.
        along = safe_divide(dot(y.omega, h), dot(h, h))
        return Load(torque_B=-scale(self.damping, y.omega - scale(along, h)))
