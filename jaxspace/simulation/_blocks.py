"""Blocks of runs side by side: one after the other on every device, and all devices at once.

A block is large enough to pay for the dispatch of each operation, and small enough that what a step
keeps of it (the stages of a method, or the accelerations of the last steps) stays in the first
levels of the cache: on low orbits blocks of 64 were faster than those of 512, and vectors of 512
bits faster than those of 256."""

import functools
from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.sharding import AxisType, Mesh, PartitionSpec
from jaxtyping import Array

from ..core import is_traced

BLOCK = 64
WIDE = {
    "xla_cpu_prefer_vector_width": "512"
}  # where the processor has no such vectors, the compiler takes what there is


def jit_wide_vectors(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function under `jit`, for CPUs with the widest vectors; within a transformation, where
    the outer call decides on the options of the compiler, under `jit` alone."""
    options: Any = {"compiler_options": WIDE}
    plain, wide = eqx.filter_jit(function), eqx.filter_jit(function, **options)

    @functools.wraps(function)
    def call(*args: Any) -> Any:
        own = jax.default_backend() == "cpu" and not is_traced(args)
        return wide(*args) if own else plain(*args)

    return call


def mesh_of(devices: Sequence[Any]) -> Mesh | None:
    """The devices as one axis of runs; `None` for a single one."""
    if len(devices) == 1:
        return None
    return jax.make_mesh((len(devices),), ("runs",), (AxisType.Auto,), devices=devices)


def lanes_on(devices: Sequence[Any], runs: int) -> int:
    """How many of the runs make a block: on CPUs what fits the cache, while an accelerator wants
    all at once."""
    return BLOCK if devices[0].platform == "cpu" else BLOCK * -(-runs // (BLOCK * len(devices)))


def by_blocks(
    function: Callable[[Any, Any], Any],
    batched: Any,
    shared: Any,
    block: int = BLOCK,
    mesh: Mesh | None = None,
) -> Any:
    """`function` of `block` runs at a time and of what all `shared`. It takes the runs on the last
    axis and returns them on the first; each device of the mesh takes an equal part of the blocks.
    The last ones are filled up with copies of the last run."""
    runs = jax.tree.leaves(batched)[0].shape[0]
    parts = 1 if mesh is None else mesh.size
    count = parts * -(-runs // (block * parts))
    arrays, rest = eqx.partition(shared, eqx.is_array)

    def cut(x: Array) -> Array:
        filled = jnp.concatenate(
            [x, jnp.broadcast_to(x[-1:], (count * block - runs, *x.shape[1:]))]
        )
        return filled.reshape(count, block, *x.shape[1:])

    def blocks(pieces: Any, arrays: Any) -> Any:
        every = eqx.combine(arrays, rest)
        return jax.lax.map(
            lambda piece: function(jax.tree.map(lambda x: jnp.moveaxis(x, 0, -1), piece), every),
            pieces,
        )

    if mesh is not None:
        split = PartitionSpec("runs")
        blocks = jax.shard_map(
            blocks, mesh=mesh, in_specs=(split, PartitionSpec()), out_specs=split, check_vma=False
        )
    rows = blocks(jax.tree.map(cut, batched), arrays)
    return jax.tree.map(lambda x: x.reshape(count * block, *x.shape[2:])[:runs], rows)


def side_by_side(shared: Any) -> Any:
    """What all runs share, with an axis of length one for them at the end of every array that has
    axes."""
    return jax.tree.map(lambda x: x[..., None] if eqx.is_array(x) and x.ndim > 0 else x, shared)
