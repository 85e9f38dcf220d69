"""Pendulums whose support is at rest, each by its Lagrangian.

    simple        L = l^2 th'^2/2 + g l cos(th)                       per unit mass
    double        L = (m1+m2) l1^2 a'^2/2 + m2 l2^2 b'^2/2 + m2 l1 l2 a' b' cos(a-b)
                      + (m1+m2) g l1 cos(a) + m2 g l2 cos(b)
    elastic       L = m (r'^2 + r^2 th'^2)/2 + m g r cos(th) - k (r - l0)^2/2

Angles are measured from the downward vertical, rad. Pendulums on a moving support are in
`_carried_pendulums.py`.

Source: Thomson 9.3, 9.10 problems 8, 11, 12, 19.
"""

from collections.abc import Sequence
from typing import ClassVar, final

import jax.numpy as jnp
from jaxtyping import Array

from ..core import NumberField, Scalar, argument, constructor, quantity
from ..core.elliptic import complete_elliptic
from ..core.limits import Limit
from ..core.listed import no_method
from ..core.types import as_float
from ._description import GeneralisedState
from ._lagrangian import AbstractLagrangian


def state_of_pairs(*pairs: tuple[Scalar, Scalar]) -> GeneralisedState:
    """The state of pairs of a coordinate and its rate."""
    # Broadcast, because some may differ between runs and others be shared.
    flat = jnp.broadcast_arrays(*(as_float(x) for pair in pairs for x in pair))
    return GeneralisedState(jnp.stack(flat[0::2]), jnp.stack(flat[1::2]))


@final
class SimplePendulum(AbstractLagrangian):
    """A point on a rod in a vertical plane. State: `GeneralisedState` of the angle."""

    length: NumberField = quantity("m", positive=True, doc="of the rod")
    gravity: NumberField = quantity("m/s^2", positive=True, doc="g, downwards")
    names: ClassVar[tuple[str, ...]] = ("theta",)

    def lagrangian(self, t: Scalar, q: Array, v: Array) -> Scalar:
        del t
        return self.length * (0.5 * self.length * v[0] ** 2 + self.gravity * jnp.cos(q[0]))

    @staticmethod
    @constructor(
        theta=argument("rad", doc="angle from the downward vertical"),
        theta_rate=argument("rad/s", default=0.0, doc="rate of theta"),
    )
    def state(theta: Scalar, theta_rate: Scalar = 0.0) -> GeneralisedState:
        """The state of the angle, rad, and its rate, rad/s."""
        return state_of_pairs((theta, theta_rate))

    def period(self, amplitude: Scalar) -> Scalar:
        """Period, s, of a swing of this amplitude, rad: 4 sqrt(l/g) K(sin(amplitude / 2))."""
        complement = jnp.cos(0.5 * amplitude) ** 2
        return 4.0 * jnp.sqrt(self.length / self.gravity) * complete_elliptic(complement)


@final
class DoublePendulum(AbstractLagrangian):
    """Two points on two rods in a vertical plane. State: `GeneralisedState` of both angles."""

    mass_1: NumberField = quantity("kg", positive=True, doc="m1, of the upper point")
    mass_2: NumberField = quantity("kg", positive=True, doc="m2, of the lower point")
    length_1: NumberField = quantity("m", positive=True, doc="l1, of the upper rod")
    length_2: NumberField = quantity("m", positive=True, doc="l2, of the lower rod")
    gravity: NumberField = quantity("m/s^2", doc="g, downwards")
    names: ClassVar[tuple[str, ...]] = ("theta_1", "theta_2")

    def lagrangian(self, t: Scalar, q: Array, v: Array) -> Scalar:
        del t
        both = self.mass_1 + self.mass_2
        l1 = self.length_1
        l2 = self.length_2
        kinetic = 0.5 * (both * (l1 * v[0]) ** 2 + self.mass_2 * (l2 * v[1]) ** 2)
        kinetic = kinetic + self.mass_2 * l1 * l2 * v[0] * v[1] * jnp.cos(q[0] - q[1])
        height = both * l1 * jnp.cos(q[0]) + self.mass_2 * l2 * jnp.cos(q[1])
        return kinetic + self.gravity * height

    @staticmethod
    @constructor(
        theta_1=argument("rad", doc="of the upper rod, from the downward vertical"),
        theta_2=argument("rad", doc="of the lower rod, from the downward vertical"),
        theta_1_rate=argument("rad/s", default=0.0, doc="rate of theta_1"),
        theta_2_rate=argument("rad/s", default=0.0, doc="rate of theta_2"),
    )
    def state(
        theta_1: Scalar, theta_2: Scalar, theta_1_rate: Scalar = 0.0, theta_2_rate: Scalar = 0.0
    ) -> GeneralisedState:
        """The state of the angles, rad, and their rates, rad/s."""
        return state_of_pairs((theta_1, theta_1_rate), (theta_2, theta_2_rate))


@final
class ElasticPendulum(AbstractLagrangian):
    """A point on a spring that swings in a vertical plane. State: `GeneralisedState` of its
    distance from the pivot and its angle."""

    mass: NumberField = quantity("kg", positive=True, doc="m")
    stiffness: NumberField = quantity("N/m", positive=True, doc="k, of the spring")
    free_length: NumberField = quantity("m", positive=True, doc="l0, of the spring")
    gravity: NumberField = quantity("m/s^2", doc="g, downwards")
    names: ClassVar[tuple[str, ...]] = ("r", "theta")

    def lagrangian(self, t: Scalar, q: Array, v: Array) -> Scalar:
        del t
        r, theta = q
        kinetic = 0.5 * self.mass * (v[0] ** 2 + (r * v[1]) ** 2)
        stretch = 0.5 * self.stiffness * (r - self.free_length) ** 2
        return kinetic + self.mass * self.gravity * r * jnp.cos(theta) - stretch

    def limits(self, t: Scalar, y: GeneralisedState) -> Sequence[Limit]:
        """The length of the spring, at zero of which these coordinates are singular."""
        del t
        margin = 1e-6 * self.free_length
        return (Limit("the length r of the spring", "m", y.coordinates[0], 0.0, margin=margin),)

    @staticmethod
    @constructor(
        r=argument("m", doc="distance from the pivot"),
        theta=argument("rad", doc="angle from the downward vertical"),
        r_rate=argument("m/s", default=0.0, doc="rate of r"),
        theta_rate=argument("rad/s", default=0.0, doc="rate of theta"),
    )
    def state(
        r: Scalar, theta: Scalar, r_rate: Scalar = 0.0, theta_rate: Scalar = 0.0
    ) -> GeneralisedState:
        """The state of distance, m, angle, rad, and their rates."""
        return state_of_pairs((r, r_rate), (theta, theta_rate))

    @property
    @no_method
    def frequencies(self) -> tuple[Scalar, Scalar]:
        """Angular frequencies, rad/s, of small bounces and of small swings; at a ratio of two they
        exchange their energy."""
        rest = self.free_length + self.mass * self.gravity / self.stiffness
        return jnp.sqrt(self.stiffness / self.mass), jnp.sqrt(self.gravity / rest)
