"""Atmospheres as functions of height: the interface, and one whose density falls exponentially.

    rho(h) = rho_0 exp(-(h - h_0) / H)
    p = rho g_0 H,   T = g_0 H / R_air,   c = sqrt(gamma g_0 H)     isothermal air in equilibrium

    symbol     meaning                                   unit
    rho, rho_0 density; at the reference height h_0      kg/m^3
    h, H       height above the planet, scale height     m
    p, T, c    pressure, temperature, speed of sound     Pa, K, m/s

Source: Vallado, Fundamentals of Astrodynamics, 8.6.2 (with a table of rho_0, h_0 and H). Valid
within some scale heights of the reference height: the scale height grows with the height, and the
density varies with the sun by a factor of ten at 500 km.
"""

__all__ = ["dry_air", "exponential_density", "isothermal_ratio"]

from abc import abstractmethod
from typing import NamedTuple, final

import jax.numpy as jnp

from ..core import AbstractParameters, NumberField, Scalar, quantity
from ..core.formula import NOT_NEGATIVE, POSITIVE, formula
from ..core.printing import printed
from ..core.square_roots import sqrt
from ..core.squares import quotient

GAS_CONSTANT = 8314.32  # J/(kmol K)
MOLAR_MASS = 28.9644  # kg/kmol
GRAVITY = 9.80665  # m/s^2
HEAT_RATIO = 1.4  # gamma


@printed(temperature="K", pressure="Pa", density="kg/m^3", sound_speed="m/s")
class Air(NamedTuple):
    """The state of the air, each (*runs,).

    - `temperature`: K.
    - `pressure`: Pa.
    - `density`: kg/m^3.
    - `sound_speed`: m/s."""

    temperature: Scalar
    pressure: Scalar
    density: Scalar
    sound_speed: Scalar


@formula(temperature=POSITIVE, pressure=NOT_NEGATIVE)
def dry_air(temperature: Scalar, pressure: Scalar) -> Air:
    """The state of dry air: rho = p M_0/(R T), c = sqrt(gamma R T/M_0) (U.S. Standard Atmosphere,
    1976, Eqs. 42 and 50).

    **Arguments**

    - `temperature`: K; `pressure`: Pa."""
    per_mass = GAS_CONSTANT / MOLAR_MASS * temperature
    return Air(temperature, pressure, pressure / per_mass, sqrt(HEAT_RATIO * per_mass))


@formula(temperature=POSITIVE)
def isothermal_ratio(climb: Scalar, temperature: Scalar) -> Scalar:
    """Ratio of the pressures of dry air in equilibrium after and before a climb at one temperature
    (U.S. Standard Atmosphere, 1976, Eq. 33b).

    **Arguments**

    - `climb`: m, (*runs,), negative downwards.
    - `temperature`: K, (*runs,)."""
    return jnp.exp(-GRAVITY * MOLAR_MASS / GAS_CONSTANT * climb / temperature)


@formula(density=NOT_NEGATIVE, scale_height=POSITIVE)
def exponential_density(
    height: Scalar, density: Scalar, reference_height: Scalar, scale_height: Scalar
) -> Scalar:
    """Density rho at a height (Vallado 8.6.2).

    **Arguments**

    - `height`: above the planet, m.
    - `density`: rho_0, kg/m^3, at the `reference_height`, m.
    - `scale_height`: m.

    **Returns** the density, kg/m^3."""
    return density * jnp.exp(quotient(reference_height - height, scale_height))


class AbstractAtmosphere(AbstractParameters):
    """The density of the air by the height above the planet. A concrete atmosphere is final."""

    @abstractmethod
    def density_at(self, height: Scalar) -> Scalar:
        """Density, kg/m^3, at a `height` above the planet, m; both (*runs,)."""

    @abstractmethod
    def air_at(self, height: Scalar) -> Air:
        """The state of the air at a `height` above the planet, m, (*runs,)."""

    @abstractmethod
    def scaled(self, factor: Scalar) -> "AbstractAtmosphere":
        """The same atmosphere with its density multiplied by `factor`."""


@final
class ExponentialAtmosphere(AbstractAtmosphere):
    """Air whose density falls by the factor e over each scale height."""

    density: NumberField = quantity(
        "kg/m^3", non_negative=True, doc="of the air at the reference height"
    )
    reference_height: NumberField = quantity(
        "m", doc="height above the planet at which the density is given"
    )
    scale_height: NumberField = quantity(
        "m", positive=True, doc="climb over which the density falls by the factor e"
    )

    def density_at(self, height: Scalar) -> Scalar:
        return exponential_density(height, self.density, self.reference_height, self.scale_height)

    def air_at(self, height: Scalar) -> Air:
        density = self.density_at(height)
        # The pressure is the weight of the air above: that of one scale height.
        per_mass = GRAVITY * self.scale_height + 0.0 * density
        temperature = per_mass * MOLAR_MASS / GAS_CONSTANT
        return Air(temperature, density * per_mass, density, sqrt(HEAT_RATIO * per_mass))

    def scaled(self, factor: Scalar) -> "ExponentialAtmosphere":
        return ExponentialAtmosphere(
            factor * self.density, self.reference_height, self.scale_height
        )
