"""Size, shape and orientation of a two-body orbit: constants of the motion, classical elements.

    E = v^2/2 - mu/r,  h = r x v,  e = (v x h)/mu - r/|r|
    p = h^2/mu,  a = -mu/(2E),  r_p = p/(1 + e),  r_a = a (1 + e)
    r = p/(1 + e cos f) (P cos f + Q sin f),  v = sqrt(mu/p) (-P sin f + Q (e + cos f))

    symbol    meaning                                                              unit
    E, h      energy and angular momentum per unit mass                            m^2/s^2, m^2/s
    e         eccentricity (vector: towards periapsis)                             1
    p, a      semi-latus rectum, semi-major axis (negative for a hyperbola)        m
    r_p, r_a  radius of periapsis, of apoapsis                                     m
    i         inclination: between h and the z axis                                rad
    node      longitude of the ascending node, from the x axis                     rad
    omega     argument of periapsis, from the node                                 rad
    f         true anomaly, from periapsis                                         rad
    P, Q      unit vectors towards periapsis and 90 degrees ahead of it

Source: Thomson 4.7 to 4.10; Danby, Fundamentals of Celestial Mechanics, 6.15.

An undefined angle is zero, and so is its derivative: the node of an equatorial orbit is on the x
axis, the periapsis of a circle at the node. The other elements then still lead back to the state,
but their derivatives do not: state to elements and back is not the identity in its derivatives on a
circle or at the equator. There the elements are not smooth functions of the state, and derivatives
that do not exist are set to zero. Vary the state instead, or `ModifiedEquinoctialElements`, which
are smooth there.

The eccentricity vector of a state is a difference of vectors of length one, and has an error of
some rounding errors. A vector shorter than 8 of them (2e-15 in double precision) is treated as
zero: its direction is noise, which would split the angle from the node into argument and anomaly at
random, with derivatives of 1/e. Above, the two angles have errors of about 1e-16/e. The node has no
such limit: z and z' of the state determine it, however small they are; its derivatives grow as 1/i.

The elements contain the semi-latus rectum instead of the semi-major axis because it is finite and
smooth through the parabola.

The functions take `position`, m, and `velocity`, m/s, both (3, *runs), and the gravitational
parameter `mu`, m^3/s^2; the batch axes broadcast, and a time axis may precede them.
"""

__all__ = [
    "angular_momentum",
    "apoapsis_radius",
    "eccentricity_vector",
    "elements_from_state",
    "inclination",
    "periapsis_radius",
    "semi_latus_rectum",
    "semi_major_axis",
    "specific_energy",
    "state_from_elements",
]

import math
from typing import final

import jax
import jax.numpy as jnp
import numpy as np

from ..core import AbstractParameters, NumberField, Scalar, Vector, check, output, quantity
from ..core.barrier import barrier, computed_once
from ..core.blocks import in_blocks
from ..core.checks import is_concrete
from ..core.formula import AWAY, NOT_ZERO, POSITIVE, formula
from ..core.safe import safe_atan2, safe_divide
from ..core.square_roots import sqrt
from ..core.squares import quotient
from ..core.trigonometry import sincos
from ..core.types import as_float
from ..core.vectors import axis, cross, dot, inverse_norm, norm, unit

# In roundings: the greatest eccentricity that rounding gave to circles of any size and plane was
# 7.6, the median 1.5.
_NOISE = 8.0


@formula(position=AWAY)
@output("m^2/s^2", mu="planet.mu")
def specific_energy(position: Vector, velocity: Vector, mu: Scalar) -> Scalar:
    """Energy per unit mass E, m^2/s^2 (Thomson 4.7).

    **Arguments**

    - `position`, `velocity`: m and m/s, about the centre, (3, *runs).
    - `mu`: gravitational parameter of the centre, m^3/s^2."""
    return 0.5 * dot(velocity, velocity) - mu * inverse_norm(position)


@formula
def angular_momentum(position: Vector, velocity: Vector) -> Vector:
    """Angular momentum per unit mass h, m^2/s.

    **Arguments**

    - `position`: m, (3, *runs).
    - `velocity`: m/s, (3, *runs)."""
    return cross(position, velocity)


@formula(position=AWAY, mu=NOT_ZERO)
def eccentricity_vector(position: Vector, velocity: Vector, mu: Scalar) -> Vector:
    """The constant vector e, (3, *runs): it points to periapsis, and its length is the eccentricity
    (Laplace, Runge, Lenz).

    **Arguments**

    - `position`, `velocity`: m and m/s, about the centre, (3, *runs).
    - `mu`: gravitational parameter of the centre, m^3/s^2; negative for a centre that repels, where
      the vector points away from periapsis."""
    h = cross(position, velocity)
    return quotient(cross(velocity, h), mu) - inverse_norm(position) * position


@formula(mu=NOT_ZERO)
def semi_latus_rectum(position: Vector, velocity: Vector, mu: Scalar) -> Scalar:
    """Semi-latus rectum p, m: p / r = 1 + e cos(f).

    **Arguments**

    - `position`, `velocity`: m and m/s, about the centre, (3, *runs).
    - `mu`: gravitational parameter of the centre, m^3/s^2; where it is negative, so is p."""
    h = cross(position, velocity)
    # In this order no square leaves the range of float32.
    return dot(h, quotient(h, mu))


@formula(position=AWAY, mu=NOT_ZERO)
@output("m", mu="planet.mu")
def semi_major_axis(position: Vector, velocity: Vector, mu: Scalar) -> Scalar:
    """Semi-major axis a = -mu / (2 E), m: negative for a hyperbola; infinite for the parabola, with
    the derivative zero.

    **Arguments**

    - `position`, `velocity`: m and m/s, about the centre, (3, *runs).
    - `mu`: gravitational parameter of the centre, m^3/s^2; where it is negative, a is positive."""
    energy = specific_energy(position, velocity, mu)
    return jnp.where(
        energy == 0.0, math.inf, quotient(-0.5 * mu, jnp.where(energy == 0.0, 1.0, energy))
    )


@formula(position=AWAY, mu=NOT_ZERO)
@output("m", mu="planet.mu")
def periapsis_radius(position: Vector, velocity: Vector, mu: Scalar) -> Scalar:
    """Least distance from the centre on the whole conic, m.

    **Arguments**

    - `position`, `velocity`: m and m/s, about the centre, (3, *runs).
    - `mu`: gravitational parameter of the centre, m^3/s^2; negative for a centre that repels."""
    # p / (1 + e) and not a (1 - e), because it is smooth through the parabola. A centre that repels
    # is the other focus of the hyperbola.
    e = norm(eccentricity_vector(position, velocity, mu))
    return semi_latus_rectum(position, velocity, mu) / (1.0 + jnp.sign(mu) * e)


@formula(position=AWAY, mu=NOT_ZERO)
@output("m", mu="planet.mu")
def apoapsis_radius(position: Vector, velocity: Vector, mu: Scalar) -> Scalar:
    """Greatest distance from the centre, m; infinite on an open orbit, with the derivative zero.

    **Arguments**

    - `position`, `velocity`: m and m/s, about the centre, (3, *runs).
    - `mu`: gravitational parameter of the centre, m^3/s^2."""
    energy = specific_energy(position, velocity, mu)
    a = quotient(-0.5 * mu, jnp.where(energy < 0.0, energy, -1.0))
    return jnp.where(
        energy < 0.0, a * (1.0 + norm(eccentricity_vector(position, velocity, mu))), math.inf
    )


@formula
@output("rad")
def inclination(position: Vector, velocity: Vector) -> Scalar:
    """Inclination i of the orbit's plane to the equator, rad, within [0, pi]; its derivative is
    zero for an equatorial orbit.

    **Arguments**

    - `position`: m, (3, *runs).
    - `velocity`: m/s, (3, *runs)."""
    h = cross(position, velocity)
    # By an arctangent of both parts of h, because the arccosine loses half of the digits near the
    # equator.
    return safe_atan2(norm(h * (1.0 - axis(2, h[2]))), h[2])


def axis_of_conic(p: Scalar, e: Scalar) -> Scalar:
    """The semi-major axis, m, from the semi-latus rectum, m, and the eccentricity: negative for a
    hyperbola; infinite for the parabola, with the derivative zero."""
    parabola = e == 1.0
    e = jnp.where(parabola, 0.0, e)
    return jnp.where(parabola, math.inf, quotient(p, (1.0 - e) * (1.0 + e)))


def apoapsis_of_conic(p: Scalar, e: Scalar) -> Scalar:
    """The radius of apoapsis, m, from the semi-latus rectum, m, and the eccentricity; infinite on
    an open orbit, with the derivative zero."""
    closed = e < 1.0
    return jnp.where(closed, quotient(p, 1.0 - jnp.where(closed, e, 0.0)), math.inf)


@final
class ClassicalElements(AbstractParameters):
    """Six elements of a conic that is not a straight line.

    The semi-major axis and the distances of the apsides are properties. Raises `InputError` for a
    true anomaly beyond the asymptotes of an open orbit."""

    semi_latus_rectum: NumberField = quantity(
        "m", positive=True, doc="a (1 - e^2), defined for every conic"
    )
    eccentricity: NumberField = quantity("", non_negative=True, doc="of the conic")
    inclination: NumberField = quantity(
        "rad", low=-math.pi, high=math.pi, doc="angle from the z axis to r x v"
    )
    node: NumberField = quantity("rad", doc="longitude of the ascending node")
    argument_of_periapsis: NumberField = quantity(
        "rad", doc="angle from the ascending node to the periapsis"
    )
    true_anomaly: NumberField = quantity("rad", doc="angle from the periapsis")

    def __check_init__(self):
        # The kinds and ranges of the numbers come first.
        super().__check_init__()
        e, f = self.eccentricity, self.true_anomaly
        if is_concrete(e) and is_concrete(f):
            e, f = np.asarray(e, float), np.asarray(f, float)
            limit = np.arccos(-1.0 / np.maximum(e, 1.0))
            # To rounding, for elements that come from a state far out.
            check(
                1.0 + e * np.cos(f) > -1e-6,
                "ClassicalElements.true_anomaly",
                f,
                f"within {np.min(limit):.6g} rad of the periapsis, where the asymptote is",
            )

    @property
    def semi_major_axis(self) -> Scalar:
        """Semi-major axis p / (1 - e^2), m: negative for a hyperbola, infinite for the parabola."""
        return axis_of_conic(self.semi_latus_rectum, self.eccentricity)

    @property
    def periapsis_radius(self) -> Scalar:
        """Least distance from the centre on the whole conic, m."""
        return self.semi_latus_rectum / (1.0 + self.eccentricity)

    @property
    def apoapsis_radius(self) -> Scalar:
        """Greatest distance from the centre, m; infinite on an open orbit, with the derivative
        zero."""
        return apoapsis_of_conic(self.semi_latus_rectum, self.eccentricity)

    @classmethod
    def from_periapsis(
        cls,
        radius: Scalar,
        eccentricity: Scalar,
        inclination: Scalar = 0.0,
        node: Scalar = 0.0,
        argument_of_periapsis: Scalar = 0.0,
        true_anomaly: Scalar = 0.0,
    ) -> "ClassicalElements":
        """The elements from the radius of periapsis, m, which is defined for every conic, and the
        other elements."""
        radius = as_float(radius)
        e = as_float(eccentricity)
        return cls(radius * (1.0 + e), e, inclination, node, argument_of_periapsis, true_anomaly)


@formula(position=AWAY, mu=POSITIVE)
def elements_from_state(position: Vector, velocity: Vector, mu: Scalar) -> ClassicalElements:
    """The classical elements of the orbit through a state, with angles within (-pi, pi].

    An eccentricity below 8 roundings is noise and counts as zero. Undefined angles and their
    derivatives are zero: on a circle and at the equator the derivatives of the elements do not lead
    back to those of the state (see the module and the manual on singularities). The derivatives of
    `ModifiedEquinoctialElements` do.

    **Arguments**

    - `position`: m, (3, *runs).
    - `velocity`: m/s, (3, *runs).
    - `mu`: gravitational parameter, m^3/s^2, (*runs,)."""
    return in_blocks(_elements, (1, 1, 0), position, velocity, mu)


def _elements(position: Vector, velocity: Vector, mu: Scalar) -> ClassicalElements:
    h, e = constant_vectors(position, velocity, mu)
    length = norm(e)
    noise = length <= _NOISE * float(jnp.finfo(e.dtype).eps)
    e, length = barrier((jnp.where(noise, 0.0, e), jnp.where(noise, 0.0, length)))
    n, m, across = _node_axes(h)
    # The anomaly is computed without the node, which turns fast near the equator. On a circle it
    # counts from the node.
    circle = length == 0.0
    ahead = jnp.where(circle, dot(position, m), dot(unit(h), cross(e, position)))
    along = jnp.where(circle, dot(position, n), dot(e, position))
    # Angles in the plane of the orbit are from the node n towards m, which is 90 degrees ahead.
    y, x = barrier(((across, h[0], dot(e, m), ahead), (h[2], -h[1], dot(e, n), along)))
    return ClassicalElements(quotient(dot(h, h), mu), length, *map(safe_atan2, y, x))


@computed_once
def constant_vectors(position: Vector, velocity: Vector, mu: Scalar) -> tuple[Vector, Vector]:
    """The angular momentum per unit mass and the eccentricity vector of an orbit, which all of its
    elements read."""
    return cross(position, velocity), eccentricity_vector(position, velocity, mu)


def _node_axes(h: Vector) -> tuple[Vector, Vector, Scalar]:
    """The unit vectors to the ascending node, the x axis at the equator, and 90 degrees ahead of it
    in the plane of the orbit; and the part of the angular momentum `h` along the equator."""
    # In units of the greater part, so that the squares of small ones do not vanish.
    size = jax.lax.stop_gradient(jnp.maximum(jnp.abs(h[0]), jnp.abs(h[1])))
    flat = size == 0.0
    per = 1.0 / jnp.where(flat, 1.0, size)
    x = jnp.where(flat, 1.0, -per * h[1])
    y = per * h[0]
    root = sqrt(x * x + y * y)
    c, s = x / root, y / root
    across = jnp.where(flat, 0.0, size * root)
    w = jnp.stack([across, h[2]]) * safe_divide(1.0, norm(h))
    return jnp.stack([c, s, jnp.zeros_like(c)]), jnp.stack([-s * w[1], c * w[1], w[0]]), across


@formula(mu=POSITIVE)
def state_from_elements(elements: ClassicalElements, mu: Scalar) -> tuple[Vector, Vector]:
    """Position, m, and velocity, m/s, both (3, *runs), at the true anomaly of `elements`.

    **Arguments**

    - `elements`: on an open orbit with a true anomaly between the asymptotes, 1 + e cos f > 0.
    - `mu`: gravitational parameter, m^3/s^2, (*runs,).
    """
    return in_blocks(_state, (0, 0), elements, mu)


@computed_once
def _sines_and_cosines(angles: tuple[Scalar, ...]) -> tuple[tuple[Scalar, Scalar], ...]:
    """The sine and the cosine of each angle, which all components of a state read."""
    return tuple(sincos(as_float(x)) for x in angles)


def _state(x: ClassicalElements, mu: Scalar) -> tuple[Vector, Vector]:
    p, e = x.semi_latus_rectum, x.eccentricity
    angles = (x.node, x.inclination, x.argument_of_periapsis, x.true_anomaly)
    (sn, cn), (si, ci), (sw, cw), (sf, cf) = _sines_and_cosines(angles)
    r = p / (1.0 + e * cf)
    speed = jnp.sqrt(mu / p)
    # From the node, and a right angle ahead of it in the plane of the orbit.
    cu, su = cf * cw - sf * sw, sf * cw + cf * sw
    plane = barrier(((r * cu, r * su), (-speed * (su + e * sw), speed * (cu + e * cw))))

    def turned(along: Scalar, ahead: Scalar) -> Vector:
        level = ci * ahead
        parts = (cn * along - sn * level, sn * along + cn * level, si * ahead)
        return jnp.stack(jnp.broadcast_arrays(*parts))

    return turned(*plane[0]), turned(*plane[1])
