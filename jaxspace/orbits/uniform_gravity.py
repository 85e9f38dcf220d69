"""Uniform gravity over a plane, and the event of reaching that plane.

    v' = g,    z = 0

    symbol  meaning                       unit
    g       acceleration, inertial axes   m/s^2
    z       height over the plane         m

Source: Thomson 2.3. Valid over heights and distances that are small against the planet's radius.
"""

__all__ = ["touchdown"]

from typing import ClassVar, final

from jaxtyping import Array, Float

from ..bodies import AbstractBody, AbstractEffect, BodyState, Load
from ..core import Scalar, event, quantity
from ..core.formula import formula
from ..core.shapes import with_rank
from ..core.vectors import dot


@final
class UniformGravity(AbstractEffect):
    """Uniform gravity: the same acceleration everywhere."""

    acceleration: Float[Array, "3 *#runs"] = quantity(
        "m/s^2", doc="g, in inertial axes; the third axis points up by convention"
    )

    keeps: ClassVar[frozenset[str]] = frozenset({"energy"})
    uniform: ClassVar[bool] = True

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        del t, body
        return Load(acceleration_N=with_rank(self.acceleration, y.position.ndim - 1))

    def potential(self, t: Scalar, y: BodyState, body: AbstractBody) -> Scalar:
        del t, body
        return -dot(with_rank(self.acceleration, y.position.ndim - 1), y.position)


@formula
@event("m", direction=-1, needs=("position",))
def touchdown(t: Scalar, y: BodyState) -> Scalar:
    """The height, m, over the plane z = 0, through which a body falls.

    **Arguments**

    - `t`: time, s, not used.
    - `y`: the state, with a position."""
    del t
    return y.position[2]
