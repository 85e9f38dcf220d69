"""Mapped runs as batched runs: an axis of runs for a field, a state and the settings of a loop.

JAX maps an integration by giving some of its arrays a further axis. If the system follows the
layout of the library (components first, batch axis last), the same runs form one batch, which is
many times faster. `add_run_axis` makes this batch, or returns `None` where it cannot.
"""

import dataclasses
import functools
import operator
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, PyTree

from ..core.layout import component_axes_of
from ..solvers.protocol import bind
from ..solvers.tolerances import Tolerance
from ._event_state import TerminalEvents
from ._individual_state import IndividualState
from ._integration import Integration, Moving
from ._layout_check import follows_layout
from ._loop_settings import LoopSettings
from .normalised_time import ScaledVectorField, Segments

BLOCK = 64
"""Runs in a block: enough to pay for the dispatch of each operation, and few enough that the data
of a step stay in the first levels of the cache. On low orbits blocks of 64 were faster than those
of 512."""


class _CannotMap(Exception):
    """An array cannot have a further axis of runs."""


def add_run_axis(
    run: Integration, dims: PyTree, size: int, moving: Moving | None = None
) -> tuple[Integration, PyTree] | None:
    """A mapped integration as a batch.

    **Arguments**

    - `run`, `dims`: the integration, and which axis of each array is mapped.
    - `size`: number of runs.
    - `moving`: the arrays that get their own value in every run, even if they are not mapped.

    **Returns** the integration of the batch, and for each of its arrays whether it carries the new
    axis; or `None` if it cannot be batched."""
    if not _can_batch(_shapes_of_one(run, dims)):
        return None
    mapped = jax.tree.map(lambda x, d: d is not None, run, dims)
    moved = jax.tree.map(lambda x, d: x if d is None else jnp.moveaxis(x, d, -1), run, dims)
    own = mapped.field
    if moving is not None:
        own = jax.tree.map(operator.or_, own, moving[0])
    try:
        field = _field_axis(moved.field, mapped.field, own, size)
        settings = _settings_axis(moved.settings, mapped.settings, size)
    except _CannotMap:
        return None

    def state(x: Array, is_mapped: bool) -> Array:
        return x if is_mapped else jnp.broadcast_to(x[..., None], (*x.shape, size))

    y0 = jax.tree.map(state, moved.y0, mapped.y0)
    if settings.terminal is not None and not _of_each_run(settings.terminal, y0):
        return None
    carried = (
        jax.tree.map(lambda x, o: o if eqx.is_array(x) else False, field, own),
        jax.tree.map(lambda x: True, y0),
        _carried_by(settings),
    )
    batch = Integration(field, y0, settings)
    # Not by the constructor, which takes arrays.
    return batch, eqx.tree_at(lambda b: (b.field, b.y0, b.settings), batch, carried)


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
    if settings.terminal is None:
        return flags
    return eqx.tree_at(lambda s: s.terminal.rounding, flags, True)


def _of_each_run(terminal: TerminalEvents, y0: PyTree) -> bool:
    """Whether each condition accepts the states of many runs and returns a number for each."""
    runs = jax.tree.leaves(y0)[0].shape[-1:]
    t = jax.ShapeDtypeStruct(runs, terminal.rounding.dtype)
    try:
        values = [eqx.filter_eval_shape(event.condition, t, y0) for event in terminal.events]
    except Exception:  # noqa: BLE001 - whatever a user's condition raises, it is not a batch
        return False
    return all(value.shape == runs for value in values)


def _shapes_of_one(run: Integration, dims: PyTree) -> Integration:
    """One of the mapped runs, with shapes in place of its arrays."""

    def leaf(x: PyTree, d: int | None) -> PyTree:
        if not eqx.is_array(x):
            return x
        shape = tuple(n for axis, n in enumerate(x.shape) if axis != d)
        return jax.ShapeDtypeStruct(shape, x.dtype)

    return jax.tree.map(leaf, run, dims)


def _can_batch(run: Integration) -> bool:
    """Whether the vector field of a run, given as shapes, treats a trailing axis as runs."""
    if not isinstance(run.field, ScaledVectorField):
        return False
    system, y = run.field.system, run.y0
    if isinstance(y, IndividualState):
        y = eqx.filter_eval_shape(lambda s, z: s.regularised().from_regularised(z), system, y.z)
    return follows_layout(system, y)


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
    rest = (mapped.tolerance, mapped.method)
    if any(x is True for x in jax.tree.leaves(rest)):
        raise _CannotMap
    # Tolerances are one for all runs of a block.
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
    terminal = settings.terminal
    if terminal is not None:
        terminal = _terminal_axis(terminal, mapped.terminal, size)
    method = bind(
        settings.method,
        tolerance=tolerance,
        save_ts=save_ts,
        run_axes=axes,
        searched=terminal is not None,
    )
    return dataclasses.replace(
        settings,
        method=method,
        tolerance=tolerance,
        lengths=lengths,
        longest_steps=longest,
        save_ts=save_ts,
        reach=reach,
        terminal=terminal,
    )


def _terminal_axis(terminal: TerminalEvents, mapped: PyTree, size: int) -> TerminalEvents:
    """The events for a further axis of runs: their conditions have no numbers of each run."""
    if any(x is True for x in jax.tree.leaves(mapped.events)):
        raise _CannotMap
    rounding = terminal.rounding
    if not mapped.rounding:
        rounding = jnp.broadcast_to(rounding[..., None], (*rounding.shape, size))
    return TerminalEvents(terminal.events, rounding)


def over_blocks(
    function: Callable[..., PyTree],
    mapped: tuple[PyTree, PyTree],
    size: int,
    one: PyTree | None,
    *more: PyTree,
) -> PyTree:
    """`function(run)`, or of the run and `more`, block after block of the runs.

    **Arguments**

    - `mapped`: the integration and which of its arrays carry runs, as from `add_run_axis`.
    - `size`: number of runs.
    - `one`: the shapes of the results of one run, where some are shared by the runs of a block,
      such as the number of steps: they are repeated for each.
    - `more`: further arrays, each with the runs on the last axis.

    **Returns** the results, runs last."""
    run, carried = mapped
    count = -(-size // BLOCK)

    def of_each(x: Array, s: jax.ShapeDtypeStruct, runs: int) -> Array:
        return jnp.broadcast_to(x[..., None], (*x.shape, runs)) if x.ndim == s.ndim else x

    def call(run: PyTree, more: PyTree, runs: int) -> PyTree:
        results = function(run, *more)
        if one is None:
            return results
        return jax.tree.map(functools.partial(of_each, runs=runs), results, one)

    if count == 1:
        return call(run, more, size)

    own, shared = eqx.partition(run, carried)
    own, more = jax.tree.map(lambda x: cut_runs(x, count, BLOCK), (own, more))

    def block(piece: tuple[PyTree, PyTree]) -> PyTree:
        own, more = piece
        return call(eqx.combine(own, shared), more, BLOCK)

    return jax.tree.map(lambda x: join_runs(x, size), jax.lax.map(block, (own, more)))


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
