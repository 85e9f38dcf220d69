"""The U.S. Standard Atmosphere through the temperature and pressure of a launch pad.

    T = T_0 + (T_t - T_0) (H - H_0) / (H_t - H_0)                           below H_t = 11 km
    p = p_0 exp(-g_0 M_0 (H - H_0) / (R T_0) f(x)),   f(x) = ln(1 + x) / x,   x = T / T_0 - 1
    T = T_s,   p = p_s p(H_t) / p_s(H_t)                                    above

    symbol         meaning                                                        unit
    H, H_0         geopotential height, that of the pad                           m
    T_0, p_0       temperature and pressure at the pad                            K, Pa
    T_s, p_s       temperature and pressure of the standard; T_t = 216.65 K       K, Pa
    g_0, M_0, R    gravity, molar mass of the air, gas constant

The temperature is linear from the pad to the tropopause of the standard, and the pressure is
hydrostatic: the lowest layer of the standard gets another lapse rate, as in OpenRocket. Above the
tropopause temperatures are those of the standard. f has a removable singularity at x = 0, where
the air is as warm as at the pad.

Source: U.S. Standard Atmosphere, 1976 (NOAA-S/T 76-1562), Eqs. 23 and 33; OpenRocket 23.09,
`ExtendedISAModel`. Near the ground; a measured sounding is better where there is one.
"""

from typing import final

import jax.numpy as jnp

from ..core import NumberField, OptionalNumberField, Scalar, quantity
from .atmosphere import GAS_CONSTANT, GRAVITY, MOLAR_MASS, AbstractAtmosphere, Air, dry_air
from .standard_atmosphere import BOTTOM, geopotential_height, standard_atmosphere

TROPOPAUSE = 11e3  # m, H_t
COLDEST = 216.65  # K, T_t
# K/m, of the lowest layer of the standard.
LAPSE = -6.5e-3
# Pa, of the standard at the sea and at the tropopause.
SEA = 101325.0
THERE = SEA * (COLDEST / 288.15) ** (GRAVITY * MOLAR_MASS / (GAS_CONSTANT * -LAPSE))
# Below it the series of f is used, because the derivative of its quotient loses 1/x of a rounding.
SERIES_RANGE = 0.3
# (0.3 / 1.7)^24 / 25 is below rounding, also for the first derivatives.
TERMS = 12


@final
class PadAtmosphere(AbstractAtmosphere):
    """The U.S. Standard Atmosphere with the temperature and the pressure of a launch pad."""

    elevation: NumberField = quantity(
        "m", low=-500.0, high=9000.0, doc="of the pad above sea level"
    )
    temperature: OptionalNumberField = quantity(
        "K", low=180.0, high=340.0, optional=True, doc="of the air at the pad; standard by default"
    )
    pressure: OptionalNumberField = quantity(
        "Pa", positive=True, optional=True, doc="of the air at the pad; standard by default"
    )
    density_factor: NumberField = quantity(
        "", non_negative=True, default=1.0, doc="factor on density and pressure"
    )

    def density_at(self, height: Scalar) -> Scalar:
        return self.air_at(height).density

    def air_at(self, height: Scalar) -> Air:
        standard = standard_atmosphere(height)
        pad = geopotential_height(self.elevation)
        level = geopotential_height(jnp.maximum(height, BOTTOM))
        low = level < TROPOPAUSE
        # Held in the layer, so that what is not taken is finite, too.
        held = jnp.where(low, level, TROPOPAUSE)
        temperature, pressure = self._layer(held, pad)
        top = self._layer(TROPOPAUSE + 0.0 * pad, pad)[1] / THERE
        below = dry_air(temperature, pressure)
        above = standard._replace(pressure=top * standard.pressure, density=top * standard.density)
        air = Air(*(jnp.where(low, *pair) for pair in zip(below, above, strict=True)))
        f = self.density_factor
        return air._replace(pressure=f * air.pressure, density=f * air.density)

    def _layer(self, level: Scalar, pad: Scalar) -> tuple[Scalar, Scalar]:
        """Temperature, K, and pressure, Pa, at a geopotential height below the tropopause, m."""
        usual = 288.15 + LAPSE * pad
        at_pad = usual if self.temperature is None else self.temperature
        pressure = self.pressure
        if pressure is None:
            power = GRAVITY * MOLAR_MASS / (GAS_CONSTANT * -LAPSE)
            pressure = SEA * jnp.exp(power * jnp.log(usual / 288.15))
        x = (COLDEST / at_pad - 1.0) * (level - pad) / (TROPOPAUSE - pad)
        depth = GRAVITY * MOLAR_MASS / GAS_CONSTANT * (level - pad) / at_pad
        return at_pad * (1.0 + x), pressure * jnp.exp(-depth * _mean_inverse(x))

    def scaled(self, factor: Scalar) -> "PadAtmosphere":
        return PadAtmosphere(
            self.elevation, self.temperature, self.pressure, factor * self.density_factor
        )


def _mean_inverse(x: Scalar) -> Scalar:
    """ln(1 + x)/x."""
    small = jnp.abs(x) < SERIES_RANGE
    # Each branch gets a harmless argument where the other is selected.
    s, large = jnp.where(small, x, 0.0), jnp.where(small, 1.0, x)
    # ln(1 + s) = 2 artanh(z)
    square = (s / (2.0 + s)) ** 2
    series = 0.0
    for n in range(2 * TERMS - 1, 0, -2):
        series = 1.0 / n + square * series
    return jnp.where(small, 2.0 / (2.0 + s) * series, jnp.log1p(large) / large)
