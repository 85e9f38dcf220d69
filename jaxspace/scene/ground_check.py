"""Whether a run has passed below the ground of the planet about which it moves.

    alpha = 1/a = 2/r - v^2/mu,  p = (r^2 v^2 - (r . v)^2)/mu,  e^2 = 1 - p alpha,  q = p/(1 + e)
    e cos E = 1 - r alpha,  e sin E = r . v sqrt(alpha/mu)
    M = E - e sin E,  n = alpha sqrt(mu alpha)

    symbol  meaning                                             unit
    r, v    position from the centre, velocity                  m, m/s
    mu      gravitational parameter of the centre               m^3/s^2
    q, e    periapsis radius, eccentricity of the orbit         m, 1
    E, M    eccentric and mean anomaly, from the periapsis      rad
    n       mean motion                                         rad/s

Source: Thomson 4.7, 4.13.

A periapsis between two saved times is assumed only if the orbits of both indicate it: a thrust
changes one of the two, and a launch or a landing has its periapsis outside the interval. A saved
state below the ground counts if it is deeper than the flattening of a planet.
"""

import math

import numpy as np
from jaxtyping import ArrayLike

from ..bodies import BodyState
from ..core import Scalar

TURN = 2.0 * math.pi

POLE = 0.01
"""Fraction of the equatorial radius by which a saved state may be below it: 0.6 % for the poles of
Mars."""
GRAZING = 1e-3
"""So much may the orbit: by so little that of a low satellite changes within a turn (J2)."""
AT_PERIAPSIS = 1e-6
"""Mean anomaly, rad, at which a run starts at the periapsis, to rounding."""


def lowest_below_ground(
    ts: ArrayLike, states: BodyState, radius: Scalar, mu: Scalar | None
) -> np.ndarray:
    """Depth to which each run passes below the surface of a planet.

    **Arguments**

    - `ts`: s, (times,) or (times, *runs); `states`: those there, about the planet's centre.
    - `radius`: of the ground, m, (*runs,).
    - `mu`: of the planet, m^3/s^2, (*runs,); `None` where the motion between the times is unknown,
      as with a controller.

    **Returns** the least distance from the centre, m, (*runs,); infinite where a run stays above
    the surface, or has no position."""
    if states.position is None or states.velocity is None:
        return np.asarray(np.inf)
    x, v, t, R = (np.asarray(a, float) for a in (states.position, states.velocity, ts, radius))
    t = t.reshape(*t.shape, *(1,) * (x.ndim - 1 - t.ndim))
    # NaN of a failed run compares as false.
    with np.errstate(all="ignore"):
        if mu is not None and _stays_above(x, v, np.asarray(mu, float), (1.0 - GRAZING) * R):
            return np.full(x.shape[2:], np.inf)
        r = np.sqrt((x * x).sum(axis=0))
        lowest = np.min(np.where(r < (1.0 - POLE) * R, r, np.inf), axis=0)
        if mu is not None:
            passed = _lowest_passed(t, x, v, r, np.asarray(mu, float), (1.0 - GRAZING) * R)
            lowest = np.minimum(lowest, passed)
    return np.asarray(lowest)


def ground_warning(lowest: np.ndarray, radius: Scalar, source: str) -> str:
    """A warning message if runs pass below the surface of a planet; empty otherwise.

    **Arguments**

    - `lowest`: of each run, as `lowest_below_ground` returns it, m.
    - `radius`: of the ground, m, (*runs,); `source`: the origin of the radius, for the message."""
    R = np.asarray(radius, float)
    count = np.count_nonzero(np.isfinite(lowest))
    if not count:
        return ""
    who = "The run passes" if lowest.ndim == 0 else f"{count} of {lowest.size} runs pass"
    return (
        f"{who} below the surface, {np.min(lowest):.4g} m from the centre of a planet with a "
        f"radius of {np.max(R):.4g} m ({source}): add a terminal event such as AtAltitude, or "
        "raise the orbit."
    )


def _stays_above(x: np.ndarray, v: np.ndarray, mu: np.ndarray, low: Scalar) -> bool:
    """Whether all states, and all periapses of their orbits, are above `low`, m, (*runs,).

    For most batches the only check, and without roots and quotients a third of the whole one: an
    orbit outside of the radius l reaches it where the energy leaves a radial velocity there,

        s = v^2 + 2 mu/l - |r x v|^2/l^2 > 2 mu/r
    """
    r2, v2, climb = (np.einsum("i...,i...", a, b) for a, b in ((x, x), (v, v), (x, v)))
    s = v2 + 2.0 * mu / low - (r2 * v2 - climb * climb) / (low * low)
    reaches = (s > 0.0) & (s * s * r2 > 4.0 * mu * mu)
    return not np.any(reaches | (r2 < low * low))


def _lowest_passed(
    t: np.ndarray, x: np.ndarray, v: np.ndarray, r: np.ndarray, mu: np.ndarray, low: Scalar
) -> np.ndarray | np.floating:
    """The lowest periapsis below `low`, m, (*runs,), that was passed between two saved times; of
    both orbits the higher one counts. Infinite where none was."""
    # As if time went forwards.
    sign = np.where(t[-1] < t[0], -1.0, 1.0)
    t, v = sign * t, sign * v
    climb = (x * v).sum(axis=0)
    v2 = (v * v).sum(axis=0)
    alpha = 2.0 / r - v2 / mu
    # A radius close to that of the ground is not a difference of large numbers here.
    p = (r * r * v2 - climb * climb) / mu
    q = p / (1.0 + np.sqrt(np.maximum(1.0 - p * alpha, 0.0)))
    # Most runs need no times: all of their orbits are above.
    if not np.any(q < low):
        return np.full_like(q[0], np.inf)
    sine = climb * np.sqrt(alpha / mu)
    M = (np.arctan2(sine, 1.0 - r * alpha) - sine) % TURN
    # To rounding the start is at the periapsis, and has not left it.
    to_come = np.where(M < AT_PERIAPSIS, 0.0, TURN - M)
    n = alpha * np.sqrt(mu * alpha)
    h = np.diff(t, axis=0)
    ellipse = (n[:-1] * h >= to_come[:-1]) & (n[1:] * h >= M[1:])
    other = (climb[:-1] <= 0.0) & (climb[1:] >= 0.0)
    passed = np.where(alpha[:-1] > 0.0, ellipse, other)
    least = np.maximum(q[:-1], q[1:])
    return np.min(np.where(passed & (least < low), least, np.inf), axis=0)
