"""The U.S. Standard Atmosphere, 1976: temperature, pressure and density of air from the ground to
1000 km.

    H = r_0 z / (r_0 + z)                                 up to 86 km, in seven layers:
    T_M = T_k + L_k (H - H_k)
    p = p_k (T_k / T_M)^(g_0 M_0 / R L_k),  p_k exp(-g_0 M_0 (H - H_k) / (R T_k)) for L_k = 0
    rho = p M_0 / (R T_M),  T = T_M M / M_0,  c = sqrt(gamma p / rho)

    symbol     meaning                                                      unit
    z, H       geometric and geopotential height                            m
    T_M, T     molecular-scale and kinetic temperature                      K
    L_k, H_k   lapse rate of a layer, height of its base                    K/m, m
    p, rho, c  pressure, density, speed of sound                            Pa, kg/m^3, m/s
    M, M_0     molar mass of the air, at sea level                          kg/kmol
    R, r_0     gas constant, radius of the earth in H                       J/(kmol K), m

Source: U.S. Standard Atmosphere, 1976 (NOAA-S/T 76-1562), Eqs. 18, 22, 23, 33, 42, 50; tables 4, 5,
8 and I.

Above 86 km the standard gives the densities of six gases by differential equations, which were
solved once; here ln rho and M are cubic splines through that solution, which agree with it to 1e-3
and with the printed table to its last digit. Temperature is that of the standard there. The
standard gives no speed of sound above 86 km: c is continued. Above 1000 km ln rho continues with
its last slope and M is constant; below the ground the first layer continues to a depth of 100 km.

Every value is continuous. Slopes jump at the bases of the layers (11, 20, 32, 47, 51, 71 km of H),
that of the density by up to a fifth, and at 86 km; there the derivative is the mean of both sides.
Adaptive steps shorten where a run passes such a height; across it, fixed steps are of second order.
"""

__all__ = ["geometric_height", "geopotential_height", "standard_atmosphere"]

import math
from typing import final

import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array

from ..core import Choice, NumberField, Scalar, constructor, quantity
from ._upper_air import LOG_DENSITY, MOLAR_MASS_CHANGE, molar_mass_ratio
from .atmosphere import GAS_CONSTANT, GRAVITY, HEAT_RATIO, MOLAR_MASS, AbstractAtmosphere, Air

RADIUS = 6356766.0  # m, r_0
PRESSURE = 101325.0  # Pa, at H = 0
TOP = 86e3  # m, where the layers end
MIXED = 80e3  # m, up to which M = M_0
BOTTOM = -1e5  # m, below which the air stays as it is
# Of each layer: H_k, m, L_k, K/m, and T_k, K.
LAYERS = (
    (0.0, -6.5e-3, 288.15),
    (11e3, 0.0, 216.65),
    (20e3, 1.0e-3, 216.65),
    (32e3, 2.8e-3, 228.65),
    (47e3, 0.0, 270.65),
    (51e3, -2.8e-3, 270.65),
    (71e3, -2.0e-3, 214.65),
)


def geopotential_height(height: Scalar) -> Scalar:
    """H, m, of the geometric `height` z, m (U.S. Standard Atmosphere, 1976, Eq. 18)."""
    return RADIUS * height / (RADIUS + height)


def geometric_height(height: Scalar) -> Scalar:
    """z, m, of the geopotential `height` H, m (U.S. Standard Atmosphere, 1976, Eq. 19)."""
    return RADIUS * height / (RADIUS - height)


def standard_atmosphere(height: Scalar) -> Air:
    """The U.S. Standard Atmosphere, 1976, at a geometric height.

    **Arguments**

    - `height`: above sea level, m, (*runs,); `geometric_height` turns a geopotential one into it.

    **Returns** the `Air` there."""
    height = jnp.asarray(height, jnp.result_type(height, float))
    # The splines of the upper air are most of the work, and are skipped where all runs are below.
    return lax.cond(jnp.any(height > MIXED), _all_air, _lower_air, height, *_layers(height))


def _lower_air(height: Scalar, logarithm: Scalar, temperature: Scalar) -> Air:
    """The air up to 80 km, where its gases are mixed as on the ground."""
    del height
    density = jnp.exp(logarithm)
    per_mass = GAS_CONSTANT / MOLAR_MASS * temperature
    return Air(temperature, density * per_mass, density, jnp.sqrt(HEAT_RATIO * per_mass))


def _all_air(height: Scalar, logarithm: Scalar, of_layers: Scalar) -> Air:
    """The air at every height."""
    above = jnp.maximum(height - TOP, 0.0) * 1e-3
    density = jnp.exp(logarithm + LOG_DENSITY(above))
    molar_mass = MOLAR_MASS * molar_mass_ratio(height) + MOLAR_MASS_CHANGE(above)
    warm = height > TOP
    kinetic = jnp.where(warm, _upper_temperature(above), of_layers * molar_mass / MOLAR_MASS)
    per_mass = GAS_CONSTANT / MOLAR_MASS * of_layers
    # The layers' own quotient where it holds, so that no digit is lost to the molar mass.
    per_mass = jnp.where(warm, GAS_CONSTANT * kinetic / molar_mass, per_mass)
    return Air(kinetic, density * per_mass, density, jnp.sqrt(HEAT_RATIO * per_mass))


def _layers(height: Scalar) -> tuple[Scalar, Scalar]:
    """ln rho and T_M of the layers; above their top those at the top."""
    level = geopotential_height(jnp.clip(height, BOTTOM, TOP))
    dtype = jnp.result_type(level, float)
    level = jnp.asarray(level, dtype)
    columns = _COLUMNS.astype(dtype)
    base, low, thick, rate = columns[:4].reshape(4, len(LAYERS), *(1,) * level.ndim)
    exponent, decay, lapse = columns[4:]
    # Every layer adds the change of height within it, so that no run of a batch needs a branch.
    climbed = jnp.clip(level - base, low, thick)

    # As a product of matrices, which the compiler vectorises, unlike a sum over layers.
    def summed(weights: np.ndarray, x: Array) -> Scalar:
        return jnp.tensordot(weights, x, 1, precision=lax.Precision.HIGHEST)

    logarithm = math.log(PRESSURE) - summed(exponent, jnp.log1p(rate * climbed))
    logarithm = logarithm - summed(decay, climbed)
    temperature = LAYERS[0][2] + summed(lapse, climbed)
    return logarithm + jnp.log(MOLAR_MASS / GAS_CONSTANT / temperature), temperature


def _columns() -> np.ndarray:
    """Constants of each layer, (7, layers): base, least and greatest climb, m; lapse over base
    temperature, 1/m; the factors of the logarithm and of the climb, 1/m; lapse, K/m."""
    base, lapse, at_base = np.array(LAYERS).T
    low = np.where(base == 0.0, -np.inf, 0.0)
    thick = np.append(base[1:], np.inf) - base
    per_kelvin = GRAVITY * MOLAR_MASS / GAS_CONSTANT
    warms = lapse != 0.0
    exponent = np.where(warms, per_kelvin / np.where(warms, lapse, 1.0), 0.0)
    decay = np.where(warms, 0.0, per_kelvin / at_base)
    return np.stack([base, low, thick, lapse / at_base, exponent, decay, lapse])


_COLUMNS = _columns()


def _upper_temperature(above: Scalar) -> Scalar:
    """T, K, at the height `above` 86 km, km (Eqs. 25, 27, 29, 31)."""
    z = 86.0 + above
    # The ellipse ends at 111 km; beyond 110 km it is not taken.
    x = (jnp.clip(z, 91.0, 110.0) - 91.0) / 19.9429
    ellipse = 263.1905 - 76.3232 * jnp.sqrt(1.0 - x * x)
    straight = 12.0 * jnp.clip(z - 110.0, 0.0, 10.0)
    far = jnp.maximum(z, 120.0)
    reduced = (far - 120.0) * (6356.766 + 120.0) / (6356.766 + far)
    return ellipse + straight - 640.0 * jnp.expm1(-0.01875 * reduced)


@final
class StandardAtmosphere(AbstractAtmosphere):
    """The U.S. Standard Atmosphere, 1976, to 1000 km and extrapolated above."""

    density_factor: NumberField = quantity(
        "", non_negative=True, default=1.0, doc="factor on the density of the standard"
    )

    @classmethod
    @constructor(model=Choice(("us_1976",), doc="the standard"))
    def named(cls, model: str, **fields: Scalar) -> "StandardAtmosphere":
        """The standard by its name, for scene files."""
        del model
        return cls(**fields)

    def density_at(self, height: Scalar) -> Scalar:
        return self.density_factor * standard_atmosphere(height).density

    def air_at(self, height: Scalar) -> Air:
        air = standard_atmosphere(height)
        f = self.density_factor
        return Air(air.temperature, f * air.pressure, f * air.density, air.sound_speed)

    def scaled(self, factor: Scalar) -> "StandardAtmosphere":
        return StandardAtmosphere(factor * self.density_factor)
