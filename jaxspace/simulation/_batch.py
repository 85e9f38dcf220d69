"""Many runs by one integration after the other, each of a block of runs. Never a mapped solve."""

import functools
from typing import Any, overload

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float, PyTree

from ..core import AbstractSystem, InputError, Scalar, State, is_concrete, is_traced, safe_divide
from ..integration._accuracy import Accuracy, as_accuracy, state_dtype
from ..integration._config import IntegrationConfig, resolve
from ..integration._events import Event
from ..integration._integrate import broadcast_state
from ..integration._mapping import BLOCK
from ..integration._status import Status
from ..integration._stiffness import InitialConditions
from ..solvers import Tolerance
from ._batch_layout import InAxes, cut_batch, local_blocks, split_batch
from ._blocks import Blocks, jit_wide_vectors
from ._checks import as_events, check_events, check_num_saved, check_structure, check_times
from ._failures import nan_where_failed
from ._mission import Mission
from ._runs import MissionResult, RunResult, run_mission, run_system
from ._simulate import (
    error_of_too_few_steps,
    mission_trajectory_of,
    raise_failures,
    resolve_phases,
    trajectory_of,
)
from ._trajectory import MissionTrajectory, Trajectory

# How many runs of a batch are looked at to choose its method.
SAMPLED = 16
# Quotient of the fastest rate and the slowest up to which the runs of a batch are not sorted.
UNIFORM = 1.25


@overload
def simulate_batch(
    systems: AbstractSystem,
    y0s: State,
    ts: Float[ArrayLike, "times *#runs"],
    *,
    accuracy: Accuracy | Scalar | None = None,
    events: tuple[Event, ...] = (),
    dense: bool = False,
    in_axes: InAxes = None,
    throw: bool = False,
) -> Trajectory: ...


@overload
def simulate_batch(
    systems: Mission,
    y0s: State,
    t0: Float[ArrayLike, "*runs"] = 0.0,
    *,
    accuracy: Accuracy | Scalar | None = None,
    num_saved: int = 2,
    in_axes: InAxes = None,
    throw: bool = False,
) -> MissionTrajectory: ...


def simulate_batch(systems: Any, y0s: State, *args: Any, **kwargs: Any) -> Any:
    """`simulate` for many runs, with the runs on the last axis of every array.

    `simulate_batch(system, y0s, ts, *, accuracy=None, events=(), dense=False, in_axes=None,
    throw=False)` for a system, `simulate_batch(mission, y0s, t0=0.0, *, accuracy=None, num_saved=2,
    in_axes=None, throw=False)` for a mission.

    **Arguments**

    - `systems`, `y0s`: as in `simulate`. Which of their arrays carry runs follows from the declared
      shapes: a field annotated `Float[Array, "3 *#runs"]` carries them if it has two axes. Arrays
      of a system that declare nothing, such as the weights of a network, are shared; arrays of a
      state that declare nothing carry runs.
    - `ts`, `t0`: (times,) or a scalar for all runs; (times, runs) or (runs,) for each.
    - `in_axes`: marks otherwise: a pair of trees for `systems` and `y0s`, as in `jax.vmap`, of -1
      (runs on the last axis) and `None` (shared).
    - `accuracy`, `events`, `dense`, `num_saved`, `throw`: as in `simulate`.

    **Returns** a `Trajectory` or `MissionTrajectory` with the runs last and a `Status` for each. A
    run that fails marks its own row. Outside of `jit`, the runs of a block whose steps ran out are
    repeated alone, and those that fail alone, with "auto", by the method that their own numbers
    call for; runs that missed the tolerance by too few fixed steps are repeated with up to eight
    times as many. All local devices take part, unless the arrays or a transformation say where to
    compute.

    The runs of a block share their adaptive steps: what else stands in the block, a run that fails
    among them, moves a run within its tolerance. With fixed steps or a closed form it does not. The
    same runs in the same blocks give the same numbers to rounding, whatever the number of devices.

    **Raises** `InputError` as `simulate` does, and for arrays that disagree about the number of
    runs."""
    if isinstance(systems, Mission):
        return _batch_of_missions(systems, y0s, *args, **kwargs)
    if not isinstance(systems, AbstractSystem):
        raise InputError(
            f"systems is of type {type(systems).__name__}: it must be a system, a scene or a "
            f"mission."
        )
    return _batch_of_systems(systems, y0s, *args, **kwargs)


def _batch_of_systems(
    systems: AbstractSystem,
    y0s: State,
    ts: Float[ArrayLike, "times *#runs"],
    *,
    accuracy: Accuracy | Scalar | None = None,
    events: tuple[Event, ...] = (),
    dense: bool = False,
    in_axes: InAxes = None,
    throw: bool = False,
) -> Trajectory:
    # A state that is not finite marks its own run: only the precision is checked of all.
    state_dtype(y0s)
    ts = check_times(ts, y0s, axes=2)
    events = as_events(events)
    batched, shared, runs = split_batch(systems, y0s, ts, in_axes, times_axes=1)
    whole = cut_batch(batched, shared)
    check_structure(whole[0], whole[1], jax.ShapeDtypeStruct(ts.shape[1:], ts.dtype))
    config_for = functools.partial(_resolve_for, as_accuracy(accuracy), whole, batched)
    config = config_for(None)
    blocks = local_blocks((batched, shared), runs)
    result = _run_systems(batched, shared, config, events, blocks, dense)
    if is_concrete(result.status) and not is_traced((batched, shared)):
        again = functools.partial(_repeat, batched, shared, events=events, dense=dense)
        result, config = _mend(result, config, config_for, again, runs)
    trajectory = trajectory_of(result, whole[0], config, 1)
    return raise_failures(trajectory) if throw else trajectory


def _batch_of_missions(
    missions: Mission,
    y0s: State,
    t0: Float[ArrayLike, "*runs"] = 0.0,
    *,
    accuracy: Accuracy | Scalar | None = None,
    num_saved: int = 2,
    in_axes: InAxes = None,
    throw: bool = False,
) -> MissionTrajectory:
    state_dtype(y0s)
    check_num_saved(num_saved)
    if jnp.ndim(t0) > 1:
        raise InputError(f"t0 has the shape {jnp.shape(t0)}: each run starts at one time, in s.")
    batched, shared, runs = split_batch(missions, y0s, t0, in_axes, times_axes=0)
    mission, y0, _ = cut_batch(batched, shared)
    configs = resolve_phases(mission, y0, as_accuracy(accuracy), 1)
    blocks = local_blocks((batched, shared), runs)
    result = _run_missions(batched, shared, configs, num_saved, blocks)
    if is_concrete(result.status) and not is_traced((batched, shared)):
        stuck = np.flatnonzero(np.asarray(result.status) == Status.MAX_STEPS)
        if stuck.size and runs > 1:
            rows = jax.tree.map(lambda x: x[..., stuck], batched)
            alone = _run_missions(rows, shared, configs, num_saved, Blocks(1, None))
            result = _put_runs(result, stuck, alone)
    trajectory = mission_trajectory_of(result, mission, configs, 1)
    return raise_failures(trajectory) if throw else trajectory


def _resolve_for(
    accuracy: Accuracy, whole: PyTree, batched: PyTree, rows: np.ndarray | None
) -> IntegrationConfig:
    """The configuration that some of these runs, or of all of them, call for."""
    system, y0, _ = whole
    starts = None
    if not is_traced((whole, accuracy)):
        every = np.arange(jax.tree.leaves(batched)[0].shape[-1])
        rows = every if rows is None else rows
        # The first and the last among them: inputs are often given in order.
        sample = rows[np.linspace(0, rows.size - 1, SAMPLED).astype(int)]
        axes = jax.tree.map(
            lambda x, own: None if x is None else int(own is not None),
            whole,
            batched,
            is_leaf=lambda x: x is None,
        )
        starts = InitialConditions(whole, axes, sample)
    return resolve(system, y0, accuracy, starts)


@jit_wide_vectors
def _run_systems(
    batched: PyTree,
    shared: PyTree,
    config: IntegrationConfig,
    events: tuple[Event, ...],
    blocks: Blocks,
    dense: bool,
) -> RunResult:
    def block(piece: PyTree, given: PyTree) -> RunResult:
        shared, config, events = given
        system, y0, ts = cut_batch(piece, shared)
        check_events(events, system, y0, ts[0], 1)
        check_runs(system, y0, ts[0], blocks.size)
        result = run_system(system, y0, ts, events, config, 1, dense)
        return _every_run(nan_where_failed(result))

    given = (shared, config, events)
    order = _order(batched, shared, config, blocks)
    if order is None:
        return blocks.map(block, batched, given)
    order, differ = order
    done = blocks.map(block, _arranged(batched, order, differ), given)
    back = jax.lax.cond(differ, jnp.argsort, lambda order: order, order)
    return _arranged(done, back, differ)


def check_runs(system: AbstractSystem, y0: State, t: Array, runs: int) -> None:
    """Raise `InputError` if the derivative has another number of runs than the block."""
    shapes = jax.tree.leaves(eqx.filter_eval_shape(broadcast_state, system, t, y0))
    if all(x.shape[-1:] == (runs,) for x in shapes):
        return
    name = type(system).__name__
    raise InputError(
        f"{name}.vector_field returns {shapes[0].shape} for {runs} runs: the runs must be on the "
        f'last axis, and a parameter that carries runs must say so (Float[Array, "*#runs"]).'
    )


@jit_wide_vectors
def _run_missions(
    batched: PyTree,
    shared: PyTree,
    configs: tuple[IntegrationConfig, ...],
    num_saved: int,
    blocks: Blocks,
) -> MissionResult:
    def block(piece: PyTree, given: PyTree) -> MissionResult:
        shared, configs = given
        mission, y0, t0 = cut_batch(piece, shared)
        result = run_mission(mission, y0, t0, num_saved, configs, 1)
        return result._replace(phases=[_every_run(phase) for phase in result.phases])

    return blocks.map(block, batched, (shared, configs))


def _every_run(result: RunResult) -> RunResult:
    """The result of a block with the runs on the last axis of its statistics, too."""
    runs = result.status.shape

    def every(x: Array) -> Array:
        return jnp.broadcast_to(x, runs)

    def times(x: Array) -> Array:
        missing = (1,) * (len(runs) + 1 - x.ndim)
        return jnp.broadcast_to(x.reshape(*x.shape, *missing), (x.shape[0], *runs))

    dense = result.dense
    if dense is not None:
        dense = dense._replace(ts=times(dense.ts))
    stats = {name: every(x) for name, x in result.stats.items()}
    return result._replace(stats=stats, dense=dense, step_ends=None)


def _order(
    batched: PyTree, shared: PyTree, config: IntegrationConfig, blocks: Blocks
) -> tuple[Array, Bool[Array, ""]] | None:
    """The order of the runs by how fast they begin, and whether they differ enough to sort them.

    Runs alike in this need similar steps, and the runs of a block share theirs. `None` where the
    steps do not depend on the runs."""
    # A single block has nothing to sort, and equal steps do not depend on the runs.
    runs = jax.tree.leaves(batched)[0].shape[-1]
    if runs == blocks.size or config.method == "closed_form" or config.fixed_step:
        return None
    system, y0, ts = cut_batch(batched, shared)
    rate = _relative_rate(system, y0, ts[0])
    differ = ~(jnp.max(rate) <= UNIFORM * jnp.min(rate))
    order = jax.lax.cond(differ, jnp.argsort, lambda rate: jnp.arange(rate.size), rate)
    return order, differ


def _relative_rate(system: AbstractSystem, y0: State, t: Array) -> Array:
    """max |dy/dt| / |y| over the blocks of each state, 1/s."""
    y = jax.lax.stop_gradient(broadcast_state(system, t, y0))
    length = Tolerance(0.0, 0.0, 1).length
    rates = jax.tree.map(
        lambda k, b: safe_divide(length(k), length(b)), system.vector_field(t, y), y
    )
    return jax.lax.stop_gradient(functools.reduce(jnp.maximum, jax.tree.leaves(rates)))


def _arranged(tree: PyTree, order: Array, differ: Array) -> PyTree:
    """The runs in this order if they differ.

    To sort and to gather runs of one rate costs as much as a few steps of each."""
    return jax.lax.cond(
        differ, lambda tree: jax.tree.map(lambda x: x[..., order], tree), lambda tree: tree, tree
    )


def _put_runs(result: PyTree, rows: np.ndarray, part: PyTree) -> PyTree:
    """The result with some of its runs replaced."""
    return jax.tree.map(lambda a, b: a.at[..., rows].set(b), result, part)


def _repeat(
    batched: PyTree,
    shared: PyTree,
    rows: np.ndarray,
    config: IntegrationConfig,
    block: int,
    *,
    events: tuple[Event, ...],
    dense: bool,
) -> RunResult:
    """Some of the runs once more."""
    filled = np.concatenate([rows, np.full(-rows.size % block, rows[-1])])
    part = jax.tree.map(lambda x: x[..., filled], batched)
    again = _run_systems(part, shared, config, events, Blocks(block, None), dense)
    return jax.tree.map(lambda x: x[..., : rows.size], again)


def _mend(
    result: RunResult, config: IntegrationConfig, config_for: Any, again: Any, runs: int
) -> tuple[RunResult, IntegrationConfig]:
    """The result with runs repeated that failed for a reason that repetition can cure.

    Runs whose block ran out of steps: each alone, then by the method that their own numbers call
    for. Runs that missed the tolerance by too few fixed steps: with more of them."""

    def stuck(result: RunResult) -> np.ndarray:
        return np.flatnonzero(np.asarray(result.status) == Status.MAX_STEPS)

    # A block shares its steps, so that one slow run can use up those of all.
    rows = stuck(result)
    if rows.size and runs > 1:
        result = _put_runs(result, rows, again(rows, config, 1))
        rows = stuck(result)
        other = config_for(rows) if rows.size else config
        if type(other.method) is not type(config.method):
            result = _put_runs(result, rows, again(rows, other, 1))
    # Each number of fixed steps is a program of its own: one more, for the worst of the runs.
    error = error_of_too_few_steps(result, config)
    missed = np.flatnonzero(error)
    if missed.size:
        config = config.with_more_steps(float(np.max(error)))
        result = _put_runs(result, missed, again(missed, config, BLOCK))
    return result, config
