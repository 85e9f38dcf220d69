"""The range of the models that are linear in an angle."""

import jax.numpy as jnp
from jaxtyping import Array

from ..core import Scalar

SMALL_ANGLE = 1.0
"""The angle, rad, from which a linear model is out of its range: its sine is 0.84, and nothing that
such a model says of it is a measurement."""


def beyond_small(angle: Scalar) -> Array:
    """Whether an angle, rad, is too large for a linear model."""
    return jnp.abs(angle) > SMALL_ANGLE
