"""Equinoctial elements: regular at the circle and the equator, with a mean longitude.

    mean longitude = K + g cos K - f sin K = K - r . v / sqrt(mu a)               ellipse
    mean longitude = atan2(g, f) + s - asinh(s / e),  s = r . v / sqrt(-mu a)     hyperbola
    e cos K = 1 - r/a

    symbol  meaning                                                       unit
    a       semi-major axis, negative for a hyperbola                     m
    K       eccentric longitude: node + argument of periapsis + anomaly   rad
    f, g    k and h of these elements, as the modified ones name them     1

Source: Broucke and Cefola (1972), Celestial Mechanics 5, 303, whose letters these are: their h, k,
p, q are g, f, k, h of the modified equinoctial elements.

The mean longitude grows evenly with the time, the others stay. A parabola has no mean motion, hence
no such elements; close to it the place beside the periapsis hangs on the last digits of the mean
longitude. The modified elements have no such limit.
"""

from typing import final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..core import (
    AbstractParameters,
    InputError,
    Scalar,
    Vector,
    check,
    dot,
    is_concrete,
    norm,
    quantity,
)
from ._kepler import kepler_flow
from ._modified_equinoctial import ModifiedEquinoctialElements


@final
class EquinoctialElements(AbstractParameters):
    """Six elements of an ellipse or a hyperbola, regular at the circle and the equator; the
    longitude is the mean one, which grows evenly with the time.

    Raises `InputError` for a parabola, and for a semi-major axis of the wrong sign."""

    semi_major_axis: Float[Array, "*#runs"] = quantity("m", doc="a, negative for a hyperbola")
    h: Float[Array, "*#runs"] = quantity("", doc="e sin(argument of periapsis + node)")
    k: Float[Array, "*#runs"] = quantity("", doc="e cos(argument of periapsis + node)")
    p: Float[Array, "*#runs"] = quantity("", doc="tan(i/2) sin(node)")
    q: Float[Array, "*#runs"] = quantity("", doc="tan(i/2) cos(node)")
    mean_longitude: Float[Array, "*#runs"] = quantity(
        "rad", doc="node + argument of periapsis + mean anomaly"
    )
    retrograde: bool = eqx.field(
        static=True,
        default=False,
        metadata={"doc": "count from the other end of the line of nodes: regular at i = 180 deg"},
    )

    def __check_init__(self):
        values = (self.semi_major_axis, self.h, self.k)
        if all(is_concrete(x) for x in values):
            a, h, k = (np.asarray(x, float) for x in values)
            check(
                a * (1.0 - h * h - k * k) > 0.0,
                "EquinoctialElements.semi_major_axis",
                a,
                "positive where h^2 + k^2 < 1 and negative above: a parabola has none, but "
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
        r = norm(position)
        x = ModifiedEquinoctialElements.of_state(position, velocity, mu, retrograde=retrograde)
        alpha = 2.0 / r - dot(velocity, velocity) / mu
        if is_concrete(alpha) and np.any(np.asarray(alpha) == 0.0):
            raise InputError(
                "EquinoctialElements.of_state: the orbit is a parabola, which has no mean motion: "
                "take ModifiedEquinoctialElements."
            )
        longitude = _mean_longitude(x, alpha, r, dot(position, velocity) / jnp.sqrt(mu))
        return cls(1.0 / alpha, x.g, x.f, x.k, x.h, longitude, retrograde)

    def state(self, mu: Scalar) -> tuple[Vector, Vector]:
        """Position, m, and velocity, m/s, each (3, *runs), for the parameter `mu`, m^3/s^2.

        By `kepler_flow` from a place near by, so that derivatives of every order are those of the
        motion."""
        a, f, g = self.semi_major_axis, self.k, self.h
        closed = a > 0.0
        size = jnp.abs(a)
        per_rate = size * jnp.sqrt(size / mu)
        e2 = f * f + g * g
        p = a * (1.0 - e2)
        # From the periapsis of a hyperbola; of an ellipse from the place whose eccentric longitude
        # is the mean one, because a circle has no periapsis.
        place = jnp.where(closed, self.mean_longitude, 0.0)
        ellipse_L = _true_longitude(place, *(jnp.where(closed, x, 0.0) for x in (f, g)))
        open_L = jnp.arctan2(*(jnp.where(closed, other, x) for other, x in ((0.0, g), (1.0, f))))
        mean = jnp.where(closed, place + g * jnp.cos(place) - f * jnp.sin(place), open_L)
        start = ModifiedEquinoctialElements(
            p, f, g, self.q, self.p, jnp.where(closed, ellipse_L, open_L), self.retrograde
        )
        return kepler_flow(*start.state(mu), (self.mean_longitude - mean) * per_rate, mu)


def _true_longitude(K: Scalar, f: Scalar, g: Scalar) -> Scalar:
    """The true longitude at the eccentric longitude `K` of an ellipse, within (-pi, pi]."""
    b = 1.0 / (1.0 + jnp.sqrt(1.0 - f * f - g * g))
    c, s = jnp.cos(K), jnp.sin(K)
    x = (1.0 - g * g * b) * c + f * g * b * s - f
    y = (1.0 - f * f * b) * s + f * g * b * c - g
    return jnp.arctan2(y, x)


def _mean_longitude(
    x: ModifiedEquinoctialElements, alpha: Scalar, r: Scalar, sigma: Scalar
) -> Scalar:
    """The mean longitude; `alpha` is 1/a, `r` the distance, `sigma` r . v / sqrt(mu)."""
    closed = alpha > 0.0
    f, g = x.f, x.g
    # The sine of the anomaly times e; of a hyperbola the hyperbolic sine.
    sine = sigma * jnp.sqrt(jnp.where(alpha == 0.0, jnp.nan, jnp.abs(alpha)))
    f1, g1, alpha1, p1 = (
        jnp.where(closed, v, w)
        for v, w in ((f, 0.0), (g, 0.0), (alpha, 1.0), (x.semi_latus_rectum, 1.0))
    )
    # sqrt(1 - e^2), without the difference.
    root = jnp.sqrt(p1 * alpha1)
    b = 1.0 / (1.0 + root)
    L = x.true_longitude
    X, Y = r * alpha1 * jnp.cos(L), r * alpha1 * jnp.sin(L)
    cosine_K = f1 + ((1.0 - f1 * f1 * b) * X - f1 * g1 * b * Y) / root
    sine_K = g1 + ((1.0 - g1 * g1 * b) * Y - f1 * g1 * b * X) / root
    ellipse = jnp.arctan2(sine_K, cosine_K) - sine
    f2, g2 = jnp.where(closed, 1.0, f), jnp.where(closed, 0.0, g)
    anomaly = jnp.arcsinh(sine / jnp.sqrt(f2 * f2 + g2 * g2))
    return jnp.where(closed, ellipse, jnp.arctan2(g2, f2) + sine - anomaly)
