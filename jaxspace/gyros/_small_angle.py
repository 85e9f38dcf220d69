"""The range of the models that are linear in an angle."""

import jax.numpy as jnp

from ..core import Scalar
from ..core.limits import Limit

SMALL_ANGLE = 1.0
"""The angle, rad, beyond which a linear model is invalid: its sine is 0.84, so that results of such
a model are meaningless."""


def small_angle(name: str, angle: Scalar) -> Limit:
    """The limit of an angle, rad, for a linear model; `name` is that of the angle in the state."""
    return Limit(f"the size of {name}", "rad", jnp.abs(angle), high=SMALL_ANGLE)
