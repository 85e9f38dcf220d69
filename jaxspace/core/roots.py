"""The root of an increasing function between two known ends.

Its derivatives follow from the implicit function theorem.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Int

from .types import Scalar

# Each halving gains one bit: this number exceeds the digits of float64, and the error is the
# rounding of the function itself.
HALVINGS = 64


def increasing_root(f: Callable[[Scalar], Scalar], lower: Scalar, upper: Scalar) -> Scalar:
    """The x where an increasing function changes sign.

    **Arguments**

    - `f`: acts on each run by itself; its closure may be differentiated.
    - `lower`, `upper`: ends of the interval, (*runs,).

    **Returns** x, (*runs,); without a sign change the end nearer to one. Derivatives of every
    order, forward and reverse, follow from f(x) = 0 and not from the iteration; those by the ends
    are zero.
    """
    # That of f, because its closure may carry runs that the ends do not.
    like = jax.eval_shape(f, lower)

    def end(x: Scalar) -> Scalar:
        return lax.stop_gradient(jnp.broadcast_to(x, like.shape).astype(like.dtype))

    def solve(g: Callable[[Scalar], Scalar], low: Scalar) -> Scalar:
        def halve(_: Int[Array, ""], ends: tuple[Scalar, Scalar]) -> tuple[Scalar, Scalar]:
            low, high = ends
            # Not (low + high) / 2, which may overflow.
            middle = low + 0.5 * (high - low)
            right = g(middle) < 0.0
            return jnp.where(right, middle, low), jnp.where(right, high, middle)

        low, high = lax.fori_loop(0, HALVINGS, halve, (low, end(upper)))
        return low + 0.5 * (high - low)

    # The runs are independent, so that the derivative is a diagonal matrix: applied to ones it
    # gives its diagonal.
    return lax.custom_root(f, end(lower), solve, lambda slope, y: y / slope(jnp.ones_like(y)))
