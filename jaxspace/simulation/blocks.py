"""Blocks of runs: one after the other on every device, and all devices at once."""

import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, ParamSpec, TypeAlias, TypeVar

import equinox as eqx
import jax
from jax.sharding import AxisType, Mesh, PartitionSpec
from jaxtyping import Array, Int, PyTree

from ..core.jit import quick_jit
from ..core.tracing import is_traced
from ..integration.mapping import BLOCK, cut_runs, join_runs

# On a processor without such wide vectors the compiler takes the widest it has.
WIDE_VECTORS: dict[str, Any] = {"compiler_options": {"xla_cpu_prefer_vector_width": "512"}}

# Of 65,536, 131,072, 262,144 and a million runs on an H100 the fastest for dispersed missions: a
# million take up to nine times as long.
ACCELERATOR_BLOCK = 262_144

# A number, or a symbolic one of `jax.export`.
NumRuns: TypeAlias = Any

P = ParamSpec("P")
T = TypeVar("T")


def jit_wide_vectors(function: Callable[P, T]) -> Callable[P, T]:
    """The function under `jit`, for CPUs with the widest vectors.

    Within a transformation plain `jit`, because the outer call sets the options of the compiler."""
    plain = quick_jit(function)
    wide = quick_jit(function, **WIDE_VECTORS)

    @functools.wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> T:
        own = jax.default_backend() == "cpu" and not is_traced((args, kwargs))
        return wide(*args, **kwargs) if own else plain(*args, **kwargs)

    return call


def _mesh_of(devices: Sequence[jax.Device]) -> Mesh | None:
    """The devices as one axis of runs; `None` for a single one."""
    if len(devices) == 1:
        return None
    return jax.make_mesh((len(devices),), ("runs",), (AxisType.Auto,), devices=devices)


class Order(NamedTuple):
    """An order of the runs: their numbers in it, and the `places` of the runs in it."""

    runs: Int[Array, " runs"]
    places: Int[Array, " runs"]


class Blocks(NamedTuple):
    """Division of runs: `size` runs in a block, and the `mesh` of devices that share the blocks."""

    size: int
    mesh: Mesh | None

    @classmethod
    def on(cls, devices: Sequence[jax.Device], runs: NumRuns) -> "Blocks":
        """The division of these `runs` on the devices.

        On CPUs a block is sized to fit the cache. On an accelerator it is sized to keep the whole
        device busy, because a block lasts as long as its longest run; all blocks have the same
        size."""
        size = BLOCK
        if devices[0].platform != "cpu":
            blocks = -(-runs // (ACCELERATOR_BLOCK * len(devices)))
            size = BLOCK * -(-runs // (BLOCK * len(devices) * blocks))
        return cls(size, _mesh_of(devices))

    def map(
        self,
        function: Callable[[PyTree, PyTree], PyTree],
        batched: PyTree,
        shared: PyTree,
        order: Order | None = None,
    ) -> PyTree:
        """`function(piece, shared)` of one block at a time, with the runs last everywhere.

        Each device processes an equal part of the blocks. The last block is padded with copies of
        the last run. `order`: that in which the runs fill the blocks, by default their own; the
        results are in the order of `batched`."""
        runs = jax.tree.leaves(batched)[0].shape[-1]
        parts = 1 if self.mesh is None else self.mesh.size
        # Whole blocks only, so that one program is sufficient for all of them.
        count = parts * -(-runs // (self.size * parts))
        # `shard_map` takes arrays alone; other shared leaves are passed around it.
        arrays, static = eqx.partition(shared, eqx.is_array)

        def cut(x: Array) -> Array:
            return cut_runs(x if order is None else x[..., order.runs], count, self.size)

        def every(pieces: PyTree, arrays: PyTree) -> PyTree:
            shared = eqx.combine(arrays, static)
            # One block after the other, so that the state of a block stays in the cache.
            return jax.lax.map(lambda piece: function(piece, shared), pieces)

        if self.mesh is not None:
            split = PartitionSpec("runs")
            every = jax.shard_map(
                every,
                mesh=self.mesh,
                in_specs=(split, PartitionSpec()),
                out_specs=split,
                check_vma=False,
            )
        results = every(jax.tree.map(cut, batched), arrays)

        def join(x: Array) -> Array:
            x = join_runs(x, runs)
            return x if order is None else x[..., order.places]

        return jax.tree.map(join, results)
