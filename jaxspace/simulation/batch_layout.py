"""The arrays of a batch that carry runs, and the division of the batch into blocks."""

from collections.abc import Callable, Sequence
from typing import TypeAlias, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.export import is_symbolic_dim
from jaxtyping import Array, ArrayLike, PyTree

from ..core import InputError, State
from ..core.layout import add_batch_axis, run_axes_of
from ..core.structure import once_per_structure
from ..core.tracing import is_traced
from ..integration.config import IntegrationConfig
from ..integration.initial_state import state_dtype
from ..integration.mapping import BLOCK
from .blocks import Blocks, NumRuns, Order

T = TypeVar("T")
InAxes: TypeAlias = tuple[PyTree, PyTree] | None


def _declared(tree: PyTree, undeclared: int, least: int) -> PyTree[bool]:
    """Whether the declared shape of a leaf has runs on its last axis, for every leaf.

    An array without a declaration carries up to `undeclared` axes of runs. An array with fewer than
    `least` runs is shared by all."""

    def leaf(x: PyTree, axes: int) -> bool:
        if not isinstance(x, jax.ShapeDtypeStruct) or axes == 0:
            return False
        # A symbolic number of runs, as `jax.export` allows, represents many.
        return is_symbolic_dim(x.shape[-1]) or x.shape[-1] >= least

    return jax.tree.map(leaf, tree, run_axes_of(tree, lambda x: min(x.ndim, undeclared)))


@once_per_structure
def _by_declaration(systems: PyTree, y0s: PyTree, times_carry_runs: bool) -> tuple[PyTree, PyTree]:
    """The batched leaves of the systems and of the states."""
    # At least two runs: an axis of length one is a shared number that broadcasts.
    flags = (_declared(systems, 0, 2), _declared(y0s, 1, 2))
    if any(jax.tree.leaves((flags, times_carry_runs))):
        return flags
    # A batch of one run, where no other array gives the number.
    return _declared(systems, 0, 1), _declared(y0s, 1, 1)


def _marked(tree: PyTree, in_axes: PyTree) -> PyTree[bool]:
    """Whether `in_axes`, a prefix of the tree, marks a leaf with -1, for every leaf."""

    def part(axis: object, leaves: PyTree) -> PyTree:
        if axis not in (-1, None):
            raise InputError(
                f"in_axes contains {axis!r}: every entry must be -1 (batch axis last) or None."
            )
        return jax.tree.map(lambda x: axis == -1 and eqx.is_array(x) and x.ndim > 0, leaves)

    return jax.tree.map(part, in_axes, tree, is_leaf=lambda a: a is None or a == -1)


def _count(tree: PyTree, flags: PyTree[bool]) -> NumRuns:
    """The number of runs. Raises `InputError` when the last axes of the arrays differ."""
    sizes: dict[str, NumRuns] = {}
    leaves = jax.tree_util.tree_flatten_with_path(tree)[0]
    for (path, leaf), flag in zip(leaves, jax.tree.leaves(flags), strict=True):
        if flag:
            names = ("systems", "y0s", "ts")
            # The name by which the caller knows the array, for the error.
            name = names[path[0].idx] + jax.tree_util.keystr(path[1:])
            sizes[name] = leaf.shape[-1]
    if not sizes:
        raise InputError(
            "systems and y0s contain no array with a batch axis: use simulate or simulate_mission "
            "for a single run."
        )
    runs = next(iter(sizes.values()))
    for name, size in sizes.items():
        if size != runs:
            raise InputError(
                f"{name} has {size} runs on its last axis, {next(iter(sizes))} has {runs}: the "
                "batch sizes must agree; mark shared arrays with in_axes."
            )
    return runs


def split_batch(
    systems: PyTree, y0s: State, ts: ArrayLike | Sequence[float], in_axes: InAxes, times_axes: int
) -> tuple[PyTree, PyTree, NumRuns]:
    """Split into the arrays that carry runs and those that all share; and the number of runs.

    **Arguments**

    - `systems`, `y0s`, `in_axes`: as in `simulate_batch`.
    - `ts`: times with `times_axes` axes, and one more if they differ between runs."""
    if not isinstance(ts, jax.Array):
        ts = jnp.asarray(ts, state_dtype(y0s))
    if in_axes is None:
        flags = _by_declaration(systems, y0s, ts.ndim > times_axes)
    else:
        flags = (_marked(systems, in_axes[0]), _marked(y0s, in_axes[1]))
    every = (systems, y0s, ts)
    every_flag = (*flags, ts.ndim > times_axes)
    runs = _count(every, every_flag)
    batched, shared = eqx.partition(every, every_flag)
    return batched, shared, runs


def cut_batch(piece: PyTree, shared: PyTree) -> tuple[PyTree, State, Array]:
    """System, states and times of a block, from its part of the batch and the shared part."""
    system, y0, ts = shared
    return eqx.combine(piece, (add_batch_axis(system), add_batch_axis(y0), ts))


def in_blocks(
    run: Callable[..., T],
    batched: PyTree,
    shared: PyTree,
    configs: tuple[IntegrationConfig, ...],
    blocks: Blocks,
    given: PyTree = (),
    order: Order | None = None,
) -> T:
    """The runs of `run(system, y0, ts, configs, *given)`, block by block, in an `order` of theirs.

    **Arguments**

    - `batched`, `shared`: as from `split_batch`.
    - `configs`: may carry runs, too; `given` does not."""
    own, rest = zip(*(config.split() for config in configs), strict=True)

    def block(piece: PyTree, passed: PyTree) -> T:
        (batched, own), (shared, rest, given) = piece, passed
        return run(*cut_batch(batched, shared), tuple(map(eqx.combine, own, rest)), *given)

    # Passed and not closed over, so that every device gets a copy of these arrays.
    return blocks.map(block, (batched, own), (shared, rest, given), order)


def local_blocks(arrays: PyTree, runs: NumRuns) -> Blocks:
    """The blocks of these `runs`: on all local devices if there is a block for each of them.

    On one device if the arrays are committed to a device, or within a transformation."""
    devices = jax.local_devices()
    leaves = [x for x in jax.tree.leaves(arrays) if isinstance(x, jax.Array)]
    free = not is_traced(arrays) and all(
        x.devices() == set(devices) or not x.committed for x in leaves
    )
    # With fewer runs than a block for each device, to distribute them costs more than it saves.
    devices = devices[: max(1, runs // BLOCK)] if free else devices[:1]
    blocks = Blocks.on(devices, runs)
    # A program for any number of runs has blocks of one size; the last one is padded.
    return blocks if is_symbolic_dim(runs) else Blocks(min(blocks.size, runs), blocks.mesh)
