"""The loop over samples as one scan: read, decide, command, integrate to the next node.

Every iteration is the same program, whatever the length of the run. Reverse mode stores only the
states between the iterations, and recomputes each iteration.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, PyTree

from ..core import Scalar, State
from ..core.barrier import barrier
from ..core.status import Status
from ._advance import advance, select
from ._clocks import Nodes
from ._controller import act_on, started
from ._crossing import Stop, crossed, not_stopped
from ._loop_parts import LoopParts
from ._sensors import Keys, drawing
from .commands import ZeroOrderHold, clipped, rounded

CONTROL, ARRIVAL = 0, 1
"""The numbers of the first two clocks; those of the sensors follow."""


class LoopState(NamedTuple):
    """Carry of the scan from one iteration to the next.

    - `drifts`, `readings`: of the sensors by name; `counts`: number of readings of each.
    - `queue`: delayed commands; `command`: the one in force; `slope`: its rate, or `None`; `fresh`:
      whether none has arrived yet.
    - `worst`: the largest local error in units of the tolerance; `bad`: whether a command was not
      finite; `stop`: the event that ended the run."""

    y: State
    memory: PyTree
    drifts: dict[str, PyTree]
    readings: dict[str, PyTree]
    counts: dict[str, Array]
    queue: tuple[PyTree, ...]
    command: PyTree
    slope: PyTree
    fresh: Array
    worst: Array
    bad: Array
    stop: Stop


class SampledRun(NamedTuple):
    """A run of a loop, with the nodes first in `states`, `commands` and `readings`."""

    states: State
    commands: PyTree
    readings: dict[str, PyTree]
    memory: PyTree
    final: State
    status: Array
    worst: Array
    stop: Stop


def run_samples(
    parts: LoopParts,
    y0: State,
    memory: PyTree,
    start: Scalar,
    nodes: Nodes,
    keys: Keys | None,
) -> SampledRun:
    """Run a loop from the state `y0` at the time `start`, s.

    **Arguments**

    - `memory`: that of the controller; `None` starts it.
    - `nodes`: from `nodes_of`, counted from the start.
    - `keys`: of the noise: one key, or one of each run."""
    dtype = jnp.result_type(*jax.tree.leaves(y0))
    times = jnp.asarray(nodes.times, dtype)
    ticks = jnp.asarray(nodes.ticks)
    start = jnp.asarray(start, dtype)
    spans = times[1:] - times[:-1]
    first = _first(parts, y0, memory, start, keys)

    def one(state: LoopState, at: tuple[Array, Array, Array]) -> tuple[LoopState, tuple]:
        since, span, ticks = at
        return _iteration(parts, state, start + since, span, ticks, nodes.at_every_node, keys)

    xs = (times[:-1], spans, ticks)
    # Checkpointed, so that reverse mode stores one state for each iteration, and not every stage.
    last, rows = jax.lax.scan(jax.checkpoint(one), first, xs)
    states = jax.tree.map(lambda a, b: jnp.concatenate([a[None], b]), first.y, rows[0])
    alive = parts.tolerance.alive(last.y)
    status = jnp.where(last.stop.number >= 0, Status.EVENT, Status.COMPLETED)
    # An event with a longest time was promised: to end without it is a failure.
    expected = any(event.within is not None for event in parts.events)
    if expected:
        status = jnp.where(last.stop.number >= 0, status, Status.EVENT_MISSED)
    status = jnp.where(last.stop.bad, Status.CONDITION_NOT_FINITE, status)
    status = jnp.where(last.worst > 1.0, Status.TOLERANCE_MISSED, status)
    status = jnp.where(alive, status, Status.NOT_FINITE)
    # Last, because it explains the others: a command that is not finite makes the state so.
    status = jnp.where(last.bad, Status.COMMAND_NOT_FINITE, status).astype(jnp.int32)
    return SampledRun(states, rows[1], rows[2], last.memory, last.y, status, last.worst, last.stop)


def _first(parts: LoopParts, y0: State, memory: PyTree, t: Array, keys: Keys | None) -> LoopState:
    """The carry before the first iteration: no readings, and a command of zeros."""
    runs = parts.tolerance.alive(y0)
    sensors = parts.sensors or {}
    drifts = {name: s.drift(t, y0) for name, s in sensors.items()}
    counts = {name: jnp.zeros((), jnp.int32) for name in sensors}
    numbers = {name: k for k, name in enumerate(sensors)}

    def read(y: State) -> dict[str, PyTree]:
        return {n: _read(parts, n, numbers[n], t, y, drifts, counts, keys)[0] for n in sensors}

    shapes = jax.eval_shape(read, y0)
    readings = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), shapes)
    seen = readings if parts.sensors else y0
    if memory is None:
        memory = started(parts.controller, seen, parts.run_axes)

    def decide(memory: PyTree, seen: PyTree) -> PyTree:
        return act_on(parts.controller, t, memory, seen, parts.run_axes)

    # Only the shapes, because the controller must not act before its first sample.
    asked, _ = jax.eval_shape(decide, memory, seen)
    dtype = jnp.result_type(*jax.tree.leaves(y0))
    idle = jax.tree.map(lambda u: jnp.zeros(u.shape, dtype), asked)
    slope = idle if parts.line else None
    # Until the first command arrives after the delay, the actuators are off.
    queue = (idle,) * parts.waiting
    worst = jnp.zeros(runs.shape, dtype)
    stop = not_stopped(parts.events, t, y0, runs)
    never = jnp.zeros(runs.shape, bool)
    return LoopState(
        y=y0,
        memory=memory,
        drifts=drifts,
        readings=readings,
        counts=counts,
        queue=queue,
        command=idle,
        slope=slope,
        fresh=jnp.array(True),
        worst=worst,
        bad=never,
        stop=stop,
    )


def _read(
    parts: LoopParts,
    name: str,
    number: int,
    t: Array,
    y: State,
    drifts: dict[str, PyTree],
    counts: dict[str, Array],
    keys: Keys | None,
) -> tuple[PyTree, PyTree]:
    assert parts.sensors is not None
    draw = drawing(keys, number, counts[name], parts.run_axes, name)
    elapsed = parts.elapsed[number]
    return parts.sensors[name].read(t, y, drifts[name], elapsed, draw)


def _iteration(
    parts: LoopParts,
    p: LoopState,
    t: Array,
    span: Array,
    ticks: Array,
    at_every_node: tuple[bool, ...],
    keys: Keys | None,
) -> tuple[LoopState, tuple]:
    """One iteration: readings and commands at the node at `t`, and the motion over `span`, s, after
    it."""
    p = _sensed(parts, p, t, ticks, at_every_node, keys)
    p = _decided(parts, p, t, ticks[CONTROL], at_every_node[CONTROL])
    p = _arrived(parts, p, ticks[ARRIVAL], at_every_node[ARRIVAL])
    # Behind a barrier: otherwise the compiler repeats the whole controller in every stage.
    p = barrier(p)
    held = ZeroOrderHold(parts.system, parts.actuate, p.command, p.slope, t, parts.limit)
    y1, error = barrier(advance(held, p.y, t, span, parts.method))
    # Without derivatives, because no result depends on it, and they would cost more than the step.
    local = parts.tolerance.error(*jax.lax.stop_gradient((p.y, y1, error)))
    still = (p.stop.number >= 0) | p.bad
    stop = p.stop
    if parts.events:
        y1, stop = crossed(parts, held, p.stop, still, t, span, p.y, y1)
    y1 = select(still, p.y, y1)
    worst = jnp.where(still, p.worst, jnp.maximum(p.worst, local))
    p = p._replace(y=y1, worst=worst, stop=stop)
    return p, (y1, p.command, p.readings)


def _sensed(
    parts: LoopParts,
    p: LoopState,
    t: Array,
    ticks: Array,
    at_every_node: tuple[bool, ...],
    keys: Keys | None,
) -> LoopState:
    readings = dict(p.readings)
    drifts = dict(p.drifts)
    counts = dict(p.counts)
    for number, name in enumerate(parts.sensors or {}):
        tick = ticks[2 + number]
        new = _read(parts, name, number, t, p.y, p.drifts, p.counts, keys)
        if not at_every_node[2 + number]:
            new = select(tick, new, (p.readings[name], p.drifts[name]))
        readings[name], drifts[name] = new
        # Runs with different breaks read at different nodes; they share one count, which
        # only has to differ from one reading to the next.
        counts[name] = p.counts[name] + jnp.any(tick).astype(jnp.int32)
    return p._replace(readings=readings, drifts=drifts, counts=counts)


def _decided(
    parts: LoopParts, p: LoopState, t: Array, tick: Array, at_every_node: bool
) -> LoopState:
    """The carry after the controller has acted, where its clock ticks."""

    def act(p: LoopState) -> LoopState:
        seen = p.readings if parts.sensors else p.y
        asked, memory = act_on(parts.controller, t, p.memory, seen, parts.run_axes)
        asked = jax.tree.map(lambda u, old: u.astype(old.dtype), asked, p.command)
        finite = parts.tolerance.alive(asked)
        # Where the command is not finite it is zero, so that sums over a batch stay finite.
        asked = select(finite, asked, jax.tree.map(jnp.zeros_like, asked))
        # Before rounding, because a quantum is no limit: an integral has to work against it.
        cut = clipped(asked, parts.limit)
        memory = parts.controller.settle(memory, asked, cut)
        applied = rounded(cut, parts.quantum)
        running = (p.stop.number < 0) & ~p.bad
        queue = (*p.queue[1:], applied)
        return p._replace(memory=memory, queue=queue, bad=p.bad | (running & ~finite))

    if at_every_node:
        return act(p)
    # All runs share the clock, so that the controller costs nothing where it does not tick.
    if tick.ndim == 0:
        return jax.lax.cond(tick, act, lambda p: p, p)
    acted = act(p)
    names = ("memory", "queue", "bad")
    return p._replace(**{n: select(tick, getattr(acted, n), getattr(p, n)) for n in names})


def _arrived(parts: LoopParts, p: LoopState, tick: Array, at_every_node: bool) -> LoopState:
    """The carry after the arrival of a command at the actuators, where the clock of arrivals
    ticks."""
    command, slope = p.queue[0], p.slope
    if parts.line:
        # The first command has no predecessor, and thus no slope.
        share = jnp.where(p.fresh, 0.0, 1.0 / parts.period)
        slope = jax.tree.map(lambda u, old: share.astype(u.dtype) * (u - old), command, p.command)
    if not at_every_node:
        command, slope = select(tick, (command, slope), (p.command, p.slope))
    return p._replace(command=command, slope=slope, fresh=p.fresh & ~jnp.any(tick))
