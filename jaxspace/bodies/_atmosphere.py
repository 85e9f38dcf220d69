"""Air by height: the interface of an atmosphere, and one whose density falls exponentially.

    rho(h) = rho_0 exp(-(h - h_0) / H)

    symbol     meaning                                   unit
    rho, rho_0 density; at the reference height h_0      kg/m^3
    h, H       height above the planet, scale height     m

Source: Vallado, Fundamentals of Astrodynamics, 8.6.2 (with a table of rho_0, h_0 and H). Valid
within some scale heights of the reference height: the scale height grows with the height, and the
density varies with the sun by a factor of ten at 500 km.
"""

from abc import abstractmethod
from typing import final

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import AbstractParameters, Scalar, quantity


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


class AbstractAtmosphere(AbstractParameters):
    """The density of the air by the height above the planet. A concrete atmosphere is final."""

    @abstractmethod
    def density_at(self, height: Scalar) -> Scalar:
        """Density, kg/m^3, at a `height` above the planet, m; both (*runs,)."""

    @abstractmethod
    def scaled(self, factor: Scalar) -> "AbstractAtmosphere":
        """The same atmosphere with its density multiplied by `factor`."""


@final
class ExponentialAtmosphere(AbstractAtmosphere):
    """Air whose density falls by the factor e over each scale height."""

    density: Float[Array, "*#runs"] = quantity(
        "kg/m^3", non_negative=True, doc="of the air at the reference height"
    )
    reference_height: Float[Array, "*#runs"] = quantity(
        "m", doc="height above the planet at which the density is given"
    )
    scale_height: Float[Array, "*#runs"] = quantity(
        "m", positive=True, doc="climb over which the density falls by the factor e"
    )

    def density_at(self, height: Scalar) -> Scalar:
        return exponential_density(height, self.density, self.reference_height, self.scale_height)

    def scaled(self, factor: Scalar) -> "ExponentialAtmosphere":
        return ExponentialAtmosphere(
            factor * self.density, self.reference_height, self.scale_height
        )
