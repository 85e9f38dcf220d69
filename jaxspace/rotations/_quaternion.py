"""Orientation as a unit quaternion, scalar first, Hamilton's product.

    q = (w, x, y, z)            turns components in the body's axes into components in inertial axes
    v_N = C_NB v_B              C_NB(q): the matrix of the same turn
    q' = q (0, omega_B) / 2     omega_B: rate of the body relative to inertial space, in body axes

    symbol   meaning                                  unit
    w        cosine of half the angle of turn         1
    x, y, z  axis of turn times sine of half angle    1
    omega_B  angular velocity in body axes            rad/s
    x        coordinates of q about q_0, Rodrigues's: axis of turn times twice the tangent of half
             the angle, near zero the rotation vector

    q = q_0 (1, x/2)/|(1, x/2)|,   x' = omega_B + x cross omega_B/2 + x (x . omega_B)/4

Source: Thomson 5.1 (Euler's theorem: every displacement with a fixed point is one turn), 3.4
(matrix), 3-P13 (rates).

A quaternion of any non-zero length represents the rotation of its direction: results do not change
when it deviates from unit length by the integration error within a step. Integrators bring it back
to unit length at the end of every step.
"""

from collections.abc import Sequence
from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..core import AbstractGroupElement, Matrix, Scalar, Vector, check
from ..core.checks import is_concrete
from ..core.printing import printed
from ..core.safe import safe_atan2, sinc_squared
from ..core.shapes import check_components, with_rank
from ..core.square_roots import inverse_sqrt
from ..core.types import as_float
from ..core.vectors import axis, components, cross, dot, norm, unit


@final
@printed()
class Quaternion(AbstractGroupElement):
    """An orientation, which maps body components to inertial components.

    - `wxyz`: the components, scalar part first, (4, *runs).

    Every method accepts one orientation, those along a trajectory, (4, times, *runs), and vectors
    with fewer or more batch axes. Raises `InputError`, at construction and in every method, for an
    array whose first axis does not have the components."""

    wxyz: Float[Array, "4 *#runs"] = eqx.field(converter=as_float)

    def __check_init__(self):
        check_components("Quaternion.wxyz", self.wxyz, 4)

    def check_start(self) -> None:
        """Raise `InputError` for a concrete quaternion of zeros, which is not a valid orientation;
        the rate of a quaternion may be zero."""
        if is_concrete(self.wxyz):
            q = np.asarray(self.wxyz)
            check(np.any(q != 0.0, axis=0), "Quaternion.wxyz", q, "of non-zero length")

    @classmethod
    def identity(cls) -> "Quaternion":
        """The orientation in which body and inertial axes coincide."""
        return cls([1.0, 0.0, 0.0, 0.0])

    @classmethod
    def from_xyzw(cls, xyzw: Float[Array, "4 *#runs"]) -> "Quaternion":
        """The orientation of a quaternion stored scalar-last, (4, *runs)."""
        check_components("Quaternion.from_xyzw: xyzw", xyzw, 4)
        return cls(jnp.concatenate([xyzw[3:], xyzw[:3]]))

    @classmethod
    def from_rotation_vector(cls, angle_axis: Vector) -> "Quaternion":
        """The turn about the direction of `angle_axis` through its length, rad; smooth at zero."""
        check_components("Quaternion.from_rotation_vector: angle_axis", angle_axis, 3)
        z = dot(angle_axis, angle_axis) / 4.0
        # cos(s) = 1 - 2 sin^2(s/2), in functions of s^2: no square root, which has no derivative
        # at zero.
        scalar = 1.0 - 2.0 * (z / 4.0) * sinc_squared(z / 4.0) ** 2
        return cls(jnp.concatenate([scalar[None], 0.5 * sinc_squared(z) * angle_axis]))

    @classmethod
    def from_axis_angle(cls, axis: Vector, angle: Scalar) -> "Quaternion":
        """The turn about `axis`, (3, *runs), of non-zero length, through `angle`, rad, of any
        size."""
        check_components("Quaternion.from_axis_angle: axis", axis, 3)
        angle = jnp.asarray(angle)
        rank = max(axis.ndim - 1, angle.ndim)
        direction = with_rank(unit(axis), rank)
        # The zero gives the cosine the runs of the axis, so that both can be joined.
        scalar = jnp.cos(angle / 2.0) + 0.0 * direction[0]
        return cls(jnp.concatenate([scalar[None], jnp.sin(angle / 2.0) * direction]))

    @classmethod
    def about(cls, index: int, angle: Scalar) -> "Quaternion":
        """The turn about the axis `index` (0, 1, 2) through `angle`, rad."""
        angle = jnp.asarray(angle)
        return cls(
            jnp.concatenate([jnp.cos(angle / 2.0)[None], jnp.sin(angle / 2.0) * axis(index, angle)])
        )

    @classmethod
    def from_matrix(cls, m: Matrix) -> "Quaternion":
        """The orientation of a rotation matrix C_NB, (3, 3, *runs)."""
        check_components("Quaternion.from_matrix: m", m, 3, axes=2)
        # Of Shepperd's four forms the one with the largest pivot: the others lose digits where
        # their divisor is small.
        t = m[0, 0] + m[1, 1] + m[2, 2]
        pivots = jnp.stack([t, m[0, 0], m[1, 1], m[2, 2]])
        x = m[2, 1] - m[1, 2]
        y = m[0, 2] - m[2, 0]
        z = m[1, 0] - m[0, 1]
        p = m[0, 1] + m[1, 0]
        q = m[0, 2] + m[2, 0]
        r = m[1, 2] + m[2, 1]
        d0, d1, d2 = (1.0 - t + 2.0 * m[i, i] for i in range(3))
        rows = [[1.0 + t, x, y, z], [x, d0, p, q], [y, p, d1, r], [z, q, r, d2]]
        best = jnp.argmax(pivots, axis=0)
        wxyz = jnp.select([best == i for i in range(4)], [jnp.stack(row) for row in rows])
        # Each form is the quaternion times a different factor: the length is removed.
        return cls(wxyz * inverse_sqrt(jnp.sum(wxyz**2, axis=0)))

    def xyzw(self) -> Float[Array, "4 *#runs"]:
        """The components stored scalar-last, (4, *runs)."""
        q = self._components()
        return jnp.concatenate([q[1:], q[:1]])

    @property
    def norm_squared(self) -> Scalar:
        """Sum of the squares of the four components; 1 for an orientation."""
        w, x, y, z = components(self._components())
        return w * w + x * x + y * y + z * z

    def normalised(self) -> "Quaternion":
        """The same orientation with unit length."""
        return Quaternion(self._components() * inverse_sqrt(self.norm_squared))

    def inverse(self) -> "Quaternion":
        """The opposite turn: inertial components to body components."""
        w, x, y, z = components(self._components())
        # Not the conjugate alone, so that the product with the inverse is one at any length.
        return Quaternion(jnp.stack([w, -x, -y, -z]) / self.norm_squared)

    def then(self, turn: "Quaternion") -> "Quaternion":
        """This orientation followed by `turn` about the body's own axes: the product q turn."""
        rank = max(self.wxyz.ndim, turn.wxyz.ndim) - 1
        a = with_rank(self._components(), rank)
        b = with_rank(turn._components(), rank)
        return Quaternion(_product(components(a), components(b)))

    def rotate(self, v_B: Vector) -> Vector:
        """Inertial components of the vector whose body components are `v_B`, (3, *runs)."""
        check_components("Quaternion.rotate: v_B", v_B, 3)
        w, u, v_B = self._meeting(v_B)
        # Divided by the squared length, so that a length other than one changes nothing.
        s = 2.0 / self.norm_squared
        return v_B + s * cross(u, cross(u, v_B) + w * v_B)

    def rotate_back(self, v_N: Vector) -> Vector:
        """Body components of the vector whose inertial components are `v_N`, (3, *runs)."""
        check_components("Quaternion.rotate_back: v_N", v_N, 3)
        w, u, v_N = self._meeting(v_N)
        s = 2.0 / self.norm_squared
        return v_N + s * cross(u, cross(u, v_N) - w * v_N)

    def matrix(self) -> Matrix:
        """The matrix C_NB, (3, 3, *runs)."""
        # Its columns are the body's axes in inertial components.
        one = jnp.ones_like(self._components()[0])
        return jnp.stack([self.rotate(axis(i, one)) for i in range(3)], axis=1)

    def rate(self, omega_B: Vector) -> "Quaternion":
        """Rate of change, 1/s, for the angular velocity `omega_B`, rad/s, in body axes."""
        check_components("Quaternion.rate: omega_B", omega_B, 3)
        rank = max(self.wxyz.ndim, omega_B.ndim) - 1
        q = components(with_rank(self._components(), rank))
        return Quaternion(0.5 * _product(q, [None, *components(with_rank(omega_B, rank))]))

    def coordinates(self) -> Vector:
        return 0.0 * self._components()[1:]

    def moved(self, local: Vector) -> "Quaternion":
        check_components("Quaternion.moved: local", local, 3)
        # Rational, because an integrator comes here at every stage; of unit length, so that many of
        # its steps stay on the group.
        turn = jnp.concatenate([jnp.ones_like(local[:1]), 0.5 * local])
        return self.then(Quaternion(turn)).normalised()

    def projected(self) -> "Quaternion":
        return self.normalised()

    def coordinate_rate(self, local: Vector, rate: "Quaternion") -> Vector:
        check_components("Quaternion.coordinate_rate: local", local, 3)
        # q' = q (0, omega_B) / 2, solved for omega_B.
        omega_B = 2.0 * self.inverse().then(rate).wxyz[1:]
        rank = max(local.ndim, omega_B.ndim) - 1
        x, w = with_rank(local, rank), with_rank(omega_B, rank)
        return w + 0.5 * cross(x, w) + (0.25 * dot(x, w)) * x

    def rotation_vector(self) -> Vector:
        """Axis of turn times angle, rad, the angle within [0, pi]; smooth at zero."""
        q = self._components()
        # q and -q are one orientation; the one with w >= 0 has the angle within [0, pi].
        q = jnp.where(q[0] < 0.0, -q, q)
        w = q[0]
        u = q[1:]
        s = norm(u)
        half = safe_atan2(s, w)
        # The angle over its sine, whose derivatives near zero come from a series.
        far = s > 1e-3 * w
        along = 2.0 * half * _direction(jnp.where(far, u, axis(0, w)))
        return jnp.where(far, along, _two_atan_over(s, w) * u)

    def axis_angle(self) -> tuple[Vector, Scalar]:
        """Axis of turn, a unit vector, and angle within [0, pi], rad (Thomson 5.1).

        Without a turn the axis is the zero vector, and both have derivatives of zero. At half a
        turn one of two opposite axes is returned."""
        q = self._components()
        # q and -q are one orientation: the one with w >= 0 has the shorter turn.
        q = jnp.where(q[0] < 0.0, -q, q)
        return unit(q[1:]), 2.0 * safe_atan2(norm(q[1:]), q[0])

    def _components(self) -> Float[Array, "4 *#runs"]:
        """`wxyz`, checked: transformations of trees rebuild a quaternion without a check."""
        check_components("Quaternion.wxyz", self.wxyz, 4)
        return self.wxyz

    def _meeting(self, vector: Vector) -> tuple[Scalar, Vector, Vector]:
        """w, (x, y, z) and the `vector`, with as many axes of runs as the one that has more."""
        q = self._components()
        rank = max(q.ndim, vector.ndim) - 1
        q = with_rank(q, rank)
        return q[0], q[1:], with_rank(vector, rank)


def _product(a: Sequence[Scalar], b: Sequence[Scalar | None]) -> Float[Array, "4 *#runs"]:
    """Hamilton's product by components; `None` in front of a vector is its zero."""
    w, x, y, z = a
    s, p, q, r = b
    rows = [
        -x * p - y * q - z * r,
        w * p + y * r - z * q,
        w * q + z * p - x * r,
        w * r + x * q - y * p,
    ]
    if s is not None:
        rows = [c * s + row for c, row in zip(a, rows, strict=True)]
    return jnp.stack(rows)


@jax.custom_jvp
def _direction(u: Vector) -> Vector:
    """u / |u|, for a vector of non-zero length."""
    return u / norm(u)


@_direction.defjvp
def _direction_tangent(primals, tangents):
    (u,), (du,) = primals, tangents
    e = _direction(u)
    # The part of du across u: the part along it would leave its rounding, which matters near half a
    # turn, where an axis that hardly moves is multiplied by pi.
    return e, cross(e, cross(du, e)) / norm(u)


def _two_atan_over(s: Scalar, w: Scalar) -> Scalar:
    """2 atan(s / w) / s by its series in s / w, for s much smaller than w."""
    # Zero in place of an argument for which the series is not meant, because a power of it could
    # overflow, and the derivative of the branch not taken would be NaN.
    x = s / jnp.where(w > 0.0, w, 1.0)
    z = jnp.where(jnp.abs(x) < 2e-3, x * x, 0.0)
    return 2.0 / jnp.where(w > 0.0, w, 1.0) * (1.0 - z * (1.0 / 3.0 - z * (1.0 / 5.0 - z / 7.0)))
