"""Steering laws: the direction of a thrust over time, or by the state of the flight.

    d = cos(phi) h + sin(phi) e           e: up, h = N x e: horizontal, downrange
    phi = sum_k c_k (t - t_s)^k           polynomial
    tan phi = (a + b tau)/(1 + c tau)     linear (c = 0) and bilinear tangent, tau = t - t_s
    d = (v - Omega x r)/|v - Omega x r|   along the flight, or along the air

    symbol  meaning                                                       unit
    phi     pitch: angle of the thrust above the horizontal               rad
    e       a fixed direction, or r/|r|, the local vertical               1
    N       normal of the plane of the flight; N x e points downrange     1
    t_s     time at which the law starts                                  s

Source: Thomson 8.3-9 (linear tangent), 8.5 (gravity turn); Bryson and Ho, Applied Optimal Control,
2.4, 2.7 (bilinear tangent).
"""

__all__ = [
    "AbstractSteering",
    "AlongVelocity",
    "FixedDirection",
    "FlightPlane",
    "PitchPolynomial",
    "PitchTable",
    "TangentSteering",
    "UserSteering",
]

from abc import abstractmethod
from collections.abc import Callable
from typing import final

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..bodies import BodyState
from ..core import AbstractParameters, NumberField, Scalar, Table, Vector, quantity
from ..core.shapes import with_rank
from ..core.vectors import axis, cross, unit


class AbstractSteering(AbstractParameters):
    """The direction of a thrust. A concrete law is final."""

    @abstractmethod
    def direction(self, t: Scalar, y: BodyState) -> Vector:
        """The unit vector of the thrust in inertial axes, (3, *runs), at the time `t`, s, in the
        state `y`."""

    def breaks(self) -> Float[Array, "times *#runs"] | None:
        """Times, s, at which the direction or a derivative of it jumps, or `None`."""
        return None


@final
class FlightPlane(AbstractParameters):
    """The plane in which a pitch is measured, by its `normal` and the direction of up."""

    normal: Float[Array, "3 *#runs"] = quantity(
        "",
        direction=True,
        default=(0.0, 1.0, 0.0),
        doc="of the plane: normal x up points downrange",
    )
    up: Float[Array, "3 *#runs"] | None = quantity(
        "",
        direction=True,
        optional=True,
        doc="fixed direction of up; by default that of the position",
    )

    def along(self, pitch: Scalar, y: BodyState) -> Vector:
        """The unit vector at a `pitch`, rad, above the horizontal, in inertial axes."""
        rank = y.position.ndim - 1
        # Along the position by default, so that the pitch counts from the local horizontal.
        up = unit(y.position if self.up is None else with_rank(self.up, rank))
        across = unit(cross(with_rank(self.normal, rank), up))
        return jnp.cos(pitch) * across + jnp.sin(pitch) * up


_PLANE_DOC = "plane of the flight; by default x and z, with up along the position"


class AbstractPitch(AbstractSteering):
    """A law for the pitch above the horizontal, in a plane."""

    plane: eqx.AbstractVar[FlightPlane | None]

    @abstractmethod
    def pitch(self, t: Scalar) -> Scalar:
        """The angle of the thrust above the horizontal, rad, at the time `t`, s."""

    def direction(self, t: Scalar, y: BodyState) -> Vector:
        # Made here: a default in the field would be one object shared by all laws.
        plane = FlightPlane() if self.plane is None else self.plane
        # The zero gives a pitch of the time alone the runs of the state.
        return plane.along(self.pitch(t) + 0.0 * y.position[0], y)


@final
class PitchTable(AbstractPitch):
    """A pitch linear between the points of a table, and constant outside."""

    times: Float[Array, "nodes *#runs"] = quantity("s", doc="ascending")
    angles: Float[Array, "nodes *#runs"] = quantity(
        "rad", doc="pitch above the horizontal at these times"
    )
    plane: FlightPlane | None = eqx.field(default=None, metadata={"doc": _PLANE_DOC})

    def pitch(self, t: Scalar) -> Scalar:
        return Table(self.times, self.angles)(t)

    def breaks(self) -> Float[Array, "times *#runs"]:
        return self.times


@final
class PitchPolynomial(AbstractPitch):
    """A pitch that is a polynomial of the time since `start`; one coefficient is a constant pitch,
    two are a constant rate."""

    coefficients: Float[Array, "terms *#runs"] = quantity(
        "", doc="c_0, rad, c_1, rad/s, and so on: pitch = sum of c_k (t - start)^k", least=1
    )
    start: NumberField = quantity("s", default=0.0, doc="from which the time counts")
    plane: FlightPlane | None = eqx.field(default=None, metadata={"doc": _PLANE_DOC})

    def pitch(self, t: Scalar) -> Scalar:
        tau = t - self.start
        total = 0.0 * tau
        # By nested products, which need no powers of a time that may be zero.
        for c in reversed(list(self.coefficients)):
            total = total * tau + c
        return total


@final
class TangentSteering(AbstractPitch):
    """The tangent of the pitch linear, or bilinear, in the time since `start`."""

    tangent: NumberField = quantity("", doc="a, of the pitch at the start")
    tangent_rate: NumberField = quantity("1/s", doc="b, its rate in the linear law")
    denominator_rate: NumberField = quantity("1/s", default=0.0, doc="c, zero in the linear law")
    start: NumberField = quantity("s", default=0.0, doc="from which the time counts")
    plane: FlightPlane | None = eqx.field(default=None, metadata={"doc": _PLANE_DOC})

    def pitch(self, t: Scalar) -> Scalar:
        tau = t - self.start
        # By both sides of the quotient, which is infinite for a vertical thrust.
        return jnp.arctan2(
            self.tangent + self.tangent_rate * tau, 1.0 + self.denominator_rate * tau
        )


@final
class FixedDirection(AbstractSteering):
    """A thrust along a fixed direction."""

    along: Float[Array, "3 *#runs"] = quantity(
        "", direction=True, doc="in inertial axes, of non-zero length"
    )

    def direction(self, t: Scalar, y: BodyState) -> Vector:
        del t
        like = y.position
        return unit(with_rank(self.along, like.ndim - 1)) + 0.0 * like


@final
class AlongVelocity(AbstractSteering):
    """A thrust along the velocity, or along the velocity relative to air that rotates about z: a
    gravity turn. At rest the direction is undefined, and the thrust is zero."""

    air_rate: NumberField = quantity(
        "rad/s", default=0.0, doc="rotation of the air about the z axis"
    )
    sense: NumberField = quantity(
        "", low=-1.0, high=1.0, default=1.0, doc="1 along the velocity, -1 against it"
    )

    def direction(self, t: Scalar, y: BodyState) -> Vector:
        del t
        # Relative to the air, because there the gravity turn has no angle of attack.
        air = cross(self.air_rate * axis(2, y.position[2]), y.position)
        return self.sense * unit(y.velocity - air)


@final
class UserSteering(AbstractSteering):
    """Steering by a user-defined function; not available in scene files.

    - `function`: (t, y) -> direction of the thrust, (3, *runs), which is scaled to unit length;
      preferably an `equinox.Module` with a `__call__`."""

    function: Callable[[Scalar, BodyState], Vector]

    def direction(self, t: Scalar, y: BodyState) -> Vector:
        return unit(self.function(t, y))


def joined_breaks(
    a: Float[Array, "some *#runs"], b: Float[Array, "more *#runs"]
) -> Float[Array, "times *#runs"]:
    """The break times of both, s, with the runs of both."""
    # One of them may be shared by the runs in which the other differs.
    runs = jnp.broadcast_shapes(a.shape[1:], b.shape[1:])
    both = (with_rank(x, len(runs)) for x in (a, b))
    return jnp.concatenate([jnp.broadcast_to(x, (x.shape[0], *runs)) for x in both])
