"""A barrier for the compiler.

It is a new primitive, because the transpose of `jax.lax.optimization_barrier` assumes that it is
linear in every argument: it fails where some of the tangents are constants, such as the zeros of a
second derivative.
"""

import functools
from collections.abc import Callable, Sequence
from typing import ParamSpec, TypeVar

import jax
import jax.numpy as jnp
from jax.core import ShapedArray
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir
from jaxtyping import Array, ArrayLike, PyTree

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")

barrier_p = Primitive("barrier")
barrier_p.multiple_results = True


def barrier(tree: PyTree, *, everywhere: bool = False) -> PyTree:
    """The same tree behind a barrier: on a CPU its leaves are computed once and together.

    Without it the compiler writes one loop for each array that is needed later, and recomputes
    shared expressions in each of them.

    **Arguments**

    - `tree`: any tree of arrays and numbers.
    - `everywhere`: whether the barrier also applies on other devices, where it is the identity by
      default: between stages whose fusion takes long to compile.

    **Returns** the tree of arrays. Derivatives are held in the same way, those that are not zero
    together."""
    leaves, structure = jax.tree.flatten(tree)
    arrays = [x if isinstance(x, jax.Array) else jnp.asarray(x) for x in leaves]
    return jax.tree.unflatten(structure, barrier_p.bind(*arrays, everywhere=everywhere))


def computed_once(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """A decorator for a part of a formula whose results are used several times: its results pass a
    `barrier`, so that the formula itself needs none."""

    @functools.wraps(function)
    def held(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        return barrier(function(*args, **kwargs))

    return held


def _values(*args: ArrayLike, everywhere: bool) -> list[ArrayLike]:
    del everywhere
    return list(args)


def _held(*args: Array, everywhere: bool) -> Sequence[Array]:
    del everywhere
    return jax.lax.optimization_barrier(args)


def _held_elsewhere(*args: Array, everywhere: bool) -> Sequence[Array]:
    return jax.lax.optimization_barrier(args) if everywhere else args


def _shapes(*args: ShapedArray, everywhere: bool) -> list[ShapedArray]:
    del everywhere
    return list(args)


def _tangent(
    primals: Sequence[ArrayLike], tangents: Sequence[ArrayLike | ad.Zero], *, everywhere: bool
) -> tuple[list[Array], list[Array | ad.Zero]]:
    held = barrier_p.bind(*primals, everywhere=everywhere)
    return held, _of_the_others(tangents, everywhere)


def _transpose(
    cotangents: Sequence[ArrayLike | ad.Zero],
    *args: ArrayLike | ad.UndefinedPrimal,
    everywhere: bool,
) -> list[Array | ad.Zero | None]:
    # An input that is no `UndefinedPrimal` is a constant, and has no cotangent.
    result = _of_the_others(cotangents, everywhere)
    pairs = zip(result, args, strict=True)
    return [c if isinstance(x, ad.UndefinedPrimal) else None for c, x in pairs]


def _of_the_others(parts: Sequence[ArrayLike | ad.Zero], everywhere: bool) -> list[Array | ad.Zero]:
    """The parts, with a barrier behind those that are not symbolic zeros."""
    others = [x for x in parts if not isinstance(x, ad.Zero)]
    held = iter(barrier_p.bind(*others, everywhere=everywhere) if others else ())
    return [x if isinstance(x, ad.Zero) else next(held) for x in parts]


def _batched(
    args: Sequence[ArrayLike], axes: Sequence[int | None], *, everywhere: bool
) -> tuple[list[Array], Sequence[int | None]]:
    return barrier_p.bind(*args, everywhere=everywhere), axes


barrier_p.def_impl(_values)
barrier_p.def_abstract_eval(_shapes)
ad.primitive_jvps[barrier_p] = _tangent
ad.primitive_transposes[barrier_p] = _transpose
batching.primitive_batchers[barrier_p] = _batched
mlir.register_lowering(barrier_p, mlir.lower_fun(_held_elsewhere, multiple_results=True))
mlir.register_lowering(barrier_p, mlir.lower_fun(_held, multiple_results=True), platform="cpu")
