"""The root of an increasing function between two known ends, with derivatives by the implicit
function theorem."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Int

from ..core import Scalar

# Each halving gains one bit: this many exceed the digits of float64, so that the result is good to
# the rounding of `f` itself.
HALVINGS = 64


def increasing_root(f: Callable[[Scalar], Scalar], lower: Scalar, upper: Scalar) -> Scalar:
    """The x in [lower, upper] where the increasing function `f` changes sign; without a sign
    change, the end nearer to one.

    `f` acts on each run by itself. The count of steps is fixed. Derivatives of every order, forward
    and reverse, with respect to whatever `f` closes over follow from f(x) = 0 and not through the
    iteration; those with respect to the ends are zero."""
    like = jax.eval_shape(f, lower)

    def end(x: Scalar) -> Scalar:
        return lax.stop_gradient(jnp.broadcast_to(x, like.shape).astype(like.dtype))

    def solve(g: Callable[[Scalar], Scalar], low: Scalar) -> Scalar:
        def halve(_: Int[Array, ""], ends: tuple[Scalar, Scalar]) -> tuple[Scalar, Scalar]:
            low, high = ends
            middle = low + 0.5 * (high - low)
            right = g(middle) < 0.0
            return jnp.where(right, middle, low), jnp.where(right, high, middle)

        low, high = lax.fori_loop(0, HALVINGS, halve, (low, end(upper)))
        return low + 0.5 * (high - low)

    return lax.custom_root(f, end(lower), solve, lambda slope, y: y / slope(jnp.ones_like(y)))
