"""A uniform bar that hangs by its end from a string or from a spring, in a vertical plane.

    string   L = m [v_G^2 + b^2 th'^2/12]/2 + m g (a cos(ph) + b/2 cos(th))
    spring   the same with the spring's length r in place of a, minus k (r - l0)^2/2
    v_G      the velocity of the middle of the bar, at r (sin(ph), cos(ph)) + b/2 (sin(th), cos(th))

    symbol   meaning                                                   unit
    m, b     mass and length of the bar                                kg, m
    a        length of the string                                      m
    r, k, l0 length of the spring, its stiffness and free length       m, N/m, m
    ph, th   angles of string or spring, and of the bar, from the      rad
             downward vertical

Small oscillations: a b w^4/12 - g (a/2 + b/3) w^2 + g^2/2 = 0, with r at rest, l0 + m g/k, for a.

Source: Thomson 9.10 problems 9, 10. Valid while the string is taut, and while the spring has a
length, r > 0: a run with a slack string, or through r = 0, has the status `OUTSIDE_MODEL`.
"""

from collections.abc import Sequence
from typing import ClassVar, final

import jax.numpy as jnp
from jaxtyping import Array

from ..core import NumberField, Scalar, argument, constructor, quantity
from ..core.limits import Limit
from ..core.listed import no_method
from ..core.square_roots import inverse_sqrt
from ._description import GeneralisedState
from ._lagrangian import AbstractLagrangian
from ._pendulums import state_of_pairs


def _kinetic(mass: Scalar, bar: Scalar, reach: tuple[Scalar, Scalar], q: Array, v: Array) -> Scalar:
    """The kinetic energy, J, of the bar: `reach` is the length from the support to its end, m, and
    its rate, `q` and `v` both angles and their rates."""
    a, a_rate = reach
    half = 0.5 * bar
    apart = q[0] - q[1]
    squares = a_rate**2 + (a * v[0]) ** 2 + (half * v[1]) ** 2 + (bar * v[1]) ** 2 / 12.0
    mixed = a * v[0] * jnp.cos(apart) + a_rate * jnp.sin(apart)
    return 0.5 * mass * (squares + 2.0 * half * v[1] * mixed)


def _swings(reach: Scalar, bar: Scalar, gravity: Scalar) -> tuple[Scalar, Scalar]:
    """The slow and the fast angular frequency, rad/s, of small swings."""
    half = 0.5 * (0.5 * reach + bar / 3.0)
    # A sum of squares, and the slow root from the product of both: nothing cancels.
    apart = jnp.sqrt((0.25 * reach - bar / 6.0) ** 2 + 0.125 * reach * bar)
    larger = gravity * (half + apart)
    return gravity * inverse_sqrt(2.0 * larger), jnp.sqrt(12.0 * larger / (reach * bar))


@final
class BarOnString(AbstractLagrangian):
    """A uniform bar that hangs on a string. State: `GeneralisedState` of both angles.

    `BarOnString(1.0, 0.5, 0.8, 9.81)` is a bar of 0.8 m on a string of 0.5 m, and `state(phi=0.1,
    theta=0.2)` its state at rest with both angles, rad, from the downward vertical."""

    mass: NumberField = quantity("kg", positive=True, doc="m, of the bar")
    string_length: NumberField = quantity("m", positive=True, doc="a")
    bar_length: NumberField = quantity("m", positive=True, doc="b")
    gravity: NumberField = quantity("m/s^2", doc="g, downwards")
    names: ClassVar[tuple[str, ...]] = ("phi", "theta")

    def lagrangian(self, t: Scalar, q: Array, v: Array) -> Scalar:
        del t
        a, b = self.string_length, self.bar_length
        depth = a * jnp.cos(q[0]) + 0.5 * b * jnp.cos(q[1])
        return _kinetic(self.mass, b, (a, 0.0), q, v) + self.mass * self.gravity * depth

    def tension(self, y: GeneralisedState) -> Scalar:
        """Tension of the string in the state `y`, N; negative where it would push."""
        phi, theta = y.coordinates
        phi_rate, theta_rate = y.rates
        turning = self.vector_field(jnp.zeros(()), y).rates[1]
        half = 0.5 * self.bar_length
        # m g less m times the acceleration of the bar's middle, along the string.
        outwards = self.string_length * phi_rate**2 + half * (
            theta_rate**2 * jnp.cos(phi - theta) - turning * jnp.sin(phi - theta)
        )
        return self.mass * (self.gravity * jnp.cos(phi) + outwards)

    def limits(self, t: Scalar, y: GeneralisedState) -> Sequence[Limit]:
        del t
        # With a margin above the error of a state, because an event may end a run there.
        lengths = self.string_length * y.rates[0] ** 2 + self.bar_length * y.rates[1] ** 2
        margin = 1e-4 * self.mass * (jnp.abs(self.gravity) + lengths)
        return (Limit("the tension of the string", "N", self.tension(y), 0.0, margin=margin),)

    @staticmethod
    @constructor(
        phi=argument("rad", doc="of the string, from the downward vertical"),
        theta=argument("rad", doc="of the bar, from the downward vertical"),
        phi_rate=argument("rad/s", default=0.0, doc="rate of phi"),
        theta_rate=argument("rad/s", default=0.0, doc="rate of theta"),
    )
    def state(
        phi: Scalar, theta: Scalar, phi_rate: Scalar = 0.0, theta_rate: Scalar = 0.0
    ) -> GeneralisedState:
        """The state of the angles, rad, and their rates, rad/s."""
        return state_of_pairs((phi, phi_rate), (theta, theta_rate))

    @property
    @no_method
    def frequencies(self) -> tuple[Scalar, Scalar]:
        """Angular frequencies, rad/s, of the slow and of the fast small swing."""
        return _swings(self.string_length, self.bar_length, self.gravity)


@final
class BarOnSpring(AbstractLagrangian):
    """A uniform bar on a spring. State: `GeneralisedState` of the spring's length and both
    angles."""

    mass: NumberField = quantity("kg", positive=True, doc="m, of the bar")
    stiffness: NumberField = quantity("N/m", positive=True, doc="k, of the spring")
    free_length: NumberField = quantity("m", positive=True, doc="l0, of the spring")
    bar_length: NumberField = quantity("m", positive=True, doc="b")
    gravity: NumberField = quantity("m/s^2", doc="g, downwards")
    names: ClassVar[tuple[str, ...]] = ("r", "phi", "theta")

    def lagrangian(self, t: Scalar, q: Array, v: Array) -> Scalar:
        del t
        r, b = q[0], self.bar_length
        depth = r * jnp.cos(q[1]) + 0.5 * b * jnp.cos(q[2])
        stretch = 0.5 * self.stiffness * (r - self.free_length) ** 2
        kinetic = _kinetic(self.mass, b, (r, v[0]), q[1:], v[1:])
        return kinetic + self.mass * self.gravity * depth - stretch

    def limits(self, t: Scalar, y: GeneralisedState) -> Sequence[Limit]:
        del t
        margin = 1e-6 * self.free_length
        return (Limit("the length r of the spring", "m", y.coordinates[0], 0.0, margin=margin),)

    @staticmethod
    @constructor(
        r=argument("m", doc="length of the spring"),
        phi=argument("rad", doc="of the spring, from the downward vertical"),
        theta=argument("rad", doc="of the bar, from the downward vertical"),
        r_rate=argument("m/s", default=0.0, doc="rate of r"),
        phi_rate=argument("rad/s", default=0.0, doc="rate of phi"),
        theta_rate=argument("rad/s", default=0.0, doc="rate of theta"),
    )
    def state(
        r: Scalar,
        phi: Scalar,
        theta: Scalar,
        r_rate: Scalar = 0.0,
        phi_rate: Scalar = 0.0,
        theta_rate: Scalar = 0.0,
    ) -> GeneralisedState:
        """The state of length, m, angles, rad, and their rates."""
        return state_of_pairs((r, r_rate), (phi, phi_rate), (theta, theta_rate))

    @property
    def rest_length(self) -> Scalar:
        """Length of the spring, m, at rest: l0 + m g/k."""
        return self.free_length + self.mass * self.gravity / self.stiffness

    @property
    @no_method
    def frequencies(self) -> tuple[Scalar, Scalar, Scalar]:
        """Angular frequencies, rad/s, of the small bounce, and of the slow and the fast small
        swing."""
        swings = _swings(self.rest_length, self.bar_length, self.gravity)
        return jnp.sqrt(self.stiffness / self.mass), *swings
