"""The pitch kick: the turn of the velocity by which a rocket that rises vertically begins its
gravity turn.

    w = v - Omega x r                                      a = e x h = N less its part along e
    w+ = w cos(k) + a x w sin(k) + a (a . w)(1 - cos k)    v+ = w+ + Omega x r

    symbol  meaning                                                      unit
    k       angle of the kick, from the vertical towards downrange       rad
    v, w    velocity, and relative to air that turns about z             m/s
    e, h    up, and downrange: h = N x e                                 1
    N       normal of the plane of the flight                            1

Source: Thomson 8.5 (Fig. 8.5-1). A manoeuvre that takes the vehicle seconds is instantaneous here:
the speed, and with it the energy relative to the air, are unchanged.
"""

from typing import ClassVar, final

import equinox as eqx
import jax.numpy as jnp

from ..bodies import AbstractJump, BodyState
from ..core import NumberField, Scalar, quantity
from ..core.shapes import with_rank
from ..core.vectors import axis, cross, dot, unit
from .steering import FlightPlane


@final
class PitchKick(AbstractJump):
    """The velocity relative to the air turned by an angle from up towards downrange, between two
    phases of a mission. Position, attitude and mass are unchanged."""

    needs: ClassVar[frozenset[str]] = frozenset({"position", "velocity"})

    angle: NumberField = quantity("rad", doc="k, of the turn, positive downrange")
    air_rate: NumberField = quantity(
        "rad/s", default=0.0, doc="rotation of the air about the z axis"
    )
    plane: FlightPlane | None = eqx.field(
        default=None,
        metadata={"doc": "plane of the flight; by default x and z, with up along the position"},
    )

    def __call__(self, t: Scalar, y: BodyState) -> BodyState:
        """The state after the kick."""
        del t
        plane = FlightPlane() if self.plane is None else self.plane
        rank = y.position.ndim - 1
        up = unit(y.position if plane.up is None else with_rank(plane.up, rank))
        normal = with_rank(plane.normal, rank)
        # Orthogonal to up, so that the turn stays in the plane of the flight.
        about = unit(normal - dot(normal, up) * up)
        air = cross(self.air_rate * axis(2, y.position[2]), y.position)
        w = y.velocity - air
        c = jnp.cos(self.angle)
        s = jnp.sin(self.angle)
        # By the formula of Rodrigues, for any direction of the velocity.
        turned = c * w + s * cross(about, w) + (1.0 - c) * dot(about, w) * about
        return eqx.tree_at(lambda y: y.velocity, y, turned + air)
