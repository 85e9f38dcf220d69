"""Mapped runs as batched runs: an axis of runs for a field, a state and the settings of a loop.

JAX maps an integration by giving some of its arrays a further axis. If the system keeps to the
layout of the library (components first, runs last), the same runs are one batch, which is many
times as fast. `add_run_axis` makes this batch, or returns `None` where it cannot.
"""

import dataclasses
import functools
from collections.abc import Callable, Sequence
from typing import TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, PyTree

from ..core import AbstractSystem
from ..core.layout import component_axes_of
from ..solvers.protocol import bind
from ..solvers.tolerances import Tolerance
from ._event_location import SoughtEvents
from ._layout_check import follows_layout
from ._loop_settings import LoopSettings
from ._own_state import OwnState
from .normalised_time import ScaledVectorField, Segments

BLOCK = 64
"""Runs in a block: enough to pay for the dispatch of each operation, and few enough that the data
of a step stay in the first levels of the cache. On low orbits blocks of 64 were faster than those
of 512."""


# Field, initial state and settings of a loop, or a tree of this structure.
Parts: TypeAlias = tuple[PyTree, PyTree, LoopSettings]


class _CannotMap(Exception):
    """An array cannot have a further axis of runs."""


def add_run_axis(
    parts_of: Callable[[Sequence[PyTree]], Parts],
    values: Sequence[Array],
    dims: Sequence[int | None],
    size: int,
    flags: Sequence[bool] | None,
) -> tuple[PyTree, PyTree] | None:
    """The parts of a mapped integration as those of a batch.

    **Arguments**

    - `parts_of`: builds field, initial state and settings from flat arrays.
    - `values`, `dims`: the arrays, and which of their axes is mapped.
    - `size`: how many runs there are.
    - `flags`: arrays that get their own value in every run, even if they are not mapped.

    **Returns** the parts, and for each of their arrays whether it carries the new axis; or `None`
    if the integration cannot be batched."""
    mapped = [d is not None for d in dims]
    moved = [x if d is None else jnp.moveaxis(x, d, -1) for x, d in zip(values, dims, strict=True)]
    own = [m or f for m, f in zip(mapped, flags or [False] * len(mapped), strict=True)]
    field, y0, settings = parts_of(moved)
    field_mapped, y0_mapped, settings_mapped = parts_of(mapped)
    field_own, _, _ = parts_of(own)
    if not isinstance(field, ScaledVectorField):
        return None
    # As one run has them, before any axis was moved.
    original = parts_of(list(values))
    if not follows_layout(*_single(original, parts_of(list(dims)))):
        return None
    try:
        field = _field_axis(field, field_mapped, field_own, size)
        settings = _settings_axis(settings, settings_mapped, size)
    except _CannotMap:
        return None

    def state(x: Array, is_mapped: bool) -> Array:
        return x if is_mapped else jnp.broadcast_to(x[..., None], (*x.shape, size))

    y0 = jax.tree.map(state, y0, y0_mapped)
    if settings.sought is not None and not _of_each_run(settings.sought, y0):
        return None
    carried = (
        jax.tree.map(lambda x, o: o if eqx.is_array(x) else False, field, field_own),
        jax.tree.map(lambda x: True, y0),
        _carried_by(settings),
    )
    return (field, y0, settings), carried


def _carried_by(settings: LoopSettings) -> PyTree:
    """Whether each array of the settings carries the runs."""
    axes = settings.tolerance.run_axes

    def of_each(x: PyTree, rows: int) -> PyTree:
        return jax.tree.map(lambda a: a.ndim == rows + axes, x)

    flags = jax.tree.map(lambda x: False, settings)
    # Not by the constructor, which takes arrays.
    flags = eqx.tree_at(
        lambda s: (s.lengths, s.longest_steps, s.save_ts, s.reach),
        flags,
        (
            of_each(settings.lengths, 1),
            of_each(settings.longest_steps, 1),
            of_each(settings.save_ts, 1),
            of_each(settings.reach, 0),
        ),
        is_leaf=lambda x: x is None,
    )
    if settings.sought is None:
        return flags
    return eqx.tree_at(lambda s: s.sought.rounding, flags, True)


def _of_each_run(sought: SoughtEvents, y0: PyTree) -> bool:
    """Whether each condition takes the states of many runs and returns a number for each."""
    runs = jax.tree.leaves(y0)[0].shape[-1:]
    t = jax.ShapeDtypeStruct(runs, sought.rounding.dtype)
    try:
        values = [eqx.filter_eval_shape(event.condition, t, y0) for event in sought.events]
    except Exception:  # noqa: BLE001 - whatever a user's condition raises, it is not a batch
        return False
    return all(value.shape == runs for value in values)


def _single(parts: Parts, dims: Parts) -> tuple[AbstractSystem, PyTree]:
    """The system and the state of one of the mapped runs, as shapes."""

    # For a leaf that is no array, such as a function, `d` is the leaf itself.
    def leaf(x: PyTree, d: PyTree) -> PyTree:
        if not eqx.is_array(x):
            return x
        shape = list(x.shape)
        if d is not None:
            del shape[d]
        return jax.ShapeDtypeStruct(tuple(shape), x.dtype)

    # `None` marks an axis that is not mapped, and must count as a leaf here.
    result = jax.tree.map(leaf, parts, dims, is_leaf=lambda x: x is None)
    system, y = result[0].system, result[1]
    if isinstance(y, OwnState):
        y = eqx.filter_eval_shape(lambda s, z: s.regularised().from_regularised(z), system, y.z)
    return system, y


def _field_axis(
    field: ScaledVectorField, mapped: PyTree, own: PyTree, size: int
) -> ScaledVectorField:
    """The field with a further axis of runs."""

    def leaf(x: PyTree, axes: int, is_mapped: PyTree, is_own: PyTree, keep_shared: bool) -> PyTree:
        if not eqx.is_array(x):
            return x
        if is_own and axes < 0:
            raise _CannotMap
        if is_mapped:
            return x
        if is_own:
            return jnp.broadcast_to(x[..., None], (*x.shape, size))
        if axes < 0 or x.ndim == 0 or (keep_shared and x.ndim == axes):
            return x
        return x[..., None]

    def every(keep_shared: bool, tree: PyTree, mapped: PyTree, own: PyTree) -> PyTree:
        axes = component_axes_of(tree)
        return jax.tree.map(
            functools.partial(leaf, keep_shared=keep_shared), tree, axes, mapped, own
        )

    system = every(False, field.system, mapped.system, own.system)
    # Shared segments stay free of runs, so that the time stays a scalar.
    segments: Segments = every(True, field.segments, mapped.segments, own.segments)
    return ScaledVectorField(system, segments)


def _settings_axis(settings: LoopSettings, mapped: PyTree, size: int) -> LoopSettings:
    """The settings for a further axis of runs."""
    rest = (mapped.plan, mapped.tolerance, mapped.method)
    if any(x is True for x in jax.tree.leaves(rest)):
        raise _CannotMap
    # Tolerances and plans are one for all runs of a block.
    axes = settings.tolerance.run_axes + 1

    def with_axis(x: Array, is_mapped: bool, rows: int) -> Array:
        # An array that all runs share stays free of them.
        return x if is_mapped or x.ndim == rows else x[..., None]

    def every(x: PyTree, is_mapped: PyTree, rows: int) -> PyTree:
        return jax.tree.map(lambda a, m: with_axis(a, m, rows), x, is_mapped)

    if settings.together and any(jax.tree.leaves((mapped.lengths, mapped.save_ts))):
        raise _CannotMap
    lengths = every(settings.lengths, mapped.lengths, 1)
    longest = every(settings.longest_steps, mapped.longest_steps, 1)
    save_ts = every(settings.save_ts, mapped.save_ts, 1)
    reach = every(settings.reach, mapped.reach, 0)
    tolerance = settings.tolerance
    tolerance = Tolerance(tolerance.rtol, tolerance.atol, axes)
    sought = settings.sought
    if sought is not None:
        sought = _sought_axis(sought, mapped.sought, size)
    method = bind(
        settings.method,
        tolerance=tolerance,
        save_ts=save_ts,
        run_axes=axes,
        searched=sought is not None,
    )
    return dataclasses.replace(
        settings,
        method=method,
        tolerance=tolerance,
        lengths=lengths,
        longest_steps=longest,
        save_ts=save_ts,
        reach=reach,
        sought=sought,
    )


def _sought_axis(sought: SoughtEvents, mapped: PyTree, size: int) -> SoughtEvents:
    """The events for a further axis of runs: their conditions have no numbers of each run."""
    if any(x is True for x in jax.tree.leaves(mapped.events)):
        raise _CannotMap
    rounding = sought.rounding
    if not mapped.rounding:
        rounding = jnp.broadcast_to(rounding[..., None], (*rounding.shape, size))
    return SoughtEvents(sought.events, rounding)


def over_blocks(
    function: Callable[..., list[Array]],
    mapped: tuple[PyTree, PyTree],
    size: int,
    ranks: Sequence[int],
    more: Sequence[Array] = (),
) -> list[Array]:
    """`function(parts)`, or of the parts and `more`, block after block of the runs.

    **Arguments**

    - `mapped`: the parts and which of their arrays carry runs, as from `add_run_axis`.
    - `size`: how many runs there are.
    - `ranks`: axes of each result without the runs; a result without runs is given them.
    - `more`: further arrays, each with the runs on the last axis.

    **Returns** the results, runs last."""
    parts, carried = mapped
    count = -(-size // BLOCK)

    # Results that the runs of a block share, such as the number of steps, are repeated for each.
    def complete(results: list[Array], runs: int) -> list[Array]:
        return [
            jnp.broadcast_to(x[..., None], (*x.shape, runs)) if x.ndim == rank else x
            for x, rank in zip(results, ranks, strict=True)
        ]

    def call(parts: PyTree, more: Sequence[Array]) -> list[Array]:
        return function(parts, more) if more else function(parts)

    if count == 1:
        return complete(call(parts, more), size)

    own, shared = eqx.partition(parts, carried)
    own, more = jax.tree.map(lambda x: cut_runs(x, count, BLOCK), (own, list(more)))

    def block(piece: tuple[PyTree, Sequence[Array]]) -> list[Array]:
        own, more = piece
        return complete(call(eqx.combine(own, shared), more), BLOCK)

    return [join_runs(x, size) for x in jax.lax.map(block, (own, more))]


def cut_runs(x: Array, count: int, size: int) -> Array:
    """The array in `count` blocks of `size` runs, on a new first axis; copies of the last run fill
    the last block."""
    filling = count * size - x.shape[-1]
    last = jnp.broadcast_to(x[..., -1:], (*x.shape[:-1], filling))
    x = jnp.concatenate([x, last], axis=-1)
    return jnp.moveaxis(x.reshape(*x.shape[:-1], count, size), -2, 0)


def join_runs(x: Array, runs: int) -> Array:
    """The array with these `runs` on the last axis, from blocks on the first one."""
    x = jnp.moveaxis(x, 0, -2)
    return x.reshape(*x.shape[:-2], x.shape[-2] * x.shape[-1])[..., :runs]
