"""One construction of each class of `jaxspace.core`, as the reference shows them."""

import jax.numpy as jnp

from jaxspace.core import Spline, Table

Table(times=jnp.array([0.0, 10.0, 20.0]), values=jnp.array([0.0, 2.0, 1.0]))
Spline(times=[0.0, 1.0, 2.0], values=[1.0, 2.0, 1.5])
