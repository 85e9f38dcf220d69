"""Planets on coplanar circles: the synodic period, and the departure phase of a transfer.

    1/S = |1/T1 - 1/T2|,  S = T1 r2/|r2 - r1| (m + r2)/(r1 + m + r2),  m = sqrt(r1 r2)
    phi = pi (1 - ((1 + r1/r2)/2)^(3/2))

    symbol   meaning                                                           unit
    T1, T2   periods                                                           s
    S        synodic period, after which the relative position repeats         s
    r1, r2   radii of the circles that are left and reached                    m
    phi      lead of the target at the departure of a transfer of Hohmann      rad

Source: Thomson 4.11 (planets as circular coplanar orbits).

A state on such a circle is `orbit_from_radius(radius, mu, true_anomaly=longitude)`.
"""

__all__ = ["departure_phase", "synodic_period"]

import math

import jax.numpy as jnp

from ..core import Scalar
from ..core.formula import POSITIVE, formula
from ..core.squares import quotient
from ..core.types import as_float
from .time_of_flight import period


@formula(radius=POSITIVE, other=POSITIVE, mu=POSITIVE)
def synodic_period(radius: Scalar, other: Scalar, mu: Scalar) -> Scalar:
    """Synodic period: the time after which the relative position of two bodies on circles repeats.

    **Arguments**, each (*runs,)

    - `radius`, `other`: of the circles, m.
    - `mu`: gravitational parameter, m^3/s^2.

    **Returns** S, s; infinite for equal radii, with derivatives of zero.
    """
    first, second = as_float(radius), as_float(other)
    # By the difference of the radii, which is exact between close ones, and not of the periods.
    apart = jnp.abs(second - first)
    equal = apart == 0.0
    mean = second * jnp.sqrt(quotient(first, second))
    share = (mean + second) / (first + mean + second)
    value = period(first, mu) * quotient(second, jnp.where(equal, 1.0, apart)) * share
    return jnp.where(equal, jnp.inf, value)


@formula(radius=POSITIVE, target_radius=POSITIVE)
def departure_phase(radius: Scalar, target_radius: Scalar) -> Scalar:
    """Phase angle by which the target must lead at the departure of a Hohmann transfer.

    **Arguments**, each (*runs,)

    - `radius`, `target_radius`: of the circles, m.

    **Returns** the angle, rad, below pi; negative where the target must be behind, as on the way
    inwards.
    """
    half = 0.5 * (1.0 + as_float(radius) / target_radius)
    return math.pi * (1.0 - half * jnp.sqrt(half))
