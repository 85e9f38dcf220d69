"""Motion of a point under a central force: powers of the distance, shells and spheres, any
potential.

    a = -U'(r) r_hat                 h = r x v and v^2/2 + U(r) are constant
    power law:  -U' = -k / r^n       U = k (r^(1-n) - r_0^(1-n)) / (1 - n), k ln(r/r_0) for n = 1
    shell:      U = -mu / r outside, -mu / R inside, where there is no field
    sphere:     U = -mu / r outside, -mu (3 R^2 - r^2) / (2 R^3) inside, where a = -mu r / R^3

    symbol  meaning                                                unit
    r       position from the centre, and its length               m
    U       potential energy per unit mass                         m^2/s^2
    k, n    coefficient and exponent of the force                  m^(n+1)/s^2, 1
    r_0     distance at which the potential of a power is zero     m
    mu      gravitational parameter of the shell or sphere         m^3/s^2
    R       radius of the shell or sphere                          m

Source: Thomson 4.5 (central force), 4.15 (powers); Harrison and Nettleton 5.2 (shell, 5.8; sphere,
5.10, 5.11), 5.4 (powers, with the opposite sign of n).
Powers with n > -1 are singular at the centre; for n >= 3 an attracted point with too little angular
momentum falls into it in finite time. At the surface the field of the shell jumps, and so does the
slope of the sphere's field: both have the values of the outside there.
"""

__all__ = [
    "power_law",
    "power_law_potential",
    "shell_gravity",
    "shell_potential",
    "sphere_gravity",
    "sphere_potential",
]

from collections.abc import Callable
from typing import ClassVar, final

import jax
import jax.numpy as jnp

from ..bodies import AbstractBody, AbstractEffect, BodyState, Load
from ..core import NumberField, Scalar, Vector, quantity
from ..core.formula import NOT_NEGATIVE, POSITIVE, formula
from ..core.safe import phi1, safe_divide
from ..core.squares import power, quotient
from ..core.vectors import dot, norm, over_norm, scale

KEEPS = frozenset({"energy", "angular_momentum", "axial_angular_momentum"})


@formula
def power_law(r: Vector, k: Scalar, n: Scalar) -> Vector:
    """Acceleration -k r_hat / |r|^n (Thomson 4.15).

    **Arguments**

    - `r`: position from the centre, m, (3, *runs).
    - `k`: coefficient, m^(n+1)/s^2; positive attracts.
    - `n`: exponent.

    **Returns** the acceleration, m/s^2, (3, *runs).
    """
    square = dot(r, r)
    exponent = -0.5 * (n + 1.0)
    # At the centre the value alone, because the slope of the power would be 0 times infinity.
    centre = square == 0.0
    at_centre = jax.lax.stop_gradient(jnp.power(jnp.zeros_like(square), exponent))
    away = power(jnp.where(centre, 1.0, square), exponent)
    return scale(-k * jnp.where(centre, at_centre, away), r)


@formula(r=POSITIVE, zero_at=POSITIVE)
def power_law_potential(r: Scalar, k: Scalar, n: Scalar, zero_at: Scalar = 1.0) -> Scalar:
    """Potential energy per unit mass of `power_law`, smooth in every argument, n = 1 included.

    **Arguments**

    - `r`: distance from the centre, m, (*runs,).
    - `k`, `n`: as in `power_law`.
    - `zero_at`: distance r_0 at which the potential is zero, m. A value close to the motion
      preserves the digits of the energy.

    **Returns** U, m^2/s^2, (*runs,).
    """
    # U has a removable singularity at n = 1: phi1(x) = (e^x - 1)/x is valid there with all its
    # derivatives. A zero at infinity would work for n > 1 only.
    logarithm = jnp.log(r / zero_at)
    return k * power(zero_at, 1.0 - n) * logarithm * phi1((1.0 - n) * logarithm)


@formula(radius=POSITIVE)
def shell_gravity(r: Vector, mu: Scalar, radius: Scalar) -> Vector:
    """Acceleration by a thin spherical shell of uniform mass (Harrison and Nettleton 5.8).

    **Arguments**

    - `r`: position from the centre, m, (3, *runs).
    - `mu`: gravitational parameter of the shell, m^3/s^2.
    - `radius`: of the shell, m.

    **Returns** a, m/s^2, (3, *runs): zero inside.
    """
    outside = dot(r, r) >= radius * radius
    # Inside, a harmless length in place of one that may be zero.
    far = jnp.where(outside, r, 1.0)
    return scale(jnp.where(outside, over_norm(-mu, far, 3), 0.0), r)


@formula(r=NOT_NEGATIVE, radius=POSITIVE)
def shell_potential(r: Scalar, mu: Scalar, radius: Scalar) -> Scalar:
    """Potential energy per unit mass of `shell_gravity`, m^2/s^2, zero at infinity; constant
    inside.

    **Arguments**

    - `r`: distance from the centre, m, (*runs,).
    - `mu`, `radius`: as in `shell_gravity`."""
    # The greater radius is used on both sides: constant inside, continuous at the surface, never
    # 1/0.
    return -mu / jnp.maximum(r, radius)


@formula(radius=POSITIVE)
def sphere_gravity(r: Vector, mu: Scalar, radius: Scalar) -> Vector:
    """Acceleration by a sphere of uniform density, outside and inside (Harrison and Nettleton
    5.11).

    **Arguments**

    - `r`, `mu`, `radius`: as in `shell_gravity`."""
    outside = dot(r, r) >= radius * radius
    far = jnp.where(outside, r, 1.0)
    inside = quotient(-mu, radius**3)
    return scale(jnp.where(outside, over_norm(-mu, far, 3), inside), r)


@formula(r=NOT_NEGATIVE, radius=POSITIVE)
def sphere_potential(r: Scalar, mu: Scalar, radius: Scalar) -> Scalar:
    """Potential energy per unit mass of `sphere_gravity`, m^2/s^2, zero at infinity (Harrison and
    Nettleton 5.10).

    **Arguments**

    - `r`: distance from the centre, m, (*runs,).
    - `mu`, `radius`: as in `shell_gravity`."""
    outside = r >= radius
    ratio = r / radius
    inside = -0.5 * mu / radius * (3.0 - ratio * ratio)
    return jnp.where(outside, -mu / jnp.where(outside, r, 1.0), inside)


@final
class PowerLawForce(AbstractEffect):
    """Attraction (k > 0) or repulsion (k < 0) by the origin with k / r^n per unit mass.

    `Scene([PowerLawForce(k, n)])` is the textbook system of a point mass."""

    keeps: ClassVar[frozenset[str]] = KEEPS
    uniform: ClassVar[bool] = True

    coefficient: NumberField = quantity("", doc="k, in m^(n+1)/s^2; positive attracts")
    exponent: NumberField = quantity("", doc="n, of the distance")
    zero_at: NumberField = quantity(
        "m",
        positive=True,
        default=1.0,
        doc="distance at which the potential is zero; a value close to the motion preserves the "
        "digits of the energy",
    )

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        del t, body
        assert y.position is not None
        return Load(acceleration_N=power_law(y.position, self.coefficient, self.exponent))

    def potential(self, t: Scalar, y: BodyState, body: AbstractBody) -> Scalar:
        del t, body
        assert y.position is not None
        return power_law_potential(norm(y.position), self.coefficient, self.exponent, self.zero_at)

    def scaled(self, factor: Scalar) -> "PowerLawForce":
        return PowerLawForce(factor * self.coefficient, self.exponent, self.zero_at)


@final
class SphereGravity(AbstractEffect):
    """Attraction by a uniform sphere at the origin, outside and inside: through a tunnel, or
    through a body without a solid surface."""

    keeps: ClassVar[frozenset[str]] = KEEPS
    uniform: ClassVar[bool] = True

    mu: NumberField = quantity(
        "m^3/s^2",
        positive=True,
        shared="planet.mu",
        doc="gravitational parameter of the sphere",
    )
    radius: NumberField = quantity("m", positive=True, shared="planet.radius", doc="of the sphere")

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        del t, body
        assert y.position is not None
        return Load(acceleration_N=sphere_gravity(y.position, self.mu, self.radius))

    def potential(self, t: Scalar, y: BodyState, body: AbstractBody) -> Scalar:
        del t, body
        assert y.position is not None
        return sphere_potential(norm(y.position), self.mu, self.radius)

    def ground(self) -> float:
        return 0.0

    def scaled(self, factor: Scalar) -> "SphereGravity":
        return SphereGravity(factor * self.mu, self.radius)


@final
class CentralPotential(AbstractEffect):
    """Any central force, from its potential energy per unit mass.

    The force is minus the derivative of the potential energy, and zero at the centre itself.

    - `function`: returns U, m^2/s^2, (*runs,), for the distance, m, (*runs,), elementwise;
      preferably an `equinox.Module` with a `__call__`, whose parameters are then part of the
      scene."""

    keeps: ClassVar[frozenset[str]] = KEEPS
    uniform: ClassVar[bool] = True

    function: Callable[[Scalar], Scalar]

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        del t, body
        assert y.position is not None
        r = norm(y.position)
        _, slope = jax.jvp(self.function, (r,), (jnp.ones_like(r),))
        return Load(acceleration_N=scale(-safe_divide(slope, r), y.position))

    def potential(self, t: Scalar, y: BodyState, body: AbstractBody) -> Scalar:
        del t, body
        assert y.position is not None
        return self.function(norm(y.position))
