"""The universal anomaly a time after any start, counted from periapsis so that nothing large
cancels: no derivatives here.

    t = q x + e G3(x)                        time since periapsis; G_n(x) = x^n c_n(beta x^2), c_n: Stumpff
    rho = q + e G2(x),  rho' = e G1(x)       radius, and its derivative by the anomaly
    sigma = e G1(x0),  1 - beta = e G0(x0)   where the motion starts, at x0
    G0 = 1 - beta G2,  G1 = x - beta G3

    symbol     meaning                                                       unit
    x          universal anomaly from periapsis: d(x) = d(t) / rho           1
    sigma      r0 . v0 / sqrt(mu |r0|)                                       1
    beta       |r0| / a, s^2 its absolute value; 0 for a parabola            1
    p, q, e    semi-latus rectum, periapsis radius (in |r0|), eccentricity   1
    tau        duration in |r0| sqrt(|r0| / mu)                              1

Source: Danby, Fundamentals of Celestial Mechanics, 6.9; starting value: Mikkola (1987), Celestial
Mechanics 40, 329, here written so that it passes through the parabola; iteration: Laguerre-Conway
(1986), Celestial Mechanics 39, 199; first value of the inverse tangent: Abramowitz and Stegun
4.4.49.
"""

import math
from typing import NamedTuple

import jax.numpy as jnp

from ..core import Flag, Scalar, barrier, stumpff, stumpff_near

_TURN = 2.0 * math.pi


class Anomaly(NamedTuple):
    """What a duration leads to: `chi` from the start on, within half a turn; G2(chi) and G3(chi);
    radius `rho` and its slope; and `left`, the duration without the whole turns."""

    chi: Scalar
    g2: Scalar
    g3: Scalar
    rho: Scalar
    slope: Scalar
    left: Scalar


class _Conic(NamedTuple):
    """`s` is that of a nearby conic where the conic is a parabola, because both forms end alike."""

    beta: Scalar
    closed: Flag
    s: Scalar
    e: Scalar
    q: Scalar


def anomaly_after(sigma: Scalar, beta: Scalar, tau: Scalar, p: Scalar) -> Anomaly:
    """Anomaly and radius a duration `tau` later; p is a function of sigma and beta, which suffers
    when computed from them."""
    closed = beta > 0.0
    zeta, s = 1.0 - beta, jnp.sqrt(jnp.maximum(jnp.abs(beta), 1e-20))
    e = barrier(jnp.sqrt(jnp.where(closed, zeta * zeta + beta * sigma * sigma, 1.0 - beta * p)))
    conic = barrier(_Conic(beta, closed, s, e, p / (1.0 + e)))
    q = conic.q
    x0, t0 = barrier(_start(conic, sigma, zeta))
    s3 = s * s * s
    turns = jnp.where(closed, jnp.round((t0 + tau) * (s3 * (1.0 / _TURN))), 0.0)
    left = tau - turns * (_TURN / s3)
    t, left = barrier((t0 + left, left))
    # Of 2.5e-3 of the anomaly the first step leaves 1e-11 of it, and Newton's then rounding.
    x = barrier(_mikkola(t, conic))
    g2, g3 = barrier(_g(x, beta, stumpff))
    x, g2, g3 = barrier(_advanced(barrier(_step(x, g2, g3, t, conic)), x, g2, g3, beta))
    change = (t - q * x - e * g3) / (q + e * g2)
    x, g1 = x + change, x - beta * g3
    g2, g1 = g2 + change * g1, g1 + change * (1.0 - beta * g2)
    chi = x - x0
    over = jnp.where(closed, jnp.round(chi * (s / _TURN)), 0.0)
    end = Anomaly(chi - over * (_TURN / s), g2, g3, q + e * g2, e * g1, left - over * (_TURN / s3))
    return _from_start(barrier(end), sigma, beta, jnp.abs(t0) + jnp.abs(t))


def _g(x: Scalar, beta: Scalar, functions) -> tuple[Scalar, Scalar]:
    """G2 and G3."""
    x2 = x * x
    c2, c3, *_ = functions(beta * x2)
    return x2 * c2, x2 * x * c3


def _advanced(
    d: Scalar, x: Scalar, g2: Scalar, g3: Scalar, beta: Scalar
) -> tuple[Scalar, Scalar, Scalar]:
    """x + d, G2(x + d) and G3(x + d) for a small d, by the addition formulas."""
    g0, g1, w = 1.0 - beta * g2, x - beta * g3, beta * d * d
    d2 = 0.5 * d * d * (1.0 - w / 12.0 * (1.0 - w / 30.0))
    d3 = d * d * d / 6.0 * (1.0 - w / 20.0 * (1.0 - w / 42.0))
    return x + d, g2 + g1 * (d - beta * d3) + g0 * d2, g3 + g2 * d + g1 * d2 + g0 * d3


def _start(conic: _Conic, sigma: Scalar, zeta: Scalar) -> tuple[Scalar, Scalar]:
    """Anomaly and time at the start, from periapsis: a rough inverse tangent, or a logarithm, and
    one correction of it."""
    beta, closed, s, e, q = conic
    safe_e = jnp.maximum(e, 1e-30)
    y = jnp.abs(s * sigma)
    sine = y / safe_e
    rough = barrier(jnp.where(closed, _arc(y, zeta), jnp.log(sine + jnp.sqrt(1.0 + sine * sine))))
    far = jnp.logical_and(rough > math.pi, jnp.logical_not(closed))
    x = jnp.where(far, 0.0, jnp.where(sigma < 0.0, -rough, rough) / s)
    g2, g3 = barrier(_g(x, beta, stumpff_near))
    g0, g1 = 1.0 - beta * g2, x - beta * g3
    d = (sigma * g0 - zeta * g1) / safe_e
    # The correction of a large logarithm would be the rounding of larger terms.
    d = jnp.where(jnp.logical_or(closed, rough < 1.0), d * (1.0 + beta * d * d / 6.0), 0.0)
    x, _, g3 = _advanced(d, x, g2, g3, beta)
    sign = jnp.where(sigma < 0.0, -1.0, 1.0)
    return jnp.where(far, sign * rough / s, x), jnp.where(
        far, sign * (y - rough) / (s * s * s), q * x + e * g3
    )


def _arc(y: Scalar, x: Scalar) -> Scalar:
    """The angle of (x, y), y >= 0, within 1e-5."""
    size = jnp.abs(x)
    a = jnp.minimum(y, size) / jnp.maximum(jnp.maximum(y, size), 1e-30)
    a2 = a * a
    angle = a * (
        0.9998660 + a2 * (-0.3302995 + a2 * (0.1801410 + a2 * (-0.0851330 + a2 * 0.0208351)))
    )
    angle = jnp.where(y > size, 0.5 * math.pi - angle, angle)
    return jnp.where(x < 0.0, math.pi - angle, angle)


def _mikkola(t: Scalar, conic: _Conic) -> Scalar:
    """The anomaly a time t after periapsis within a quarter of a per cent: the sine of its third by
    a cubic, corrected once."""
    _, closed, s, e, q = conic
    k = 1.0 / (4.0 * e + 0.5)
    a, b = q * k, 0.5 * t * k
    z2 = barrier(
        jnp.exp(jnp.log(jnp.maximum(jnp.abs(b) + jnp.sqrt(b * b + a * a * a), 1e-30)) * (2.0 / 3.0))
    )
    x = s * 2.0 * b / (z2 + a + a * a / z2)
    x2 = x * x
    x5 = x2 * x2 * x
    u = x - 0.078 * x5 / (1.0 + e)
    w = barrier(x + 0.071 * x5 / ((1.0 + 0.45 * x2) * (1.0 + 4.0 * x2) * jnp.maximum(e, 1e-30)))
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


def _step(x: Scalar, g2: Scalar, g3: Scalar, t: Scalar, conic: _Conic) -> Scalar:
    """Correction of x, of fourth order: Laguerre's method with n = 5, then one round of the Taylor
    series."""
    beta, _, _, e, q = conic
    g0, g1 = 1.0 - beta * g2, x - beta * g3
    late, rho, slope = q * x + e * g3 - t, q + e * g2, e * g1
    d = -5.0 * late / (rho + jnp.sqrt(jnp.abs(16.0 * rho * rho - 20.0 * late * slope)))
    return -late / (rho + 0.5 * d * (slope + d / 3.0 * e * (g0 - 0.25 * d * beta * g1)))


def _from_start(end: Anomaly, sigma: Scalar, beta: Scalar, terms: Scalar) -> Anomaly:
    """The functions of the anomaly since the start. Kepler's equation from the start has the last
    word where its terms are the smaller ones: a short duration keeps all of its digits."""
    chi, _, _, rho, slope, left = end
    g2, g3 = barrier(_g(chi, beta, stumpff))
    g1 = chi - beta * g3
    early = left - g1 - sigma * g2 - g3
    better = jnp.abs(g1) + jnp.abs(sigma) * g2 + jnp.abs(g3) < terms
    d = barrier(jnp.where(better, early / rho, 0.0))
    return Anomaly(
        chi + d, g2 + d * g1, g3 + d * g2, rho + d * slope, slope + d * (1.0 - beta * rho), left
    )
