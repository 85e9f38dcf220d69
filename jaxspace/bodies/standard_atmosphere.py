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
that of the density by up to a fifth, and at 86 km; the derivative there is that of the air above.
Adaptive steps shorten where a run passes such a height; across it, fixed steps are of second order.
"""

__all__ = ["geometric_height", "geopotential_height", "standard_atmosphere"]

import math
from typing import final

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from ..core import Choice, NumberField, Scalar, constructor, quantity
from ..core.formula import formula
from ..core.square_roots import sqrt
from ..core.tables import within
from ._upper_air import MIXED, upper_changes
from .atmosphere import GAS_CONSTANT, GRAVITY, HEAT_RATIO, MOLAR_MASS, AbstractAtmosphere, Air

RADIUS = 6356766.0  # m, r_0
PRESSURE = 101325.0  # Pa, at H = 0
TOP = 86e3  # m, where the layers end
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


@formula
def geopotential_height(height: Scalar) -> Scalar:
    """H, m, of the geometric `height` z, m (U.S. Standard Atmosphere, 1976, Eq. 18)."""
    return RADIUS * height / (RADIUS + height)


@formula
def geometric_height(height: Scalar) -> Scalar:
    """z, m, of the geopotential `height` H, m (U.S. Standard Atmosphere, 1976, Eq. 19)."""
    return RADIUS * height / (RADIUS - height)


@formula
def standard_atmosphere(height: Scalar) -> Air:
    """The U.S. Standard Atmosphere, 1976, at a geometric height.

    **Arguments**

    - `height`: above sea level, m, (*runs,); `geometric_height` turns a geopotential one into it.

    **Returns** the `Air` there."""
    return _air(jnp.asarray(height, jnp.result_type(height, float)))


def _of_height(height: Scalar) -> Air:
    logarithm, temperature = _layers(height)
    # The upper air is most of the work, and is skipped where all runs are below. The rest is
    # outside, although the values then pass through memory: it would be duplicated in both
    # branches.
    logarithm, molecular, kinetic = lax.cond(
        jnp.any(height > MIXED), _every_air, _mixed_air, height, logarithm, temperature
    )
    density = jnp.exp(logarithm)
    per_mass = GAS_CONSTANT / MOLAR_MASS * molecular
    return Air(kinetic, density * per_mass, density, sqrt(HEAT_RATIO * per_mass))


_air = jax.custom_jvp(_of_height)


@_air.defjvp
def _air_rule(primals: tuple[Scalar], tangents: tuple[Scalar]) -> tuple[Air, Air]:
    # With the slope, because reverse mode would contain the backward pass of both branches as well.
    (d_height,) = tangents
    air, slope = jax.jvp(_of_height, primals, (jnp.ones_like(primals[0]),))
    return air, Air(*(s * d_height for s in slope))


def _mixed_air(
    height: Scalar, logarithm: Scalar, temperature: Scalar
) -> tuple[Scalar, Scalar, Scalar]:
    """ln rho, T_M and T from those of the layers, up to 80 km, where the gases are mixed as on the
    ground."""
    del height
    return logarithm, temperature, temperature


def _every_air(
    height: Scalar, logarithm: Scalar, temperature: Scalar
) -> tuple[Scalar, Scalar, Scalar]:
    """Constant air: the same at every height."""
    rarer, ratio = upper_changes(height)
    upper = _upper_temperature((height - TOP) * 1e-3)
    # T itself, and not T_M M / M_0: its slope is small in the thin air, where that of M is not.
    molecular, kinetic = (
        jnp.where(height >= TOP, *pair)
        for pair in ((upper / ratio, temperature), (upper, ratio * temperature))
    )
    return logarithm + rarer, molecular, kinetic


def _layers(height: Scalar) -> tuple[Scalar, Scalar]:
    """ln rho and T_M of the layers; above their top those at the top."""
    # Not `within`: at the top the slope is that above it, as of the upper air. Nor a selection,
    # whose constants a derivative would contain once for each effect.
    above = (height >= TOP).astype(height.dtype) * (height - TOP)
    level = geopotential_height(jnp.maximum(height - above, BOTTOM))
    dtype = jnp.result_type(level, float)
    level = jnp.asarray(level, dtype)
    table = _CONSTANTS.astype(dtype)
    number = jnp.sum(level >= table[0, 1:].reshape(-1, *(1,) * level.ndim), axis=0)
    # A logarithm is most of the work: one of the layer of each run, and not one of every layer.
    of_runs = jnp.asarray(table).at[:, number].get(mode="promise_in_bounds")
    base, at_base, warming, logarithm, power, decay = of_runs
    climbed = level - base
    warmer = 1.0 + warming * climbed
    # Not `log1p` and `expm1`, whose programs are several times as long: of the logarithm, up to 12,
    # this loses a rounding or two.
    return logarithm + power * jnp.log(warmer) + decay * climbed, at_base * warmer


def _of_layers() -> np.ndarray:
    """Constants of each layer, (6, layers): H_k, m; T_k, K; L_k / T_k, 1/m; ln rho at its base; and
    the factors, there, of ln(T_M / T_k), 1, and of the climb, 1/m."""
    base, lapse, at_base = np.array(LAYERS).T
    per_kelvin = GRAVITY * MOLAR_MASS / GAS_CONSTANT
    warms = lapse != 0.0
    warming = lapse / at_base
    power = np.where(warms, -1.0 - per_kelvin / np.where(warms, lapse, 1.0), 0.0)
    decay = np.where(warms, 0.0, -per_kelvin / at_base)
    climbed = np.diff(base)
    rises = power[:-1] * np.log1p(warming[:-1] * climbed) + decay[:-1] * climbed
    ground = math.log(PRESSURE * MOLAR_MASS / GAS_CONSTANT / at_base[0])
    logarithm = ground + np.append(0.0, np.cumsum(rises))
    return np.stack([base, at_base, warming, logarithm, power, decay])


_CONSTANTS = _of_layers()


def _upper_temperature(above: Scalar) -> Scalar:
    """T, K, at the height `above` 86 km, km (Eqs. 25, 27, 29, 31)."""
    z = 86.0 + jnp.maximum(above, 0.0)
    # The ellipse ends at 111 km; beyond 110 km it is not taken.
    x = (within(z, 91.0, 110.0) - 91.0) / 19.9429
    ellipse = 263.1905 - 76.3232 * jnp.sqrt(1.0 - x * x)
    straight = 12.0 * within(z - 110.0, 0.0, 10.0)
    far = jnp.maximum(z, 120.0)
    reduced = (far - 120.0) * (6356.766 + 120.0) / (6356.766 + far)
    return ellipse + straight + 640.0 * (1.0 - jnp.exp(-0.01875 * reduced))


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
