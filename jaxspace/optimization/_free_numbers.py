"""Free numbers q in place of scaled unknowns z with bounds, for optimisers that know no bounds.

    a <= z <= b    z = a + (b - a)(1 + sin q)/2
    a <= z         z = a - 1 + sqrt(1 + q^2)            z <= b    z = b + 1 - sqrt(1 + q^2)

The slope of each map vanishes at a bound, so that an optimum there is an ordinary point of a
descent. A projection would do for steps of a given length; a line search and the curvature of
L-BFGS need a smooth function, which the problem on a clipped step is not.

Source: James and Roos, MINUIT (Comput. Phys. Commun. 10, 1975).
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

Numbers = Float[Array, " n"]

# How near a bound a descent may begin, in units of its range: on it the slope of the map is zero.
NEAREST = 1e-3


def inside(q: Numbers, low: Numbers, high: Numbers) -> Numbers:
    """The z of free numbers, between bounds that may be infinite."""
    below, above = jnp.isfinite(low), jnp.isfinite(high)
    # Finite in place of bounds that are none: the branch not taken would be NaN in its derivative.
    a, b = jnp.where(below, low, 0.0), jnp.where(above, high, 1.0)
    root = jnp.sqrt(1.0 + q * q) - 1.0
    both = a + 0.5 * (b - a) * (1.0 + jnp.sin(q))
    one = jnp.where(below, a + root, jnp.where(above, b - root, q))
    return jnp.where(below & above, both, one)


def free(z: Numbers, low: Numbers, high: Numbers) -> Numbers:
    """The free numbers of a z, which is moved inside where it lies on a bound or beyond."""
    below, above = jnp.isfinite(low), jnp.isfinite(high)
    a, b = jnp.where(below, low, 0.0), jnp.where(above, high, 1.0)
    share = jnp.clip((z - a) / (b - a), NEAREST, 1.0 - NEAREST)
    off = 1.0 + jnp.maximum(jnp.where(below, z - a, b - z), NEAREST)
    one = jnp.where(below | above, jnp.sqrt(off * off - 1.0), z)
    return jnp.where(below & above, jnp.arcsin(2.0 * share - 1.0), one)
