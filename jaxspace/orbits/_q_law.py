"""The Q-law: a feedback law that steers a small thrust from one orbit to another.

    d = -D/sqrt(|D|^2 + b^2),   D = dQ/dv at a constant r       where Q falls fastest
    Q = (1 + exp(k (1 - r_p/r_min))) (W_a Q_a + W_e Q_e + W_i Q_i)
    Q_a = S (a - a_T)^2/a_x^2                       a_x^2 = 4 a^4 (1 + e)^2/(mu p)
    Q_e = (e - e_T)^2/e_x^2                         e_x^2 = 4 p/mu
    Q_i = (tau - tau_T)^2/tau_x^2                   tau_x^2 = p (1 + tau^2)^2/(4 mu (1 - e)^2)
    S = sqrt(1 + ((a - a_T)/(3 a_T))^4)             tau = tan(i/2)

    symbol   meaning                                                             unit
    Q        distance from the target orbit, which the thrust makes smaller      m^2/s^2
    d        thrust over the full thrust                                         1
    b        softening: the thrust is full where |D| is larger                   m/s
    a, e, i  semi-major axis, eccentricity, inclination; of the target with _T   m, 1, rad
    a_x, e_x, tau_x   fastest change of an element by an acceleration of one,    its unit
             over all directions of the thrust and all positions on the orbit    per m/s
    S        keeps the orbit bounded                                             1
    p, r_p   semi-latus rectum, periapsis radius p/(1 + e)                       m
    r_min    lowest periapsis; k = 100 sets the steepness of the penalty         m
    W        weights                                                             1

Source: Petropoulos (2004), AIAA 2004-5089, and (2005), AAS 05-162; elements that are regular at the
equator: Varga and Perez (2016), AIAA/AAS Astrodynamics Specialist Conference. Their Q is this one
over the square of the acceleration, which leaves the direction as it is.

Q depends on the orbit but not on the position on it, and a thrust changes the orbit through the
velocity only (Gauss' equations): Q therefore falls fastest against its gradient with respect to the
velocity. Node, line of apsides and position on the orbit are free. Close to the target sqrt(Q) is
the remaining increment of speed; far from it, it is several times larger.

Three things differ from the papers, so that nothing is singular:

- e is replaced in a_x, tau_x and r_p by sqrt(e^2 + 0.05^2) - 0.05, which is smooth at e = 0;
- tau_x is that of an orbit with its periapsis on the line of nodes, because there is no node at i =
  0;
- the thrust is softened: in full, its direction would flip ever faster close to the target.

The law is not optimal: a transfer takes a few percent longer than the optimum. It never coasts. It
does not tilt an exactly equatorial orbit, where all nodes are equivalent; at i = 180 degrees tau is
infinite.
"""

from collections.abc import Callable
from typing import ClassVar, final

import equinox as eqx
import jax
import jax.numpy as jnp

from ..bodies import AbstractBody, AbstractCondition, AbstractEffect, BodyState, Load
from ..core import NumberField, OptionalNumberField, Scalar, Vector, quantity, reference
from ..core.safe import safe_divide
from ..core.square_roots import inverse_sqrt, sqrt
from ..core.squares import quotient, unit_factor
from ..core.vectors import axis, components, cross, dot, inverse_norm, norm, scale, unit
from ._planet import gravitational_parameter
from .elements import eccentricity_vector

ROUNDING = 0.05
"""The eccentricity below which its corner at the circle is rounded."""
STEEPNESS = 100.0
"""k, by which the penalty grows below the lowest periapsis (Petropoulos)."""


@final
class QLaw(AbstractEffect):
    """A thrust steered by the Q-law to an orbit of given size, shape and, optionally, inclination.
    `AtTargetOrbit` is the event of its arrival."""

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
        doc="i_T, of the target; without it the plane is free",
    )
    exhaust_velocity: OptionalNumberField = quantity(
        "m/s",
        positive=True,
        optional=True,
        doc="from which the mass loss follows; without it the mass is constant",
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
        doc="b: the thrust is reduced where the slope of Q is not much larger",
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
        the remaining increment of speed, and zero only on a target orbit."""
        return sqrt(self._distance(self._gaps(_Orbit.of_state(y.position, y.velocity, self.mu)))[0])

    def direction(self, y: BodyState) -> Vector:
        """The thrust over the full thrust, d, in inertial axes, (3, *runs), in the state `y`: a
        unit vector except close to a target orbit, where it decreases to zero."""
        return self._thrust_direction(*self._slope(y))

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        del t, body
        assert y.position is not None
        D, softening = self._slope(y)
        force = scale(self.thrust, self._thrust_direction(D, softening))
        if self.exhaust_velocity is None:
            return Load(force_N=force)
        # Not the length of d, whose slope would be what is left of those of two long vectors.
        D2 = dot(D, D)
        still = D2 == 0.0
        rest = softening * softening / jnp.where(still, 1.0, D2)
        throttle = jnp.where(still, 0.0, inverse_sqrt(1.0 + rest))
        return Load(force_N=force, mass_rate=-self.thrust * throttle / self.exhaust_velocity)

    def _thrust_direction(self, D: Vector, softening: Scalar) -> Vector:
        return scale(-inverse_sqrt(dot(D, D) + softening * softening), D)

    def _slope(self, y: BodyState) -> tuple[Vector, Scalar]:
        """D over 1 + exp(...), m/s: the penalty itself would leave the range of float32. And the
        softening b, m/s. In float32 both are over about the speed, because the slopes of D next to
        the equator would leave the range, too."""
        orbit = _Orbit.of_state(y.position, y.velocity, self.mu)
        (q, log_penalty), slope = jax.vjp(self._distance, self._gaps(orbit))
        factor = unit_factor(*components(orbit.v)) * jnp.ones_like(q)
        (over,) = slope((factor, factor * q * jnp.ones_like(log_penalty)))
        # Half of the slopes over the vectors e and tau, the latter in parts of tau and of its
        # direction. The nearest vector of the target's length moves across the gap to it, and so
        # adds nothing.
        to_e = orbit.e - scale(self.eccentricity * jnp.ones_like(orbit.p), unit(orbit.e))
        over_e = scale(over.e2, orbit.e) + scale(over.e_gap, to_e)
        over_tau = None
        if self.inclination is not None:
            over_tau = over.tau2 + over.tau_gap, -over.tau_gap * self._target_tau()
        return orbit.over_velocity(over.p, over.per_a, over_e, over_tau), factor * self.softening

    def _gaps(self, orbit: "_Orbit") -> "_Gaps":
        e_gap = norm(orbit.e) - self.eccentricity
        tau2 = tau_gap = None
        if self.inclination is not None:
            tau2 = dot(orbit.tau, orbit.tau)
            tau_gap = (orbit.tilt - self._target_tau()) ** 2
        return _Gaps(orbit.p, orbit.per_a, dot(orbit.e, orbit.e), e_gap * e_gap, tau2, tau_gap)

    def _target_tau(self) -> Scalar:
        assert self.inclination is not None
        return jnp.tan(0.5 * self.inclination)

    def _distance(self, x: "_Gaps") -> tuple[Scalar, Scalar]:
        """Q without its penalty, m^2/s^2, and the logarithm of the penalty's factor."""
        e = sqrt(x.e2 + ROUNDING**2) - ROUNDING
        # Q_a by 1/a, which is regular at the parabola.
        ratio = self.semi_major_axis * x.per_a
        gap = 1.0 - ratio
        s = sqrt((ratio * ratio) * (ratio * ratio) + (gap / 3.0) ** 4)
        per = gap / (self.semi_major_axis * (1.0 + e))
        q = self.size_weight * 0.25 * s * self.mu * x.p * per * per
        q = q + self.shape_weight * 0.25 * x.e_gap * self.mu / x.p
        if self.inclination is not None:
            assert x.tau2 is not None and x.tau_gap is not None
            rate = 2.0 * (1.0 - e) / (1.0 + x.tau2)
            q = q + self.tilt_weight * x.tau_gap * rate * rate * self.mu / x.p
        if self.lowest_periapsis is None:
            return q, 0.0 * q
        low = 1.0 - x.p / ((1.0 + e) * self.lowest_periapsis)
        return q, jax.nn.softplus(STEEPNESS * low)


class _Gaps(eqx.Module):
    """Arguments of Q, each (*runs,): p, m, 1/a, 1/m, e^2, the squares of e - e_T and of
    tau - tau_T, and tau^2; the last two where the target has an inclination."""

    p: Scalar
    per_a: Scalar
    e2: Scalar
    e_gap: Scalar
    tau2: Scalar | None
    tau_gap: Scalar | None


class _Orbit(eqx.Module):
    """The orbit of a state: p, 1/a, vectors whose lengths are e and tau, and of tau the length
    `tilt` and the direction `lean`, in which the momentum leans.

    Vectors are used because they are smooth where the angles of node and periapsis are
    undefined."""

    r: Vector
    v: Vector
    mu: Scalar
    h: Vector
    e: Vector
    tau: Vector
    tilt: Scalar
    lean: Vector
    p: Scalar
    per_a: Scalar

    @classmethod
    def of_state(cls, r: Vector, v: Vector, mu: Scalar) -> "_Orbit":
        h = cross(r, v)
        # The tilt of h from the z axis: its side over |h| + h_z. Length and direction are those of
        # the side, because float32 does not hold the components of tau where those of the side are
        # small.
        # Assembled from components, because the z of a difference has a derivative in reverse mode,
        # which cancels.
        x, y, z = components(h)
        side = jnp.stack([x, y, jnp.zeros_like(z)])
        share = 1.0 / (norm(h) + z)
        tau, tilt = scale(share, side), share * norm(side)
        e, p = eccentricity_vector(r, v, mu), quotient(dot(h, h), mu)
        per_a = 2.0 * inverse_norm(r) - quotient(dot(v, v), mu)
        return cls(r, v, mu, h, e, tau, tilt, _flat_unit(side), p, per_a)

    def over_velocity(
        self, p: Scalar, per_a: Scalar, half_e: Vector, half_tau: tuple[Scalar, Scalar] | None
    ) -> Vector:
        """The slope over the velocity, from those over p and 1/a and half of those over the vectors
        e and tau: the latter in parts of tau and `lean`."""
        per_mu = quotient(2.0, self.mu)
        over_h = scale(p * per_mu, self.h) + scale(per_mu, cross(half_e, self.v))
        if half_tau is not None:
            # Over the divisor first, because the slopes of `lean` may be close to the largest
            # numbers.
            by_tau, by_lean = (2.0 * x / (norm(self.h) + self.h[2]) for x in half_tau)
            # Of the length of h in the divisor of tau.
            along = self.tilt * (by_tau * self.tilt + by_lean)
            part = scale(by_tau, self.tau) + scale(by_lean, self.lean)
            over_h = over_h + part - scale(along, unit(self.h) + axis(2, along))
        across = scale(per_mu, cross(self.h, half_e))
        return cross(over_h, self.r) + across - scale(per_a * per_mu, self.v)


@jax.custom_jvp
def _flat_unit(a: Vector) -> Vector:
    """`unit` of a vector without a third component."""
    return unit(a)


@_flat_unit.defjvp
def _flat_unit_rule(primals: tuple[Vector], tangents: tuple[Vector]) -> tuple[Vector, Vector]:
    # By the angle, because the part of the change across the direction would be a difference, which
    # leaves no digit of the small component.
    (a,), (da,) = primals, tangents
    u = unit(a)
    x, y, z = components(u)
    dx, dy, _ = components(da)
    return u, scale(safe_divide(x * dy - y * dx, norm(a)), jnp.stack([-y, x, z]))


@final
class AtTargetOrbit(AbstractCondition):
    """Arrival of a steered thrust at its target orbit: the remaining increment of speed falls to a
    tolerance, m/s.

    Created as `AtTargetOrbit(law.increment_left)` for a `QLaw`. In a scene file the law is the
    first effect of the phase that has a target."""

    direction: ClassVar[int] = -1
    needs: ClassVar[frozenset[str]] = frozenset({"position", "velocity"})

    increment_left: Callable[[BodyState], Scalar] = reference(
        "increment_left",
        doc="of the law: the remaining increment of speed to its target, m/s, in a state",
    )
    tolerance: NumberField = quantity(
        "m/s", positive=True, default=10.0, doc="tolerance on the remaining increment of speed"
    )

    def __call__(self, t: Scalar, y: BodyState) -> Scalar:
        """The increment of speed beyond the tolerance, m/s, in the state `y`."""
        del t
        return self.increment_left(y) - self.tolerance
