"""One construction of each class of `jaxspace.verification`, as the reference shows them."""

import jax.numpy as jnp

from jaxspace.verification import Case


def chord(x):
    """The chord of an angle in the unit circle, accurate also for small angles."""
    return 2.0 * jnp.sin(0.5 * x)


Case(
    "geometry: small chord",
    chord,
    inputs=(1e-8,),
    value=(1e-8,),
    slopes=((1.0,),),
)
