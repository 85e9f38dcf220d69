"""Motion relative to a body on a circular orbit, to first order in the distance: Clohessy and
Wiltshire.

    x'' - 2 n y' - 3 n^2 x = 0,  y'' + 2 n x' = 0,  z'' + n^2 z = 0
    x = (1 + 3 n q2) x0 + q1 u0 + 2 q2 v0
    y = y0 - 6 n q3 x0 - 2 q2 u0 + (4 q1 - 3 t) v0
    z = cos(n t) z0 + q1 w0
    q1 = sin(n t)/n,  q2 = (1 - cos(n t))/n,  q3 = t - q1

    symbol    meaning                                                   unit
    x, y, z   outwards, along the motion, normal to the plane           m
    u, v, w   their rates, in the rotating axes; index 0: at the start  m/s
    n         mean motion of the circle                                 rad/s
    t         duration                                                  s

Source: Clohessy and Wiltshire (1960), Journal of the Aerospace Sciences 27, 653; the small
disturbance of a circle is Thomson 4.15-1.

Valid for distances small against the radius of the circle. q1 to q3 are series at small n t: no
digit is lost there, and n = 0 is motion without gravity.
"""

__all__ = ["clohessy_wiltshire_flow", "clohessy_wiltshire_transfer"]

from typing import final

import jax.numpy as jnp
from jaxtyping import Array

from ..bodies import BodyState
from ..core import AbstractClosedForm, AbstractSystem, NumberField, Scalar, Vector, quantity
from ..core.formula import NOT_NEGATIVE, formula
from ..core.shapes import with_rank
from ..core.special import stumpff_near
from ..core.types import as_float
from ..core.vectors import dot

# The limit of (n t)^2 for the series, just within the range of `stumpff_near`. Beyond half a turn
# nothing cancels.
_SMALL = 9.0


@formula(mean_motion=NOT_NEGATIVE)
def clohessy_wiltshire_flow(
    position: Vector, velocity: Vector, duration: Scalar, mean_motion: Scalar
) -> tuple[Vector, Vector]:
    """The relative state after a given duration.

    **Arguments**

    - `position`, m, and `velocity`, m/s, in the rotating axes: (3, *runs), outwards, along the
      motion, normal.
    - `duration`: s, (*runs,), of either sign.
    - `mean_motion`: n of the circle, rad/s, (*runs,).

    **Returns** position, m, and velocity, m/s, (3, *runs).
    """
    t, n = as_float(duration), as_float(mean_motion)
    rank = max(position.ndim - 1, velocity.ndim - 1, jnp.ndim(t), jnp.ndim(n))
    x, y, z = with_rank(position, rank)
    u, v, w = with_rank(velocity, rank)
    c, q1, q2, q3 = _functions(t, n)
    s = n * q1
    moved = (
        (1.0 + 3.0 * n * q2) * x + q1 * u + 2.0 * q2 * v,
        y - 6.0 * n * q3 * x - 2.0 * q2 * u + (4.0 * q1 - 3.0 * t) * v,
        c * z + q1 * w,
    )
    rates = (
        3.0 * n * s * x + c * u + 2.0 * s * v,
        -6.0 * n * n * q2 * x - 2.0 * s * u + (1.0 - 4.0 * n * q2) * v,
        c * w - n * s * z,
    )
    return jnp.stack(jnp.broadcast_arrays(*moved)), jnp.stack(jnp.broadcast_arrays(*rates))


@formula(mean_motion=NOT_NEGATIVE)
def clohessy_wiltshire_transfer(
    start: Vector, end: Vector, duration: Scalar, mean_motion: Scalar
) -> tuple[Vector, Vector]:
    """The relative velocities at both ends of the motion from one position to another.

    **Arguments**

    - `start`, `end`: positions, m, (3, *runs), as in `clohessy_wiltshire_flow`.
    - `duration`: s, (*runs,); `mean_motion`: rad/s, (*runs,).

    **Returns** the velocities at `start` and at `end`, m/s, (3, *runs): their differences from the
    velocities before and after are the two impulses of a rendezvous. Infinite or NaN where the
    positions do not determine them: for zero duration, after whole and (normal to the plane) half
    revolutions, and where 8 (1 - cos(n t)) = 3 n t sin(n t).
    """
    t, n = as_float(duration), as_float(mean_motion)
    rank = max(start.ndim - 1, end.ndim - 1, jnp.ndim(t), jnp.ndim(n))
    start, end = with_rank(start, rank), with_rank(end, rank)
    x, y, z = start
    c, q1, q2, q3 = _functions(t, n)
    along = 4.0 * q1 - 3.0 * t
    # The way without the motion that starts at rest.
    dx = end[0] - (1.0 + 3.0 * n * q2) * x
    dy = end[1] - y + 6.0 * n * q3 * x
    det = q1 * along + 4.0 * q2 * q2
    leaving = (
        (along * dx - 2.0 * q2 * dy) / det,
        (2.0 * q2 * dx + q1 * dy) / det,
        (end[2] - c * z) / q1,
    )
    velocity = jnp.stack(jnp.broadcast_arrays(*leaving))
    return velocity, clohessy_wiltshire_flow(start, velocity, t, n)[1]


def _functions(t: Scalar, n: Scalar) -> tuple[Scalar, Scalar, Scalar, Scalar]:
    """cos(n t) and q1 to q3 of the module."""
    angle = n * t
    z = angle * angle
    small = z < _SMALL
    c2, c3, *_ = stumpff_near(jnp.where(small, z, 0.0))
    # A divisor of one in place of n, which may be zero where the series are taken.
    per = 1.0 / jnp.where(small, 1.0, n)
    q1 = jnp.where(small, t * (1.0 - z * c3), jnp.sin(angle) * per)
    q2 = jnp.where(small, t * angle * c2, (1.0 - jnp.cos(angle)) * per)
    q3 = jnp.where(small, t * z * c3, t - jnp.sin(angle) * per)
    return jnp.cos(angle), q1, q2, q3


@final
class RelativeMotion(AbstractClosedForm):
    """`clohessy_wiltshire_flow` of a state, about a circle of this mean motion, rad/s."""

    mean_motion: Scalar

    def flow(self, duration: Scalar, y: BodyState) -> BodyState:
        assert y.position is not None and y.velocity is not None
        return BodyState(
            *clohessy_wiltshire_flow(y.position, y.velocity, duration, self.mean_motion)
        )


@final
class ClohessyWiltshire(AbstractSystem):
    """Motion relative to a body on a circular orbit, to first order in the distance.

    State: `BodyState` with position and velocity in the rotating axes: outwards, along the motion,
    normal."""

    mean_motion: NumberField = quantity("rad/s", doc="of the circle")

    def vector_field(self, t: Scalar, y: BodyState) -> BodyState:
        del t
        assert y.position is not None and y.velocity is not None
        n = self.mean_motion
        x, _, z = y.position
        u, v, _ = y.velocity
        rates = jnp.stack([3.0 * n * n * x + 2.0 * n * v, -2.0 * n * u, -n * n * z])
        return BodyState(position=y.velocity, velocity=rates)

    def invariants(self, t: Scalar, y: BodyState) -> dict[str, Array]:
        """The energy of the relative motion, that of the oscillation normal to the plane, and the
        momentum along the motion, n/2 times the distance of the ellipse's centre."""
        del t
        assert y.position is not None and y.velocity is not None
        n = self.mean_motion
        x, _, z = y.position
        _, v, w = y.velocity
        across = 0.5 * (w * w + n * n * z * z)
        in_plane = dot(y.velocity, y.velocity) - w * w - 3.0 * n * n * x * x
        return {
            "energy": 0.5 * in_plane + across,
            "normal_energy": across,
            "momentum_along": v + 2.0 * n * x,
        }

    def closed_form(self) -> RelativeMotion:
        return RelativeMotion(self.mean_motion)
