"""Attitude of a thin disk on a horizontal plane: its triad and its tilt.

xi is horizontal along the tangent at the contact, eta in the disk up from the contact; the normal
is z. Equations in `_rolling_disk.py`.
"""

__all__ = ["disk_tilt", "lies_flat"]

import jax.numpy as jnp

from ..bodies import BodyState
from ..core import Scalar, Vector, event, output
from ..core.formula import formula
from ..core.square_roots import sqrt
from ..rotations import Quaternion
from ._state import vertical


@output("rad")
def disk_tilt(attitude: Quaternion) -> Scalar:
    """Angle of the normal, z, with the upward vertical, rad: pi/2 for an upright disk."""
    Z = vertical(attitude)
    # Not by the arc cosine, which has lost half of its digits near flat.
    return jnp.arctan2(jnp.sqrt(Z[0] * Z[0] + Z[1] * Z[1]), Z[2])


@formula
@event("", direction=-1, needs=("attitude",))
def lies_flat(t: Scalar, y: BodyState) -> Scalar:
    """theta - 1e-4 rad: zero where a settling coin is almost flat.

    **Arguments**

    - `t`: time, s, not used.
    - `y`: the state, with an attitude."""
    del t
    # Not at zero itself, towards which the precession grows without bound and the steps shrink.
    return disk_tilt(y.attitude) - 1e-4


def disk_triad(attitude: Quaternion) -> tuple[Vector, Vector, Scalar, Scalar]:
    """xi and eta in body axes, (3, *runs), and sine and cosine of theta."""
    Z = vertical(attitude)
    s = sqrt(Z[0] * Z[0] + Z[1] * Z[1])
    zero = jnp.zeros_like(s)
    return jnp.stack([Z[1], -Z[0], zero]) / s, jnp.stack([Z[0], Z[1], zero]) / s, s, Z[2]
