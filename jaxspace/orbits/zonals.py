"""Gravity of a body of revolution beyond that of a point: its zonal harmonics of every degree.

    U = (mu/r) sum_n J_n (R/r)^n P_n(s)                        s = z/r
    a = -grad U = (mu/r^2) sum_n J_n (R/r)^n (P'_(n+1)(s) r/r - P'_n(s) Z)
    n P'_(n+1) = (2 n + 1) s P'_n - (n + 1) P'_(n-1),  P'_1 = 1,  P'_2 = 3 s

    symbol   meaning                                                     unit
    r, z     position from the centre, its component along the axis Z    m
    mu       gravitational parameter of the attracting body              m^3/s^2
    J_n      zonal harmonic of degree n, from n = 2 on                   1
    R        equatorial radius to which they refer                       m
    P_n, P'  Legendre polynomial, its derivative                         1

Source: Vallado, Fundamentals of Astrodynamics, 8.6.1 (there by degrees); the sum in closed form
follows from (n + 1) P_n + s P'_n = P'_(n+1). The first term is that of Thomson 4.18.

J_n is minus the unnormalised coefficient C_n0: J_n = -sqrt(2 n + 1) times the normalised one. The
axis of symmetry is the inertial z axis. Add `PointGravity` for the field of the point; for J2 only,
`Oblateness` computes the same field with fewer operations.
"""

__all__ = ["zonal_potential", "zonals"]

from typing import ClassVar, final

from jaxtyping import Array, Float

from ..bodies import AbstractBody, AbstractEffect, BodyState, Load
from ..core import NumberField, Scalar, Vector, quantity
from ..core.formula import AWAY, POSITIVE, formula
from ..core.vectors import axis, inverse_norm, scale
from ._planet import equatorial_radius, gravitational_parameter


@formula(r=AWAY, radius=POSITIVE)
def zonals(
    r: Vector, mu: Scalar, harmonics: Float[Array, "degrees *#runs"], radius: Scalar
) -> Vector:
    """Acceleration by zonal harmonics.

    **Arguments**

    - `r`: position from the centre, m, (3, *runs).
    - `mu`: gravitational parameter, m^3/s^2.
    - `harmonics`: J2, J3 and so on, (degrees, *runs).
    - `radius`: equatorial radius, m.

    **Returns** a, m/s^2, (3, *runs)."""
    # In units of the radius from the start: the compiler gathers constant factors, and the sixth
    # power of a radius in metres leaves the range of float32.
    u = scale(1.0 / radius, r)
    ratio = inverse_norm(u)
    s = u[2] * ratio
    before = 1.0
    slope = 3.0 * s
    power = ratio
    along = across = 0.0
    # Unrolled: the degrees are few, and the compiler folds the factors of each.
    for n in range(2, 2 + harmonics.shape[0]):
        after = ((2 * n + 1) / n) * s * slope - ((n + 1) / n) * before
        power = power * ratio
        term = harmonics[n - 2] * power
        along, across = along + term * after, across + term * slope
        before, slope = slope, after
    weight = (mu / radius**2) * inverse_norm(u, 2)
    down = -weight * across
    return scale(weight * along * ratio, u) + scale(down, axis(2, down))


@formula(r=AWAY, radius=POSITIVE)
def zonal_potential(
    r: Vector, mu: Scalar, harmonics: Float[Array, "degrees *#runs"], radius: Scalar
) -> Scalar:
    """Potential energy per unit mass U, m^2/s^2, of zonal harmonics, zero at infinity.

    **Arguments**

    - `r`, `mu`, `harmonics`, `radius`: as in `zonals`."""
    u = scale(1.0 / radius, r)
    ratio = inverse_norm(u)
    s = u[2] * ratio
    before = 1.0
    value = s
    power = ratio
    total = 0.0
    for n in range(2, 2 + harmonics.shape[0]):
        before, value = value, ((2 * n - 1) / n) * s * value - ((n - 1) / n) * before
        power = power * ratio
        total = total + harmonics[n - 2] * power * value
    return (mu / radius) * ratio * total


@final
class Zonals(AbstractEffect):
    """Attraction by the zonal harmonics of a body of revolution about the z axis, from J2 on."""

    keeps: ClassVar[frozenset[str]] = frozenset({"energy", "axial_angular_momentum"})
    uniform: ClassVar[bool] = True

    mu: NumberField = gravitational_parameter()
    harmonics: Float[Array, "degrees *#runs"] = quantity(
        "", doc="J2, J3 and so on, up to any degree"
    )
    radius: NumberField = equatorial_radius("the harmonics refer")

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        del t, body
        assert y.position is not None
        return Load(acceleration_N=zonals(y.position, self.mu, self.harmonics, self.radius))

    def potential(self, t: Scalar, y: BodyState, body: AbstractBody) -> Scalar:
        del t, body
        assert y.position is not None
        return zonal_potential(y.position, self.mu, self.harmonics, self.radius)

    def ground(self) -> Scalar:
        return self.radius

    def scaled(self, factor: Scalar) -> "Zonals":
        return Zonals(self.mu, factor * self.harmonics, self.radius)
