"""Gravity of an oblate body beyond that of a point: its second zonal harmonic.

    U = mu J2 R^2 / (2 r^3) (3 z^2/r^2 - 1)                     a = -grad U = s r + k Z
    s = -3/2 mu J2 R^2 / r^5 (1 - 5 z^2/r^2),  k = -3 mu J2 R^2 z / r^5
    node' = -3/2 n J2 (R/p)^2 cos i                             mean over a revolution,
    argument of periapsis' = 3/4 n J2 (R/p)^2 (5 cos^2 i - 1)   to first order in J2

    symbol  meaning                                                        unit
    r, z    position from the centre, its component along the axis Z       m
    mu      gravitational parameter of the attracting body                 m^3/s^2
    J2      oblateness (C - A) / (m R^2)                                   1
    R       equatorial radius to which J2 refers                           m
    n, p    mean motion sqrt(mu/a^3), semi-latus rectum a (1 - e^2)        rad/s, m
    i       inclination of the orbit to the equator                        rad

Source: Thomson 4.18-12, per turn 3 pi J2 (R/a)^2 cos i (his uniform earth: C = 0.4 m R^2); Curtis,
Orbital Mechanics, 4.52, 4.53.

The axis of symmetry is the inertial z axis. Add `PointGravity` for the field of the point; `Zonals`
has the harmonics of higher degree too.
"""

__all__ = ["apsidal_rate", "node_regression_rate", "oblateness", "oblateness_potential"]

from typing import ClassVar, final

from ..bodies import AbstractBody, AbstractEffect, BodyState, Load
from ..core import NumberField, Scalar, Vector, quantity
from ..core.barrier import barrier
from ..core.formula import AWAY, BELOW_ONE, POSITIVE, formula
from ..core.vectors import axis, inverse_norm, scale
from ._planet import equatorial_radius, gravitational_parameter
from .secular_rates import secular_rates


@formula(r=AWAY, radius=POSITIVE)
def oblateness(r: Vector, mu: Scalar, j2: Scalar, radius: Scalar) -> Vector:
    """Acceleration due to J2 only.

    **Arguments**

    - `r`: position from the centre, m, (3, *runs).
    - `mu`: gravitational parameter, m^3/s^2.
    - `j2`: second zonal harmonic.
    - `radius`: equatorial radius, m.

    **Returns** a, m/s^2, (3, *runs).
    """
    z = r[2]
    # Computed once, and its powers as products: reverse mode then sums scalars in place of a vector
    # for each power. Behind a barrier, because in a user's loop the compiler would compute it again
    # for everything that depends on it.
    per_r = barrier(inverse_norm(r))
    per_r2 = per_r * per_r
    # In this order no factor leaves the range of float32: mu R^2 / r^5 in metres would.
    c = (-1.5 * j2 * mu * per_r * per_r2) * (radius * radius * per_r2)
    k = 2.0 * c * z
    # `scale` has a derivative that does not compute the scalar again for every component.
    return scale(c * (1.0 - 5.0 * z * z * per_r2), r) + scale(k, axis(2, k))


@formula(r=AWAY, radius=POSITIVE)
def oblateness_potential(r: Vector, mu: Scalar, j2: Scalar, radius: Scalar) -> Scalar:
    """Potential energy per unit mass U, m^2/s^2, of J2 only, zero at infinity.

    **Arguments**

    - `r`, `mu`, `j2`, `radius`: as in `oblateness`."""
    z = r[2]
    per_r2 = inverse_norm(r, 2)
    c = (0.5 * j2 * mu * inverse_norm(r)) * (radius * radius * per_r2)
    return c * (3.0 * z * z * per_r2 - 1.0)


@formula(semi_major_axis=POSITIVE, eccentricity=BELOW_ONE, mu=POSITIVE, radius=POSITIVE)
def node_regression_rate(
    semi_major_axis: Scalar,
    eccentricity: Scalar,
    inclination: Scalar,
    mu: Scalar,
    j2: Scalar,
    radius: Scalar,
) -> Scalar:
    """Mean rate at which the node moves backwards, by J2 to first order (Thomson 4.18-12).

    **Arguments**, each (*runs,)

    - `semi_major_axis`: m; `eccentricity`, below one; `inclination`: rad.
    - `mu`: gravitational parameter, m^3/s^2.
    - `j2`: second zonal harmonic.
    - `radius`: equatorial radius, m.

    **Returns** minus the rate of the longitude of the node, rad/s, (*runs,): positive for direct
    orbits.
    """
    return -secular_rates(semi_major_axis, eccentricity, inclination, mu, j2, radius).node


@formula(semi_major_axis=POSITIVE, eccentricity=BELOW_ONE, mu=POSITIVE, radius=POSITIVE)
def apsidal_rate(
    semi_major_axis: Scalar,
    eccentricity: Scalar,
    inclination: Scalar,
    mu: Scalar,
    j2: Scalar,
    radius: Scalar,
) -> Scalar:
    """Mean rate of the argument of periapsis, rad/s, by J2 to first order (Curtis 4.53).

    It is zero where cos^2 i = 1/5.

    **Arguments**

    - `semi_major_axis`, `eccentricity`, `inclination`, `mu`, `j2`, `radius`: as in
      `node_regression_rate`."""
    rates = secular_rates(semi_major_axis, eccentricity, inclination, mu, j2, radius)
    return rates.argument_of_periapsis


@final
class Oblateness(AbstractEffect):
    """Attraction by the oblateness (J2) of a body about the z axis."""

    keeps: ClassVar[frozenset[str]] = frozenset({"energy", "axial_angular_momentum"})
    uniform: ClassVar[bool] = True

    mu: NumberField = gravitational_parameter()
    j2: NumberField = quantity(
        "", shared="planet.j2", doc="second zonal harmonic; negative for a prolate body"
    )
    radius: NumberField = equatorial_radius("j2 refers")

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        del t, body
        assert y.position is not None
        return Load(acceleration_N=oblateness(y.position, self.mu, self.j2, self.radius))

    def ground(self) -> Scalar:
        return self.radius

    def potential(self, t: Scalar, y: BodyState, body: AbstractBody) -> Scalar:
        del t, body
        assert y.position is not None
        return oblateness_potential(y.position, self.mu, self.j2, self.radius)
