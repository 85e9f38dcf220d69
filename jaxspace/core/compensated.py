"""Running sums with twice the digits of their numbers.

    s = fl(a + b),   s + e = a + b exactly                         the error of one sum
    (s, e) + (s', e') = two_sum(s, s') with e + e' added to its error

The difference of two running sums far along a long log is small compared with both: it requires the
digits lost in a plain sum.

Source: Knuth, The Art of Computer Programming II, 4.2.2 (two_sum); Dekker (1971), A floating-point
technique for extending the available precision.
"""

import math

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


def two_sum(a: Array, b: Array) -> tuple[Array, Array]:
    """The rounded sum of two numbers, and its error, exactly."""
    s = a + b
    b_of_sum = s - a
    return s, (a - (s - b_of_sum)) + (b - b_of_sum)


def running_sums(x: Float[Array, "n ..."]) -> tuple[Array, Array]:
    """The sums of the first 1, 2, ... n numbers along the first axis, each as a rounded sum and its
    remainder."""

    def step(sums: tuple[Array, Array], row: tuple[Array, Array]) -> tuple:
        sums = _added(sums, row)
        return sums, sums

    # About sqrt(n) blocks in parallel, then the sums over whole blocks: two short loops, where one
    # over all numbers would be slow and a tree of them large to compile.
    n = x.shape[0]
    size = max(math.isqrt(max(n - 1, 0)) + 1, 1)
    rows = jnp.concatenate([x, jnp.zeros((size * size - n, *x.shape[1:]), x.dtype)])
    rows = jnp.moveaxis(rows.reshape(size, size, *x.shape[1:]), 0, 1)
    none = jnp.zeros_like(rows[0])
    total, within = jax.lax.scan(step, (none, none), (rows, jnp.zeros_like(rows)))
    _, ends = jax.lax.scan(step, (none[0], none[0]), total)
    before = jax.tree.map(lambda x: jnp.concatenate([none[:1], x[:-1]]), ends)
    sums = _added(before, within)
    return jax.tree.map(lambda x: jnp.moveaxis(x, 0, 1).reshape(-1, *x.shape[2:])[:n], sums)


def _added(left: tuple[Array, Array], right: tuple[Array, Array]) -> tuple[Array, Array]:
    s, e = two_sum(left[0], right[0])
    return two_sum(s, e + (left[1] + right[1]))
