"""Pressure of sunlight on a satellite, with the shadow of the planet.

    a = -f P (L/d)^2 C A/m (s - r)/d                   d = |s - r|

    symbol  meaning                                                        unit
    r, s    position, that of the sun, both from the planet's centre       m
    f       part of the sun that is seen, 0 to 1 (`sunlight`)              1
    P, L    pressure of absorbed light at the distance L of one au         N/m^2, m
    C       coefficient: 1 for light absorbed, 2 for light reflected       1
    A/m     lit area over mass                                             m^2/kg

Source: Montenbruck and Gill, Satellite Orbits, 3.4 (3.75). The force points away from the sun,
independent of the attitude. It is not conservative because of the shadow.
"""

__all__ = ["solar_pressure"]

from typing import final

import equinox as eqx

from ..bodies import AbstractBody, AbstractEffect, BodyState, Load
from ..core import NumberField, OptionalNumberField, Scalar, Vector, quantity
from ..core.barrier import barrier
from ..core.formula import NOT_NEGATIVE, formula
from ..core.shapes import with_rank
from ..core.vectors import inverse_norm, scale
from .paths import Path
from .shadow import sunlight

ASTRONOMICAL_UNIT = 149597870700.0  # m, the L to which the pressure refers


@formula(pressure=NOT_NEGATIVE, area_per_mass=NOT_NEGATIVE)
def solar_pressure(
    position: Vector, sun: Vector, pressure: Scalar, area_per_mass: Scalar
) -> Vector:
    """Acceleration by sunlight without any shadow.

    **Arguments**

    - `position`, `sun`: from the planet's centre, m, (3, *runs).
    - `pressure`: on the area at one au, N/m^2: C P.
    - `area_per_mass`: m^2/kg.

    **Returns** a, m/s^2, (3, *runs), away from the sun."""
    rank = max(position.ndim, sun.ndim) - 1
    away = with_rank(position, rank) - with_rank(sun, rank)
    # From relative sizes, for the range of float32.
    near = (ASTRONOMICAL_UNIT * inverse_norm(away)) ** 2
    return scale(pressure * area_per_mass * near * inverse_norm(away), away)


@final
class SolarPressure(AbstractEffect):
    """Pressure of sunlight, with the shadow of the planet: a cylinder, or cones with a penumbra.

    At the edge of the cylinder the acceleration is discontinuous, and no step ends there: for
    accuracies below 1e-6 specify the radius of the sun."""

    area_per_mass: NumberField = quantity("m^2/kg", non_negative=True, doc="lit area over mass")
    # The checker takes the quantity above for a default.
    sun: Path = eqx.field(  # pyright: ignore[reportGeneralTypeIssues]
        metadata={"doc": "path of the sun from the planet's centre"}
    )
    radius: OptionalNumberField = quantity(
        "m",
        non_negative=True,
        optional=True,
        shared="planet.radius",
        doc="of the planet that casts the shadow; no shadow by default",
    )
    sun_radius: OptionalNumberField = quantity(
        "m",
        positive=True,
        optional=True,
        doc="of the sun, for a shadow with a penumbra; by default the shadow is a cylinder",
    )
    coefficient: NumberField = quantity(
        "", default=1.0, doc="1 for light that is absorbed, 2 for light that is reflected"
    )
    pressure: NumberField = quantity(
        "N/m^2",
        non_negative=True,
        default=4.5398e-6,
        doc="of light that is absorbed, at one astronomical unit",
    )

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        del body
        assert y.position is not None
        sun = self.sun(t)
        push = solar_pressure(y.position, sun, self.coefficient * self.pressure, self.area_per_mass)
        if self.radius is not None:
            light = sunlight(y.position, sun, self.radius, self.sun_radius)
            # Behind a barrier: fused with the components, each would compute the shadow again.
            push = scale(barrier(light), push)
        return Load(acceleration_N=push)

    def ground(self) -> Scalar | None:
        return self.radius

    def scaled(self, factor: Scalar) -> "SolarPressure":
        return SolarPressure(
            factor * self.area_per_mass,
            self.sun,
            self.radius,
            self.sun_radius,
            self.coefficient,
            self.pressure,
        )
