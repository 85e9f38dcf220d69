"""The conic in its plane: radius, eccentric, hyperbolic and mean anomaly; the angle of a flyby.

    r = p / (1 + e cos f)
    tan(E/2) = sqrt((1 - e)/(1 + e)) tan(f/2),    M = E - e sin E           ellipse
    tanh(H/2) = sqrt((e - 1)/(e + 1)) tan(f/2),   M = e sinh H - H          hyperbola
    sin(delta/2) = 1/e

    symbol   meaning                                                          unit
    f        true anomaly                                                     rad
    E, H     eccentric and hyperbolic anomaly                                 rad, 1
    M        mean anomaly: sqrt(mu/|a|^3) times the time since the periapsis  rad
    p, e     semi-latus rectum, eccentricity                                  m, 1
    delta    by which a flyby turns the velocity far away                     rad

Source: Thomson 4.8, 4.13-12, -13.

On a parabola E, H and M are zero everywhere: use `time_of_flight`, which is regular there.
"""

__all__ = ["conic_radius", "eccentric_anomaly", "mean_anomaly", "true_anomaly", "turning_angle"]

import math

import jax.numpy as jnp

from ..core import Scalar
from ..core.formula import NOT_NEGATIVE, POSITIVE, formula
from ..core.safe import safe_sqrt
from ..core.special import stumpff
from ..core.types import as_float

_TURN = 2.0 * math.pi


@formula(semi_latus_rectum=POSITIVE, eccentricity=NOT_NEGATIVE)
def conic_radius(semi_latus_rectum: Scalar, eccentricity: Scalar, true_anomaly: Scalar) -> Scalar:
    """Distance from the centre, m; infinite on an asymptote, negative beyond it.

    **Arguments**

    - `semi_latus_rectum`: m, (*runs,).
    - `eccentricity`: (*runs,).
    - `true_anomaly`: rad, (*runs,)."""
    return semi_latus_rectum / (1.0 + eccentricity * jnp.cos(true_anomaly))


@formula(eccentricity=NOT_NEGATIVE)
def eccentric_anomaly(true_anomaly: Scalar, eccentricity: Scalar) -> Scalar:
    """The eccentric anomaly E, rad, or on a hyperbola the hyperbolic anomaly H.

    **Arguments**, each (*runs,)

    - `true_anomaly`: rad; whole turns of an ellipse are preserved.
    - `eccentricity`: of any conic.

    **Returns** E or H; NaN beyond an asymptote.
    """
    f, e = as_float(true_anomaly), as_float(eccentricity)
    closed = e < 1.0
    turns = _TURN * jnp.round(f / _TURN)
    half = 0.5 * (f - turns)
    # Of half the angle, whose ratio loses no digits near the parabola.
    # Each form gets an eccentricity of its kind: the root of the other kind is NaN.
    inner, outer = jnp.where(closed, e, 0.0), jnp.where(closed, 2.0, e)
    out, across = jnp.cos(half), jnp.sin(half)
    angle = jnp.arctan2(jnp.sqrt(1.0 - inner) * across, jnp.sqrt(1.0 + inner) * out)
    ratio = jnp.tan(0.5 * f) * safe_sqrt((outer - 1.0) / (outer + 1.0))
    return jnp.where(closed, turns + 2.0 * angle, 2.0 * jnp.arctanh(ratio))


@formula(eccentricity=NOT_NEGATIVE)
def true_anomaly(eccentric_anomaly: Scalar, eccentricity: Scalar) -> Scalar:
    """The true anomaly, rad, of an eccentric or a hyperbolic one: the inverse of
    `eccentric_anomaly`.

    **Arguments**

    - `eccentric_anomaly`: rad, (*runs,); the hyperbolic one above an eccentricity of 1.
    - `eccentricity`: (*runs,)."""
    x, e = as_float(eccentric_anomaly), as_float(eccentricity)
    closed = e < 1.0
    turns = jnp.where(closed, _TURN * jnp.round(x / _TURN), 0.0)
    half = 0.5 * (x - turns)
    inner, outer = jnp.where(closed, e, 0.0), jnp.where(closed, 2.0, e)
    # As a quotient of two terms, infinite in the asymptote and at the apoapsis.
    across = jnp.where(closed, jnp.sqrt(1.0 + inner) * jnp.sin(half), 0.0)
    out = jnp.where(closed, jnp.sqrt(1.0 - inner) * jnp.cos(half), 1.0)
    ellipse = turns + 2.0 * jnp.arctan2(across, out)
    hyperbola = 2.0 * jnp.arctan2(jnp.sqrt(outer + 1.0) * jnp.tanh(half), safe_sqrt(outer - 1.0))
    return jnp.where(closed, ellipse, hyperbola)


@formula(eccentricity=NOT_NEGATIVE)
def mean_anomaly(eccentric_anomaly: Scalar, eccentricity: Scalar) -> Scalar:
    """Kepler's equation: the mean anomaly, rad, of an eccentric or a hyperbolic one.

    Accurate near the parabola and the periapsis. Its inverse is `true_anomaly_after`.

    **Arguments**

    - `eccentric_anomaly`: rad, (*runs,); the hyperbolic one above an eccentricity of 1.
    - `eccentricity`: (*runs,)."""
    x, e = as_float(eccentric_anomaly), as_float(eccentricity)
    closed = e < 1.0
    # Whole turns are subtracted, because the Stumpff functions are valid up to the square of pi.
    turns = jnp.where(closed, jnp.round(x / _TURN), 0.0)
    x = x - _TURN * turns
    square = jnp.where(closed, x * x, -x * x)
    # E - sin E and sinh H - H as a power series, which does not cancel.
    _, c3, *_ = stumpff(square)
    return _TURN * turns + jnp.abs(1.0 - e) * x + e * x * x * x * c3


@formula(eccentricity=NOT_NEGATIVE)
def turning_angle(eccentricity: Scalar) -> Scalar:
    """The angle, rad, between the asymptotic velocities before and after a flyby on a hyperbola of
    this eccentricity, (*runs,); pi on the parabola, NaN on an ellipse."""
    e = as_float(eccentricity)
    return 2.0 * jnp.arctan2(1.0, jnp.sqrt((e - 1.0) * (e + 1.0)))
