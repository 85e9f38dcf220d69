"""A function under `jit` that costs little to call."""

import functools
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

import equinox as eqx
import jax
import numpy as np
from jaxtyping import PyTree

P = ParamSpec("P")
T = TypeVar("T")


def quick_jit(function: Callable[P, T], **options: Any) -> Callable[P, T]:
    """`equinox.filter_jit` of a function, in two thirds of its time.

    A short run takes less time than `equinox.filter_jit` does to bind its arguments and to listen
    for errors. Here an error is raised by a second call, which words it as `equinox` does.

    `options` are those of `jax.jit`."""
    careful = eqx.filter_jit(function, **options)

    @functools.partial(jax.jit, static_argnums=1, **options)
    def program(arrays: tuple, static: tuple) -> tuple[PyTree, eqx.internal.Static]:
        others, structure = static
        leaves = [b if a is None else a for a, b in zip(arrays, others, strict=True)]
        args, kwargs = jax.tree.unflatten(structure, leaves)
        result = function(*args, **kwargs)  # pyright: ignore[reportCallIssue]
        arrays, rest = eqx.partition(result, eqx.is_array)
        return arrays, eqx.internal.Static(rest)

    @functools.wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> T:
        leaves, structure = jax.tree.flatten((args, kwargs))
        arrays = tuple(x if isinstance(x, jax.Array | np.ndarray) else None for x in leaves)
        others = tuple(None if isinstance(x, jax.Array | np.ndarray) else x for x in leaves)
        try:
            arrays, rest = program(arrays, (others, structure))
        except (jax.errors.JaxRuntimeError, ValueError):
            return careful(*args, **kwargs)
        return eqx.combine(arrays, rest.value)

    return call
