"""Motion seen from a frame that moves and turns, and from inertial space.

    V = V_o + C (v + w x r)
    A = A_o + C (a + 2 w x v + w' x r + w x (w x r))

    symbol         meaning                                                     unit
    r, v, a        position, velocity, acceleration relative to the frame,     m, m/s, m/s^2
                   components in its axes
    R, V, A        the same relative to inertial space, inertial components    m, m/s, m/s^2
    R_o, V_o, A_o  of the frame's origin, inertial components                  m, m/s, m/s^2
    C              turns components in the frame's axes into inertial ones     1
    w, w'          angular velocity of the frame, its rate, in its axes        rad/s, rad/s^2

Source: Thomson 2.5-4, 2.5-7 (general motion), 2.4-7 (on a turning curve: there the r' of
the Coriolis term is the velocity relative to the curve), 1.6-3.
"""

__all__ = ["instantaneous_centre", "path_components", "polar_components"]

from typing import final

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import Scalar, Vector
from ..core.formula import formula
from ..core.printing import printed
from ..core.shapes import with_rank
from ..core.square_roots import sqrt
from ..core.squares import unit_factor
from ..core.structure import HashedModule
from ..core.vectors import cross, dot, norm
from ._quaternion import Quaternion


def _zero() -> Array:
    # Weakly typed, so that the precision follows its operands.
    return jnp.full(3, 0.0)


def _sum(a: Vector, b: Vector) -> Vector:
    """a + b, where one may have fewer axes of runs."""
    rank = max(a.ndim, b.ndim) - 1
    return with_rank(a, rank) + with_rank(b, rank)


@final
@printed(omega="rad/s", omega_rate="rad/s^2", position="m", velocity="m/s", acceleration="m/s^2")
class MovingFrame(HashedModule):
    """A frame at an instant: motion of its origin, orientation and angular velocity.

    - `attitude`: from the frame's axes to inertial ones.
    - `omega`, rad/s: angular velocity, in the frame's axes.
    - `omega_rate`, rad/s^2: rate of the angular velocity, in the frame's axes.
    - `position`, m: of the origin, in inertial axes.
    - `velocity`, m/s: of the origin, in inertial axes.
    - `acceleration`, m/s^2: of the origin, in inertial axes.

    Vectors are (3, *runs); omitted vectors are zero."""

    attitude: Quaternion
    omega: Float[Array, "3 *#runs"] = eqx.field(default_factory=_zero)
    omega_rate: Float[Array, "3 *#runs"] = eqx.field(default_factory=_zero)
    position: Float[Array, "3 *#runs"] = eqx.field(default_factory=_zero)
    velocity: Float[Array, "3 *#runs"] = eqx.field(default_factory=_zero)
    acceleration: Float[Array, "3 *#runs"] = eqx.field(default_factory=_zero)

    def to_inertial(self, r: Vector, v: Vector, a: Vector) -> tuple[Vector, Vector, Vector]:
        """Position R, velocity V and acceleration A, (3, *runs), of a point that has r, v and a
        relative to the frame (Thomson 2.5-4, 2.5-7)."""
        rotate = self.attitude.rotate
        velocity = _sum(v, cross(self.omega, r))
        acceleration = _sum(a, self._due_to_rotation(r, v))
        return (
            _sum(self.position, rotate(r)),
            _sum(self.velocity, rotate(velocity)),
            _sum(self.acceleration, rotate(acceleration)),
        )

    def from_inertial(self, r: Vector, v: Vector, a: Vector) -> tuple[Vector, Vector, Vector]:
        """Position r, velocity v and acceleration a, (3, *runs), relative to the frame, of a point
        that has R, V and A relative to inertial space; undoes `to_inertial`."""
        rotate_back = self.attitude.rotate_back
        place = rotate_back(_sum(r, -self.position))
        velocity = _sum(rotate_back(_sum(v, -self.velocity)), -cross(self.omega, place))
        acceleration = rotate_back(_sum(a, -self.acceleration))
        return place, velocity, _sum(acceleration, -self._due_to_rotation(place, velocity))

    def _due_to_rotation(self, r: Vector, v: Vector) -> Vector:
        """Coriolis', Euler's and centripetal acceleration, in the frame's axes."""
        w = self.omega
        turning = _sum(cross(self.omega_rate, r), cross(w, cross(w, r)))
        return _sum(2.0 * cross(w, v), turning)


@formula
def instantaneous_centre(r: Vector, v: Vector, omega: Vector) -> Vector:
    """The point of a body, or of its extension, that is at rest in a plane motion.

    **Arguments**

    - `r`, `v`: position and velocity of any point of the body, m and m/s, (3, *runs).
    - `omega`: angular velocity, rad/s, (3, *runs), in the same axes.

    **Returns** the instantaneous centre, m, (3, *runs) (Thomson 3.3-1): in space, the nearest point
    to `r` on the axis of the instantaneous screw. NaN for a body that does not turn: it has none.
    """
    # In float32 the square of a slow rate is zero.
    factor = unit_factor(*omega)
    scaled = factor * omega
    return r + factor * (cross(scaled, v) / dot(scaled, scaled))


@formula
def polar_components(
    r: Scalar,
    r_rate: Scalar,
    r_acceleration: Scalar,
    angle_rate: Scalar,
    angle_acceleration: Scalar,
) -> tuple[Float[Array, "2 *#runs"], Float[Array, "2 *#runs"]]:
    """Velocity and acceleration of a plane motion, along and across the radius (Thomson 2.2-7).

    **Arguments**, each (*runs,)

    - `r`, `r_rate`, `r_acceleration`: distance and its derivatives, m, m/s, m/s^2.
    - `angle_rate`, `angle_acceleration`: derivatives of the polar angle, rad/s, rad/s^2.

    **Returns** (r', r theta'), m/s, and (r'' - r theta'^2, r theta'' + 2 r' theta'), m/s^2, each
    (2, *runs).
    """
    velocity = jnp.stack(jnp.broadcast_arrays(r_rate, r * angle_rate))
    along = r_acceleration - r * angle_rate * angle_rate
    across = r * angle_acceleration + 2.0 * r_rate * angle_rate
    return velocity, jnp.stack(jnp.broadcast_arrays(along, across))


@formula
def path_components(v: Vector, a: Vector) -> tuple[Scalar, Scalar, Scalar]:
    """Acceleration along and across a path, and the curvature of the path (Thomson 2.3-5).

    **Arguments**

    - `v`, `a`: velocity, m/s, and acceleration, m/s^2, (3, *runs).

    **Returns** s'' and s'^2/rho, m/s^2, and the curvature 1/rho, 1/m, each (*runs,); zero on a
    straight path. A point at rest has no path: NaN.
    """
    square = dot(v, v)
    speed = sqrt(square)
    across = norm(cross(v, a))
    return dot(v, a) / speed, across / speed, across / (square * speed)
