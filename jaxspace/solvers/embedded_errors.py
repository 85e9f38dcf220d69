"""The two embedded errors of DOP853, and the estimate that they give together, by component:

    e = e5^2 / sqrt(e5^2 + e3^2 / 100)

Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, II.10.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, PyTree

from ..core import State
from ..core.square_roots import inverse_sqrt


class EmbeddedErrors(NamedTuple):
    """The errors of orders 5 and 3: linear in the step, unlike their `blend`."""

    fifth: Array
    third: Array


def is_in_parts(x: object) -> bool:
    """Whether the error of a block is in parts."""
    return isinstance(x, EmbeddedErrors)


def whole_error(error: PyTree) -> State:
    """The estimate of an error that may be in parts, as those of `DOP853.in_parts`."""

    def leaf(x: PyTree) -> Array:
        return blend(x.fifth, x.third) if is_in_parts(x) else x

    return jax.tree.map(leaf, error, is_leaf=is_in_parts)


def of_each_part(function: Callable[[State], State], error: PyTree) -> PyTree:
    """The function of an error, or of each of its parts."""
    if not any(map(is_in_parts, jax.tree.leaves(error, is_leaf=is_in_parts))):
        return function(error)
    fifth, third = (
        function(jax.tree.map(lambda x, k=k: x[k], error, is_leaf=is_in_parts)) for k in (0, 1)
    )
    return jax.tree.map(EmbeddedErrors, fifth, third)


def blend(e5: Array, e3: Array) -> Array:
    """The estimate of the error of each component."""
    bottom = e5 * e5 + 0.01 * e3 * e3
    # A component that does not change has zero over zero; a safe value keeps derivatives finite.
    positive = bottom > 0.0
    return jnp.where(positive, e5 * e5 * inverse_sqrt(jnp.where(positive, bottom, 1.0)), 0.0)


def cautious(e5: Array, e3: Array) -> Array:
    """A larger estimate of the error of each component, the geometric mean of `blend` and `e5`, for
    steps that may be longer than a perturbation.

    `blend` assumes that the error is as much smaller than e5 as e5 is smaller than e3. In
    regularised variables the steps are limited by the perturbations alone. A step of a quarter of a
    revolution that ends in the atmosphere does not resolve the density, and its error has been up
    to 140 times `blend`. It has the same sign in every revolution, so that the errors add up."""
    return jnp.sqrt(jnp.abs(e5 * blend(e5, e3)))


def blended_square(e5: Array, e3: Array) -> Array:
    """The square of `blend`: without a root, and without a derivative where nothing changes."""
    square = e5 * e5
    bottom = square + 0.01 * e3 * e3 + jnp.finfo(square.dtype).tiny
    # No fourth power of an error, which single precision has no room for.
    return square * (square / bottom)
