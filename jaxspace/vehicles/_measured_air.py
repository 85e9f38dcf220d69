"""Air as it was measured: temperature, pressure and wind at the levels of a sounding.

    rho = p M_0/(R T),   c = sqrt(gamma R T/M_0)
    ln p = ln p_end - g_0 M_0 (h - h_end)/(R T_end)        below the first and above the last level

    symbol         meaning                                unit
    h, T, p, rho   height, temperature, pressure, density m, K, Pa, kg/m^3
    R, M_0         gas constant, molar mass of dry air    J/(kmol K), kg/kmol
    c, gamma       speed of sound, ratio of heats         m/s, 1

Between the levels ln T, ln p and the wind are cubic with a continuous slope, linear in their values
at the levels (`hermite.py`): derivatives with respect to these are exact, also for zero
wind and constant temperature. Beyond the levels the temperature and the wind stay, and the pressure
falls as that of isothermal air in equilibrium. Humidity is left out: moist air of the tropics is
lighter by up to 1.5 percent.

Source: U.S. Standard Atmosphere, 1976 (NOAA-S/T 76-1562), Eqs. 33, 42, 50; World Meteorological
Organization, Guide to Instruments, I.12 (soundings).
"""

import os
from typing import final

import equinox as eqx
import jax.numpy as jnp
import numpy.typing as npt
from jaxtyping import Array, Float

from ..bodies import AbstractAtmosphere, Air
from ..bodies.atmosphere import dry_air, isothermal_ratio
from ..core import FileName, NumberField, Scalar, constructor, quantity
from ..core.hermite import cubic, interval, stacked
from ..core.quantities import check_declared
from ..core.types import as_float
from ._sounding_file import read_sounding_file
from .local_air import AbstractWind, check_nodes

SOUNDING = FileName("sounding: text or CSV of the University of Wyoming, or generic CSV")


@final
class MeasuredAtmosphere(AbstractAtmosphere):
    """The air of a sounding: `read_sounding(path).atmosphere()`.

    Raises `InputError` for heights that do not ascend, or another number of values."""

    heights: Float[Array, "nodes *#runs"] = quantity("m", doc="above sea level, ascending")
    pressure: Float[Array, "nodes *#runs"] = quantity("Pa", positive=True, doc="there")
    temperature: Float[Array, "nodes *#runs"] = quantity("K", positive=True, doc="there")
    density_factor: NumberField = quantity(
        "", non_negative=True, default=1.0, doc="factor on density and pressure"
    )
    data: Float[Array, "nodes 4 *#runs"] = eqx.field(default=None)

    def __init__(
        self,
        heights: npt.ArrayLike,
        pressure: npt.ArrayLike,
        temperature: npt.ArrayLike,
        density_factor: Scalar = 1.0,
    ):
        self.heights, self.pressure = as_float(heights), as_float(pressure)
        self.temperature, self.density_factor = as_float(temperature), as_float(density_factor)
        check_declared(self, "heights", "pressure", "temperature", "density_factor")
        name = "MeasuredAtmosphere.heights"
        check_nodes(name, self.heights, pressure=self.pressure, temperature=self.temperature)
        # By logarithms no cubic between levels reaches zero.
        logarithms = jnp.log(self.temperature), jnp.log(self.pressure)
        self.data = stacked(self.heights, *logarithms)

    @classmethod
    @constructor(sets=("heights", "pressure", "temperature"), sounding=SOUNDING)
    def of_sounding(
        cls, sounding: str | os.PathLike[str], density_factor: Scalar = 1.0
    ) -> "MeasuredAtmosphere":
        """The air of the sounding in a file; see `read_sounding`."""
        return cls(*read_sounding_file(sounding).air_levels(), density_factor)

    def density_at(self, height: Scalar) -> Scalar:
        return self.air_at(height).density

    def air_at(self, height: Scalar) -> Air:
        temperature, pressure = jnp.exp(cubic(self.heights, self.data, height))
        # The cubic is constant beyond the levels; the pressure continues to decrease.
        beyond = height - interval(self.heights, height)[1]
        pressure = pressure * isothermal_ratio(beyond, temperature)
        # By the pressure: at the same temperature the density follows, and the speed of sound
        # stays.
        return dry_air(temperature, self.density_factor * pressure)

    def scaled(self, factor: Scalar) -> "MeasuredAtmosphere":
        return MeasuredAtmosphere(
            self.heights, self.pressure, self.temperature, factor * self.density_factor
        )


@final
class MeasuredWind(AbstractWind):
    """The wind of a sounding: `read_sounding(path).wind()`. As `Wind` with a continuous slope, and
    for hundreds of levels.

    Raises `InputError` for heights that do not ascend, or another number of values."""

    # Without a default: a file that gives these lists itself gives a `Wind`.
    data: Float[Array, "nodes 4 *#runs"]
    heights: Float[Array, "nodes *#runs"] = quantity("m", doc="above sea level, ascending")
    east: Float[Array, "nodes *#runs"] = quantity("m/s", doc="towards the east at these heights")
    north: Float[Array, "nodes *#runs"] = quantity("m/s", doc="towards the north")

    def __init__(self, heights: npt.ArrayLike, east: npt.ArrayLike, north: npt.ArrayLike):
        self.heights = as_float(heights)
        self.east = as_float(east)
        self.north = as_float(north)
        check_declared(self, "heights", "east", "north")
        check_nodes("MeasuredWind.heights", self.heights, east=self.east, north=self.north)
        self.data = stacked(self.heights, self.east, self.north)

    @classmethod
    @constructor(sets=("heights", "east", "north"), sounding=SOUNDING)
    def of_sounding(cls, sounding: str | os.PathLike[str]) -> "MeasuredWind":
        """The wind of the sounding in a file; see `read_sounding`."""
        return cls(*read_sounding_file(sounding).wind_levels())

    def at(self, height: Scalar) -> tuple[Scalar, Scalar]:
        east, north = cubic(self.heights, self.data, height)
        return east, north
