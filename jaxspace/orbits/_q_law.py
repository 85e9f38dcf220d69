"""The Q-law: a feedback law that steers a small thrust from one orbit to another.

    d = -D/sqrt(|D|^2 + b^2),   D = dQ/dv at a constant r       where Q falls fastest
    Q = (1 + exp(k (1 - r_p/r_min))) (W_a Q_a + W_e Q_e + W_i Q_i)
    Q_a = S (a - a_T)^2/a_x^2                       a_x^2 = 4 a^4 (1 + e)^2/(mu p)
    Q_e = (e - e_T)^2/e_x^2                         e_x^2 = 4 p/mu
    Q_i = (tau - tau_T)^2/tau_x^2                   tau_x^2 = p (1 + tau^2)^2/(4 mu (1 - e)^2)
    S = sqrt(1 + ((a - a_T)/(3 a_T))^4)             tau = tan(i/2)

    symbol   meaning                                                             unit
    Q        distance from the target orbit, which the thrust lets fall          m^2/s^2
    d        thrust over the full thrust                                         1
    b        softening: the thrust is full where |D| is larger                   m/s
    a, e, i  semi-major axis, eccentricity, inclination; of the target with _T   m, 1, rad
    a_x ...  fastest change of an element for an acceleration of one, over all   m per m/s
             directions of the thrust and all places on the orbit
    S        keeps the orbit from growing without end                            1
    p, r_p   semi-latus rectum, periapsis radius p/(1 + e)                       m
    r_min    lowest periapsis; k = 100 says how steep the penalty below it is    m
    W        weights                                                             1

Source: Petropoulos (2004), AIAA 2004-5089, and (2005), AAS 05-162; elements that are regular at the
equator: Varga and Perez (2016), AIAA/AAS Astrodynamics Specialist Conference. Their Q is this one
over the square of the acceleration, which leaves the direction as it is.

Q depends on the shape of the orbit alone, which a thrust changes through the velocity alone (the
equations of Gauss): so the direction is the slope of Q over the velocity. Node, line of apsides and
place on the orbit are free. Close to the target sqrt(Q) is the increment of speed that is left; far
from it, it is several times as much.

Three things differ from the papers, so that nothing is singular:

- where they have e in a_x, tau_x and r_p, here it is sqrt(e^2 + 0.05^2) - 0.05, smooth at e = 0;
- tau_x is that of an orbit with its periapsis on the line of nodes, as no node exists at i = 0;
- they always thrust in full; the direction then flips ever faster on the way to the target.

The law is not optimal: a transfer takes some percent longer than the best one. It does not coast.
An orbit at i = 0 exactly is not tilted, as all nodes are alike there, and at i = 180 degrees tau is
infinite.
"""

from collections.abc import Callable
from typing import ClassVar, final

import equinox as eqx
import jax
import jax.numpy as jnp

from ..bodies import AbstractBody, AbstractCondition, AbstractEffect, BodyState, Load
from ..core import NumberField, OptionalNumberField, Scalar, Vector, quantity, reference
from ..core.safe import safe_sqrt
from ..core.square_roots import inverse_sqrt, sqrt
from ..core.vectors import axis, cross, dot, inverse_norm, norm, scale, unit
from ._planet import gravitational_parameter
from .elements import eccentricity_vector

ROUNDING = 0.05
"""The eccentricity below which its corner at the circle is rounded."""
STEEPNESS = 100.0
"""k, by which the penalty grows below the lowest periapsis (Petropoulos)."""


@final
class QLaw(AbstractEffect):
    """A thrust that the Q-law steers to an orbit of a given size, shape and, where it is given,
    inclination. `AtTargetOrbit` is the event of its arrival."""

    thrust: NumberField = quantity("N", non_negative=True, doc="full thrust")
    semi_major_axis: NumberField = quantity("m", positive=True, doc="a_T, of the target")
    mu: NumberField = gravitational_parameter()
    eccentricity: NumberField = quantity(
        "", low=0.0, high=0.99, default=0.0, doc="e_T, of the target"
    )
    inclination: OptionalNumberField = quantity(
        "rad",
        low=0.0,
        high=3.1,
        optional=True,
        doc="i_T, of the target; without it the plane stays free",
    )
    exhaust_velocity: OptionalNumberField = quantity(
        "m/s",
        positive=True,
        optional=True,
        doc="by which the mass falls; without it the mass stays constant",
    )
    lowest_periapsis: OptionalNumberField = quantity(
        "m",
        positive=True,
        optional=True,
        doc="r_min, from the centre, below which a penalty lifts the periapsis",
    )
    softening: NumberField = quantity(
        "m/s",
        positive=True,
        default=5.0,
        doc="b: less than the full thrust where the slope of Q is not much larger",
    )
    size_weight: NumberField = quantity(
        "", non_negative=True, default=1.0, doc="W_a, of the semi-major axis"
    )
    shape_weight: NumberField = quantity(
        "", non_negative=True, default=1.0, doc="W_e, of the eccentricity"
    )
    tilt_weight: NumberField = quantity(
        "", non_negative=True, default=1.0, doc="W_i, of the inclination"
    )

    def increment_left(self, y: BodyState) -> Scalar:
        """The root of Q without its penalty, m/s, (*runs,), in the state `y`: close to the target
        the increment of speed that is left, and zero on a target orbit alone."""
        return sqrt(self._distance(_Shape.of_state(y.position, y.velocity, self.mu))[0])

    def direction(self, y: BodyState) -> Vector:
        """The thrust over the full thrust, d, in inertial axes, (3, *runs), in the state `y`: a
        unit vector but close to a target orbit, where it falls to zero."""
        r, v, mu = y.position, y.velocity, self.mu
        shape = _Shape.of_state(r, v, mu)
        (q, log_penalty), slope = jax.vjp(self._distance, shape)
        # The slope of Q over 1 + exp(...): the penalty itself would leave the range of float32.
        (over,) = slope((jnp.ones_like(q), q * jnp.ones_like(log_penalty)))
        # The slopes of e^2 over the velocity are those of 1 - p/a.
        p = over.p - shape.per_a * over.e2
        per_a = over.per_a - shape.p * over.e2
        h = cross(r, v)
        over_h = scale(2.0 * p / mu, h) + scale(over.tau2, _tau2_over_momentum(h))
        D = cross(over_h, r) - scale(2.0 * per_a / mu, v)
        return scale(-inverse_sqrt(dot(D, D) + self.softening * self.softening), D)

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        del t, body
        assert y.position is not None
        force = scale(self.thrust, self.direction(y))
        if self.exhaust_velocity is None:
            return Load(force_N=force)
        return Load(force_N=force, mass_rate=-norm(force) / self.exhaust_velocity)

    def _distance(self, x: "_Shape") -> tuple[Scalar, Scalar]:
        """Q without its penalty, m^2/s^2, and the logarithm of the penalty's factor."""
        e = sqrt(x.e2 + ROUNDING**2) - ROUNDING
        # Q_a by 1/a, which is regular at the parabola.
        ratio = self.semi_major_axis * x.per_a
        gap = 1.0 - ratio
        s = sqrt((ratio * ratio) * (ratio * ratio) + (gap / 3.0) ** 4)
        per = gap / (self.semi_major_axis * (1.0 + e))
        q = self.size_weight * 0.25 * s * self.mu * x.p * per * per
        # Not by (e - e_T)^2, whose second derivative at e = e_T = 0 would be lost in the corner.
        gap = _squared_gap(x.e2, self.eccentricity)
        q = q + self.shape_weight * 0.25 * gap * self.mu / x.p
        if self.inclination is not None:
            gap = _squared_gap(x.tau2, jnp.tan(0.5 * self.inclination))
            rate = 2.0 * (1.0 - e) / (1.0 + x.tau2)
            q = q + self.tilt_weight * gap * rate * rate * self.mu / x.p
        if self.lowest_periapsis is None:
            return q, 0.0 * q
        low = 1.0 - x.p / ((1.0 + e) * self.lowest_periapsis)
        return q, jax.nn.softplus(STEEPNESS * low)


class _Shape(eqx.Module):
    """What Q depends on, each (*runs,): p, m, 1/a, 1/m, e^2 and tau^2."""

    p: Scalar
    per_a: Scalar
    e2: Scalar
    tau2: Scalar

    @classmethod
    def of_state(cls, r: Vector, v: Vector, mu: Scalar) -> "_Shape":
        h = cross(r, v)
        e = eccentricity_vector(r, v, mu)
        h2 = dot(h, h)
        below = sqrt(h2) + h[2]
        per_a = 2.0 * inverse_norm(r) - dot(v, v) / mu
        # e^2 by its vector, and not by 1 - p/a, which loses half of the digits of a small e.
        return cls(h2 / mu, per_a, dot(e, e), (h[0] * h[0] + h[1] * h[1]) / (below * below))


def _tau2_over_momentum(h: Vector) -> Vector:
    """The slope of tau^2 = (h_x^2 + h_y^2)/(|h| + h_z)^2 over h."""
    z = axis(2, h[2])
    per = 1.0 / (norm(h) + h[2])
    side = h - h[2] * z
    return 2.0 * per * per * (side - (dot(side, side) * per) * (unit(h) + z))


def _squared_gap(square: Scalar, target: Scalar) -> Scalar:
    """(x - target)^2 of x >= 0 by its square; the derivative of the corner x = 0 is zero."""
    return square - (2.0 * safe_sqrt(square) - target) * target


@final
class AtTargetOrbit(AbstractCondition):
    """A thrust that steers to a target orbit has arrived: the increment of speed that is left
    falls to a tolerance, m/s.

    It is made by `AtTargetOrbit(law.increment_left)`, of a `QLaw`. In a scene file the law is
    found: the first effect of the phase that has a target."""

    direction: ClassVar[int] = -1
    needs: ClassVar[frozenset[str]] = frozenset({"position", "velocity"})

    increment_left: Callable[[BodyState], Scalar] = reference(
        "increment_left", doc="of the law: the increment of speed to its target, m/s, in a state"
    )
    tolerance: NumberField = quantity(
        "m/s", positive=True, default=10.0, doc="increment of speed that may be left"
    )

    def __call__(self, t: Scalar, y: BodyState) -> Scalar:
        """The increment of speed beyond the tolerance, m/s, in the state `y`."""
        del t
        return self.increment_left(y) - self.tolerance
