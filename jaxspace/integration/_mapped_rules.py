"""The rules by which JAX maps the primitives of an integration over runs or tangents.

The rules are registered with JAX when this file is imported.
"""

from collections.abc import Callable, Sequence
from typing import TypeAlias

import jax
import jax.numpy as jnp
from jax.extend.core import Primitive
from jax.interpreters import batching
from jaxtyping import Array

from ._primitives import Program, along, along_p, back, back_p, derivative_p, record_p, solve_p
from ._problem import Avals, Leaves, Moving, Parts, Problem, arguments_of
from .mapping import add_run_axis, over_blocks

# The mapped axis of each argument; `None` for one that is not mapped.
Dims: TypeAlias = Sequence[int | None]
Batched: TypeAlias = tuple[list[Array], list[int | None]]


def _size(values: Leaves, dims: Dims) -> int:
    return next(x.shape[d] for x, d in zip(values, dims, strict=True) if d is not None)


def _with_axis(values: Leaves, dims: Dims, size: int, axis: int) -> list[Array]:
    """The arrays with the mapped axis at `axis`; those without one get a new axis."""

    return [
        jnp.moveaxis(jnp.broadcast_to(x, (size, *x.shape)) if d is None else x, d or 0, axis)
        for x, d in zip(values, dims, strict=True)
    ]


def _by_jax(function: Program, values: Leaves, dims: Dims) -> Batched:
    """The batching of the traced program by JAX."""
    outs = jax.vmap(function, in_axes=tuple(dims))(*values)
    return outs, [0] * len(outs)


def _solve_batch(values: Leaves, dims: Dims, *, problem: Problem) -> Batched:
    size = _size(values, dims)
    mapped = add_run_axis(problem.parts, values, dims, size, flags=None)
    if mapped is None:
        return _by_jax(problem.solve, values, dims)

    def block(parts: Parts) -> list[Array]:
        return solve_p.bind(*arguments_of(parts), problem=Problem(parts))

    ranks = [x.ndim for x in problem.outcome_avals]
    outs = over_blocks(block, mapped, size, ranks)
    return outs, [x.ndim - 1 for x in outs]


def _record_batch(values: Leaves, dims: Dims, *, problem: Problem, moving: Moving) -> Batched:
    outs, out_dims = _solve_batch(values, dims, problem=problem)
    # The record of a mapped run is computed again where it is used, and this one is never read.
    empty = [jnp.zeros(x.shape, x.dtype) for x in problem.record_avals(moving)]
    return [*outs, *empty], [*out_dims, *[None] * len(empty)]


def _linear_batch(primitive: Primitive, program: Program) -> Callable[..., Batched]:
    """The batching rule of `along` or of `back`."""

    def rule(
        values: Leaves, dims: Dims, *, problem: Problem, moving: Moving, columns: int
    ) -> Batched:
        args, record, last = problem.split(values)
        arg_dims, _, last_dims = problem.split(dims)
        size = _size(values, dims)
        if not any(d is not None for d in arg_dims):
            # Several tangents of one run, as in a Jacobian.
            last = _with_axis(last, last_dims, size, 0)
            outs = primitive.bind(
                *args, *record, *last, problem=problem, moving=moving, columns=columns + 1
            )
            return outs, [0] * len(outs)
        # Every run has its own derivative with respect to the arguments that move.
        flags = [k in moving for k in range(len(args))]
        mapped = add_run_axis(problem.parts, args, arg_dims, size, flags=flags)
        if mapped is None:

            def one(*x: Array) -> list[Array]:
                args, last = x[: len(arg_dims)], x[len(arg_dims) :]
                _, record = problem.split_record(problem.solve(*args, recorded=True, moving=moving))
                return program(
                    *args, *record, *last, problem=problem, moving=moving, columns=columns
                )

            return _by_jax(one, [*args, *last], [*arg_dims, *last_dims])

        def block(parts: Parts, last: Leaves) -> list[Array]:
            inner = Problem(parts)
            args = arguments_of(parts)
            _, record = inner.split_record(record_p.bind(*args, problem=inner, moving=moving))
            return primitive.bind(
                *args, *record, *last, problem=inner, moving=moving, columns=columns
            )

        # A rank that no result has, because every result carries the runs already.
        ranks = [-1] * (problem.num_states if primitive is along_p else len(moving))
        outs = over_blocks(block, mapped, size, ranks, _with_axis(last, last_dims, size, -1))
        return outs, [x.ndim - 1 for x in outs]

    return rule


def _derivative_batch(values: Leaves, dims: Dims, *, function: Program, shapes: Avals) -> Batched:
    del shapes
    return _by_jax(function, values, dims)


batching.primitive_batchers[solve_p] = _solve_batch
batching.primitive_batchers[record_p] = _record_batch
batching.primitive_batchers[along_p] = _linear_batch(along_p, along)
batching.primitive_batchers[back_p] = _linear_batch(back_p, back)
batching.primitive_batchers[derivative_p] = _derivative_batch
