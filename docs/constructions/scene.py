"""One construction of each class of `jaxspace.scene`, as the reference shows them."""

import jax.numpy as jnp

from jaxspace.scene.random_loads import RandomAcceleration, RandomTorque

RandomAcceleration.white(
    density=jnp.array([1e-6, 1e-6, 1e-6]), seed=3.0, duration=100.0, step=1.0
)
RandomTorque.coloured(
    deviation=jnp.array([0.1, 0.1, 0.0]),
    correlation_time=5.0,
    seed=3.0,
    duration=100.0,
    step=1.0,
)
