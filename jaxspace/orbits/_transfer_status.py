"""Reasons why a transfer of Lambert's problem does not exist or is not unique."""

import enum

import jax.numpy as jnp
from jaxtyping import Array, Int

from ..core import Flag, Scalar, Vector
from ..core.shapes import with_rank
from ..core.vectors import axis, cross, dot


class TransferStatus(enum.IntEnum):
    """Whether `lambert` has a unique solution; `sentence` explains why not, and how to proceed."""

    FOUND = 0
    INVALID = 1
    SAME_PLACE = 2
    NO_PLANE = 3
    TOO_SHORT = 4
    NO_WAY = 5

    @property
    def sentence(self) -> str:
        """Explanation of the status, and how to proceed."""
        return _SENTENCES[self]


_SENTENCES = {
    TransferStatus.FOUND: "The transfer exists and is the only one of its kind.",
    TransferStatus.INVALID: (
        "A place, the normal, the duration or mu is not finite, a place is the centre, or the "
        "duration or mu is not positive: check the inputs."
    ),
    TransferStatus.SAME_PLACE: (
        "Start and end are the same place: every orbit with this period returns to it. Give "
        "different places."
    ),
    TransferStatus.NO_PLANE: (
        "Start and end are opposite each other, so that every plane through them contains a "
        "transfer: select one with a `normal` that is not along the start."
    ),
    TransferStatus.TOO_SHORT: (
        "The duration is below the minimum for this number of revolutions: see `least_duration`."
    ),
    TransferStatus.NO_WAY: (
        "The plane of start and end contains the normal, by default the third axis, so that "
        "neither direction of motion is counterclockwise about it: give a `normal` that is not in "
        "this plane."
    ),
}


def rounding_of_directions(x: Scalar) -> float:
    """The bound below which the sine of the angle between two directions is rounding error, so that
    they do not define a plane."""
    return 4.0 * float(jnp.finfo(x.dtype).eps)


def way_is_undecided(directions: tuple[Vector, Vector], normal: Vector | None) -> Flag:
    """Whether the plane of both `directions`, (3, *runs), contains the `normal`, (3, *runs), to
    rounding. Directions on one line define no plane."""
    i1, i2 = directions
    up = axis(2, jnp.ones_like(i1[0])) if normal is None else with_rank(normal, i1.ndim - 1)
    n = cross(i1, i2)
    turn = dot(n, up)
    noise = rounding_of_directions(turn)
    return (dot(n, n) > noise * noise) & (turn * turn <= noise * noise * dot(up, up))


def geometry_status(
    places: tuple[Scalar, Scalar, Scalar],
    directions: tuple[Vector, Vector],
    duration: Scalar,
    mu: Scalar,
    normal: Vector | None,
) -> Int[Array, "*runs"]:
    """The `TransferStatus` that follows from positions, duration and plane.

    **Arguments**

    - `places`: |r1|, |r2| and their distance, m, (*runs,).
    - `directions`: of r1 and r2, (3, *runs).
    - `duration`, `mu`, `normal`: as in `lambert`.

    **Returns** the status, (*runs,).
    """
    r1, r2, c = places
    i1, i2 = directions
    # Not finite where a place, and so the distance, is not.
    valid = (r1 > 0.0) & (r2 > 0.0) & jnp.isfinite(c)
    valid = valid & (duration > 0.0) & jnp.isfinite(duration) & (mu > 0.0) & jnp.isfinite(mu)
    noise = rounding_of_directions(r1)
    n = cross(i1, i2)
    opposite = (dot(n, n) <= noise * noise) & (dot(i1, i2) < 0.0)
    if normal is not None:
        up = with_rank(normal, i1.ndim - 1)
        size = dot(up, up)
        valid = valid & jnp.isfinite(size)
        # A normal along the start leaves no plane either.
        across = cross(i1, up)
        opposite = opposite & (dot(across, across) <= noise * noise * size)
    # The last true condition decides: for invalid inputs, the others are meaningless.
    undecided = way_is_undecided(directions, normal)
    status = jnp.where(undecided, TransferStatus.NO_WAY, TransferStatus.FOUND)
    status = jnp.where(opposite, TransferStatus.NO_PLANE, status)
    status = jnp.where(c == 0.0, TransferStatus.SAME_PLACE, status)
    return jnp.where(valid, status, TransferStatus.INVALID).astype(jnp.int32)
