"""The complete elliptic integral of the first kind.

    K = int_0^(pi/2) dx / sqrt(1 - k^2 sin^2 x) = pi / (2 agm(1, k'))         k'^2 = 1 - k^2

    symbol   meaning                                             unit
    k        modulus                                             1
    k'^2     complement of the squared modulus                   1
    agm      arithmetic-geometric mean                           1

Source: Thomson 5.11; Gauss (Abramowitz and Stegun 17.6). The complement is the argument: near k =
1, where K grows like ln(4/k'), a complement formed as 1 - k^2 has no digits left.
"""

import jax
import jax.numpy as jnp

from ..core import Scalar

# The mean doubles its digits in every step once its two sides are near: nine steps serve every k'
# down to 1e-100.
STEPS = 9


def complete_elliptic(complement: Scalar) -> Scalar:
    """K, 1, from the complement k'^2 = 1 - k^2 within [0, 1]; infinite at zero."""
    regular = complement > 0.0
    b = jnp.sqrt(jnp.where(regular, complement, 1.0))

    def mean(_, ab):
        return (0.5 * (ab[0] + ab[1]), jnp.sqrt(ab[0] * ab[1]))

    a, _ = jax.lax.fori_loop(0, STEPS, mean, (jnp.ones_like(b), b))
    return jnp.where(regular, 0.5 * jnp.pi / a, jnp.inf)
