"""Equinoctial elements: regular at the circle and the equator, with a mean longitude.

    mean longitude = K + g cos K - f sin K = K - r . v / sqrt(mu a)               ellipse
    mean longitude = atan2(g, f) + s - asinh(s / e),  s = r . v / sqrt(-mu a)     hyperbola
    f cos K + g sin K = 1 - r/a,  f sin K - g cos K = r . v / sqrt(mu a)          ellipse

    symbol  meaning                                                       unit
    a       semi-major axis, negative for a hyperbola                     m
    K       eccentric longitude: node + argument of periapsis + anomaly   rad
    f, g    k and h of these elements, as the modified ones name them     1

Source: Broucke and Cefola (1972), Celestial Mechanics 5, 303, whose letters these are: their h, k,
p, q are g, f, k, h of the modified equinoctial elements.

The mean longitude grows linearly with time, and the other elements are constant. A parabola has no
mean motion and therefore no such elements; close to one, a position near the periapsis depends on
the last digits of the mean longitude. The modified elements do not have this limitation.
"""

import functools
from typing import final

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from ..core import AbstractParameters, InputError, NumberField, Scalar, Vector, check, quantity
from ..core.barrier import barrier
from ..core.blocks import in_blocks
from ..core.checks import is_concrete
from ..core.square_roots import inverse_sqrt, sqrt
from ..core.squares import quotient
from ..core.trigonometry import atan2, sincos_once
from ..core.vectors import dot, norm
from ._modified_equinoctial import ModifiedEquinoctialElements, norm_of, orbit_axes, state_along
from .kepler import conic_flow


@final
class EquinoctialElements(AbstractParameters):
    """Six elements of an ellipse or a hyperbola, regular at the circle and the equator. The mean
    longitude grows linearly with time.

    Raises `InputError` for a parabola, and for a semi-major axis of the wrong sign."""

    semi_major_axis: NumberField = quantity("m", doc="a, negative for a hyperbola")
    h: NumberField = quantity("", doc="e sin(argument of periapsis + node)")
    k: NumberField = quantity("", doc="e cos(argument of periapsis + node)")
    p: NumberField = quantity("", doc="tan(i/2) sin(node)")
    q: NumberField = quantity("", doc="tan(i/2) cos(node)")
    mean_longitude: NumberField = quantity("rad", doc="node + argument of periapsis + mean anomaly")
    retrograde: bool = eqx.field(
        static=True,
        default=False,
        metadata={"doc": "retrograde elements: regular at i = 180 deg"},
    )

    def __check_init__(self):
        # The kinds of the numbers come first.
        super().__check_init__()
        values = (self.semi_major_axis, self.h, self.k)
        if all(is_concrete(x) for x in values):
            a, h, k = (np.asarray(x, float) for x in values)
            check(
                a * (1.0 - h * h - k * k) > 0.0,
                "EquinoctialElements.semi_major_axis",
                a,
                "positive where h^2 + k^2 < 1 and negative above; for a parabola use "
                "ModifiedEquinoctialElements",
            )

    @classmethod
    def of_state(
        cls, position: Vector, velocity: Vector, mu: Scalar, *, retrograde: bool = False
    ) -> "EquinoctialElements":
        """The elements of the orbit through a state. The mean longitude of an ellipse is within
        pi + e of zero, that of a hyperbola unbounded; on a parabola it is NaN.

        **Arguments** as in `ModifiedEquinoctialElements.of_state`.

        **Raises** `InputError` for a single parabola whose state is known."""
        elements = functools.partial(_of_state, retrograde)
        return in_blocks(elements, (1, 1, 0), position, velocity, mu)

    @property
    def eccentricity(self) -> Scalar:
        """Eccentricity of the conic; its derivative is zero on a circle."""
        return norm_of(self.k, self.h)

    @property
    def periapsis_radius(self) -> Scalar:
        """Least distance from the centre on the whole conic, m."""
        return self.semi_major_axis * (1.0 - self.eccentricity)

    @property
    def apoapsis_radius(self) -> Scalar:
        """Greatest distance from the centre, m; infinite on an open orbit."""
        a = self.semi_major_axis
        return jnp.where(a > 0.0, a * (1.0 + self.eccentricity), jnp.inf)

    def state(self, mu: Scalar) -> tuple[Vector, Vector]:
        """Position, m, and velocity, m/s, each (3, *runs), for the parameter `mu`, m^3/s^2.

        Computed with `kepler_flow` from a nearby point, so that derivatives of every order are
        those of the motion."""
        return in_blocks(_state, (0, 0), self, mu)


def _of_state(
    retrograde: bool, position: Vector, velocity: Vector, mu: Scalar
) -> EquinoctialElements:
    r = norm(position)
    x = ModifiedEquinoctialElements.of_state(position, velocity, mu, retrograde=retrograde)
    # 1/a and not a, because it is finite on every conic.
    alpha = 2.0 / r - quotient(dot(velocity, velocity), mu)
    if is_concrete(alpha) and np.any(np.asarray(alpha) == 0.0):
        raise InputError(
            "EquinoctialElements.of_state: the orbit is a parabola, which has no mean motion: use "
            "ModifiedEquinoctialElements."
        )
    longitude = _mean_longitude(x, alpha, r, dot(position, velocity) * inverse_sqrt(mu))
    return EquinoctialElements(1.0 / alpha, x.g, x.f, x.k, x.h, longitude, retrograde)


def _state(x: EquinoctialElements, mu: Scalar) -> tuple[Vector, Vector]:
    a, f, g = x.semi_major_axis, x.k, x.h
    closed = a > 0.0
    size = jnp.abs(a)
    per_rate = size * jnp.sqrt(quotient(size, mu))
    # A hyperbola starts at its periapsis; an ellipse starts where its eccentric longitude equals
    # the mean one, because a circle has no periapsis.
    K = jnp.where(closed, x.mean_longitude, 0.0)
    s, c = sincos_once(K)
    f1, g1 = (jnp.where(closed, y, 0.0) for y in (f, g))
    b = 1.0 / (1.0 + jnp.sqrt(1.0 - f1 * f1 - g1 * g1))
    X = jnp.where(closed, (1.0 - g1 * g1 * b) * c + f1 * g1 * b * s - f1, f)
    Y = jnp.where(closed, (1.0 - f1 * f1 * b) * s + f1 * g1 * b * c - g1, g)
    u = inverse_sqrt(X * X + Y * Y)
    # An ellipse may be a circle: it gets a harmless direction in place of that of its periapsis.
    f2, g2 = jnp.where(closed, 1.0, f), jnp.where(closed, 0.0, g)
    mean = jnp.where(closed, K + g1 * c - f1 * s, atan2(g2, f2))
    F, G = orbit_axes(x.q, x.p, x.retrograde)
    p = a * (1.0 - (f * f + g * g))
    r, v = state_along(F, G, p, (f, g), (u * X, u * Y), mu)
    r, v, duration = barrier((r, v, (x.mean_longitude - mean) * per_rate))
    return conic_flow(r, v, duration, mu)


def _mean_longitude(
    x: ModifiedEquinoctialElements, alpha: Scalar, r: Scalar, sigma: Scalar
) -> Scalar:
    """The mean longitude; `alpha` is 1/a, `r` the distance, `sigma` r . v / sqrt(mu)."""
    closed = alpha > 0.0
    f, g = x.f, x.g
    # The sine of the anomaly times e; of a hyperbola the hyperbolic sine.
    # NaN on a parabola, which has no mean longitude: the zero would look like one.
    sine = sigma * jnp.sqrt(jnp.where(alpha == 0.0, jnp.nan, jnp.abs(alpha)))
    f1, g1, alpha1, p1 = (
        jnp.where(closed, v, w)
        for v, w in ((f, 0.0), (g, 0.0), (alpha, 1.0), (x.semi_latus_rectum, 1.0))
    )
    # sqrt(1 - e^2), without the difference.
    root = sqrt(p1 * alpha1)
    b = 1.0 / (1.0 + root)
    L = x.true_longitude
    s, c = sincos_once(L)
    X, Y = r * alpha1 * c, r * alpha1 * s
    cosine_K = f1 + ((1.0 - f1 * f1 * b) * X - f1 * g1 * b * Y) / root
    sine_K = g1 + ((1.0 - g1 * g1 * b) * Y - f1 * g1 * b * X) / root
    # Of a narrow ellipse the root is small and what it divides cancels; there the eccentric anomaly
    # counts from the periapsis, which a circle lacks.
    narrow = f1 * f1 + g1 * g1 > 0.5
    C, S = 1.0 - r * alpha1, jnp.where(closed, sine, 0.0)
    sine_K = jnp.where(narrow, g1 * C + f1 * S, sine_K)
    cosine_K = jnp.where(narrow, f1 * C - g1 * S, cosine_K)
    ellipse = atan2(sine_K, cosine_K) - sine
    f2, g2 = jnp.where(closed, 1.0, f), jnp.where(closed, 0.0, g)
    anomaly = jnp.arcsinh(sine * inverse_sqrt(f2 * f2 + g2 * g2))
    return jnp.where(closed, ellipse, atan2(g2, f2) + sine - anomaly)
