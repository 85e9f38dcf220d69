"""From a loop and a state to a run: what is refused, what is known before, one program, and once
more with finer steps where they proved too few."""

from typing import Any, TypeAlias, final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int, PRNGKeyArray, PyTree

from ..core import InputError, State, breaks_of, is_concrete, is_traced
from ..integration._accuracy import (
    DEFAULT_RTOL,
    as_accuracy,
    check_initial_state,
    check_start,
    state_dtype,
)
from ..integration._config import IntegrationConfig, check_tolerance
from ..integration._events import Event
from ..integration._layout import broadcast_state, times_behind_components
from ..integration._status import Status, raise_on_failure
from ..simulation import Trajectory
from ..simulation._batch_layout import cut_batch, local_blocks, split_batch
from ..simulation._blocks import Blocks, jit_wide_vectors
from ..simulation._failures import loud, nan_where_failed
from ..simulation._finish import trajectory_of
from ..simulation._runs import RunResult
from ..solvers import FixedSteps, Tolerance
from ._advance import as_fixed
from ._clocks import Clock, Nodes, at_nodes, known_times, nodes_of
from ._controller import AbstractController
from ._samples import Left, Setting, run_samples
from ._sensors import Keys

# A `ClosedLoop`, whose module imports this one.
Loop: TypeAlias = Any

Flown: TypeAlias = tuple[RunResult, PyTree, PyTree, PyTree]
"""What a flight leaves: the run, commands, readings, and the memory of the controller."""

REPEATS = 3
"""How often a run is repeated with finer steps before its status tells that they are too few."""


@final
class LoopRun(eqx.Module):
    """A run of a loop, or a batch of runs.

    - `trajectory`: times, states and status, as of any run; a run that failed has NaN.
    - `commands`: in force behind each of the times, with the shapes of the states: components lead,
      then times, then runs. The last is that in force at the end.
    - `readings`: of each sensor by name, the last one at each time.
    - `memory`: of the controller, at the end.
    - `steps`: fixed steps between two nodes.
    - `asked`: with what the loop was flown, for `error`."""

    trajectory: Trajectory
    commands: PyTree
    readings: dict[str, PyTree]
    memory: PyTree
    steps: int = eqx.field(static=True)
    asked: PyTree = None

    @property
    def ts(self) -> Array:
        """Save times, s, (times,), or (times, runs) where events have stopped runs."""
        return self.trajectory.ts

    @property
    def states(self) -> State:
        """The states at the save times: a position is (3, times, *runs)."""
        return self.trajectory.states

    @property
    def final(self) -> State:
        """The last state: a position is (3, *runs)."""
        return self.trajectory.final

    @property
    def end(self) -> Array:
        """The last time, s, (*runs,)."""
        return self.trajectory.ts[-1]

    @property
    def status(self) -> Int[Array, "*runs"]:
        """A `Status` for each run."""
        return self.trajectory.status

    @property
    def stats(self) -> dict[str, Array]:
        """Steps, evaluations, largest local error in units of the tolerance."""
        return self.trajectory.stats

    def error(self) -> State:
        """An estimate of the error of the final state: the change by half the steps' length.

        Of the same noise; commands in quanta may switch, and then it tells of them."""
        loop, y0, ts, options, run_axes = self.asked
        key, accuracy, events, start, memory = options
        again = fly(
            *(loop, y0, ts, key, accuracy, 2 * self.steps),
            *(events, start, memory, False, run_axes),
        )
        return jax.tree.map(lambda a, b: jnp.abs(a - b), self.final, again.final)


def fly(
    loop: Loop,
    y0: State,
    ts: Any,
    key: PRNGKeyArray | None,
    accuracy: Any,
    steps: int,
    events: Any,
    start: Any,
    memory: PyTree,
    throw: bool,
    run_axes: int,
) -> LoopRun:
    """`ClosedLoop.simulate` and `simulate_batch`, with `run_axes` axes of runs."""
    _check(loop, y0, run_axes)
    asked = (loop, y0, ts, (key, accuracy, events, start, memory), run_axes)
    ts, events = known_times(ts), _as_events(events)
    dtype = state_dtype(y0)
    wanted = as_accuracy(accuracy)
    rtol = DEFAULT_RTOL.get(dtype.name, 1e-2) if wanted.rtol is None else wanted.rtol
    if is_concrete(rtol):
        check_tolerance(float(np.min(np.asarray(rtol))), dtype)
    rough = float(np.max(np.asarray(rtol))) if is_concrete(rtol) else 1e-9
    method = as_fixed(wanted.method, rough, steps)
    rtol = jnp.asarray(rtol, dtype)
    atol = 1e-3 * rtol if wanted.atol is None else jnp.asarray(wanted.atol, dtype)
    start = jnp.asarray(ts[0] if start is None else start, dtype)
    config = IntegrationConfig(rtol, atol, method, None, wanted.max_steps, None)
    parts = (loop.system, loop.controller, loop.sensors, loop.limit, loop.quantum)
    known = (parts, y0, start, key, memory, events)
    for _ in range(REPEATS + 1):
        run = _program(loop, known, ts, config, run_axes)
        error = _too_few(run)
        if error == 0.0 or is_traced(known):
            break
        config = config.with_more_steps(error)
    run = eqx.tree_at(lambda r: r.asked, run, asked, is_leaf=lambda x: x is None)
    if not throw:
        return run
    if is_concrete(run.status) and not is_traced(run.trajectory):
        raise_on_failure(run.status)
        return run
    return eqx.tree_at(lambda r: r.trajectory, run, loud(run.trajectory))


def _program(
    loop: Loop, known: PyTree, ts: np.ndarray, config: IntegrationConfig, run_axes: int
) -> LoopRun:
    """One flight, as one compiled program for all that has the same shapes."""
    static = (tuple(ts.tolist()), loop.period, loop.hold, loop.delay, loop.actuate, run_axes)
    parts, y0, start, key, memory, events = known
    result, commands, readings, memory = _compiled(
        parts, y0, start, key, memory, events, config, static
    )
    trajectory = trajectory_of(result, loop.system, config, run_axes)
    solver = config.solver
    assert isinstance(solver, FixedSteps)
    return LoopRun(trajectory, commands, readings, memory, solver.steps)


@jit_wide_vectors
def _compiled(
    parts: PyTree,
    y0: State,
    start: Array,
    key: PRNGKeyArray | None,
    memory: PyTree,
    events: tuple[Event, ...],
    config: IntegrationConfig,
    static: tuple,
) -> Flown:
    run_axes = static[-1]
    if key is not None and not jnp.issubdtype(key.dtype, jax.dtypes.prng_key):
        key = jax.random.wrap_key_data(key)  # one of the old style, an array of numbers
    if run_axes == 0:
        return _flight(parts, y0, start, key, memory, events, config, static)
    batched, shared, runs = split_batch(parts, (y0, start, memory), 0.0, None, 0)
    keys = None if key is None else jax.random.split(key, runs)
    blocks = local_blocks((batched, shared), runs)

    def piece(own: PyTree, shared: PyTree) -> PyTree:
        own, keys = own
        parts, (y0, start, memory), _ = cut_batch(own, shared)
        return _flight(parts, y0, start, keys, memory, events, config, static)

    return Blocks.map(blocks, piece, (batched, keys), shared)


def _flight(
    parts: PyTree,
    y0: State,
    start: Array,
    keys: Keys | None,
    memory: PyTree,
    events: tuple[Event, ...],
    config: IntegrationConfig,
    static: tuple,
) -> Flown:
    """The flight of one run, or of one block of runs, and its save times."""
    system, controller, sensors, limit, quantum = parts
    ts, period, hold, delay, actuate, run_axes = static
    periods = tuple(s.period or period for s in (sensors or {}).values())
    waiting = int(np.floor(delay / period + 1e-6))
    late = max(delay - waiting * period, 0.0)
    late = 0.0 if late < 1e-6 * period else late
    clocks = (Clock(period), Clock(period, late), *(Clock(p) for p in periods))
    breaks = breaks_of(system)
    nodes = nodes_of(np.array(ts), clocks, None if breaks is None else breaks - start)
    y0 = broadcast_state(system, jnp.zeros((), start.dtype), y0)
    method = config.solver
    assert isinstance(method, FixedSteps)
    tolerance = Tolerance(config.rtol, config.atol, run_axes)
    setting = Setting(
        system=system,
        controller=controller,
        sensors=sensors,
        limit=limit,
        quantum=quantum,
        events=events,
        tolerance=tolerance,
        method=method,
        actuate=actuate,
        period=period,
        elapsed=periods,
        line=hold == "first",
        waiting=waiting + 1,
        run_axes=run_axes,
    )
    left = run_samples(setting, y0, memory, start, nodes, keys)
    times = start + jnp.asarray(np.array(ts) - ts[0], start.dtype).reshape(-1, *(1,) * start.ndim)
    return _flown(left, nodes, times, len(events), run_axes)


def _flown(left: Left, nodes: Nodes, times: Array, events: int, run_axes: int) -> Flown:
    """What is kept of a flight: rows at the save times, and NaN where it failed."""
    saved = jnp.asarray(nodes.saved)
    # Commands and readings belong to the pass behind a node; the last node has that before it.
    rows = saved.at[-1].add(-1)
    commands, readings = jax.tree.map(
        lambda x: times_behind_components(x, run_axes),
        at_nodes((left.commands, left.readings), rows),
    )
    states = times_behind_components(at_nodes(left.states, saved), run_axes)
    status, number = left.status, left.stop.number
    times = times.reshape(times.shape[0], *(times.shape[1:] or (1,) * run_axes))
    # Blocks of runs are joined along the runs: each has its own times, though they agree.
    times = jnp.broadcast_to(times, (times.shape[0], *status.shape))
    if events:
        times = jnp.where(number >= 0, jnp.minimum(times, left.stop.t), times)
    kinds = jnp.arange(events, dtype=number.dtype).reshape(-1, *(1,) * run_axes)
    stats = {"largest_local_error": left.worst}
    result = RunResult(times, states, status, number, kinds == number, stats, None, None, ())
    factor = jnp.where(status > Status.EVENT, jnp.nan, 1.0)
    commands, readings = jax.tree.map(lambda x: x * factor.astype(x.dtype), (commands, readings))
    return nan_where_failed(result), commands, readings, left.memory


def _too_few(run: LoopRun) -> float:
    """The largest local error of a run that missed the tolerance by too few steps; else zero."""
    if not is_concrete(run.status):
        return 0.0
    missed = np.asarray(run.status) == Status.TOLERANCE_MISSED
    error = np.asarray(run.stats["largest_local_error"])
    error = error[missed & np.isfinite(error)]
    return float(np.max(error)) if error.size else 0.0


def _as_events(events: Any) -> tuple[Event, ...]:
    events = (events,) if isinstance(events, Event) else tuple(events)
    for event in events:
        if not isinstance(event, Event):
            raise InputError(f"events holds {event!r}: it must hold events, Event(...).")
        if event.touch is not None or not event.terminal:
            raise InputError(
                "events holds an event with touch or terminal=False: of a loop it must be one that "
                "ends the run by passing through zero."
            )
    return events


def _check(loop: Loop, y0: State, run_axes: int) -> None:
    """Raise `InputError` for what no loop can be flown with."""
    if not isinstance(loop.controller, AbstractController):
        raise InputError(
            f"ClosedLoop.controller is of type {type(loop.controller).__name__}: it must be a "
            f"controller or a function of what is measured."
        )
    if run_axes:
        state_dtype(y0)
        return
    check_initial_state(y0)
    check_start(y0)
