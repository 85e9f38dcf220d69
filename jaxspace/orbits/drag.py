"""Drag of an atmosphere that may turn with the planet.

    a = -1/2 rho |v_r| v_r / B                 v_r = v - Omega Z x r
    a' = -rho sqrt(mu a) / B                   circular orbit, air at rest, first order in rho

    symbol     meaning                                               unit
    r, v       position from the centre, velocity                    m, m/s
    v_r        velocity relative to the air                          m/s
    Omega, Z   rotation rate of the air, axis of the planet          rad/s, 1
    rho        density at the height |r| - R                         kg/m^3
    R          radius of the planet                                  m
    B          ballistic coefficient m / (C_D A)                     kg/m^2
    a, a'      acceleration; in the last line, radius and its rate   m/s^2; m, m/s

Source: Curtis, Orbital Mechanics, 12.4 (drag); King-Hele, Satellite Orbits in an Atmosphere,
4.2 (decay).

The atmospheres are those of `bodies`. The air turns like a rigid body, heights count from a sphere.
"""

__all__ = ["circular_decay_rate", "drag_acceleration"]

from collections.abc import Sequence
from typing import final

import equinox as eqx
import jax.numpy as jnp

from ..bodies import AbstractAtmosphere, AbstractBody, AbstractEffect, BodyState, Load
from ..bodies.random_signals import Fluctuation
from ..core import NumberField, Scalar, Vector, output, quantity
from ..core.formula import ABOVE_ZERO, NOT_NEGATIVE, POSITIVE, formula
from ..core.limits import Limit
from ..core.vectors import axis, cross, norm


@formula(density=NOT_NEGATIVE, ballistic_coefficient=ABOVE_ZERO)
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


@formula(radius=POSITIVE, density=NOT_NEGATIVE, ballistic_coefficient=ABOVE_ZERO, mu=POSITIVE)
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
    """Drag of an atmosphere, which may turn with the planet about the z axis."""

    ballistic_coefficient: NumberField = quantity(
        "kg/m^2", positive=True, doc="mass over drag coefficient times area"
    )
    # The checker takes the quantity above for a default.
    atmosphere: AbstractAtmosphere = eqx.field(  # pyright: ignore[reportGeneralTypeIssues]
        metadata={"doc": "density by the height"}
    )
    radius: NumberField = quantity(
        "m", positive=True, shared="planet.radius", doc="of the planet, from which heights count"
    )
    air_rate: NumberField = quantity(
        "rad/s", default=0.0, doc="rotation of the air about the z axis"
    )
    fluctuation: Fluctuation | None = eqx.field(
        default=None, metadata={"doc": "random factor on the density; none by default"}
    )

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        del body
        assert y.position is not None and y.velocity is not None
        density = self.density_at(y.position)
        if self.fluctuation is not None:
            density = self.fluctuation.factor(t) * density
        v_r = self._through_air(y.position, y.velocity)
        return Load(acceleration_N=drag_acceleration(v_r, density, self.ballistic_coefficient))

    def density_at(self, position: Vector) -> Scalar:
        """Density of the air, kg/m^3, at a `position`, m, (3, *runs), without its fluctuation."""
        return self.atmosphere.density_at(norm(position) - self.radius)

    @output("Pa")
    def dynamic_pressure(self, y: BodyState) -> Scalar:
        """Dynamic pressure rho |v_r|^2 / 2, Pa."""
        assert y.position is not None and y.velocity is not None
        speed = norm(self._through_air(y.position, y.velocity))
        return 0.5 * self.density_at(y.position) * speed * speed

    def _through_air(self, position: Vector, velocity: Vector) -> Vector:
        """v_r, m/s, (3, *runs)."""
        return velocity - self.air_rate * cross(axis(2, position[2]), position)

    def ground(self) -> Scalar:
        return self.radius

    def scaled(self, factor: Scalar) -> "Drag":
        # Scales the density and not the ballistic coefficient, which a factor of zero would make
        # infinite.
        air = self.atmosphere.scaled(factor)
        return Drag(self.ballistic_coefficient, air, self.radius, self.air_rate, self.fluctuation)

    def limits(self, t: Scalar, y: BodyState, body: AbstractBody) -> Sequence[Limit]:
        del y, body
        return () if self.fluctuation is None else self.fluctuation.limits(t)
