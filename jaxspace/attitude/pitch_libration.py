"""Libration in the plane of the orbit: on a circle in closed form, and on an ellipse as a system.

    tan(th) = tan(a) cn(p t, sin a)                          circle, from rest at the amplitude a
    p^2 = 3 n^2 (I_1 - I_3)/I_2

    th'' + f'' + (3/2) (mu/r^3) kappa sin 2 th = 0           ellipse, kappa = (I_1 - I_3)/I_2
    f' = n (1 + e cos f)^2/(1 - e^2)^(3/2),   mu/r^3 = n^2 (1 + e cos f)^3/(1 - e^2)^3
    f'' = -2 e sin f mu/r^3

    symbol        meaning                                                             unit
    th            pitch: angle of axis 3 from the outward radius, with the orbit      rad
    n             mean motion                                                         rad/s
    f, e          true anomaly, eccentricity                                          rad, 1
    I_1, I_2, I_3 moments along the velocity, the normal of the orbit, outwards       kg m^2
    cn            Jacobi's function of the modulus sin a                              1

Source: Thomson 7.4, Problems 14 and 15 (circle); Hughes, Spacecraft Attitude Dynamics, 9.3;
Beletsky (ellipse: his equation in f is this one). On an ellipse nothing is conserved: the orbit
pushes the pitch, resonantly at 3 kappa = 1, and may make it tumble.
"""

__all__ = ["EllipticLibration", "LibrationState", "pitch_libration"]

from typing import final

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from ..core import AbstractSystem, NumberField, Scalar, Vector, quantity
from ..core.formula import POSITIVE, formula
from ..core.jacobi import jacobi
from ..core.printing import printed
from ..core.shapes import check_components


@formula(moments=POSITIVE, mean_motion=POSITIVE)
def pitch_libration(t: Scalar, amplitude: Scalar, moments: Vector, mean_motion: Scalar) -> Scalar:
    """The pitch a time after rest at its amplitude, on a circle (Thomson 7.4, Problem 15).

    **Arguments**

    - `t`: s, (*runs,).
    - `amplitude`: a, rad, (*runs,), up to a right angle, from which it never comes back.
    - `moments`: I_1 along the velocity, I_2 along the normal and I_3 outwards, kg m^2, (3, *runs),
      with I_1 >= I_3.
    - `mean_motion`: n, rad/s, (*runs,).

    **Returns** the pitch, rad, (*runs,); its period is `pitch_libration_period`. NaN for I_1 < I_3,
    where the equilibrium is unstable.
    """
    check_components("pitch_libration: moments", moments, 3)
    along, across, outwards = moments
    square = 3.0 * mean_motion * mean_motion * (along - outwards) / across
    s, c = jnp.sin(amplitude), jnp.cos(amplitude)
    # Near a right angle the difference decides: it is computed without cancellation.
    upright = square >= 0.0
    x = jnp.where(upright, square, 0.0)
    t, x, s, c = jnp.broadcast_arrays(t, x, s, c)
    result = jacobi(t, x, x * s * s, x * c * c)
    # Each half period that was subtracted changes the sign of cn.
    cn = result.c * (1.0 - 2.0 * jnp.mod(jnp.abs(result.half_periods), 2.0))
    return jnp.where(upright, jnp.arctan2(s * cn, c), jnp.nan)


@final
@printed()
class LibrationState(eqx.Module):
    """Pitch, its rate, and the place on the orbit."""

    pitch: NumberField = quantity("rad", doc="th, from the outward radius")
    pitch_rate: NumberField = quantity("rad/s", doc="th'")
    true_anomaly: NumberField = quantity("rad", doc="f, from the periapsis")


@final
class EllipticLibration(AbstractSystem):
    """Pitch of a body on an elliptic orbit. State: `LibrationState`."""

    mean_motion: NumberField = quantity("rad/s", positive=True, doc="n, of the orbit")
    eccentricity: NumberField = quantity("", low=0.0, high=0.99, doc="e, of the orbit")
    inertia_ratio: NumberField = quantity("", low=-1.0, high=1.0, doc="kappa, (I_1 - I_3)/I_2")

    def vector_field(self, t: Scalar, y: LibrationState) -> LibrationState:
        del t
        n, e, f = self.mean_motion, self.eccentricity, y.true_anomaly
        flat = (1.0 - e) * (1.0 + e)
        near = (1.0 + e * jnp.cos(f)) / flat
        pull = n * n * near * near * near
        rate = n * near * near * jnp.sqrt(flat)
        turning = 2.0 * e * jnp.sin(f) - 1.5 * self.inertia_ratio * jnp.sin(2.0 * y.pitch)
        return LibrationState(y.pitch_rate, pull * turning, rate)

    def invariants(self, t: Scalar, y: LibrationState) -> dict[str, Array]:
        # Only a circle has an invariant, and on an orbit that is circular to rounding it would
        # drift.
        del t, y
        return {}
