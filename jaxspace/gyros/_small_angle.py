"""The range of the models that are linear in an angle."""

import jax.numpy as jnp
from jaxtyping import Array

from ..core import Scalar

SMALL_ANGLE = 1.0
"""The angle, rad, beyond which a linear model is invalid: its sine is 0.84, so that results of such
a model are meaningless."""


def beyond_small(angle: Scalar) -> Array:
    """Whether an angle, rad, is too large for a linear model."""
    return jnp.abs(angle) > SMALL_ANGLE
