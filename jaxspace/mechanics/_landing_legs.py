"""A lander on legs that spread: touchdown, stroke and the load on the springs.

    J theta'^2 / 2 + U = h,      J = M l^2 sin^2(theta) + n m l^2 / 3
    U = (M + n m / 2) g l cos(theta) + n k (theta - theta_0)^2 / 2,     D = n c theta'^2 / 2
    touchdown:   theta'_+ = (M + n m / 2) l sin(theta) v / J
    t = int sqrt(J / (2 (h - U))) dtheta

    symbol      meaning                                                    unit
    theta       angle of the legs from the vertical                        rad
    theta_0     that of the unloaded springs, at which it touches down     rad
    M, m, l, n  body; each of n legs, uniform: mass, length                kg, kg, m, 1
    k, c        spring and damper in the hinge of each leg                 N m, N m s
    v           speed of the fall at touchdown                             m/s

The feet slide outwards without friction and do not bounce: the impact dissipates the rest of the
energy.

Source: Thomson 9.10 (impulsive motion of linked bars).
Valid for a level lander that stays level, while the feet press on the ground and until the legs are
flat: a run that lifts off as the legs close, or whose legs pass pi/2 or the vertical, has the
status `OUTSIDE_MODEL`. While heavy legs still spread from a fast touchdown the ground would have to
pull for a moment: as in the impact, the feet are taken to stay.
"""

import math
from collections.abc import Sequence
from typing import ClassVar, final

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..core import NumberField, OptionalNumberField, Scalar, argument, constructor, quantity
from ..core.limits import Limit
from ..core.roots import increasing_root
from ..core.types import as_float
from ._description import GeneralisedState
from ._lagrangian import AbstractLagrangian

NODES = 40


@final
class LandingLegs(AbstractLagrangian):
    """A lander whose legs spread on the ground. State: `GeneralisedState` of their angle,
    preferably created with `state`, or by `touchdown` from a fall."""

    body_mass: NumberField = quantity("kg", positive=True, doc="M, without the legs")
    leg_mass: NumberField = quantity("kg", non_negative=True, doc="m, of each leg")
    leg_length: NumberField = quantity("m", positive=True, doc="l")
    rest_angle: NumberField = quantity(
        "rad", low=0.0, high=1.5, strict=True, doc="theta_0, of legs with unloaded springs"
    )
    stiffness: NumberField = quantity("N m", non_negative=True, doc="k, of each hinge")
    gravity: NumberField = quantity("m/s^2", non_negative=True, doc="g, downwards")
    legs: NumberField = quantity("", positive=True, default=4.0, doc="n, how many")
    damping: OptionalNumberField = quantity(
        "N m s", non_negative=True, optional=True, doc="c, of each hinge"
    )
    names: ClassVar[tuple[str, ...]] = ("theta",)

    def lagrangian(self, t: Scalar, q: Array, v: Array) -> Scalar:
        del t
        return 0.5 * self.moment(q[0]) * v[0] ** 2 - self.potential(q[0])

    def dissipation(self, t: Scalar, q: Array, v: Array) -> Scalar | None:
        del t, q
        if self.damping is None:
            return None
        return 0.5 * self.legs * self.damping * v[0] ** 2

    @staticmethod
    @constructor(
        theta=argument("rad", doc="angle of the legs from the vertical"),
        theta_rate=argument("rad/s", default=0.0, doc="rate of theta"),
    )
    def state(theta: Scalar, theta_rate: Scalar = 0.0) -> GeneralisedState:
        """The state of the angle, rad, and its rate, rad/s."""
        pair = jnp.broadcast_arrays(as_float(theta), as_float(theta_rate))
        return GeneralisedState(pair[0][None], pair[1][None])

    def moment(self, theta: Scalar) -> Scalar:
        """J, kg m^2, at the angle `theta`, rad."""
        legs = self.legs * self.leg_mass / 3.0
        return self.leg_length**2 * (self.body_mass * jnp.sin(theta) ** 2 + legs)

    def potential(self, theta: Scalar) -> Scalar:
        """U, J, at the angle `theta`, rad."""
        weight = self._carried() * self.gravity * self.leg_length
        springs = 0.5 * self.legs * self.stiffness * (theta - self.rest_angle) ** 2
        return weight * jnp.cos(theta) + springs

    def ground_force(self, y: GeneralisedState) -> Scalar:
        """Force of the ground on all feet in the state `y`, N; negative where it would pull."""
        theta, rate = y.coordinates[0], y.rates[0]
        turning = self.vector_field(jnp.zeros(()), y).rates[0]
        # The weight, and the rate of the momentum upwards.
        rising = -self.leg_length * (jnp.cos(theta) * rate**2 + jnp.sin(theta) * turning)
        whole = self.body_mass + self.legs * self.leg_mass
        return whole * self.gravity + self._carried() * rising

    def limits(self, t: Scalar, y: GeneralisedState) -> Sequence[Limit]:
        del t
        theta, rate = y.coordinates[0], y.rates[0]
        # With a margin above the error of a state, because an event may end a run there.
        weight = self._carried() * (self.gravity + self.leg_length * rate**2)
        force, closing = self.ground_force(y), rate < 0.0
        return (
            Limit("the force of the ground", "N", force, 0.0, margin=1e-4 * weight, where=closing),
            Limit("theta", "rad", theta, 0.0, 0.5 * math.pi, margin=1e-6),
        )

    def touchdown(self, speed: Scalar) -> GeneralisedState:
        """The state after a touchdown at this `speed`, m/s, with the legs at rest in the body."""
        lever = self._carried() * self.leg_length * jnp.sin(self.rest_angle)
        return self.state(self.rest_angle, lever * speed / self.moment(self.rest_angle))

    def touchdown_loss(self, speed: Scalar) -> Scalar:
        """The energy dissipated by the impact, J."""
        s = jnp.sin(self.rest_angle)
        legs = self.legs * self.leg_mass
        # The difference of both energies, without the part that body and legs have in common.
        share = self.body_mass / 3.0 + legs * (1.0 / 3.0 - 0.25 * s * s)
        return 0.5 * legs * share / (self.body_mass * s * s + legs / 3.0) * speed**2

    def greatest_spread(self, speed: Scalar) -> Scalar:
        """The angle, rad, to which legs without dampers spread after a touchdown at this `speed`,
        m/s; pi/2 where they become flat."""
        height = self._height(speed)
        lower = self.rest_angle + 0.0 * height
        return increasing_root(
            lambda theta: self.potential(theta) - height, lower, 0.5 * jnp.pi + 0.0 * lower
        )

    def spreading_time(self, speed: Scalar) -> Scalar:
        """The time, s, from a touchdown at this `speed`, m/s, to the greatest spread of legs
        without dampers that do not become flat, by quadrature."""
        end = self.greatest_spread(speed)
        start = self.rest_angle
        root_before = self._root_before(speed)
        before = root_before * root_before
        # theta = low + width sin^2(phi) removes the roots of the denominator at both ends.
        low, width = start - before, end - start + before
        first = jnp.arcsin(root_before / jnp.sqrt(width))
        x, weights = np.polynomial.legendre.leggauss(NODES)
        shape = (NODES,) + (1,) * jnp.ndim(end)
        x, weights = (jnp.asarray(a, end.dtype).reshape(shape) for a in (x, weights))
        phi = first + 0.5 * (x + 1.0) * (0.5 * jnp.pi - first)
        s, c = jnp.sin(phi), jnp.cos(phi)
        rise, fall = width * s * s, width * c * c
        # h - U over the way from the nearer end, from differences of U as products.
        rest = 0.5 * self.moment(start) * self._rate(speed) ** 2
        rest = rest - before * self._slope(start - 0.5 * before, before)
        near_low = self._slope(low + 0.5 * rise, rise) + rest / rise
        upper = s > c
        slope = jnp.where(upper, -self._slope(end - 0.5 * fall, fall), near_low)
        moment = self.moment(jnp.where(upper, end - fall, low + rise))
        integrand = jnp.where(upper, s, c) * jnp.sqrt(2.0 * width * moment / slope)
        return (0.25 * jnp.pi - 0.5 * first) * jnp.sum(weights * integrand, axis=0)

    def _root_before(self, speed: Scalar) -> Scalar:
        """The square root of the angle, rad, from the start back to where the motion would have
        started from rest; no further than upright."""

        def excess(x):
            climb = self._slope(self.rest_angle - 0.5 * x * x, x * x)
            return x * jnp.sqrt(climb) - jnp.sqrt(0.5 * self.moment(self.rest_angle)) * rate

        # The root is the unknown, because the angle itself loses its digits at a slow touchdown.
        rate = self._rate(speed)
        return increasing_root(excess, 0.0 * rate, jnp.sqrt(self.rest_angle) + 0.0 * rate)

    def _slope(self, middle: Scalar, way: Scalar) -> Scalar:
        """The fall of U over a `way` about its `middle`, rad, per way, J."""
        weight = self._carried() * self.gravity * self.leg_length
        # As a product: the difference of the cosines has no digits of a short way.
        tilting = weight * jnp.sin(middle) * jnp.sinc(0.5 * way / jnp.pi)
        return tilting - self.legs * self.stiffness * (middle - self.rest_angle)

    def _rate(self, speed: Scalar) -> Scalar:
        """The rate after the touchdown, rad/s."""
        return self.touchdown(speed).rates[0]

    def _height(self, speed: Scalar) -> Scalar:
        """The energy h after the touchdown, J."""
        kinetic = 0.5 * self.moment(self.rest_angle) * self._rate(speed) ** 2
        return kinetic + self.potential(self.rest_angle)

    def _carried(self) -> Scalar:
        return self.body_mass + 0.5 * self.legs * self.leg_mass
