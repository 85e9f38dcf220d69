"""The rules by which JAX maps the primitives of an integration over runs or tangents.

The rules are registered with JAX when this file is imported.
"""

from typing import TypeAlias

import equinox as eqx
import equinox.internal as eqxi
import jax
import jax.numpy as jnp
from jax.extend.core import Primitive
from jax.interpreters import batching
from jaxtyping import Array, PyTree

from ._integration import Integration, Moving, moving_in
from ._mapped_integration import AnyIntegration, MappedIntegration
from ._primitives import (
    Arguments,
    Program,
    Traced,
    bind,
    cotangent_p,
    derivative_p,
    record_p,
    solve_p,
    tangent_p,
    traced,
)
from .mapping import add_run_axis, over_blocks

# The mapped axis of each array of a tree; `None` for one that is not mapped.
Dims: TypeAlias = PyTree


def _size(values: PyTree, dims: Dims) -> int:
    sizes = jax.tree.map(lambda x, d: None if d is None else x.shape[d], values, dims)
    return jax.tree.leaves(sizes)[0]


def _with_axis(values: PyTree, dims: Dims, size: int, axis: int) -> PyTree:
    """The arrays with the mapped axis at `axis`; those without one get a new axis."""

    def leaf(x: Array, d: int | None) -> Array:
        x = jnp.broadcast_to(x, (size, *x.shape)) if d is None else x
        return jnp.moveaxis(x, d or 0, axis)

    return jax.tree.map(leaf, values, dims)


def _on(axis: int, outs: PyTree) -> tuple[PyTree, Dims]:
    """The results with the mapped `axis` of each, from the first or the last one."""
    return outs, jax.tree.map(lambda x: axis % x.ndim, outs)


def _by_jax(function: Program, values: PyTree, dims: Dims) -> tuple[PyTree, Dims]:
    """The batching of the traced program by JAX."""
    return _on(0, eqx.filter_vmap(lambda x: function(*x), in_axes=(dims,))(values))


def _as_batch(
    run: AnyIntegration, dims: Dims, size: int, moving: Moving | None = None
) -> tuple[Integration, PyTree] | None:
    """`add_run_axis`; `None` for runs that are mapped already, without being a batch."""
    if isinstance(run, MappedIntegration):
        return None
    return add_run_axis(run, dims, size, moving)


def _run_batch(run: AnyIntegration, dims: Dims, program: Traced) -> tuple[PyTree, Dims]:
    """The outcomes of mapped runs; `program`: that of one of them, for its shapes."""
    size = _size(run, dims)
    mapped = _as_batch(run, dims, size)
    if mapped is None:
        whole = MappedIntegration.of(run, dims, size)
        return _on(0, bind(solve_p, whole, traced(whole)))

    def block(run: Integration) -> PyTree:
        return bind(solve_p, run, traced(run))

    return _on(-1, over_blocks(block, mapped, size, program.out_struct[0]))


@eqxi.filter_primitive_batching
def _solve_batch(values: Arguments, dims: Arguments) -> tuple[PyTree, Dims]:
    run, program = values
    return _run_batch(run, dims[0], program)


@eqxi.filter_primitive_batching
def _record_batch(values: Arguments, dims: Arguments) -> tuple[PyTree, Dims]:
    run, _, program = values
    outs, out_dims = _run_batch(run, dims[0], program)
    # The record of a mapped run is computed again where it is used, and this one is never read.
    empty = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), program.out_struct[1])
    return (outs, empty), (out_dims, jax.tree.map(lambda _: None, empty))


def _linear_batch(primitive: Primitive) -> Program:
    """The batching rule of `tangent` or of `cotangent`."""

    @eqxi.filter_primitive_batching
    def rule(values: Arguments, dims: Arguments) -> tuple[PyTree, Dims]:
        run, record, last, *rest = values
        size = _size(values, dims)
        if not jax.tree.leaves(dims[0]):
            # Several tangents of one run, as in a Jacobian.
            last = _with_axis(last, dims[2], size, 0)
            columns, *rest = rest
            return _on(0, bind(primitive, run, record, last, columns + 1, *rest))
        # Every run has its own derivative with respect to the arrays that move.
        moving = moving_in((run.field, run.y0), last) if primitive is tangent_p else rest[1]
        mapped = _as_batch(run, dims[0], size, moving)
        if mapped is None:
            whole, columns = MappedIntegration.of(run, dims[0], size, moving), rest[0]
            _, record = bind(record_p, whole, moving, traced(whole, moving))
            last = _with_axis(last, dims[2], size, columns)
            return _on(columns, bind(primitive, whole, record, last, *rest))

        def block(run: Integration, last: PyTree) -> PyTree:
            _, record = bind(record_p, run, moving, traced(run, moving))
            return bind(primitive, run, record, last, *rest)

        last = _with_axis(last, dims[2], size, -1)
        return _on(-1, over_blocks(block, mapped, size, None, last))

    return rule


@eqxi.filter_primitive_batching
def _derivative_batch(values: Arguments, dims: Arguments) -> tuple[PyTree, Dims]:
    function, *arrays, _, _ = values
    return _by_jax(function, tuple(arrays), tuple(dims[1:3]))


batching.primitive_batchers[solve_p] = _solve_batch
batching.primitive_batchers[record_p] = _record_batch
batching.primitive_batchers[tangent_p] = _linear_batch(tangent_p)
batching.primitive_batchers[cotangent_p] = _linear_batch(cotangent_p)
batching.primitive_batchers[derivative_p] = _derivative_batch
