"""Control moment gyros: wheels of constant speed whose axes are turned by gimbals.

    s_i = cos(d_i) s0_i + sin(d_i) g_i x s0_i           axis of a wheel
    H = J omega + sum h_i s_i
    J omega' = M - sum h_i d_i' t_i - omega x H,        t_i = g_i x s_i

    symbol    meaning                                                         unit
    g_i, s_i  axes of the gimbal and of the wheel, of length one              1
    d_i       angle of the gimbal, from the position where the axis is s0_i   rad
    h_i       angular momentum of the wheel relative to the body              kg m^2/s
    t_i       direction of the torque required to turn the gimbal             1
    J         inertia of all, with the wheels and gimbals locked              kg m^2

Source: Thomson 7.11 (relative momentum); Wie, Space Vehicle Dynamics and Control, 7.4.
The gimbals turn at given rates. Valid for gimbals and wheels that are small compared with the body:
J does not change with the angles, and the momentum of the gimbals about their axes is left out.
"""

from collections.abc import Callable
from typing import ClassVar, final

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..bodies import AbstractBody, AbstractEffect, BodyState, Load
from ..core import Scalar, State, quantity
from ..core.shapes import with_rank
from ..core.vectors import cross, unit


@final
class ControlMomentGyros(AbstractEffect):
    """Single-gimbal control moment gyros in a body.

    `Scene.start` adds the part `gimbals` to a state: the gimbal angles, rad, (gyros, *runs).

    - `steering`: a function (t, y, torques) that returns the gimbal rates, rad/s, (gyros, *runs);
      `torques` is the matrix that `torque_matrix` returns. Without it the gimbals turn at the
      constant `gimbal_rate`."""

    keeps: ClassVar[frozenset[str]] = frozenset(
        {"angular_momentum", "axial_angular_momentum", "rotational_momentum"}
    )

    gimbal_axes: Float[Array, "3 gyros *#runs"] = quantity(
        "", direction=True, doc="g_i as columns: x of all gyros, y, z; of non-zero length"
    )
    spin_axes: Float[Array, "3 gyros *#runs"] = quantity(
        "", direction=True, doc="s0_i as columns, across the gimbal axes; of non-zero length"
    )
    momentum: Float[Array, "gyros *#runs"] = quantity("kg m^2/s", doc="h_i, of each wheel")
    gimbal_angle: Float[Array, "gyros *#runs"] = quantity("rad", doc="d_i, at the start")
    gimbal_rate: Float[Array, "gyros *#runs"] = quantity("rad/s", doc="d_i', of each gimbal")
    steering: Callable[[Scalar, BodyState, Array], Array] | None = None
    part: str = eqx.field(
        static=True, default="gimbals", metadata={"doc": "name of its part of the state"}
    )

    def start(self, y: BodyState, body: AbstractBody) -> dict[str, State]:
        del body
        angle = with_rank(self.gimbal_angle, y.omega.ndim - 1)
        return {self.part: angle + 0.0 * y.omega[:1]}

    def wheel_axes(self, angles: Array) -> Array:
        """s_i, (3, gyros, *runs), at the `angles`, rad, (gyros, *runs)."""
        rank = angles.ndim - 1
        along = with_rank(unit(self.spin_axes), rank, axes=2)
        across = with_rank(cross(unit(self.gimbal_axes), unit(self.spin_axes)), rank, axes=2)
        return jnp.cos(angles) * along + jnp.sin(angles) * across

    def torque_matrix(self, angles: Array) -> Array:
        """h_i t_i, N m per rad/s, (3, gyros, *runs), at the `angles`, rad: torque on the gyros per
        rate of each gimbal. Singular gimbal angles are those where its rank is below three.
        """
        rank = angles.ndim - 1
        gimbal = with_rank(unit(self.gimbal_axes), rank, axes=2)
        return with_rank(self.momentum, rank) * cross(gimbal, self.wheel_axes(angles))

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        del body
        angles = y.part(self.part)
        rank = angles.ndim - 1
        torques = self.torque_matrix(angles)
        if self.steering is None:
            rates = with_rank(self.gimbal_rate, rank) + 0.0 * angles
        else:
            rates = self.steering(t, y, torques)
        return Load(
            torque_B=-jnp.sum(torques * rates, axis=1),
            parts_rate={self.part: rates},
            momentum_B=jnp.sum(with_rank(self.momentum, rank) * self.wheel_axes(angles), axis=1),
        )
