"""Orientation as a unit quaternion, scalar first, Hamilton's product.

    q = (w, x, y, z)            turns components in the body's axes into components in inertial axes
    v_N = C_NB v_B              C_NB(q): the matrix of the same turn
    q' = q (0, omega_B) / 2     omega_B: rate of the body relative to inertial space, in body axes
    theta' = omega_B + theta x omega_B / 2 + (1 - (theta/2) cot(theta/2)) theta x (theta x omega_B) / theta^2

    symbol   meaning                                  unit
    w        cosine of half the angle of turn         1
    x, y, z  axis of turn times sine of half angle    1
    omega_B  angular velocity in body axes            rad/s
    theta    turn from q_0, q = q_0 exp(theta/2)      rad

Source: Thomson 5.1 (Euler's theorem: every displacement with a fixed point is one turn), 3.4
(matrix), 3-P13 (rates). A quaternion of any length but zero stands for the turn of its direction:
the small departure from unit length that an integration leaves bends no vector.
"""

from typing import final

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import (
    AbstractGroupElement,
    Matrix,
    Scalar,
    Vector,
    as_float,
    axis,
    cross,
    dot,
    norm,
    safe_atan2,
    sinc_squared,
)


@final
class Quaternion(AbstractGroupElement):
    """An orientation: `wxyz`, shape (4, *runs), maps body components to inertial components."""

    wxyz: Float[Array, "4 *#runs"] | Float[Array, "*#rows 4"] = eqx.field(converter=as_float)

    @classmethod
    def identity(cls) -> "Quaternion":
        """The orientation in which body and inertial axes coincide."""
        return cls([1.0, 0.0, 0.0, 0.0])

    @classmethod
    def from_xyzw(cls, xyzw: Float[Array, "4 *#runs"]) -> "Quaternion":
        """From scalar-last storage."""
        return cls(jnp.concatenate([xyzw[3:], xyzw[:3]]))

    @classmethod
    def from_rotation_vector(cls, angle_axis: Vector) -> "Quaternion":
        """The turn about the direction of `angle_axis` through its length, rad; smooth at zero."""
        z = dot(angle_axis, angle_axis) / 4.0
        scalar = 1.0 - 2.0 * (z / 4.0) * sinc_squared(z / 4.0) ** 2
        return cls(jnp.concatenate([scalar[None], 0.5 * sinc_squared(z) * angle_axis]))

    @classmethod
    def about(cls, index: int, angle: Scalar) -> "Quaternion":
        """The turn about the axis `index` (0, 1, 2) through `angle`, rad."""
        angle = jnp.asarray(angle)
        return cls(
            jnp.concatenate([jnp.cos(angle / 2.0)[None], jnp.sin(angle / 2.0) * axis(index, angle)])
        )

    @classmethod
    def from_matrix(cls, m: Matrix) -> "Quaternion":
        """From a rotation matrix C_NB: of Shepperd's four forms the one with the largest pivot, so
        that no digit is lost."""
        t = m[0, 0] + m[1, 1] + m[2, 2]
        pivots = jnp.stack([t, m[0, 0], m[1, 1], m[2, 2]])
        x, y, z = m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
        p, q, r = m[0, 1] + m[1, 0], m[0, 2] + m[2, 0], m[1, 2] + m[2, 1]
        d0, d1, d2 = (1.0 - t + 2.0 * m[i, i] for i in range(3))
        rows = [[1.0 + t, x, y, z], [x, d0, p, q], [y, p, d1, r], [z, q, r, d2]]
        best = jnp.argmax(pivots, axis=0)
        wxyz = jnp.select([best == i for i in range(4)], [jnp.stack(row) for row in rows])
        return cls(wxyz / jnp.sqrt(jnp.sum(wxyz**2, axis=0)))

    def xyzw(self) -> Float[Array, "4 *#runs"]:
        """In scalar-last storage."""
        return jnp.concatenate([self.wxyz[1:], self.wxyz[:1]])

    def norm_squared(self) -> Scalar:
        """Sum of the squares of the four components; 1 for an orientation."""
        q = self.wxyz
        return q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]

    def normalised(self) -> "Quaternion":
        """The same orientation with unit length."""
        return Quaternion(self.wxyz / jnp.sqrt(self.norm_squared()))

    def inverse(self) -> "Quaternion":
        """The opposite turn: inertial components to body components."""
        q = self.wxyz
        return Quaternion(jnp.concatenate([q[:1], -q[1:]]) / self.norm_squared())

    def then(self, turn: "Quaternion") -> "Quaternion":
        """This orientation followed by `turn` about the body's own axes: the product q turn."""
        a, b = self.wxyz, turn.wxyz
        u, v = a[1:], b[1:]
        return Quaternion(
            jnp.concatenate([(a[0] * b[0] - dot(u, v))[None], a[0] * v + b[0] * u + cross(u, v)])
        )

    def rotate(self, v_B: Vector) -> Vector:
        """Inertial components of the vector whose body components are `v_B`."""
        w, u = self.wxyz[0], self.wxyz[1:]
        s = 2.0 / self.norm_squared()
        return v_B + s * cross(u, cross(u, v_B) + w * v_B)

    def rotate_back(self, v_N: Vector) -> Vector:
        """Body components of the vector whose inertial components are `v_N`."""
        w, u = self.wxyz[0], self.wxyz[1:]
        s = 2.0 / self.norm_squared()
        return v_N + s * cross(u, cross(u, v_N) - w * v_N)

    def matrix(self) -> Matrix:
        """The matrix C_NB, whose columns are the body's axes in inertial components."""
        one = jnp.ones_like(self.wxyz[0])
        return jnp.stack([self.rotate(axis(i, one)) for i in range(3)], axis=1)

    def rate(self, omega_B: Vector) -> "Quaternion":
        """Rate of change of the quaternion, 1/s, for the angular velocity `omega_B`, rad/s, in body
        axes."""
        w, u = self.wxyz[0], self.wxyz[1:]
        return Quaternion(
            0.5 * jnp.concatenate([-dot(u, omega_B)[None], w * omega_B + cross(u, omega_B)])
        )

    def coordinates(self) -> Vector:
        return 0.0 * self.wxyz[1:]

    def moved(self, local: Vector) -> "Quaternion":
        return self.then(Quaternion.from_rotation_vector(local)).normalised()

    def coordinate_rate(self, local: Vector, rate: "Quaternion") -> Vector:
        omega_B = 2.0 * self.inverse().then(rate).wxyz[1:]
        across = cross(local, omega_B)
        return omega_B + 0.5 * across + _bend(dot(local, local)) * cross(local, across)

    def rotation_vector(self) -> Vector:
        """Axis of turn times angle, rad, the angle within [0, pi]; smooth at zero."""
        q = jnp.where(self.wxyz[0] < 0.0, -self.wxyz, self.wxyz)
        u, w = q[1:], q[0]
        s = norm(u)
        half = safe_atan2(s, w)
        return (
            jnp.where(s > 1e-3 * w, 2.0 * half / jnp.where(s > 0.0, s, 1.0), _two_atan_over(s, w))
            * u
        )


def _bend(z: Scalar) -> Scalar:
    """(1 - s cot(s)) / (4 s^2) of z = 4 s^2, with its series about z = 0; singular at a whole
    turn."""
    small = z < 0.1
    y, x = jnp.where(small, z, 0.0), jnp.where(small, 1.0, z)
    s = 0.5 * jnp.sqrt(x)
    series = 691.0 / 1307674368000.0
    for inverse in (47900160.0, 1209600.0, 30240.0, 720.0, 12.0):
        series = 1.0 / inverse + y * series
    return jnp.where(small, series, (1.0 - s / jnp.tan(s)) / x)


def _two_atan_over(s: Scalar, w: Scalar) -> Scalar:
    """2 atan(s / w) / s by its series in s / w, for s much smaller than w."""
    x = s / jnp.where(w > 0.0, w, 1.0)
    z = jnp.where(jnp.abs(x) < 2e-3, x * x, 0.0)
    return 2.0 / jnp.where(w > 0.0, w, 1.0) * (1.0 - z * (1.0 / 3.0 - z * (1.0 / 5.0 - z / 7.0)))
