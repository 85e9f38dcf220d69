"""One construction of each class of `jaxspace.rotations`, as the reference shows them."""

import jax.numpy as jnp

from jaxspace.rotations import MovingFrame, Quaternion

attitude = Quaternion(jnp.array([0.5, 0.5, 0.5, 0.5]))
MovingFrame(attitude=attitude, omega=jnp.array([0.0, 0.0, 7.292e-5]))
