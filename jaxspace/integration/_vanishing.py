"""Products with a factor that is zero but has a nonzero derivative.

    d(x f(a)) = dx f(a)        x = 0

Such a product contributes to second derivatives only. As a primitive it evaluates to zero, and f is
absent from the program until the factor is differentiated. A plain product would put f into each
first derivative: the first gradient of the apogee of a model rocket then takes 14 % longer.
"""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
from jax.core import ShapedArray
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir
from jaxtyping import Array, ArrayLike, PyTree

vanishing_p = Primitive("vanishing")
vanishing_p.multiple_results = True

# The product, of the number and of flat arrays.
Product = Callable[..., Sequence[ArrayLike]]


def vanishing(
    product: Callable[..., PyTree], number: ArrayLike, args: PyTree, like: PyTree
) -> PyTree:
    """Zero with the derivatives of `product(number, args)`, where the `number` is zero.

    **Arguments**

    - `product`: linear in the number; it closes over no traced array.
    - `args`: a tree of arrays.
    - `like`: a tree of arrays with the shapes and types of the result.

    **Returns** zeros, whose derivative with respect to the number is the product with that of the
    number. Where the product is linear in some of the `args`, reverse mode takes it as linear in
    them."""
    leaves, structure = jax.tree.flatten(args)
    shapes, result = jax.tree.flatten(like)

    def flat(number: ArrayLike, *leaves: ArrayLike) -> list[ArrayLike]:
        return jax.tree.leaves(product(number, jax.tree.unflatten(structure, leaves)))

    avals = tuple(ShapedArray(s.shape, s.dtype) for s in shapes)
    return jax.tree.unflatten(result, vanishing_p.bind(number, *leaves, product=flat, avals=avals))


def _zeros(*args: ArrayLike, product: Product, avals: tuple[ShapedArray, ...]) -> list[Array]:
    del args, product
    return [jnp.zeros(a.shape, a.dtype) for a in avals]


def _avals(*args: Any, product: Product, avals: tuple[ShapedArray, ...]) -> list[ShapedArray]:
    del args, product
    return list(avals)


def _jvp(
    primals: Sequence[ArrayLike],
    tangents: Sequence[ArrayLike | ad.Zero],
    *,
    product: Product,
    avals: tuple[ShapedArray, ...],
) -> tuple[list[Array], Sequence[ArrayLike | ad.Zero]]:
    outs = vanishing_p.bind(*primals, product=product, avals=avals)
    (number, *args), (of_number, *of_args) = primals, tangents
    d_outs: Sequence[ArrayLike | ad.Zero] = [ad.Zero(a.to_tangent_aval()) for a in avals]
    if not isinstance(of_number, ad.Zero):
        d_outs = product(of_number, *args)
    moving = [k for k, t in enumerate(of_args) if not isinstance(t, ad.Zero)]
    if moving:
        # It vanishes as well, and counts for a third derivative.
        def change(number: ArrayLike, *given: ArrayLike) -> Sequence[ArrayLike]:
            def of(*some: ArrayLike) -> Sequence[ArrayLike]:
                return product(number, *_with(given[: len(args)], moving, some))

            return jax.jvp(of, tuple(given[k] for k in moving), given[len(args) :])[1]

        more = vanishing_p.bind(
            number, *args, *(of_args[k] for k in moving), product=change, avals=avals
        )
        d_outs = [ad.add_tangents(a, b) for a, b in zip(d_outs, more, strict=True)]
    return outs, d_outs


def _transpose(
    cotangents: Sequence[ArrayLike | ad.Zero],
    number: ArrayLike,
    *args: ArrayLike | ad.UndefinedPrimal,
    product: Product,
    avals: tuple[ShapedArray, ...],
) -> list[ArrayLike | None]:
    linear = {k: x.aval for k, x in enumerate(args) if isinstance(x, ad.UndefinedPrimal)}
    known = [x for x in args if not isinstance(x, ad.UndefinedPrimal)]
    places = [k for k in range(len(args)) if k not in linear]
    given = [
        jnp.zeros(a.shape, a.dtype) if isinstance(c, ad.Zero) else c
        for c, a in zip(cotangents, avals, strict=True)
    ]

    def transposed(number: ArrayLike, *values: ArrayLike) -> Sequence[ArrayLike]:
        def of(*some: ArrayLike) -> Sequence[ArrayLike]:
            fixed = _with([None] * len(args), places, values[: len(known)])
            return list(product(number, *_with(fixed, list(linear), some)))

        like = [jax.ShapeDtypeStruct(a.shape, a.dtype) for a in linear.values()]
        return jax.linear_transpose(of, *like)(list(values[len(known) :]))

    shapes = tuple(linear.values())
    result = vanishing_p.bind(number, *known, *given, product=transposed, avals=shapes)
    of_args = _with([None] * len(args), list(linear), result)
    return [None, *of_args]


def _batched(
    args: Sequence[ArrayLike],
    axes: Sequence[int | None],
    *,
    product: Product,
    avals: tuple[ShapedArray, ...],
) -> tuple[Sequence[ArrayLike], list[int]]:
    (size,) = {jnp.shape(x)[k] for x, k in zip(args, axes, strict=True) if k is not None}
    wide = tuple(ShapedArray((size, *a.shape), a.dtype) for a in avals)
    mapped = jax.vmap(product, axes, axis_size=size)
    return vanishing_p.bind(*args, product=mapped, avals=wide), [0] * len(avals)


def _with(values: Sequence[Any], places: Sequence[int], some: Sequence[Any]) -> list[Any]:
    """The values with `some` of them at their places."""
    result = list(values)
    for k, x in zip(places, some, strict=True):
        result[k] = x
    return result


vanishing_p.def_impl(_zeros)
vanishing_p.def_abstract_eval(_avals)
ad.primitive_jvps[vanishing_p] = _jvp
ad.primitive_transposes[vanishing_p] = _transpose
batching.primitive_batchers[vanishing_p] = _batched
mlir.register_lowering(vanishing_p, mlir.lower_fun(_zeros, multiple_results=True))
