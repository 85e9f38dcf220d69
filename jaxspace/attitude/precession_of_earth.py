"""Precession of a planet's axis by the attraction of the sun and the moon on its bulge.

    M     = 3 f n^2 (C - A) (s . u) (u x s)                    torque of a body in the direction u
    psi'  = -(3 f n^2 / 2 Omega) [(C - A)/C] cos(theta) (1 - cos 2L)          in the orbit's plane
    theta' = -(3 f n^2 / 2 Omega) [(C - A)/C] sin(theta) sin 2L
    mean:   psi' = -(3 f n^2 / 2 Omega) [(C - A)/C] cos(theta),   theta' = 0

    symbol   meaning                                                              unit
    f        share of the attracting mass in both: 1 for the sun, m/(m + M)       1
             for the moon
    n        mean motion of the orbit, 2 pi/tau                                   rad/s
    Omega    spin of the planet                                                   rad/s
    C, A     its axial and transverse moment of inertia                           kg m^2
    theta    obliquity: angle of the axis s with the normal of the orbit          rad
    psi      longitude of the node of the equator on the orbit                    rad
    L        longitude of the attracting body from that node                      rad

Source: Thomson 5.15-1 to -7 (a rate per unit of the time of tau, not per revolution of the moon).
Valid for an axis that precesses slowly compared with the spin and the orbit, and a circular orbit.
"""

__all__ = ["luni_solar_nutation", "luni_solar_rate", "luni_solar_rates_at"]

import jax.numpy as jnp

from ..core import Scalar
from ..core.formula import NOT_NEGATIVE, POSITIVE, formula


@formula(mass_share=NOT_NEGATIVE, period=POSITIVE)
def luni_solar_rate(
    mass_share: Scalar, period: Scalar, ellipticity: Scalar, obliquity: Scalar, spin: Scalar
) -> Scalar:
    """Secular precession by one attracting body (Thomson 5.15-6, -7).

    **Arguments**

    - `mass_share`: f, 1.
    - `period`: tau of its orbit, s.
    - `ellipticity`: (C - A)/C, 1.
    - `obliquity`: theta, rad.
    - `spin`: Omega, rad/s.

    **Returns** psi', rad/s: negative, against the spin, for an oblate planet.
    """
    return -_amplitude(mass_share, period, ellipticity, spin) * jnp.cos(obliquity)


@formula(mass_share=NOT_NEGATIVE, period=POSITIVE)
def luni_solar_rates_at(
    longitude: Scalar,
    mass_share: Scalar,
    period: Scalar,
    ellipticity: Scalar,
    obliquity: Scalar,
    spin: Scalar,
) -> tuple[Scalar, Scalar]:
    """Precession and nutation at one place of the orbit: the secular rate and the part that repeats
    twice in an orbit (Thomson 5.15-3 to -5).

    **Arguments**

    - `longitude`: L, rad, from the node of the equator on the orbit.
    - the others: as in `luni_solar_rate`.

    **Returns** psi' and theta', rad/s.
    """
    rate = _amplitude(mass_share, period, ellipticity, spin)
    # 1 - cos 2L, with its digits where the body crosses the equator.
    precession = -2.0 * rate * jnp.cos(obliquity) * jnp.sin(longitude) ** 2
    return precession, -rate * jnp.sin(obliquity) * jnp.sin(2.0 * longitude)


@formula(mass_share=NOT_NEGATIVE, period=POSITIVE)
def luni_solar_nutation(
    mass_share: Scalar, period: Scalar, ellipticity: Scalar, obliquity: Scalar, spin: Scalar
) -> tuple[Scalar, Scalar]:
    """Amplitudes, rad, of the periodic parts of psi, as sin 2L, and of theta, as cos 2L: the
    integrals of `luni_solar_rates_at`.

    **Arguments**

    - `mass_share`, `period`, `ellipticity`, `obliquity`, `spin`: as in `luni_solar_rate`,
      (*runs,)."""
    swing = _amplitude(mass_share, period, ellipticity, spin) * period / (4.0 * jnp.pi)
    return swing * jnp.cos(obliquity), swing * jnp.sin(obliquity)


def _amplitude(f: Scalar, period: Scalar, ellipticity: Scalar, spin: Scalar) -> Scalar:
    """3 f n^2 (C - A)/(2 Omega C), rad/s."""
    n = 2.0 * jnp.pi / period
    return 1.5 * f * n * n * ellipticity / spin
