"""Many runs by one integration after the other, each of a block of runs side by side. Never a
mapped solve."""

import functools
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh
from jaxtyping import Array

from ..core import AbstractSystem, InputError, Scalar, State, is_concrete, is_traced, safe_divide
from ..integration._accuracy import Accuracy, as_accuracy, settled, state_dtype, with_method
from ..integration._events import Event
from ..integration._segment import alike
from ..integration._selection import shape
from ..integration._status import Status
from ..integration._stiffness import Starts
from ..solvers import AbstractFixedStep, Tolerance
from ._blocks import BLOCK, by_blocks, jit_wide_vectors, lanes_on, mesh_of, side_by_side
from ._mission import Mission
from ._runs import Span, run_mission, run_system
from ._simulate import missed_by, repeat, thrown
from ._trajectory import MissionTrajectory, Trajectory

SAMPLED = 16  # how many runs of a batch are looked at to choose its method
# quotient of the fastest pace and the slowest up to which the runs of a batch are not sorted
ALIKE = 1.25


def simulate_batch(
    systems: AbstractSystem | Mission,
    y0s: State,
    ts: Any = 0.0,
    *,
    accuracy: Accuracy | Scalar = 1e-9,
    events: tuple[Event, ...] = (),
    samples: int = 2,
    in_axes: tuple[Any, Any] = (0, 0),
    throw: bool = False,
):
    """`simulate` for many runs: the same contract with the runs on the first axis of every array.

    - `systems`, `y0s`: as in `simulate`, every array with a leading axis of runs. A number without
      axes is shared by all; `in_axes` = (for `systems`, for `y0s`), as in `jax.vmap`, shares more
      with `None`.
    - `ts`: (times,) for all runs or (runs, times) for each; for a mission its start.

    Returns a `Trajectory` or `MissionTrajectory` with a `Status` for every run. A run that fails
    marks its own row: when the steps of its block run out, the runs of that block are repeated
    alone, and those that fail alone, with `"auto"`, by the method that their own numbers ask for;
    runs that missed the tolerance by equal steps are repeated with more of them, up to eight times
    as many (all this outside of `jit`). All local devices take part, if there are runs enough and
    neither the arrays nor a transformation say where to compute. Raises as `simulate` does, and
    `InputError` for an array whose first axis is not that of the runs."""
    asked = as_accuracy(accuracy)
    carried = [_carried(tree, axes) for tree, axes in zip((systems, y0s), in_axes, strict=True)]
    runs = _count(systems, y0s, carried)
    ts = jnp.asarray(ts, state_dtype(y0s))
    own_ts = ts.ndim == (1 if isinstance(systems, Mission) else 2)
    batched, shared = eqx.partition((systems, y0s, ts), (*carried, own_ts))
    by_numbers = functools.partial(_by_numbers, asked, systems, y0s, carried, (batched, shared))
    accuracy = by_numbers(np.arange(runs))
    result = _run(
        batched, shared, accuracy, tuple(events), samples, *_spread((batched, shared), runs)
    )
    if is_concrete(result.status):
        result, accuracy = _again(
            result, batched, shared, accuracy, by_numbers, tuple(events), samples
        )
    result = _with_systems(result, systems, carried[0], accuracy)
    return thrown(result) if throw else result


def _by_numbers(
    accuracy: Accuracy, systems: Any, y0s: State, carried: list[Any], arrays: Any, rows: np.ndarray
) -> Accuracy:
    """The accuracy with its method chosen by some of these runs, the first and the last among
    them."""
    if isinstance(systems, Mission) or is_traced((arrays, accuracy)):
        return accuracy
    starts = Starts(arrays[0], arrays[1], rows[np.linspace(0, rows.size - 1, SAMPLED).astype(int)])
    system, y0 = (
        jax.tree.map(lambda x, flag: shape(x, int(flag)), *p)
        for p in zip((systems, y0s), carried, strict=True)
    )
    return with_method(accuracy, system, y0, starts)


def _carried(tree: Any, axes: Any) -> Any:
    """For every leaf whether it carries runs on its first axis."""

    def flags(axis: Any, part: Any) -> Any:
        return jax.tree.map(lambda x: axis is not None and eqx.is_array(x) and x.ndim > 0, part)

    return jax.tree.map(flags, axes, tree, is_leaf=lambda a: a is None or a == 0)


def _count(systems: Any, y0s: Any, carried: list[Any]) -> int:
    """The number of runs. Raises `InputError` when the leading axes of the arrays differ."""
    sizes = {}
    for name, tree, flags in (("y0s", y0s, carried[1]), ("systems", systems, carried[0])):
        for (path, leaf), flag in zip(
            jax.tree_util.tree_flatten_with_path(tree)[0], jax.tree.leaves(flags), strict=True
        ):
            if flag:
                sizes[name + jax.tree_util.keystr(path)] = leaf.shape[0]
    if not sizes:
        raise InputError(
            "simulate_batch found no array with a leading axis of runs: use simulate for one run."
        )
    runs = next(iter(sizes.values()))
    for name, n in sizes.items():
        if n != runs:
            raise InputError(
                f"{name} has {n} rows, the batch {runs} runs: its first axis must be that of the runs, or shared by in_axes."
            )
    return runs


def _again(
    result: Any,
    batched: Any,
    shared: Any,
    accuracy: Accuracy,
    by_numbers: Any,
    events: tuple[Event, ...],
    samples: int,
) -> tuple[Any, Accuracy]:
    """The result with the runs repeated whose block ran out of steps, each alone, and those that do
    so alone by the method that their own numbers ask for, if it is another; and those that missed
    the tolerance by equal steps, with as many more of these as their errors ask for. With it the
    accuracy of the finest of the runs."""

    def repeated(result: Any, rows: np.ndarray, accuracy: Accuracy, block: int) -> Any:
        filled = np.concatenate([rows, np.full(-rows.size % block, rows[-1])])
        again = _run(
            jax.tree.map(lambda x: x[filled], batched),
            shared,
            accuracy,
            events,
            samples,
            block,
            None,
        )
        return jax.tree.map(lambda a, b: a.at[rows].set(b[: rows.size]), result, again)

    def stuck(result):
        return np.flatnonzero(np.asarray(result.status) == Status.MAX_STEPS)

    if stuck(result).size and result.status.size > 1:
        result = repeated(result, stuck(result), accuracy, 1)
        other = by_numbers(stuck(result)) if stuck(result).size else accuracy
        result = (
            result
            if type(other.method) is type(accuracy.method)
            else repeated(result, stuck(result), other, 1)
        )
    error = missed_by(result, accuracy)
    missed = np.flatnonzero(error)
    if missed.size:
        accuracy = accuracy.with_more_steps(float(np.max(error)))
        result = repeated(result, missed, accuracy, BLOCK)
    return result, accuracy


def _spread(arrays: Any, runs: int) -> tuple[int, Mesh | None]:
    """The runs in a block, and the devices that share the blocks: all local ones, if there is a
    block for each and nothing says otherwise (arrays that were put on a device, or a transformation
    around this call)."""
    devices, leaves = (
        jax.local_devices(),
        [x for x in jax.tree.leaves(arrays) if isinstance(x, jax.Array)],
    )
    free = not is_traced(arrays) and all(
        x.devices() == set(devices) or not x.committed for x in leaves
    )
    devices = devices[: max(1, runs // BLOCK)] if free else devices[:1]
    return min(lanes_on(devices, runs), runs), mesh_of(devices)


@jit_wide_vectors
def _run(
    batched: Any,
    shared: Any,
    accuracy: Accuracy,
    events: tuple[Event, ...],
    samples: int,
    block: int,
    mesh: Mesh | None,
) -> Any:
    def rows(lanes: Any, given: Any) -> Any:
        shared, accuracy, events = given
        system, y0, ts = eqx.combine(lanes, shared)
        return _rows(system, y0, ts, accuracy, events, samples, block)

    given = ((*side_by_side(shared[:2]), shared[2]), accuracy, events)
    if jax.tree.leaves(batched)[0].shape[0] == block:
        return by_blocks(rows, batched, given, block, mesh)
    pace = _pace(
        eqx.combine(jax.tree.map(lambda x: jnp.moveaxis(x, 0, -1), batched), given[0]), accuracy
    )
    if pace is None:
        return by_blocks(rows, batched, given, block, mesh)
    differ = ~(jnp.max(pace) <= ALIKE * jnp.min(pace))
    order = jax.lax.cond(differ, jnp.argsort, lambda pace: jnp.arange(pace.size), pace)
    done = by_blocks(rows, _arranged(batched, order, differ), given, block, mesh)
    back = jax.lax.cond(differ, jnp.argsort, lambda order: order, order)
    return _arranged(done, back, differ)


def _arranged(rows: Any, order: Array, differ: Array) -> Any:
    """The rows in this order if they differ: to sort and to gather runs of one pace costs as much
    as a few steps of each."""
    return jax.lax.cond(
        differ, lambda rows: jax.tree.map(lambda x: x[order], rows), lambda rows: rows, rows
    )


def _pace(given: tuple[Any, State, Array], accuracy: Accuracy) -> Array | None:
    """How fast each run begins, max |dy/dt| / |y| over the blocks of its state, 1/s: runs alike in
    this want like steps, and the runs of a block share theirs. `None` where the steps do not depend
    on the runs."""
    system, y, ts = given
    t = ts
    if isinstance(system, Mission):
        system = system.phases[0].system
    else:
        t = ts[0]
    method = settled(accuracy, system, y).method
    if method == "auto" or isinstance(method, AbstractFixedStep):
        return None
    y = jax.lax.stop_gradient(alike(system, t, y))
    length = Tolerance(0.0, 0.0, 1).length
    paces = jax.tree.map(
        lambda k, b: safe_divide(length(k), length(b)), system.vector_field(t, y), y
    )
    return jax.lax.stop_gradient(functools.reduce(jnp.maximum, jax.tree.leaves(paces)))


def _rows(
    system: Any,
    y0: State,
    ts: Array,
    accuracy: Accuracy,
    events: tuple[Event, ...],
    samples: int,
    block: int,
) -> Any:
    """The trajectories of a block of runs, without what was run."""
    if isinstance(system, Mission):
        spans, final, end, status = run_mission(system, y0, ts, samples, accuracy, 1)
        phases = tuple(_trajectory(span, block) for span in spans)
        return MissionTrajectory(
            phases, tuple(p.name for p in system.phases), _front(final), end, status
        )
    return _trajectory(run_system(system, y0, ts, events, settled(accuracy, system, y0), 1), block)


def _front(tree: Any) -> Any:
    return jax.tree.map(lambda x: jnp.moveaxis(x, -1, 0), tree)


def _trajectory(span: Span, block: int) -> Trajectory:
    ts = span.ts[:, None] if span.ts.ndim == 1 else span.ts
    ts = jnp.broadcast_to(ts, (ts.shape[0], block))
    stats = {name: jnp.broadcast_to(value, (block,)) for name, value in span.stats.items()}
    return Trajectory(_front(ts), _front(span.states), span.status, span.event, stats)


def _with_systems(result: Any, systems: Any, carried: Any, accuracy: Accuracy) -> Any:
    """The trajectories with what was run, and which of its arrays all runs share."""

    def attach(t: Trajectory, system: Any, flags: Any) -> Trajectory:
        shared = tuple(not flag for flag in jax.tree.leaves(flags))
        one = (
            jax.tree.map(lambda x, flag: shape(x, int(flag)), system, flags),
            jax.tree.map(lambda x: shape(x, 2), t.states),
        )
        return Trajectory(
            t.ts, t.states, t.status, t.event, t.stats, system, with_method(accuracy, *one), shared
        )

    if not isinstance(result, MissionTrajectory):
        return attach(result, systems, carried)
    every = zip(result.phases, systems.phases, carried.phases, strict=True)
    phases = tuple(attach(t, phase.system, flags.system) for t, phase, flags in every)
    return MissionTrajectory(phases, result.names, result.final, result.end, result.status)


def repeat_batch(trajectory: Trajectory, accuracy: Accuracy) -> State:
    """The final states of all runs of a batch, simulated anew by way of the middle of their
    span."""
    tree = jax.tree.structure(trajectory.system)
    flags = jax.tree.unflatten(tree, [not alone for alone in trajectory.shared or ()])
    ends = trajectory.ts[:, :: max(trajectory.ts.shape[1] - 1, 1)]
    batched, shared = eqx.partition(
        (trajectory.system, trajectory.initial, ends), (flags, True, True)
    )
    return _repeat(batched, shared, accuracy, *_spread((batched, shared), ends.shape[0]))


@jit_wide_vectors
def _repeat(batched: Any, shared: Any, accuracy: Accuracy, block: int, mesh: Mesh | None) -> State:
    def rows(lanes: Any, given: Any) -> State:
        shared, accuracy = given
        system, y0, ts = eqx.combine(lanes, shared)
        return _front(repeat(system, y0, ts, accuracy, 1))

    return by_blocks(rows, batched, ((*side_by_side(shared[:2]), shared[2]), accuracy), block, mesh)
