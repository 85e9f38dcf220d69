"""The runs of a batch, block by block; every result has the axis of runs.

Runs of similar rates share a block."""

import contextlib
import dataclasses
import functools
from collections.abc import Callable, Iterator

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, PyTree

from ..core import AbstractSystem, InputError, State
from ..core.layout import component_axes_of
from ..core.safe import safe_divide
from ..integration.config import IntegrationConfig
from ..integration.events import Event
from ..integration.layout import broadcast_state
from ..solvers.tolerances import Tolerance
from ._mission import Mission
from ._runs import run_system
from .batch_layout import cut_batch, in_blocks
from .blocks import Blocks, Order, jit_wide_vectors
from .checks import check_events
from .failures import mask_mission
from .mission_result import MissionTrajectory, Result
from .mission_runs import run_mission
from .repeat import Configs
from .trajectory import Trajectory

# Quotient of the fastest rate and the slowest up to which the runs of a batch are not sorted.
UNIFORM = 1.05
# Part of the time in which a state changes by itself, over which the change of its rate is seen.
AHEAD = 0.01


@jit_wide_vectors
def run_systems(
    batched: PyTree,
    shared: PyTree,
    config: IntegrationConfig,
    events: tuple[Event, ...],
    blocks: Blocks,
    dense: bool,
) -> Trajectory:
    """The runs of a system, block by block; `batched` carries runs, `shared` is for all of them."""

    def run(
        system: AbstractSystem, y0: State, ts: Array, configs: Configs, *events: Event
    ) -> Trajectory:
        # Checked here, where a condition first gets states with the axis of runs.
        shapes = _checked_runs(system, y0, ts[0], blocks.size)
        check_events(events, system, shapes, ts[0], 1)
        return _every_run(run_system(system, y0, ts, events, configs[0], 1, dense))

    order = _order_of(batched, shared, config, blocks)
    return in_blocks(run, batched, shared, (config,), blocks, events, order)


@jit_wide_vectors
def run_missions(
    batched: PyTree,
    shared: PyTree,
    configs: Configs,
    num_saved: int,
    blocks: Blocks,
) -> MissionTrajectory:
    """The runs of a mission, block by block; `batched` carries runs, `shared` is for all of
    them."""

    def run(mission: Mission, y0: State, t0: Array, configs: Configs) -> MissionTrajectory:
        with _shared_arrays_named(mission, blocks.size):
            run = run_mission(mission, y0, t0, num_saved, configs, 1)
        result = mask_mission(run)
        return result.with_phases([_every_run(phase) for phase in result.phases], result.status)

    return in_blocks(run, batched, shared, configs, blocks)


def _checked_runs(system: AbstractSystem, y0: State, t: Array, runs: int) -> PyTree:
    """The shapes of the state, broadcast to the runs of the system. Raises `InputError` if they
    have another number of runs than the block."""
    with _shared_arrays_named(system, runs):
        shapes = eqx.filter_eval_shape(broadcast_state, system, t, y0)
    first, *others = jax.tree.leaves(shapes)
    if all(x.shape[-1:] == (runs,) for x in (first, *others)):
        return shapes
    name = type(system).__name__
    raise InputError(
        f"{name}.vector_field returns {first.shape} for {runs} runs: the batch axis must "
        f'be last, and a batched parameter must be annotated as such (Float[Array, "*#runs"]).'
    )


@contextlib.contextmanager
def _shared_arrays_named(systems: PyTree, runs: int) -> Iterator[None]:
    """In this context, let an error about shapes name the arrays shared by all runs because their
    annotations have no batch axis: one of them was most likely meant to be batched."""
    try:
        yield
    except (TypeError, ValueError) as error:
        leaves = jax.tree_util.tree_flatten_with_path(systems)[0]
        axes = jax.tree.leaves(component_axes_of(systems))
        shared = [
            f"{jax.tree_util.keystr(path).lstrip('.')} of shape {x.shape}"
            for (path, x), declared in zip(leaves, axes, strict=True)
            if declared < 0 and eqx.is_array(x) and x.ndim
        ]
        # Of shapes alone: a traced number in the place of a known one has another reason.
        other = isinstance(error, InputError | jax.errors.JAXTypeError)
        if other or "shape" not in str(error) or not shared:
            raise
        raise InputError(
            f"systems cannot be evaluated for {runs} runs at once: {error} All runs share "
            f"{', '.join(shared)}, because their annotations have no batch axis: annotate a "
            f'batched field as Float[Array, "*#runs"].'
        ) from error


def _every_run(result: Trajectory) -> Trajectory:
    """The result of a block, with an axis of runs for its statistics as well."""
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
    return dataclasses.replace(result, stats=stats, dense=dense)


def _order_of(
    batched: PyTree, shared: PyTree, config: IntegrationConfig, blocks: Blocks
) -> Order | None:
    """The order of the runs by their initial rates, if these differ.

    Runs of similar rates need about as many steps, and a block lasts as long as its longest run.
    `None` where the steps do not depend on the runs."""
    # In a single block, and with fixed steps, the order has no effect.
    runs = jax.tree.leaves(batched)[0].shape[-1]
    if runs == blocks.size or config.method == "closed_form" or config.fixed_step:
        return None
    system, y0, ts = cut_batch(batched, shared)
    rate = _relative_rate(system, y0, ts[0])
    # Negated, so that rates that are NaN count as different.
    differ = ~(jnp.max(rate) <= UNIFORM * jnp.min(rate))
    return jax.lax.cond(differ, _sorted, _unsorted, rate)


def _sorted(rate: Array) -> Order:
    order = jnp.argsort(rate)
    # The second one puts the results back into the order of the caller.
    return Order(order, jnp.argsort(order))


def _unsorted(rate: Array) -> Order:
    order = jnp.arange(rate.size)
    return Order(order, order)


def _relative_rate(system: AbstractSystem, y0: State, t: Array) -> Array:
    """Rate of change of each run: the largest of |y'| / |y| and sqrt(|y''| / |y|) over the blocks
    of its state, 1/s.

    For bodies with equal rotation rates, only the second derivative distinguishes those whose axis
    will change soon."""
    # The order changes no result, and therefore no derivative.
    y = jax.lax.stop_gradient(broadcast_state(system, t, y0))
    length = Tolerance(0.0, 0.0, 1).length

    def largest(rate: State) -> Array:
        sizes = jax.tree.map(lambda k, b: safe_divide(length(k), length(b)), rate, y)
        return functools.reduce(jnp.maximum, jax.tree.leaves(sizes))

    def scaled(h: Array, rate: State) -> State:
        return jax.tree.map(lambda k: h.astype(k.dtype) * k, rate)

    # A loop, so that the program contains the field once; a difference quotient, because not every
    # field is differentiable.
    def after(rate: State, _: None) -> tuple[State, State]:
        ahead = jax.tree.map(jnp.add, y, scaled(safe_divide(AHEAD, largest(rate)), rate))
        rate = jax.tree.map(lambda k, b: k.astype(b.dtype), system.vector_field(t, ahead), y)
        return rate, rate

    _, rates = jax.lax.scan(after, jax.tree.map(jnp.zeros_like, y), length=2)
    first, second = (jax.tree.map(lambda k, i=i: k[i], rates) for i in range(2))
    rate = largest(first)
    change = largest(jax.tree.map(jnp.subtract, second, first))
    return jax.lax.stop_gradient(jnp.maximum(rate, jnp.sqrt(change * rate / AHEAD)))


def again_by(
    run: Callable[[PyTree, Blocks, Configs], Result], batched: PyTree
) -> Callable[[Result, np.ndarray, Configs, int], Result]:
    """The repetition of some runs of a batch, in the form of `rerun_failed`, from the `run` of
    some of them."""

    def again(result: Result, rows: np.ndarray, configs: Configs, block: int) -> Result:
        # Padded to whole blocks, so that fewer shapes are compiled.
        filled = np.concatenate([rows, np.full(-rows.size % block, rows[-1])])
        configs = tuple(config.of_runs(filled) for config in configs)
        part = run(jax.tree.map(lambda x: x[..., filled], batched), Blocks(block, None), configs)
        # Without the copies of the last run that fill the block.
        return jax.tree.map(lambda a, b: a.at[..., rows].set(b[..., : rows.size]), result, part)

    return again
