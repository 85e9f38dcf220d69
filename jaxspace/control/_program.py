"""A run of a closed loop as one program."""

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, PyTree

from ..core import AbstractSystem, InputError, State
from ..core.shapes import with_rank
from ..core.status import Status
from ..core.tables import breaks_of
from ..core.tracing import count_operations
from ..integration.config import IntegrationConfig
from ..integration.events import Event
from ..integration.layout import broadcast_state, times_behind_components
from ..integration.programs import Runs, rolls_stages
from ..simulation.batch_layout import cut_batch, local_blocks, split_batch
from ..simulation.blocks import jit_wide_vectors
from ..simulation.masking import mask_invalid
from ..simulation.trajectory import Trajectory
from ..solvers import FixedSteps
from ..solvers.protocol import rolled_stages
from ..solvers.tolerances import Tolerance
from ._clocks import SLACK, Clock, Nodes, at_nodes, nodes_of, stopped_at
from ._loop_parts import LoopParts
from ._sampled_loop import AbstractSampledLoop
from ._samples import SampledRun, run_samples
from .commands import Actuate


class LoopInputs(NamedTuple):
    """The numbers of a run.

    - `parts`: of the loop: system, controller, sensors, limit and quantum.
    - `y0`, `start`: the state, and its time, s.
    - `key`: of the noise, or one of each run; `memory`: of the controller.
    - `events`: each ends the run; `end`: so does this time from its start, s, if it is given."""

    parts: PyTree
    y0: State
    start: Array
    key: Array | None
    memory: PyTree
    events: tuple[Event, ...]
    end: Array | None


class Static(NamedTuple):
    """The static part of a program: save times, s, clocks, and how a command acts."""

    ts: tuple[float, ...]
    period: float
    line: bool
    delay: float
    actuate: Actuate
    run_axes: int

    @classmethod
    def of(cls, loop: AbstractSampledLoop, ts: np.ndarray, run_axes: int) -> "Static":
        """The static part of a loop with these save times."""
        line = loop.hold == "first"
        return cls(tuple(ts.tolist()), loop.period, line, loop.delay, loop.actuate, run_axes)


def as_key(key: Array | None) -> Array | None:
    """A key, or one of each run; one of the old style is an array of numbers."""
    if key is None or jnp.issubdtype(key.dtype, jax.dtypes.prng_key):
        return key
    return jax.random.wrap_key_data(key)


def as_events(events: PyTree) -> tuple[Event, ...]:
    """The events that may end a loop. Raises `InputError` for others."""
    events = (events,) if isinstance(events, Event) else tuple(events)
    for event in events:
        if not isinstance(event, Event):
            raise InputError(f"events contains {event!r}: it must contain events, Event(...).")
        if event.touch is not None or not event.terminal:
            raise InputError(
                "events contains an event with touch or terminal=False: in a closed loop every "
                "event must end the run at a zero crossing."
            )
    return events


@jit_wide_vectors
def compiled(inputs: LoopInputs, config: IntegrationConfig, static: Static) -> Trajectory:
    """One run, or a batch in blocks; each run has noise from its own key."""
    if static.run_axes == 0:
        return _run(inputs, config, static)
    given = (inputs.y0, inputs.start, inputs.memory)
    batched, shared, runs = split_batch(inputs.parts, given, 0.0, None, 0)
    # Before the runs are cut into blocks, so that the noise of a run does not depend on their size.
    keys = None if inputs.key is None else jax.random.split(inputs.key, runs)
    blocks = local_blocks((batched, shared), runs)

    def piece(mapped: PyTree, shared: PyTree) -> Trajectory:
        mapped, keys = mapped
        parts, (y0, start, memory), _ = cut_batch(mapped, shared)
        block = inputs._replace(parts=parts, y0=y0, start=start, key=keys, memory=memory)
        return _run(block, config, static)

    return blocks.map(piece, (batched, keys), shared)


@jit_wide_vectors
def alone(inputs: LoopInputs, config: IntegrationConfig, static: Static) -> Trajectory:
    """One run, or one block of runs that are cut already, with a key for each."""
    return _run(inputs, config, static)


def _run(inputs: LoopInputs, config: IntegrationConfig, static: Static) -> Trajectory:
    system, controller, sensors, limit, quantum = inputs.parts
    start, end, run_axes = inputs.start, inputs.end, static.run_axes
    ts = np.array(static.ts)
    periods = tuple(s.period or static.period for s in (sensors or {}).values())
    waiting, clocks = _clocks_of(static, periods)
    nodes = _nodes_of(system, start, ts, clocks)
    if end is not None:
        nodes = stopped_at(nodes, end, SLACK * min(clock.period for clock in clocks))
    y0 = broadcast_state(system, jnp.zeros((), start.dtype), inputs.y0)
    method = _method_of(config, system, start, y0, run_axes)
    parts = LoopParts(
        system=system,
        controller=controller,
        sensors=sensors,
        limit=limit,
        quantum=quantum,
        events=inputs.events,
        tolerance=Tolerance(config.rtol, config.atol, run_axes),
        method=method,
        actuate=static.actuate,
        period=static.period,
        elapsed=periods,
        line=static.line,
        waiting=waiting + 1,
        run_axes=run_axes,
    )
    sampled = run_samples(parts, y0, inputs.memory, start, nodes, inputs.key)
    times = start + jnp.asarray(ts - ts[0], start.dtype).reshape(-1, *(1,) * start.ndim)
    if end is not None:
        times = jnp.minimum(times, start + end)
        # A phase longer than its samples was not run to its end.
        over = end > (ts[-1] - ts[0]) * (1.0 + SLACK)
        sampled = sampled._replace(status=jnp.where(over, Status.MAX_STEPS, sampled.status))
    passes = len(nodes.times) - 1
    stats = {
        "largest_local_error": sampled.worst,
        "steps": jnp.full(sampled.status.shape, passes * method.steps),
        "evaluations": jnp.full(sampled.status.shape, passes * method.traits.evaluations),
    }
    return _result(sampled, nodes, times, stats, len(inputs.events), run_axes)


def _clocks_of(static: Static, periods: tuple[float, ...]) -> tuple[int, tuple[Clock, ...]]:
    """The delay of a command in whole periods; and the clocks of the samples, of the commands
    delayed by the remainder, and of the sensors with these `periods`, s."""
    period = static.period
    waiting = int(np.floor(static.delay / period + SLACK))
    late = max(static.delay - waiting * period, 0.0)
    # A delay of whole periods needs no second clock; its quotient may be off by a rounding.
    late = 0.0 if late < SLACK * period else late
    return waiting, (Clock(period), Clock(period, late), *(Clock(p) for p in periods))


def _nodes_of(
    system: AbstractSystem, start: Array, ts: np.ndarray, clocks: tuple[Clock, ...]
) -> Nodes:
    """The times at which steps end, s since the `start`: saved ones, those of the clocks, and the
    breaks of the system."""
    breaks = breaks_of(system)
    if breaks is not None:
        # In a phase every run may start at another time.
        breaks = with_rank(breaks, start.ndim) - start
    nodes = nodes_of(ts, clocks, breaks)
    shortest, farthest = min(clock.period for clock in clocks), float(np.max(np.abs(ts)))
    apart = float(jnp.finfo(start.dtype).eps) * farthest
    if apart > shortest:
        raise InputError(
            f"ts reaches {farthest:.6g} s, where numbers of this precision are {apart:.3g} s "
            f"apart, more than a period of {shortest:.6g} s: use a time origin close to the run."
        )
    return nodes


def _method_of(
    config: IntegrationConfig, system: AbstractSystem, start: Array, y0: State, run_axes: int
) -> FixedSteps:
    """The method of the steps between nodes, with rolled stages where that pays."""
    method = config.solver
    # A loop contains a step in three places.
    kind = Runs.CLOSED_LOOPS if run_axes else Runs.ONE_CLOSED_LOOP
    if rolls_stages(kind, _operations(system, start, y0)):
        method = rolled_stages(method)
    assert isinstance(method, FixedSteps)
    return method


def _operations(system: AbstractSystem, t: Array, y: State) -> int:
    """Number of operations in one evaluation of the vector field."""
    return count_operations(jax.make_jaxpr(lambda y: system.vector_field(t, y))(y).jaxpr)


def _result(
    sampled: SampledRun,
    nodes: Nodes,
    times: Array,
    stats: dict[str, Array],
    events: int,
    run_axes: int,
) -> Trajectory:
    """The rows of a run at the save times; NaN where it failed."""
    saved = jnp.asarray(nodes.saved)
    # Commands and readings belong to the pass after a node; the last node has those of the pass
    # before.
    rows = saved.at[-1].add(-1)
    commands, readings = jax.tree.map(
        lambda x: times_behind_components(x, run_axes),
        at_nodes((sampled.commands, sampled.readings), rows),
    )
    states = times_behind_components(at_nodes(sampled.states, saved), run_axes)
    status, number = sampled.status, sampled.stop.number
    times = times.reshape(times.shape[0], *(times.shape[1:] or (1,) * run_axes))
    # Blocks are joined along the runs, so that each run has the times, although they agree.
    times = jnp.broadcast_to(times, (times.shape[0], *status.shape))
    if events:
        times = jnp.where(number >= 0, jnp.minimum(times, sampled.stop.t), times)
    kinds = jnp.arange(events, dtype=number.dtype).reshape(-1, *(1,) * run_axes)
    result = Trajectory(times, states, status, number, kinds == number, stats, run_axes)
    # As a factor, and not a selection, so that the derivative of a failed run is NaN, too.
    factor = jnp.where(status > Status.EVENT, jnp.nan, 1.0)
    commands, readings = jax.tree.map(lambda x: x * factor.astype(x.dtype), (commands, readings))
    control = {"commands": commands, "readings": readings, "memory": sampled.memory}
    return dataclasses.replace(mask_invalid(result), control=control)
