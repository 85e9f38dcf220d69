"""Complete elliptic integrals, by arithmetic-geometric means that never subtract.

    K = int_0^(pi/2) dx / sqrt(1 - k^2 sin^2 x) = pi / (2 agm(1, k'))         k'^2 = 1 - k^2

    R_F(0, y, z)    = 1/2 int_0^inf dx / sqrt(x (x + y) (x + z))   = pi / (2 agm(sqrt(y), sqrt(z)))
    R_J(0, y, z, p) = 3/2 int_0^inf dx / (sqrt(x (x + y) (x + z)) (x + p))

    symbol   meaning                                             unit
    k        modulus                                             1
    k'^2     complement of the squared modulus                   1
    agm      arithmetic-geometric mean                           1

Source: Thomson 5.11; Gauss (Abramowitz and Stegun 17.6); Carlson (DLMF 19.16.1, .2); Bulirsch
(1969), Numer. Math. 13, 305 (`cel`). The complement is the argument: near k = 1, where K grows like
ln(4/k'), a complement computed as 1 - k^2 loses all digits.
"""

__all__ = ["complete_elliptic", "complete_first", "complete_third"]

import math

import jax
import jax.numpy as jnp

from ._lists import takes_lists
from .square_roots import sqrt
from .types import Scalar

# The mean doubles its digits in every step once its two sides are near: eleven steps suffice for k'
# down to 1e-200.
STEPS = 11


@takes_lists
def complete_elliptic(complement: Scalar) -> Scalar:
    """K, 1, from the complement k'^2 = 1 - k^2 within [0, 1]; infinite, with a derivative of zero,
    at zero."""
    regular = complement > 0.0
    # One in place of zero, at which the root has an infinite slope.
    b = jnp.sqrt(jnp.where(regular, complement, 1.0))
    return jnp.where(regular, 0.5 * math.pi / _mean(jnp.ones_like(b), b), jnp.inf)


def _mean(a: Scalar, b: Scalar) -> Scalar:
    """agm(a, b) of positive numbers."""

    def step(_, ab):
        return (0.5 * (ab[0] + ab[1]), jnp.sqrt(ab[0] * ab[1]))

    # A fixed number of steps, because a loop that ends by a condition has no reverse mode.
    return jax.lax.fori_loop(0, STEPS, step, (a, b))[0]


@takes_lists
def complete_first(total: Scalar, product: Scalar) -> Scalar:
    """R_F(0, y, z), from two symmetric functions of its arguments.

    They have no square root where y = z, and so derivatives there.

    **Arguments**

    - `total`: sqrt(y) + sqrt(z), of any unit U.
    - `product`: sqrt(y z), U^2; positive.

    **Returns** R_F, 1/U.
    """
    return 0.5 * math.pi / _mean(0.5 * total, jnp.sqrt(product))


@takes_lists
def complete_third(total: Scalar, product: Scalar, p: Scalar) -> Scalar:
    """R_J(0, y, z, p).

    **Arguments**

    - `total`, `product`: as in `complete_first`.
    - `p`: above zero, U^2.

    **Returns** R_J, 1/U^3; every step of Bulirsch's algorithm adds what is positive."""
    root = sqrt(p)
    c = 2.0 * jnp.sqrt(product)
    carry = (1.0 / p, 2.0 / root, product / root + root, total, c, c * total)

    def step(_, carry):
        a, b, p, m, c, e = carry
        ratio = e / p
        return (
            a + b / p,
            2.0 * (b + a * ratio),
            p + ratio,
            m + c,
            2.0 * jnp.sqrt(e),
            2.0 * jnp.sqrt(e) * (m + c),
        )

    a, b, p, m, *_ = jax.lax.fori_loop(0, STEPS, step, carry)
    return 1.5 * math.pi * (b + a * m) / (m * (m + p))
