"""Pendulums and their kin, each by its Lagrangian.

    double        L = (m1+m2) l1^2 a'^2/2 + m2 l2^2 b'^2/2 + m2 l1 l2 a' b' cos(a-b)
                      + (m1+m2) g l1 cos(a) + m2 g l2 cos(b)
    elastic       L = m (r'^2 + r^2 th'^2)/2 + m g r cos(th) - k (r - l0)^2/2
    centrifugal   L = I th'^2/2 + m [R^2 th'^2 + r^2 (th'+ph')^2 + 2 R r th' (th'+ph') cos(ph)]/2
    framed        L = [I + m l^2 sin^2(th)] ph'^2/2 + m l^2 th'^2/2 + m g l cos(th)
    on a hoop     L = m r^2 [th'^2 + W^2 sin^2(th)]/2 + m g r cos(th)
    carried       L = M V^2/2 + I th'^2/2 + m [(vx + s')^2 + (vy + th' s)^2]/2 - k (s - s0)^2/2

Angles are measured from the downward vertical, rad; V is the velocity of the carrier, vx and vy its
components along the carrier, on which the slider runs.

Source: Thomson 9.3, 9.10 problems 8, 11, 12, 19; 9.11.
"""

from typing import ClassVar, final

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import Scalar, argument, as_float, complete_elliptic, constructor, quantity
from ._description import GeneralisedState
from ._lagrangian import AbstractLagrangian

Number = Float[Array, "*#runs"]


def _state(*pairs: tuple[Scalar, Scalar]) -> GeneralisedState:
    """The state of pairs of a coordinate and its rate."""
    flat = jnp.broadcast_arrays(*(as_float(x) for pair in pairs for x in pair))
    return GeneralisedState(jnp.stack(flat[0::2]), jnp.stack(flat[1::2]))


@final
class SimplePendulum(AbstractLagrangian):
    """A point on a rod in a vertical plane. State: `GeneralisedState` of the angle."""

    length: Number = quantity("m", positive=True, doc="of the rod")
    gravity: Number = quantity("m/s^2", positive=True, doc="g, downwards")
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
        return _state((theta, theta_rate))

    def period(self, amplitude: Scalar) -> Scalar:
        """Period, s, of a swing of this amplitude, rad: 4 sqrt(l/g) K(sin(amplitude / 2))."""
        complement = jnp.cos(0.5 * amplitude) ** 2
        return 4.0 * jnp.sqrt(self.length / self.gravity) * complete_elliptic(complement)


@final
class DoublePendulum(AbstractLagrangian):
    """Two points on two rods in a vertical plane. State: `GeneralisedState` of both angles."""

    mass_1: Number = quantity("kg", positive=True, doc="m1, of the upper point")
    mass_2: Number = quantity("kg", positive=True, doc="m2, of the lower point")
    length_1: Number = quantity("m", positive=True, doc="l1, of the upper rod")
    length_2: Number = quantity("m", positive=True, doc="l2, of the lower rod")
    gravity: Number = quantity("m/s^2", doc="g, downwards")
    names: ClassVar[tuple[str, ...]] = ("theta_1", "theta_2")

    def lagrangian(self, t: Scalar, q: Array, v: Array) -> Scalar:
        del t
        both, l1, l2 = self.mass_1 + self.mass_2, self.length_1, self.length_2
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
        return _state((theta_1, theta_1_rate), (theta_2, theta_2_rate))


@final
class ElasticPendulum(AbstractLagrangian):
    """A point on a spring that swings in a vertical plane. State: `GeneralisedState` of its
    distance from the pivot and its angle."""

    mass: Number = quantity("kg", positive=True, doc="m")
    stiffness: Number = quantity("N/m", positive=True, doc="k, of the spring")
    free_length: Number = quantity("m", positive=True, doc="l0, of the spring")
    gravity: Number = quantity("m/s^2", doc="g, downwards")
    names: ClassVar[tuple[str, ...]] = ("r", "theta")

    def lagrangian(self, t: Scalar, q: Array, v: Array) -> Scalar:
        del t
        r, theta = q
        kinetic = 0.5 * self.mass * (v[0] ** 2 + (r * v[1]) ** 2)
        stretch = 0.5 * self.stiffness * (r - self.free_length) ** 2
        return kinetic + self.mass * self.gravity * r * jnp.cos(theta) - stretch

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
        return _state((r, r_rate), (theta, theta_rate))

    def frequencies(self) -> tuple[Scalar, Scalar]:
        """Angular frequencies, rad/s, of small bounces and of small swings; a ratio of two makes
        them exchange their energy."""
        rest = self.free_length + self.mass * self.gravity / self.stiffness
        return jnp.sqrt(self.stiffness / self.mass), jnp.sqrt(self.gravity / rest)


@final
class CentrifugalPendulum(AbstractLagrangian):
    """A pendulum that hangs on the rim of a free flywheel. State: `GeneralisedState` of the
    flywheel's angle and of the pendulum's angle from the radius."""

    inertia: Number = quantity("kg m^2", positive=True, doc="I, of the flywheel")
    mass: Number = quantity("kg", positive=True, doc="m, of the pendulum")
    arm: Number = quantity("m", positive=True, doc="R, of the pivot from the axis")
    length: Number = quantity("m", positive=True, doc="r, of the pendulum")
    names: ClassVar[tuple[str, ...]] = ("theta", "phi")

    def lagrangian(self, t: Scalar, q: Array, v: Array) -> Scalar:
        del t
        rim, bob = self.arm * v[0], self.length * (v[0] + v[1])
        speed2 = rim * rim + bob * bob + 2.0 * rim * bob * jnp.cos(q[1])
        return 0.5 * (self.inertia * v[0] ** 2 + self.mass * speed2)

    @staticmethod
    @constructor(
        theta_rate=argument("rad/s", doc="of the flywheel"),
        phi=argument("rad", doc="of the pendulum, from the radius"),
        phi_rate=argument("rad/s", default=0.0, doc="rate of phi"),
        theta=argument("rad", default=0.0, doc="of the flywheel"),
    )
    def state(
        theta_rate: Scalar, phi: Scalar, phi_rate: Scalar = 0.0, theta: Scalar = 0.0
    ) -> GeneralisedState:
        """The state of the angles, rad, and their rates, rad/s."""
        return _state((theta, theta_rate), (phi, phi_rate))

    def frequencies(self, theta_rate: Scalar) -> tuple[Scalar, Scalar]:
        """Angular frequencies, rad/s, of small swings at this rate, rad/s, of the flywheel: held at
        that rate, and free: w^2 = W^2 (R / r) [1 + m (R + r)^2 / I] (Thomson 9.10, problem 11)."""
        held = theta_rate * jnp.sqrt(self.arm / self.length)
        share = self.mass * (self.arm + self.length) ** 2 / self.inertia
        return held, held * jnp.sqrt(1.0 + share)


@final
class FramedPendulum(AbstractLagrangian):
    """A pendulum in a frame that turns freely about the vertical through its pivot. State:
    `GeneralisedState` of the pendulum's angle and of the frame's."""

    inertia: Number = quantity("kg m^2", positive=True, doc="I, of the frame about the vertical")
    mass: Number = quantity("kg", positive=True, doc="m, of the pendulum")
    length: Number = quantity("m", positive=True, doc="l, of the pendulum")
    gravity: Number = quantity("m/s^2", doc="g, downwards")
    names: ClassVar[tuple[str, ...]] = ("theta", "phi")

    def lagrangian(self, t: Scalar, q: Array, v: Array) -> Scalar:
        del t
        ml2 = self.mass * self.length**2
        turning = (self.inertia + ml2 * jnp.sin(q[0]) ** 2) * v[1] ** 2
        weight = self.mass * self.gravity * self.length * jnp.cos(q[0])
        return 0.5 * (turning + ml2 * v[0] ** 2) + weight

    @staticmethod
    @constructor(
        theta=argument("rad", doc="of the pendulum, from the downward vertical"),
        theta_rate=argument("rad/s", default=0.0, doc="rate of theta"),
        phi=argument("rad", default=0.0, doc="of the frame"),
        phi_rate=argument("rad/s", default=0.0, doc="rate of phi"),
    )
    def state(
        theta: Scalar, theta_rate: Scalar = 0.0, phi: Scalar = 0.0, phi_rate: Scalar = 0.0
    ) -> GeneralisedState:
        """The state of the angles, rad, and their rates, rad/s."""
        return _state((theta, theta_rate), (phi, phi_rate))


@final
class RotatingHoop(AbstractLagrangian):
    """A bead on a hoop that turns at a given rate about its vertical diameter. State:
    `GeneralisedState` of the bead's angle. Its energy is Jacobi's: the motor does work."""

    mass: Number = quantity("kg", positive=True, doc="m, of the bead")
    radius: Number = quantity("m", positive=True, doc="r, of the hoop")
    rate: Number = quantity("rad/s", doc="W, of the hoop")
    gravity: Number = quantity("m/s^2", positive=True, doc="g, downwards")
    names: ClassVar[tuple[str, ...]] = ("theta",)

    def lagrangian(self, t: Scalar, q: Array, v: Array) -> Scalar:
        del t
        around = self.rate * jnp.sin(q[0])
        kinetic = 0.5 * self.radius**2 * (v[0] ** 2 + around**2)
        return self.mass * (kinetic + self.gravity * self.radius * jnp.cos(q[0]))

    @staticmethod
    @constructor(
        theta=argument("rad", doc="of the bead, from the bottom"),
        theta_rate=argument("rad/s", default=0.0, doc="rate of theta"),
    )
    def state(theta: Scalar, theta_rate: Scalar = 0.0) -> GeneralisedState:
        """The state of the angle, rad, and its rate, rad/s."""
        return _state((theta, theta_rate))

    def mechanical_energy(self, y: GeneralisedState) -> Scalar:
        """T + U, J, with zero height at the bottom; the motor changes it."""
        theta, theta_rate = y.coordinates[0], y.rates[0]
        speed2 = self.radius**2 * (theta_rate**2 + (self.rate * jnp.sin(theta)) ** 2)
        height = 2.0 * self.radius * jnp.sin(0.5 * theta) ** 2
        return self.mass * (0.5 * speed2 + self.gravity * height)

    def rest_angle(self) -> Scalar:
        """The stable angle, rad: zero up to W^2 = g / r, then cos(theta) = g / (r W^2). Its slope
        is infinite where it leaves the bottom."""
        fast = self.radius * self.rate**2 > self.gravity
        ratio = jnp.where(fast, self.gravity / (self.radius * self.rate**2), 0.5)
        # Of half the angle: the arc cosine has lost half of the digits near the bottom.
        angle = 2.0 * jnp.arctan2(jnp.sqrt(0.5 * (1.0 - ratio)), jnp.sqrt(0.5 * (1.0 + ratio)))
        return jnp.where(fast, angle, 0.0)


@final
class SliderCarrier(AbstractLagrangian):
    """A free body in the plane on which a mass slides against a spring, along a line through the
    body's mass centre. State: `GeneralisedState` of place, angle and slider."""

    carrier_mass: Number = quantity("kg", positive=True, doc="M, of the carrier")
    inertia: Number = quantity("kg m^2", positive=True, doc="I, of the carrier")
    slider_mass: Number = quantity("kg", positive=True, doc="m, of the slider")
    stiffness: Number = quantity("N/m", non_negative=True, doc="k, of the spring")
    rest_length: Number = quantity("m", doc="s0, of the slider from the mass centre")
    names: ClassVar[tuple[str, ...]] = ("x", "y", "theta", "s")

    def lagrangian(self, t: Scalar, q: Array, v: Array) -> Scalar:
        del t
        along, across = self.body_velocity(GeneralisedState(q, v))
        carrier = self.carrier_mass * (v[0] ** 2 + v[1] ** 2) + self.inertia * v[2] ** 2
        slider = self.slider_mass * ((along + v[3]) ** 2 + (across + v[2] * q[3]) ** 2)
        return 0.5 * (carrier + slider - self.stiffness * (q[3] - self.rest_length) ** 2)

    @staticmethod
    def body_velocity(y: GeneralisedState) -> tuple[Scalar, Scalar]:
        """The velocity of the carrier's mass centre along and across its axis, m/s."""
        c, s = jnp.cos(y.coordinates[2]), jnp.sin(y.coordinates[2])
        return c * y.rates[0] + s * y.rates[1], c * y.rates[1] - s * y.rates[0]
