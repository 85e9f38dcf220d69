"""Gravity over flat ground, along z, and its size by latitude and height.

    a = -g (R/(R + z))^2 z_hat
    g_0 = g_e (1 + k sin^2 phi)/sqrt(1 - e^2 sin^2 phi)              Somigliana, WGS 84

    symbol  meaning                                             unit
    g       at the origin of the axes                           m/s^2
    R       radius of the planet; without it gravity is uniform  m
    phi     geodetic latitude                                   rad

Source: Thomson 8.1; NIMA TR8350.2, World Geodetic System 1984, 4.1. The direction stays: right for
flights that are short against R.
"""

__all__ = ["GroundGravity", "normal_gravity"]

from typing import ClassVar, final

import jax.numpy as jnp

from ..bodies import AbstractBody, AbstractEffect, BodyState, Load
from ..core import NumberField, OptionalNumberField, Scalar, argument, constructor, quantity
from ..core.formula import formula
from ..core.square_roots import inverse_sqrt
from ..core.types import as_float
from ..core.vectors import axis

EQUATORIAL = 9.7803253359  # m/s^2
SOMIGLIANA = 0.00193185265241
ECCENTRICITY_SQUARED = 0.00669437999013
STANDARD_GRAVITY = 9.80665  # m/s^2, of the CGPM, 1901
RADIUS = 6371008.8  # m, mean of the ellipsoid


@formula
def normal_gravity(latitude: Scalar, height: Scalar = 0.0) -> Scalar:
    """Gravity of the rotating Earth, m/s^2, at a geodetic latitude (WGS 84, 4-1).

    **Arguments**

    - `latitude`: rad; `height`: above the ellipsoid, m, by the inverse square of the distance."""
    s = jnp.sin(as_float(latitude)) ** 2
    surface = EQUATORIAL * (1.0 + SOMIGLIANA * s) * inverse_sqrt(1.0 - ECCENTRICITY_SQUARED * s)
    # Not by the parabola in h of WGS 84 (4-3), which grows again from a third of a radius on.
    return surface * (RADIUS / (RADIUS + height)) ** 2


@final
class GroundGravity(AbstractEffect):
    """Gravity against z, uniform or falling with the height."""

    gravity: NumberField = quantity("m/s^2", doc="at the origin of the axes")
    radius: OptionalNumberField = quantity(
        "m", positive=True, optional=True, doc="of the planet; without it gravity is uniform"
    )

    keeps: ClassVar[frozenset[str]] = frozenset({"energy"})
    uniform: ClassVar[bool] = True

    @classmethod
    @constructor(
        sets=("gravity", "radius"),
        latitude=argument("rad", low=-1.6, high=1.6, doc="geodetic"),
        elevation=argument("m", default=0.0, doc="of the origin above sea level"),
    )
    def of_latitude(cls, latitude: Scalar, elevation: Scalar = 0.0) -> "GroundGravity":
        """Gravity of the Earth at a `latitude`, rad, and an `elevation` of the ground, m."""
        return cls(normal_gravity(latitude, elevation), RADIUS + as_float(elevation))

    def load(self, t: Scalar, y: BodyState, body: AbstractBody) -> Load:
        del t, body
        z = y.position[2]
        share = 1.0 if self.radius is None else (self.radius / (self.radius + z)) ** 2
        return Load(acceleration_N=-(self.gravity * share) * axis(2, z))

    def potential(self, t: Scalar, y: BodyState, body: AbstractBody) -> Scalar:
        del t, body
        z = y.position[2]
        # Zero at the origin, and finite far away.
        return self.gravity * (z if self.radius is None else z * self.radius / (self.radius + z))
