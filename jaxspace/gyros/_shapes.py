"""Shapes of the parameters of instruments about three axes."""

from typing import TypeAlias

from jaxtyping import Array, Float

Three: TypeAlias = Float[Array, "3 *#runs"]
ZERO = (0.0, 0.0, 0.0)
