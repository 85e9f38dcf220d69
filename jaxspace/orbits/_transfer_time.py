"""The time of flight between two places on a conic.

    T = eta (2 (1 + lambda)^2 + eta^2 K(S)) / (4 (1 - S)) + N pi / (1 - x^2)^(3/2)
    eta = y - lambda x,  y = sqrt(kappa + lambda^2 x^2),  S = (1 - lambda - x eta) / 2
    K(S) = (F(1, 1; 3/2; S) - 1) / S                  F: hypergeometric function
    K(S) = (2 + K(s)) / (2 c (1 + c))                 the same at half of the angle:
                                                      c = sqrt(1 - S), s = S / (2 (1 + c))
    dT/dlambda = -2 lambda^2 / y                      at a fixed x

    symbol   meaning                                                                         unit
    x        parameter of the conics: 1 - x^2 = s / (2 a); -1 < x, ellipses below 1          1
    T        time of flight times sqrt(2 mu / s^3); s: half of |r1| + |r2| + chord           1
    lambda   sqrt(|r1| |r2|) cos(theta / 2) / s, negative for an angle theta above 180 deg   1
    kappa    chord / s = 1 - lambda^2, a separate input so that it loses no digits           1
    S        sin^2 of a quarter of the difference in eccentric anomaly; hyperbola: negative  1
    N        whole revolutions before the arrival                                            1

Source: variables of Lancaster and Blanchard (1969), NASA TN D-5368, as in Izzo (2015), Celestial
Mechanics 121, 1. The form of T here has terms of one sign only: it loses no digits at the parabola,
on the shortest arcs, or towards infinity.
"""

import functools
import math
from typing import NamedTuple

import jax.numpy as jnp

from ..core import Scalar
from ..core.barrier import barrier
from ..core.square_roots import sqrt

# After five halvings of the angle S is so small that eight terms of the series reach rounding.
_HALVINGS = 5
_SERIES = [1.0]
for _n in range(14):
    _SERIES.append(_SERIES[-1] * (_n + 1.0) / (_n + 1.5))
_K = _SERIES[1:]
_DK = [n * k for n, k in enumerate(_K)][1:]


class TransferTime(NamedTuple):
    """The time `value`, its derivative `slope` by x, and the intermediate y and eta; (*runs,)."""

    value: Scalar
    slope: Scalar
    y: Scalar
    eta: Scalar


def transfer_time(x: Scalar, lam: Scalar, kappa: Scalar, revolutions: int = 0) -> TransferTime:
    """The time of flight on a conic, in the symbols and units of the module, (*runs,).

    **Arguments**

    - `x`, `lam`, `kappa`: the conic x, lambda and kappa.
    - `revolutions`: whole revolutions N before the arrival.
    """
    less, more = one_minus_plus(lam, kappa)
    energy = (1.0 - x) * (1.0 + x)
    path = lam * x
    y = sqrt(kappa + path * path)
    ahead = path > 0.0
    outward = x >= 0.0
    # eta = y - lambda x from the sum y + |lambda x|, because eta (y + lambda x) = kappa.
    long = y + jnp.where(ahead, path, -path)
    eta = jnp.where(ahead, kappa / long, long)
    eta2 = eta * eta
    more2 = 2.0 * more * more
    # S and 1 - S: the larger one as a sum, the smaller one from 4 S (1 - S) = eta^2 (1 - x^2).
    large = 0.5 * (jnp.where(outward, more, less) + jnp.where(outward, x, -x) * eta)
    small = eta2 * energy / (4.0 * large)
    s = jnp.where(outward, small, large)
    c2 = jnp.where(outward, large, small)
    y, eta, s, c2 = barrier((y, eta, s, c2))
    k, dk = _series(s, c2)
    k, dk, per = barrier((k, dk, 0.25 / c2))
    value = eta * (more2 + eta2 * k) * per
    slope = (
        -(lam * eta * (more2 + 3.0 * eta2 * k) + 0.5 * eta2 * (4.0 * value + eta2 * eta * dk))
        * per
        / y
    )
    # Not with a factor of zero: at the parabola the time of a whole turn is infinite.
    if revolutions:
        turns = revolutions * math.pi / (energy * jnp.sqrt(energy))
        value = value + turns
        slope = slope + 3.0 * turns * x / energy
    return TransferTime(value, slope, y, eta)


def one_minus_plus(lam: Scalar, kappa: Scalar) -> tuple[Scalar, Scalar]:
    """1 - lambda and 1 + lambda; the smaller one from their product kappa."""
    short = lam > 0.0
    large = 1.0 + jnp.where(short, lam, -lam)
    small = kappa / large
    return jnp.where(short, small, large), jnp.where(short, large, small)


def _series(s: Scalar, c2: Scalar) -> tuple[Scalar, Scalar]:
    """K(S) and its derivative, c2 = 1 - S."""
    # The derivative from the differential equation of K; near S = 0, where that is 0/0, from the
    # series.
    k = series_k(s, c2, _HALVINGS, 8)
    near = jnp.abs(s) < 0.05
    away = (2.0 - (3.0 - 4.0 * s) * k) / jnp.where(near, 1.0, 2.0 * s * c2)
    return k, jnp.where(near, _polynomial(_DK, jnp.where(near, s, 0.0)), away)


def series_k(s: Scalar, c2: Scalar, halvings: int, terms: int) -> Scalar:
    """K(S), c2 = 1 - S, from the first `terms` of its series after `halvings` of the angle."""
    factors = []
    for _ in range(halvings):
        c = sqrt(c2)
        factors.append(0.5 / (c + c2))
        s = s * c * factors[-1]
        c2 = 1.0 - s
    k = _polynomial(_K[:terms], s)
    for factor in reversed(factors):
        k = (2.0 + k) * factor
    return k


def _polynomial(coefficients: list[float], x: Scalar) -> Scalar:
    return functools.reduce(lambda total, c: total * x + c, reversed(coefficients), 0.0)
