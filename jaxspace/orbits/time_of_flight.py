"""Time of flight between two places on a conic, and the place after a given time.

    W = G1(chi/2) / G0(chi/2) = sin(d/2) / (sqrt(p) cos(d/2) - sigma sin(d/2))
    T = G1(chi) + sigma G2(chi) + G3(chi)                     Kepler's equation
    tan(d/2) = sqrt(p) W / (1 + sigma W)                      the inverse

    symbol     meaning                                                       unit
    f          true anomaly; d: its change                                   rad
    T          time of flight in |r0| sqrt(|r0|/mu), r0: the first place     1
    p          semi-latus rectum in |r0|: 1 + e cos f                        1
    sigma      r0 . v0 / sqrt(mu |r0|) = e sin f / sqrt(p)                   1
    beta       |r0| / a = (1 - e^2) / p; 0 for a parabola                    1
    chi, G_n   universal anomaly, G_n = chi^n c_n(beta chi^2)                1

Source: Battin, An Introduction to the Mathematics and Methods of Astrodynamics, 4.5, 4.6; Thomson
4.13-12, -13, -21 has the forms with logarithms and arccosines, which lose their digits at e = 1.

On one side of the periapsis all terms of T have one sign when it counts from the nearer place, so
that neither the parabola nor a short arc loses digits; across it two such times are added.
"""

__all__ = ["period", "semi_major_axis_of_period", "time_of_flight", "true_anomaly_after"]

import math

import jax.numpy as jnp

from ..core import Scalar
from ..core.barrier import barrier
from ..core.formula import FINITE, NOT_NEGATIVE, POSITIVE, formula
from ..core.special import stumpff
from ..core.square_roots import inverse_sqrt, sqrt
from ..core.squares import quotient
from ..core.types import as_float
from .kepler import universal_anomaly

_TURN = 2.0 * math.pi


@formula(mu=POSITIVE)
def period(semi_major_axis: Scalar, mu: Scalar) -> Scalar:
    """Time of a revolution 2 pi sqrt(a^3/mu), s (Thomson 4.10-8); infinite for an open orbit, with
    the derivative zero.

    **Arguments**

    - `semi_major_axis`: m, (*runs,); negative or infinite for an open orbit.
    - `mu`: gravitational parameter, m^3/s^2, (*runs,).
    """
    a = as_float(semi_major_axis)
    closed = (a > 0.0) & (a < math.inf)
    a = jnp.where(closed, a, 1.0)
    return jnp.where(closed, _TURN * a * jnp.sqrt(quotient(a, mu)), math.inf)


@formula(period=POSITIVE, mu=POSITIVE)
def semi_major_axis_of_period(period: Scalar, mu: Scalar) -> Scalar:
    """The semi-major axis (mu (T/(2 pi))^2)^(1/3), m, (*runs,), of the closed orbits of a period:
    undoes `period`.

    Of two masses it is their mean distance D, with mu = G (m1 + m2), by Thomson 4.6
    D^3 = g R^2/(w^2 (1 - m2/(m1 + m2))).

    **Arguments**, each (*runs,)

    - `period`: T, s, positive.
    - `mu`: gravitational parameter, of two masses that of both together, m^3/s^2.
    """
    return jnp.cbrt(mu * (as_float(period) / _TURN) ** 2)


@formula(semi_latus_rectum=POSITIVE, eccentricity=NOT_NEGATIVE, mu=POSITIVE)
def time_of_flight(
    start: Scalar, end: Scalar, semi_latus_rectum: Scalar, eccentricity: Scalar, mu: Scalar
) -> Scalar:
    """The time in which the true anomaly goes from `start` to `end` (Thomson 4.13).

    **Arguments**, each (*runs,)

    - `start`, `end`: true anomalies, rad. Add 2 pi for each whole revolution; on an open orbit
      both lie within (-pi, pi), between the asymptotes.
    - `semi_latus_rectum`: m; `eccentricity`: of any conic that is not a straight line.
    - `mu`: gravitational parameter, m^3/s^2.

    **Returns** the time, s, (*runs,): negative where `end` is the smaller angle, NaN beyond an
    asymptote.
    """
    p, e = as_float(semi_latus_rectum), as_float(eccentricity)
    turns = jnp.round(start / _TURN), jnp.round(end / _TURN)
    first, last = (f - _TURN * n for f, n in zip((start, end), turns, strict=True))
    unit_of_time = p * jnp.sqrt(quotient(p, mu))
    # A whole turn takes 2 pi / (1 - e^2)^(3/2) of these units.
    closed = e < 1.0
    energy = jnp.where(closed, (1.0 - e) * (1.0 + e), 1.0)
    whole = jnp.where(closed, (turns[1] - turns[0]) * _TURN / (energy * jnp.sqrt(energy)), 0.0)
    # An inbound arc is replaced by its mirror image, which takes as long, so that no anomaly is
    # negative.
    across = (first < 0.0) & (last > 0.0) | (first > 0.0) & (last < 0.0)
    forwards = jnp.abs(last) >= jnp.abs(first)
    inbound = jnp.where(forwards, last, first) < 0.0
    near, far = jnp.where(forwards, first, last), jnp.where(forwards, last, first)
    near, far = (jnp.where(inbound, -f, f) for f in (near, far))
    # From the nearer place; across the periapsis the two times from there are added.
    time = _outwards(jnp.where(across, 0.0, near), far, e)
    time = time + jnp.where(across, _outwards(0.0 * e, jnp.where(across, -near, 0.0), e), 0.0)
    time = jnp.where(forwards != inbound, time, -time)
    # An open orbit has no whole turns: a value that rounds to one is beyond an asymptote.
    beyond = ~closed & ((turns[0] != 0.0) | (turns[1] != 0.0))
    return unit_of_time * jnp.where(beyond, jnp.nan, time + whole)


@formula(duration=FINITE, semi_latus_rectum=POSITIVE, eccentricity=NOT_NEGATIVE, mu=POSITIVE)
def true_anomaly_after(
    start: Scalar, duration: Scalar, semi_latus_rectum: Scalar, eccentricity: Scalar, mu: Scalar
) -> Scalar:
    """The true anomaly a given duration after that of the `start`: undoes `time_of_flight`.

    **Arguments**, each (*runs,)

    - `start`: true anomaly, rad; `duration`: s, of either sign.
    - `semi_latus_rectum`, `eccentricity`, `mu`: as in `time_of_flight`.

    **Returns** the true anomaly, rad, (*runs,), whole revolutions included. Derivatives of every
    order follow from the implicit function theorem.
    """
    p, e = as_float(semi_latus_rectum), as_float(eccentricity)
    rho, sigma, beta = _place(start, e)
    per_time = rho * jnp.sqrt(mu * rho / p) / p
    chi = universal_anomaly(sigma, beta, duration * per_time, rho)
    # Each whole turn adds 2 pi / sqrt(beta) to the anomaly.
    root = sqrt(jnp.where(beta > 0.0, beta, 1.0))
    turns = jnp.where(beta > 0.0, jnp.round(chi * root / _TURN), 0.0)
    half = 0.5 * (chi - turns * _TURN / root)
    c2, c3, *_ = stumpff(beta * half * half)
    g1 = half - beta * half * half * half * c3
    g0 = 1.0 - beta * half * half * c2
    return start + _TURN * turns + 2.0 * jnp.arctan2(jnp.sqrt(rho) * g1, g0 + sigma * g1)


def _place(f: Scalar, e: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    """p, sigma and beta of the module at the true anomaly `f`."""
    rho = 1.0 + e * jnp.cos(f)
    return rho, e * jnp.sin(f) * inverse_sqrt(rho), (1.0 - e) * (1.0 + e) / rho


def _outwards(near: Scalar, far: Scalar, e: Scalar) -> Scalar:
    """Time from the anomaly `near` to `far`, 0 <= near <= far <= pi, in units of
    sqrt(p^3/mu)."""
    rho, sigma, beta = barrier(_place(near, e))
    half = 0.5 * (far - near)
    sine = jnp.sin(half)
    chi = _anomaly(sine, jnp.sqrt(rho) * jnp.cos(half) - sigma * sine, beta)
    c2, c3, *_ = stumpff(beta * chi * chi)
    g2 = chi * chi * c2
    g3 = chi * chi * chi * c3
    return (chi - beta * g3 + sigma * g2 + g3) / (rho * jnp.sqrt(rho))


def _anomaly(sine: Scalar, cosine: Scalar, beta: Scalar) -> Scalar:
    """The universal anomaly chi with G1(chi/2) / G0(chi/2) = sine / cosine, sine >= 0; NaN where an
    open orbit does not get there."""
    z = beta * sine * sine / jnp.where(cosine == 0.0, 1.0, cosine * cosine)
    small = (cosine > 0.0) & (jnp.abs(z) < 0.05)
    ratio = sine / jnp.where(small, cosine, 1.0)
    w = jnp.where(small, z, 0.0)
    # atan(sqrt(w)) / sqrt(w), for w < 0 the hyperbolic one: 0.05^13 / 27 is below rounding.
    series = 1.0 / 27.0
    for n in range(12, -1, -1):
        series = 1.0 / (2 * n + 1) - w * series
    root = sqrt(jnp.where(small, 1.0, jnp.abs(beta)))
    closed = beta > 0.0
    c = jnp.where(small, 1.0, cosine)
    angle = jnp.arctan2(root * sine, jnp.where(closed, c, 1.0))
    hyperbolic = jnp.arctanh(jnp.where(closed | small, 0.0, root * sine / c))
    reached = closed | (cosine > 0.0)
    away = jnp.where(closed, angle, jnp.where(reached, hyperbolic, jnp.nan)) / root
    return 2.0 * jnp.where(small, ratio * series, away)
