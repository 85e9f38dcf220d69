"""Complex numbers as pairs (real, imaginary), (2, *runs), and an attitude as two of them, its
Cayley-Klein parameters.

    a = q_0 + i q_3,   b = q_1 + i q_2          |a| = cos(theta/2),   |b| = sin(theta/2)

Source: Klein and Sommerfeld, Theorie des Kreisels, I. Pairs in place of a complex type, so that a
formula has one precision and real derivatives.
"""

import jax.numpy as jnp
from jaxtyping import Array

from ..core import Scalar


def pairs_of(q: Array) -> tuple[Array, Array]:
    """a and b of a quaternion, (4, *runs)."""
    return jnp.stack([q[0], q[3]]), jnp.stack([q[1], q[2]])


def raised(q: Array) -> Array:
    """The attitude, (4, *runs), seen from a space that is turned upside down about its x axis."""
    # The product with a unit quaternion, written out: exact, and without a multiplication.
    return jnp.stack([-q[1], q[0], -q[3], q[2]])


def lowered(q: Array) -> Array:
    """The inverse of `raised`."""
    return jnp.stack([q[1], -q[0], q[3], -q[2]])


def conjugate(z: Array) -> Array:
    """The conjugate of a pair."""
    return jnp.stack([z[0], -z[1]])


def times_i(z: Array) -> Array:
    """i z."""
    return jnp.stack([-z[1], z[0]])


def product(z: Array, w: Array) -> Array:
    """z w."""
    return jnp.stack([z[0] * w[0] - z[1] * w[1], z[0] * w[1] + z[1] * w[0]])


def turned(angle: Scalar, z: Array) -> Array:
    """z e^(i angle)."""
    return product(jnp.stack([jnp.cos(angle), jnp.sin(angle)]), z)
