"""Pendulums and sliders on a moving support, each by its Lagrangian.

    centrifugal   L = I th'^2/2 + m [R^2 th'^2 + r^2 (th'+ph')^2 + 2 R r th' (th'+ph') cos(ph)]/2
    framed        L = [I + m l^2 sin^2(th)] ph'^2/2 + m l^2 th'^2/2 + m g l cos(th)
    on a hoop     L = m r^2 [th'^2 + W^2 sin^2(th)]/2 + m g r cos(th)
    carried       L = M V^2/2 + I th'^2/2 + m [(vx + s')^2 + (vy + th' s)^2]/2 - k (s - s0)^2/2

Angles are measured from the downward vertical, rad, that of the centrifugal pendulum from the
radius; V is the velocity of the carrier, vx and vy its components along the carrier, on which the
slider runs.

Source: Thomson 9.10 problems 8, 11, 12, 19; 9.11.
"""

from typing import ClassVar, final

import jax.numpy as jnp
from jaxtyping import Array

from ..core import NumberField, Scalar, argument, constructor, quantity
from ._description import GeneralisedState
from ._lagrangian import AbstractLagrangian
from ._pendulums import state_of_pairs


@final
class CentrifugalPendulum(AbstractLagrangian):
    """A pendulum that hangs on the rim of a free flywheel. State: `GeneralisedState` of the
    flywheel's angle and of the pendulum's angle from the radius."""

    inertia: NumberField = quantity("kg m^2", positive=True, doc="I, of the flywheel")
    mass: NumberField = quantity("kg", positive=True, doc="m, of the pendulum")
    arm: NumberField = quantity("m", positive=True, doc="R, of the pivot from the axis")
    length: NumberField = quantity("m", positive=True, doc="r, of the pendulum")
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
        return state_of_pairs((theta, theta_rate), (phi, phi_rate))

    def frequencies(self, theta_rate: Scalar) -> tuple[Scalar, Scalar]:
        """Angular frequencies, rad/s, of small swings at this rate, rad/s, of the flywheel: held at
        that rate, and free: w^2 = W^2 (R / r) [1 + m (R + r)^2 / I] (Thomson 9.10, problem 11)."""
        held = theta_rate * jnp.sqrt(self.arm / self.length)
        share = self.mass * (self.arm + self.length) ** 2 / self.inertia
        return held, held * jnp.sqrt(1.0 + share)


@final
class FramedPendulum(AbstractLagrangian):
    """A pendulum in a frame that rotates freely about the vertical through its pivot. State:
    `GeneralisedState` of the pendulum's angle and of the frame's."""

    inertia: NumberField = quantity(
        "kg m^2", positive=True, doc="I, of the frame about the vertical"
    )
    mass: NumberField = quantity("kg", positive=True, doc="m, of the pendulum")
    length: NumberField = quantity("m", positive=True, doc="l, of the pendulum")
    gravity: NumberField = quantity("m/s^2", doc="g, downwards")
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
        return state_of_pairs((theta, theta_rate), (phi, phi_rate))


@final
class RotatingHoop(AbstractLagrangian):
    """A bead on a hoop that rotates at a given rate about its vertical diameter. State:
    `GeneralisedState` of the bead's angle. Its `energy` is Jacobi's integral, because the motor
    does work.

    `RotatingHoop(0.2, 0.5, 6.0, 9.81)` rotates faster than sqrt(g / r), so that its `rest_angle` is
    not zero; `state(theta=0.1)` is the bead at rest at 0.1 rad from the bottom."""

    mass: NumberField = quantity("kg", positive=True, doc="m, of the bead")
    radius: NumberField = quantity("m", positive=True, doc="r, of the hoop")
    rate: NumberField = quantity("rad/s", doc="W, of the hoop")
    gravity: NumberField = quantity("m/s^2", positive=True, doc="g, downwards")
    names: ClassVar[tuple[str, ...]] = ("theta",)

    def lagrangian(self, t: Scalar, q: Array, v: Array) -> Scalar:
        del t
        around = self.rate * jnp.sin(q[0])
        kinetic = 0.5 * self.radius**2 * (v[0] ** 2 + around**2)
        return self.mass * (kinetic - self.gravity * self._height(q[0]))

    def _height(self, theta: Scalar) -> Scalar:
        """Height of the bead above the bottom, m."""
        # 1 - cos(theta) by half of the angle, with its digits near the bottom.
        return 2.0 * self.radius * jnp.sin(0.5 * theta) ** 2

    @staticmethod
    @constructor(
        theta=argument("rad", doc="of the bead, from the bottom"),
        theta_rate=argument("rad/s", default=0.0, doc="rate of theta"),
    )
    def state(theta: Scalar, theta_rate: Scalar = 0.0) -> GeneralisedState:
        """The state of the angle, rad, and its rate, rad/s."""
        return state_of_pairs((theta, theta_rate))

    def mechanical_energy(self, y: GeneralisedState) -> Scalar:
        """T + U, J, which the motor changes; `energy` is Jacobi's integral. Both have their zero of
        height at the bottom."""
        theta, theta_rate = y.coordinates[0], y.rates[0]
        speed2 = self.radius**2 * (theta_rate**2 + (self.rate * jnp.sin(theta)) ** 2)
        return self.mass * (0.5 * speed2 + self.gravity * self._height(theta))

    @property
    def rest_angle(self) -> Scalar:
        """The stable angle, rad: zero up to W^2 = g / r, then cos(theta) = g / (r W^2). Its slope
        is infinite where it leaves the bottom."""
        outward = self.radius * self.rate**2
        fast = outward > self.gravity
        # One half replaces the value at the bottom, where the root of a negative number or a
        # division by a rate of zero would put NaN into the derivative of the branch not taken.
        ratio = jnp.where(fast, self.gravity, 0.5) / jnp.where(fast, outward, 1.0)
        # By half the angle, because the arc cosine loses half of the digits near the bottom.
        angle = 2.0 * jnp.arctan2(jnp.sqrt(0.5 * (1.0 - ratio)), jnp.sqrt(0.5 * (1.0 + ratio)))
        return jnp.where(fast, angle, 0.0)


@final
class SliderCarrier(AbstractLagrangian):
    """A free body in the plane on which a mass slides against a spring, along a line through the
    body's mass centre. State: `GeneralisedState` of place, angle and slider."""

    carrier_mass: NumberField = quantity("kg", positive=True, doc="M, of the carrier")
    inertia: NumberField = quantity("kg m^2", positive=True, doc="I, of the carrier")
    slider_mass: NumberField = quantity("kg", positive=True, doc="m, of the slider")
    stiffness: NumberField = quantity("N/m", non_negative=True, doc="k, of the spring")
    rest_length: NumberField = quantity("m", doc="s0, of the slider from the mass centre")
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
