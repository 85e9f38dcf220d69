"""Mean rates of an orbit about an oblate body, and the orbits that they make special.

    k = J2/2 (R/p)^2,  q = -3/8 J4 (R/p)^4,  h = sqrt(1 - e^2),  c = cos i,  n = sqrt(mu/a^3)
    M' = n (1 + 3/2 k h (3 c^2 - 1)
           + 3/32 k^2 h (-15 + 16 h + 25 h^2 + (30 - 96 h - 90 h^2) c^2
                         + (105 + 144 h + 25 h^2) c^4)
           + 15/16 q h e^2 (3 - 30 c^2 + 35 c^4))
    w' = n (3/2 k (5 c^2 - 1)
           + 3/32 k^2 (-35 + 24 h + 25 h^2 + (90 - 192 h - 126 h^2) c^2
                       + (385 + 360 h + 45 h^2) c^4)
           + 5/16 q (21 - 9 h^2 + (-270 + 126 h^2) c^2 + (385 - 189 h^2) c^4))
    O' = n c (-3 k + 3/8 k^2 (-5 + 12 h + 9 h^2 - (35 + 36 h + 5 h^2) c^2)
              + 5/4 q (5 - 3 h^2) (3 - 7 c^2))

    symbol      meaning                                                       unit
    M, w, O     mean anomaly, argument of periapsis, longitude of the node    rad
    a, e, i, p  mean elements, p = a (1 - e^2)                                m, 1, rad, m
    J2, J4, R   zonal harmonics, the equatorial radius they refer to          1, 1, m

Source: Brouwer, Solution of the problem of artificial satellite theory without drag, AJ 64 (1959),
378, p. 394. The terms in k only are Curtis 4.52, 4.53 and Thomson 4.18-12.

The elements are Brouwer's mean ones; the mean of an osculating element over whole revolutions
differs from them by the second order in J2. The odd harmonics have no part in the mean rates to
this order.
"""

__all__ = ["CRITICAL_INCLINATION", "SecularRates", "secular_rates", "sun_synchronous_inclination"]

from typing import NamedTuple

import jax.numpy as jnp

from ..core import Scalar
from ..core.formula import BELOW_ONE, POSITIVE, formula
from ..core.printing import printed

# cos^2 i = 1/5: the line of apsides rests to first order in J2; its supplement is critical too.
CRITICAL_INCLINATION = 1.1071487177940904  # rad


@printed(node="rad/s", argument_of_periapsis="rad/s", mean_anomaly="rad/s")
class SecularRates(NamedTuple):
    """Mean rates, rad/s, each (*runs,): of the longitude of the `node`, of the
    `argument_of_periapsis` and of the `mean_anomaly`."""

    node: Scalar
    argument_of_periapsis: Scalar
    mean_anomaly: Scalar


@formula(semi_major_axis=POSITIVE, eccentricity=BELOW_ONE, mu=POSITIVE, radius=POSITIVE)
def secular_rates(
    semi_major_axis: Scalar,
    eccentricity: Scalar,
    inclination: Scalar,
    mu: Scalar,
    j2: Scalar,
    radius: Scalar,
    j4: Scalar = 0.0,
    second_order: bool = False,
) -> SecularRates:
    """Mean rates of node, periapsis and mean anomaly by J2, and to second order by J2^2 and J4.

    **Arguments**, each (*runs,)

    - `semi_major_axis`: m; `eccentricity`, below one; `inclination`: rad.
    - `mu`: gravitational parameter, m^3/s^2.
    - `j2`, `j4`: zonal harmonics; `radius`: equatorial radius, m.
    - `second_order`: whether to include the terms in J2^2. The terms in J4 are always included.

    **Returns** the `SecularRates`. Their relative error is of the order of J2 to first order, and
    of J2^2 to second order."""
    a, e = semi_major_axis, eccentricity
    # As a product, because 1 - e^2 loses digits close to the parabola.
    square = (1.0 - e) * (1.0 + e)
    h = jnp.sqrt(square)
    c = jnp.cos(inclination)
    ratio = radius / (a * square)
    k, q = 0.5 * j2 * ratio**2, -0.375 * j4 * ratio**4
    x = c * c
    node = -3.0 * k + 1.25 * q * (5.0 - 3.0 * square) * (3.0 - 7.0 * x)
    apsis = 1.5 * k * (5.0 * x - 1.0) + 0.3125 * q * (
        21.0 - 9.0 * square + x * (126.0 * square - 270.0 + x * (385.0 - 189.0 * square))
    )
    anomaly = 1.5 * k * (3.0 * x - 1.0) + 0.9375 * q * e * e * (3.0 + x * (35.0 * x - 30.0))
    if second_order:
        parts = _second_order(h, x)
        node, apsis, anomaly = (
            first + k * k * part for first, part in zip((node, apsis, anomaly), parts, strict=True)
        )
    n = jnp.sqrt(mu / a) / a
    return SecularRates(n * c * node, n * apsis, n * (1.0 + h * anomaly))


def _second_order(h: Scalar, x: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    """The terms in k^2 of node, periapsis and anomaly, from h and c^2."""
    node = 0.375 * (-5.0 + h * (12.0 + 9.0 * h) - x * (35.0 + h * (36.0 + 5.0 * h)))
    apsis = (-35.0 + h * (24.0 + 25.0 * h)) + x * (
        90.0 - h * (192.0 + 126.0 * h) + x * (385.0 + h * (360.0 + 45.0 * h))
    )
    anomaly = (-15.0 + h * (16.0 + 25.0 * h)) + x * (
        30.0 - h * (96.0 + 90.0 * h) + x * (105.0 + h * (144.0 + 25.0 * h))
    )
    return node, 0.09375 * apsis, 0.09375 * anomaly


@formula(semi_major_axis=POSITIVE, eccentricity=BELOW_ONE, mu=POSITIVE, radius=POSITIVE)
def sun_synchronous_inclination(
    semi_major_axis: Scalar,
    eccentricity: Scalar,
    mu: Scalar,
    j2: Scalar,
    radius: Scalar,
    rate: Scalar = 1.991063853e-7,
) -> Scalar:
    """Inclination at which the node turns as fast as the sun, to first order in J2.

    **Arguments**, each (*runs,)

    - `semi_major_axis`: m; `eccentricity`; `mu`, m^3/s^2; `j2`; `radius`, m.
    - `rate`: of the node, rad/s; one turn in a tropical year of 365.24219 days by default.

    **Returns** the inclination, rad: cos i = -rate / (3/2 n J2 (R/p)^2); NaN where no orbit of this
    size is sun-synchronous."""
    # Over the equator: to first order every other inclination has the share cos i of this rate.
    along = secular_rates(semi_major_axis, eccentricity, 0.0, mu, j2, radius).node
    return jnp.arccos(rate / along)
