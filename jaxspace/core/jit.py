"""A function under `jit` that costs little to call."""

import functools
from collections.abc import Callable
from typing import Any, TypeVar

import equinox as eqx
import jax
import numpy as np

T = TypeVar("T")


def quick_jit(function: Callable[..., T]) -> Callable[..., T]:
    """`equinox.filter_jit` of a function of positional arguments, in two thirds of its time.

    A short run takes less time than `equinox.filter_jit` does to bind its arguments and to listen
    for errors. Here an error is raised by a second call, which words it as `equinox` does."""
    careful = eqx.filter_jit(function)

    @functools.partial(jax.jit, static_argnums=1)
    def program(arrays: tuple, static: tuple) -> tuple[Any, eqx.internal.Static]:
        others, structure = static
        leaves = [b if a is None else a for a, b in zip(arrays, others, strict=True)]
        arrays, rest = eqx.partition(function(*jax.tree.unflatten(structure, leaves)), eqx.is_array)
        return arrays, eqx.internal.Static(rest)

    @functools.wraps(function)
    def call(*args: Any) -> T:
        leaves, structure = jax.tree.flatten(args)
        arrays = tuple(x if isinstance(x, jax.Array | np.ndarray) else None for x in leaves)
        others = tuple(None if isinstance(x, jax.Array | np.ndarray) else x for x in leaves)
        try:
            arrays, rest = program(arrays, (others, structure))
        except (jax.errors.JaxRuntimeError, ValueError):
            return careful(*args)
        return eqx.combine(arrays, rest.value)

    return call
