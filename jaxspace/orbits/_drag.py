"""Drag of an atmosphere whose density falls exponentially with the height.

    a = -1/2 rho |v_r| v_r / B                 v_r = v - Omega Z x r
    rho(r) = rho_0 exp(-(|r| - R - h_0) / H)
    a' = -rho sqrt(mu a) / B                   circular orbit, air at rest, first order in rho

    symbol     meaning                                               unit
    r, v       position from the centre, velocity                    m, m/s
    v_r        velocity relative to the air                          m/s
    Omega, Z   rotation rate of the air, axis of the planet          rad/s, 1
    rho, rho_0 density; at the reference height h_0                  kg/m^3
    R, h_0, H  radius of the planet, reference height, scale height  m
    B          ballistic coefficient m / (C_D A)                     kg/m^2
    a, a'      acceleration; in the last line, radius and its rate   m/s^2; m, m/s

Source: Curtis, Orbital Mechanics, 12.4 (drag); Vallado, Fundamentals of Astrodynamics, 8.6.2
(exponential model, with a table of rho_0, h_0 and H); King-Hele, Satellite Orbits in an Atmosphere,
4.2 (decay). Valid within some scale heights of the reference height: the scale height grows with
the height, and the density varies with the sun by a factor of ten at 500 km. The air turns like a
rigid body.
"""

from typing import ClassVar, final

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..bodies import AbstractBody, AbstractEffect, BodyState, Load
from ..core import Scalar, Vector, axis, cross, norm, quantity


def exponential_density(
    height: Scalar, density: Scalar, reference_height: Scalar, scale_height: Scalar
) -> Scalar:
    """Density rho at a height (Vallado 8.6.2).

    **Arguments**

    - `height`: above the planet, m.
    - `density`: rho_0, kg/m^3, at the `reference_height`, m.
    - `scale_height`: m.

    **Returns** the density, kg/m^3."""
    return density * jnp.exp((reference_height - height) / scale_height)


def drag_acceleration(
    relative_velocity: Vector, density: Scalar, ballistic_coefficient: Scalar
) -> Vector:
    """Acceleration by drag, against the velocity relative to the air (Curtis 12.4).

    **Arguments**

    - `relative_velocity`: m/s, (3, *runs).
    - `density`: of the air, kg/m^3.
    - `ballistic_coefficient`: m / (C_D A), kg/m^2.

    **Returns** the acceleration, m/s^2, (3, *runs); zero, with a zero derivative, at rest."""
    factor = -0.5 * density / ballistic_coefficient * norm(relative_velocity)
    return factor * relative_velocity


def circular_decay_rate(
    radius: Scalar, density: Scalar, ballistic_coefficient: Scalar, mu: Scalar
) -> Scalar:
    """Rate of the radius of a circular orbit in air at rest, m/s, negative (King-Hele 4.2).

    First order in the density.

    **Arguments**

    - `radius`: of the orbit, m.
    - `density`: there, kg/m^3.
    - `ballistic_coefficient`: kg/m^2; `mu`: m^3/s^2."""
    return -density * jnp.sqrt(mu * radius) / ballistic_coefficient


@final
class Drag(AbstractEffect):
    """Drag of an exponential atmosphere, which may turn with the planet about the z axis."""

    ballistic_coefficient: Float[Array, "*#runs"] = quantity(
        "kg/m^2", positive=True, doc="mass over drag coefficient times area"
    )
    density: Float[Array, "*#runs"] = quantity(
        "kg/m^3", non_negative=True, doc="of the air at the reference height"
    )
    reference_height: Float[Array, "*#runs"] = quantity(
        "m", doc="height above the planet at which the density is given"
    )
    scale_height: Float[Array, "*#runs"] = quantity(
        "m", positive=True, doc="climb over which the density falls by the factor e"
    )
    radius: Float[Array, "*#runs"] = quantity(
        "m", positive=True, shared="planet.radius", doc="of the planet, from which heights count"
    )
    air_rate: Float[Array, "*#runs"] = quantity(
        "rad/s", default=0.0, doc="rotation of the air about the z axis"
    )

    needs: ClassVar[frozenset[str]] = frozenset({"position", "velocity"})
    adds: ClassVar[frozenset[str]] = frozenset({"acceleration"})
    keeps: ClassVar[frozenset[str]] = frozenset()

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        del t, body
        assert y.position is not None and y.velocity is not None
        density = self.density_at(y.position)
        air = self.air_rate * cross(axis(2, y.position[2]), y.position)
        return Load(
            acceleration_N=drag_acceleration(y.velocity - air, density, self.ballistic_coefficient)
        )

    def potential(self, t: Scalar, y: BodyState, body: AbstractBody) -> None:
        del t, y, body
        return None

    def density_at(self, position: Vector) -> Scalar:
        """Density of the air, kg/m^3, at a `position`, m, (3, *runs)."""
        height = norm(position) - self.radius
        return exponential_density(height, self.density, self.reference_height, self.scale_height)

    def scaled(self, factor: Scalar) -> "Drag":
        return Drag(
            self.ballistic_coefficient,
            factor * self.density,
            self.reference_height,
            self.scale_height,
            self.radius,
            self.air_rate,
        )
