"""The universal anomaly a given duration after any start.

The anomaly counts from periapsis, so that no large terms cancel. The functions here are not
differentiated: `kepler.py` defines the derivative rule.

    G_n(x) = x^n c_n(beta x^2)               c_n: Stumpff functions
    t = q x + e G3(x)                        time since periapsis
    rho = q + e G2(x),  rho' = e G1(x)       radius, and its derivative by the anomaly
    sigma = e G1(x0),  1 - beta = e G0(x0)   where the motion starts, at x0
    G0 = 1 - beta G2,  G1 = x - beta G3

    symbol     meaning                                                       unit
    x          universal anomaly from periapsis: d(x) = d(t) / rho           1
    sigma      r0 . v0 / sqrt(mu |r0|)                                       1
    beta       |r0| / a, s^2 its absolute value; 0 for a parabola            1
    p, q, e    semi-latus rectum, periapsis radius (in |r0|), eccentricity   1
    tau        duration in |r0| sqrt(|r0| / mu)                              1

Source: Danby, Fundamentals of Celestial Mechanics, 6.9. Starting value: Mikkola (1987), Celestial
Mechanics 40, 329, written here so that it passes through the parabola. Iteration: Laguerre-Conway
(1986), Celestial Mechanics 39, 199. First value of the inverse tangent: Abramowitz and Stegun
4.4.49.
"""

import math
from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import jax.numpy as jnp

from ..core import Flag, Scalar
from ..core.barrier import barrier, computed_once
from ..core.special import stumpff, stumpff_near
from ..core.square_roots import sqrt

_TURN = 2.0 * math.pi

Stumpff: TypeAlias = Callable[[Scalar], tuple[Scalar, Scalar, Scalar, Scalar]]


class Anomaly(NamedTuple):
    """The end of a motion, in the symbols of the module.

    - `chi`: anomaly from the start on, within half a turn; `g2`, `g3`: G2(chi) and G3(chi).
    - `rho`, `slope`: radius, and its derivative by the anomaly.
    - `left`: the duration without its whole turns.
    """

    chi: Scalar
    g2: Scalar
    g3: Scalar
    rho: Scalar
    slope: Scalar
    left: Scalar


class _Conic(NamedTuple):
    """The constants of a conic. `s` has a floor: a parabola, where the forms for ellipses and
    hyperbolas meet, is computed as a nearby conic."""

    beta: Scalar
    closed: Flag
    s: Scalar
    e: Scalar
    q: Scalar


def anomaly_after(sigma: Scalar, beta: Scalar, tau: Scalar, p: Scalar) -> Anomaly:
    """Anomaly and radius after a duration `tau`, in the symbols of the module, each (*runs,).

    `p` follows from sigma and beta, but loses digits when it is computed from them."""
    closed = beta > 0.0
    zeta = 1.0 - beta
    s = sqrt(jnp.maximum(jnp.abs(beta), 1e-20))
    # e^2 as a sum of squares on a closed orbit, and as 1 - beta p on an open one: each is the form
    # that does not cancel. Far below rounding the squares underflow; there the orbit is a circle,
    # and a floor under e leaves it a periapsis, whose place does not matter.
    e2 = jnp.where(closed, zeta * zeta + beta * sigma * sigma, 1.0 - beta * p)
    e = barrier(jnp.sqrt(jnp.maximum(e2, float(jnp.finfo(e2.dtype).eps) ** 4)))
    conic = barrier(_Conic(beta, closed, s, e, p / (1.0 + e)))
    q = conic.q
    x0, t0 = _start(conic, sigma, zeta)
    s3 = s * s * s
    # Whole turns are subtracted first, so that the iteration starts within half a turn of
    # periapsis.
    turns = jnp.where(closed, jnp.round((t0 + tau) * (s3 * (1.0 / _TURN))), 0.0)
    left = tau - turns * (_TURN / s3)
    t, left = barrier((t0 + left, left))
    # The start is within 2.5e-3 of the anomaly. The first step leaves 1e-11 of it, and Newton's
    # step then rounding alone.
    x = _mikkola(t, conic)
    g2, g3 = _g(x, beta, stumpff)
    x, g2, g3 = barrier(_advanced(_step(x, g2, g3, t, conic), x, g2, g3, beta))
    change = (t - q * x - e * g3) / (q + e * g2)
    g1 = x - beta * g3
    x = x + change
    # To first order in the last change: its square is below rounding.
    g2, g1 = g2 + change * g1, g1 + change * (1.0 - beta * g2)
    chi = x - x0
    over = jnp.where(closed, jnp.round(chi * (s / _TURN)), 0.0)
    end = Anomaly(chi - over * (_TURN / s), g2, g3, q + e * g2, e * g1, left - over * (_TURN / s3))
    return _from_start(barrier(end), sigma, beta, jnp.abs(t0) + jnp.abs(t))


@computed_once
def _g(x: Scalar, beta: Scalar, functions: Stumpff) -> tuple[Scalar, Scalar]:
    """G2 and G3 at the anomaly x."""
    x2 = x * x
    c2, c3, *_ = functions(beta * x2)
    return x2 * c2, x2 * x * c3


def _advanced(
    d: Scalar, x: Scalar, g2: Scalar, g3: Scalar, beta: Scalar
) -> tuple[Scalar, Scalar, Scalar]:
    """x + d, G2(x + d) and G3(x + d) for a small d, by the addition formulas."""
    g0 = 1.0 - beta * g2
    g1 = x - beta * g3
    # G2(d) and G3(d) from three terms of their series, accurate to rounding for |beta| d^2 < 1e-4.
    w = beta * d * d
    d2 = 0.5 * d * d * (1.0 - w / 12.0 * (1.0 - w / 30.0))
    d3 = d * d * d / 6.0 * (1.0 - w / 20.0 * (1.0 - w / 42.0))
    return x + d, g2 + g1 * (d - beta * d3) + g0 * d2, g3 + g2 * d + g1 * d2 + g0 * d3


@computed_once
def _start(conic: _Conic, sigma: Scalar, zeta: Scalar) -> tuple[Scalar, Scalar]:
    """Anomaly and time of the start, from periapsis.

    A rough inverse tangent (a logarithm on an open orbit) and one correction of it."""
    beta, closed, s, e, q = conic
    y = jnp.abs(s * sigma)
    sine = y / e
    rough = barrier(jnp.where(closed, _arc(y, zeta), jnp.log(sine + jnp.sqrt(1.0 + sine * sine))))
    far = jnp.logical_and(rough > math.pi, jnp.logical_not(closed))
    x = jnp.where(far, 0.0, jnp.where(sigma < 0.0, -rough, rough) / s)
    g2, g3 = _g(x, beta, stumpff_near)
    g0 = 1.0 - beta * g2
    g1 = x - beta * g3
    d = (sigma * g0 - zeta * g1) / e
    # A large logarithm gets no correction: it would be the rounding of larger terms.
    d = jnp.where(jnp.logical_or(closed, rough < 1.0), d * (1.0 + beta * d * d / 6.0), 0.0)
    x, _, g3 = _advanced(d, x, g2, g3, beta)
    sign = jnp.where(sigma < 0.0, -1.0, 1.0)
    anomaly = jnp.where(far, sign * rough / s, x)
    time = jnp.where(far, sign * (y - rough) / (s * s * s), q * x + e * g3)
    return anomaly, time


def _arc(y: Scalar, x: Scalar) -> Scalar:
    """The angle of the point (x, y), y >= 0, within 1e-5."""
    # A polynomial is enough: `_start` corrects its error.
    size = jnp.abs(x)
    a = jnp.minimum(y, size) / jnp.maximum(jnp.maximum(y, size), 1e-30)
    a2 = a * a
    angle = a * (
        0.9998660 + a2 * (-0.3302995 + a2 * (0.1801410 + a2 * (-0.0851330 + a2 * 0.0208351)))
    )
    angle = jnp.where(y > size, 0.5 * math.pi - angle, angle)
    return jnp.where(x < 0.0, math.pi - angle, angle)


@computed_once
def _mikkola(t: Scalar, conic: _Conic) -> Scalar:
    """The anomaly at the time `t` from periapsis, within a quarter of a per cent.

    A cubic gives the sine (the hyperbolic sine) of a third of the anomaly; one correction follows.
    """
    _, closed, s, e, q = conic
    k = 1.0 / (4.0 * e + 0.5)
    a = q * k
    b = 0.5 * t * k
    # z is the cube root in Cardano's formula. The form of x below has terms of one sign only, and
    # is valid at the parabola, where a is zero or s small.
    least = float(jnp.finfo(b.dtype).tiny)
    z = jnp.maximum(jnp.abs(b) + jnp.sqrt(b * b + a * a * a), least)
    z2 = barrier(jnp.exp(jnp.log(z) * (2.0 / 3.0)))
    x = s * 2.0 * b / (z2 + a + a * a / z2)
    x2 = x * x
    x5 = x2 * x2 * x
    # u corrects the sine of ellipses, w the hyperbolic sine of hyperbolas (Mikkola's constants).
    u = x - 0.078 * x5 / (1.0 + e)
    w = barrier(x + 0.071 * x5 / ((1.0 + 0.45 * x2) * (1.0 + 4.0 * x2) * e))
    size = jnp.abs(w)
    third = jnp.where(
        size < 0.1, size * (1.0 - size * size / 6.0), jnp.log(size + jnp.sqrt(1.0 + size * size))
    )
    return (
        jnp.where(
            closed,
            s * s * s * t + e * (3.0 - 4.0 * u * u) * u,
            3.0 * jnp.where(w < 0.0, -third, third),
        )
        / s
    )


@computed_once
def _step(x: Scalar, g2: Scalar, g3: Scalar, t: Scalar, conic: _Conic) -> Scalar:
    """The correction of x, of fourth order."""
    beta, _, _, e, q = conic
    g0 = 1.0 - beta * g2
    g1 = x - beta * g3
    late = q * x + e * g3 - t
    rho = q + e * g2
    slope = e * g1
    # Laguerre's method with n = 5 gives d; the Taylor series about x, solved again with this d,
    # brings the error to fourth order.
    d = -5.0 * late / (rho + jnp.sqrt(jnp.abs(16.0 * rho * rho - 20.0 * late * slope)))
    return -late / (rho + 0.5 * d * (slope + d / 3.0 * e * (g0 - 0.25 * d * beta * g1)))


def _from_start(end: Anomaly, sigma: Scalar, beta: Scalar, terms: Scalar) -> Anomaly:
    """The functions of the anomaly since the start, from those since periapsis.

    `terms` is the size of the terms of Kepler's equation about periapsis."""
    chi, _, _, rho, slope, left = end
    g2, g3 = _g(chi, beta, stumpff)
    g1 = chi - beta * g3
    # Kepler's equation from the start corrects the result where its terms are the smaller ones, so
    # that a short duration retains full accuracy.
    early = left - g1 - sigma * g2 - g3
    better = jnp.abs(g1) + jnp.abs(sigma) * g2 + jnp.abs(g3) < terms
    d = barrier(jnp.where(better, early / rho, 0.0))
    return Anomaly(
        chi + d, g2 + d * g1, g3 + d * g2, rho + d * slope, slope + d * (1.0 - beta * rho), left
    )
