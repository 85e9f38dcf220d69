"""A wind with a height-dependent standard deviation, whose errors are correlated over a length.

    u(h_k) = m(h_k) + s(h_k) x_k,   Cov(x_j, x_k) = exp(-|h_j - h_k|/l)
    x_{k+1} = q x_k + sqrt(1 - q^2) z_{k+1},   q = exp(-(h_{k+1} - h_k)/l)

    symbol   meaning                                                       unit
    m, s     mean wind and its standard deviation, of either component     m/s
    l        correlation length of the error                               m
    z        independent standard normal numbers                           1

The recursion is exact: it is the Cholesky factor of that covariance, because the errors over height
form a Markov chain. East and north err independently. Between the heights the wind is cubic, and
linear in m, s and z (`hermite.py`).

Source: Gardiner, Handbook of Stochastic Methods, 4.4.
"""

from typing import final

import equinox as eqx
import jax.numpy as jnp
import numpy.typing as npt
from jaxtyping import Array, Float

from ..core import NumberField, Scalar, argument, constructor, quantity
from ..core.hermite import cubic, stacked
from ..core.quantities import check_declared, quantities
from ..core.random_paths import longitudinal, normal_numbers
from ..core.shapes import with_rank
from ..core.types import as_float
from ._sounding_file import FASTEST
from .local_air import AbstractWind, check_nodes


@final
class UncertainWind(AbstractWind):
    """A mean wind with random errors. In a campaign the numbers z are inputs, one by one, or all by
    one `seed` (`of_seed`); with zeros it is the mean wind."""

    heights: Float[Array, "nodes *#runs"] = quantity("m", doc="above sea level, ascending")
    east: Float[Array, "nodes *#runs"] = quantity(
        "m/s", low=-FASTEST, high=FASTEST, doc="mean towards the east there"
    )
    north: Float[Array, "nodes *#runs"] = quantity(
        "m/s", low=-FASTEST, high=FASTEST, doc="mean towards the north"
    )
    deviation: Float[Array, "nodes *#runs"] = quantity(
        "m/s", non_negative=True, doc="standard deviation of either component there"
    )
    correlation_length: NumberField = quantity(
        "m", positive=True, doc="l, over which the correlation falls by the factor e"
    )
    east_numbers: Float[Array, "nodes *#runs"] = quantity(
        "", doc="standard normal numbers z of the errors to the east"
    )
    north_numbers: Float[Array, "nodes *#runs"] = quantity("", doc="those to the north")
    data: Float[Array, "nodes 4 *#runs"] = eqx.field(default=None)

    def __init__(
        self,
        heights: npt.ArrayLike,
        east: npt.ArrayLike,
        north: npt.ArrayLike,
        deviation: npt.ArrayLike,
        correlation_length: Scalar,
        east_numbers: npt.ArrayLike,
        north_numbers: npt.ArrayLike,
    ):
        self.heights = as_float(heights)
        self.east = as_float(east)
        self.north = as_float(north)
        self.deviation, self.correlation_length = as_float(deviation), as_float(correlation_length)
        self.east_numbers, self.north_numbers = as_float(east_numbers), as_float(north_numbers)
        # Before `data` is computed from them.
        check_declared(self, *set(quantities(type(self))))
        given = {"east": self.east, "north": self.north, "deviation": self.deviation}
        given |= {"east_numbers": self.east_numbers, "north_numbers": self.north_numbers}
        check_nodes("UncertainWind.heights", self.heights, **given)
        # Each list may have the axes of the runs, or be shared by them.
        rank = max(*(x.ndim - 1 for x in given.values()), jnp.ndim(self.correlation_length))
        heights = with_rank(self.heights, rank)
        # In correlation lengths, by which alone the recursion goes.
        steps = (heights[1:] - heights[:-1]) / self.correlation_length
        winds = [
            with_rank(mean, rank)
            + with_rank(self.deviation, rank) * longitudinal(steps, with_rank(z, rank))
            for mean, z in ((self.east, self.east_numbers), (self.north, self.north_numbers))
        ]
        self.data = stacked(self.heights, *winds)

    @classmethod
    @constructor(
        sets=("east_numbers", "north_numbers"),
        seed=argument("", doc="of the errors: any number; each one gives another wind"),
    )
    def of_seed(
        cls,
        heights: npt.ArrayLike,
        east: npt.ArrayLike,
        north: npt.ArrayLike,
        deviation: npt.ArrayLike,
        correlation_length: Scalar,
        seed: Scalar,
    ) -> "UncertainWind":
        """A wind whose errors are those of a `seed`; the other arguments are its fields."""
        # Two at each height, because east and north err independently.
        z = normal_numbers(as_float(seed), (as_float(heights).shape[0], 2))
        return cls(heights, east, north, deviation, correlation_length, z[:, 0], z[:, 1])

    def at(self, height: Scalar) -> tuple[Scalar, Scalar]:
        east, north = cubic(self.heights, self.data, height)
        return east, north
