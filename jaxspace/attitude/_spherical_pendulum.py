"""The spherical pendulum: a point on a rod without mass that swings about a fixed point in any
direction, under gravity.

    u'' = lambda u - (g / l) Z,   lambda = (g / l u_Z - u'^2) / u^2        so that u . u'' = -u'^2
    E = l^2 u'^2 / 2 + g l u_Z,   h_Z = l^2 (u x u')_Z                         both constant

    psi'^2 = g / (l cos(theta))                    conical pendulum
    T = 4 sqrt(l / g) K(sin(theta_max / 2))        swing in a vertical plane

    symbol      meaning                                                  unit
    u           unit vector from the fixed point along the rod           1
    l, g        length of the rod, gravity                               m, m/s^2
    Z           the upward vertical; u_Z is a component along it         1
    theta       angle of the rod from the downward vertical              rad
    psi         angle of the vertical plane of the rod about Z           rad
    E, h_Z      energy, angular momentum about Z, per unit mass          m^2/s^2, m^2/s
    K           complete elliptic integral of the first kind             1

Source: Thomson 5.13 with C n = 0 (the heavy top without spin); Landau and Lifshitz, Mechanics, 14.
The direction is integrated and not its angles: nothing is singular at the verticals. Dividing
lambda by u^2 prevents an error in the length of u from growing. Valid for a rigid rod without
friction.
"""

from typing import final

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import AbstractSystem, NumberField, Scalar, Vector, argument, constructor, quantity
from ..core.elliptic import complete_elliptic
from ..core.printing import printed
from ..core.squares import quotient
from ..core.types import as_float
from ..core.vectors import axis, cross, dot


def direction_acceleration(u: Vector, u_rate: Vector, gravity_over_length: Scalar) -> Vector:
    """Second derivative of the direction.

    **Arguments**

    - `u`: direction, (3, *runs).
    - `u_rate`: its rate, 1/s, (3, *runs).
    - `gravity_over_length`: g / l, 1/s^2.

    **Returns** u'', 1/s^2, (3, *runs)."""
    # u_Z u - u^2 Z = u x (u x Z), in which nothing cancels at the verticals.
    tangent = jnp.stack([u[2] * u[0], u[2] * u[1], -u[0] * u[0] - u[1] * u[1]])
    return (gravity_over_length * tangent - dot(u_rate, u_rate) * u) / dot(u, u)


def energy(u: Vector, u_rate: Vector, length: Scalar, gravity: Scalar) -> Scalar:
    """Energy E per unit mass, m^2/s^2, with zero height at the fixed point; arguments in m and
    m/s^2, the direction and its rate (3, *runs)."""
    return 0.5 * length * length * dot(u_rate, u_rate) + gravity * length * u[2]


def vertical_angular_momentum(u: Vector, u_rate: Vector, length: Scalar) -> Scalar:
    """Angular momentum h_Z per unit mass about the vertical, m^2/s."""
    return length * length * cross(u, u_rate)[2]


@final
@printed()
class PendulumState(eqx.Module):
    """Angles of the rod and their rates; also the rates of both."""

    direction: Float[Array, "3 *#runs"] = quantity(
        "", doc="unit vector from the fixed point along the rod"
    )
    direction_rate: Float[Array, "3 *#runs"] = quantity("1/s", doc="rate of the direction")


@final
class SphericalPendulum(AbstractSystem):
    """A spherical pendulum. State: `PendulumState`, preferably created with `state`."""

    length: NumberField = quantity("m", positive=True, doc="l, of the rod")
    gravity: NumberField = quantity("m/s^2", positive=True, doc="g, downwards")

    def vector_field(self, t: Scalar, y: PendulumState) -> PendulumState:
        del t
        acceleration = direction_acceleration(
            y.direction, y.direction_rate, self.gravity / self.length
        )
        return PendulumState(y.direction_rate, acceleration)

    def invariants(self, t: Scalar, y: PendulumState) -> dict[str, Array]:
        del t
        u, u_rate = y.direction, y.direction_rate
        return {
            "energy": energy(u, u_rate, self.length, self.gravity),
            "vertical_angular_momentum": vertical_angular_momentum(u, u_rate, self.length),
            "direction_norm": jnp.sqrt(dot(u, u)),
        }

    @staticmethod
    @constructor(
        theta=argument("rad", doc="angle of the rod from the downward vertical"),
        psi=argument("rad", default=0.0, doc="angle of the plane of the rod about the vertical"),
        theta_rate=argument("rad/s", default=0.0, doc="rate of theta"),
        psi_rate=argument("rad/s", default=0.0, doc="rate of psi"),
    )
    def state(
        theta: Scalar, psi: Scalar = 0.0, theta_rate: Scalar = 0.0, psi_rate: Scalar = 0.0
    ) -> PendulumState:
        """The state from angles and their rates.

        **Arguments**

        - `theta`, `psi`: rad; `theta_rate`, `psi_rate`: rad/s."""
        theta, psi, theta_rate, psi_rate = jnp.broadcast_arrays(
            *(as_float(x) for x in (theta, psi, theta_rate, psi_rate))
        )
        s, c = jnp.sin(theta), jnp.cos(theta)
        out = jnp.stack([jnp.cos(psi), jnp.sin(psi), jnp.zeros_like(psi)])
        around = jnp.stack([-out[1], out[0], out[2]])
        up = axis(2, s)
        return PendulumState(
            s * out - c * up, theta_rate * (c * out + s * up) + psi_rate * s * around
        )

    def conical_rate(self, theta: Scalar) -> Scalar:
        """Rate psi', rad/s, with which the rod circles at the constant angle `theta`, rad.

        NaN from the horizontal on, where there is none."""
        return jnp.sqrt(self.gravity / (self.length * jnp.cos(theta)))

    def plane_period(self, amplitude: Scalar) -> Scalar:
        """Period, s, of the swing in a vertical plane through `amplitude`, rad, on both sides.

        It grows without limit towards an amplitude of half a turn."""
        # By the complement of k^2 = sin^2, because 1 - k^2 loses its digits near half a turn.
        complement = jnp.cos(0.5 * amplitude) ** 2
        return 4.0 * jnp.sqrt(quotient(self.length, self.gravity)) * complete_elliptic(complement)
