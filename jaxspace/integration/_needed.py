"""Programs without the operations that their result does not need.

A step returns its error estimate and the coefficients of its dense output. Where a derivative reads
neither, both would still be differentiated, lowered and optimised in every first call, until the
compiler removes them.
"""

from collections.abc import Callable
from typing import TypeVar

import jax
from jax.extend.core import ClosedJaxpr, jaxpr_as_fun  # pyright: ignore
from jax.interpreters import partial_eval

Result = TypeVar("Result")


def needed_only(function: Callable[..., Result]) -> Callable[..., Result]:
    """The function of arrays, traced without the operations that its result does not need."""

    def call(*args: object) -> Result:
        closed, shapes = jax.make_jaxpr(function, return_shape=True)(*args)
        # Every argument stays, so that the list of flat arguments is the same.
        jaxpr, _ = partial_eval.dce_jaxpr(closed.jaxpr, [True] * len(closed.out_avals), True)
        leaves = jaxpr_as_fun(ClosedJaxpr(jaxpr, closed.consts))(*jax.tree.leaves(args))
        return jax.tree.unflatten(jax.tree.structure(shapes), leaves)

    return call
