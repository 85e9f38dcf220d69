"""From a loop and a state to a run: what is refused, what is known before, and the program once
more with finer steps where they proved too few."""

from collections.abc import Sequence
from typing import Any, NamedTuple, TypeAlias, final

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float, Int, PRNGKeyArray, PyTree

from ..core import InputError, Scalar, State, is_concrete, is_traced
from ..integration.accuracy import (
    Accuracy,
    as_accuracy,
    check_initial_state,
    check_start,
    state_dtype,
)
from ..integration.events import Event
from ..integration.status import raise_on_failure
from ..simulation import Trajectory
from ..simulation.failures import loud
from ..simulation.finish import trajectory_of
from ._clocks import known_times
from ._controller import AbstractController
from ._program import Known, Static, as_events, as_key, compiled, parts_of
from ._repeats import config_of, repeated, steps_of

# A `ClosedLoop`, whose module imports this one.
Loop: TypeAlias = Any


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

        Of the same noise; commands in quanta may switch, and then it shows that."""
        loop, y0, ts, options, run_axes = self.asked
        again = fly(loop, y0, ts, options._replace(steps=2 * self.steps), run_axes, throw=False)
        return jax.tree.map(lambda a, b: jnp.abs(a - b), self.final, again.final)


class LoopOptions(NamedTuple):
    """Options of one simulation of a loop, as given to `ClosedLoop.simulate`."""

    key: PRNGKeyArray | None
    accuracy: Accuracy | Float[ArrayLike, ""] | None
    steps: int | None
    events: Event | Sequence[Event]
    start: Scalar | None
    memory: PyTree


def fly(
    loop: Loop,
    y0: State,
    ts: ArrayLike | Sequence[float],
    options: LoopOptions,
    run_axes: int,
    *,
    throw: bool,
) -> LoopRun:
    """`ClosedLoop.simulate` and `simulate_batch`, with `run_axes` axes of runs."""
    _check(loop, y0, run_axes)
    asked = (loop, y0, ts, options, run_axes)
    times, events = known_times(ts), as_events(options.events)
    accuracy = as_accuracy(options.accuracy)
    config = config_of(loop, y0, accuracy, options.steps)
    start = times[0] if options.start is None else options.start
    start = jnp.asarray(start, state_dtype(y0))
    key = as_key(loop.key if options.key is None else options.key)
    numbers = Known(parts_of(loop), y0, start, key, options.memory, events, None)
    result, config = repeated(compiled, numbers, config, Static.of(loop, times, run_axes))
    assert result.control is not None
    trajectory = trajectory_of(
        result._replace(control=None), loop.system, accuracy, config, run_axes
    )
    run = LoopRun(trajectory, **result.control, steps=steps_of(config), asked=asked)
    if not throw:
        return run
    if is_concrete(run.status) and not is_traced(run.trajectory):
        raise_on_failure(run.status)
        return run
    return eqx.tree_at(lambda r: r.trajectory, run, loud(run.trajectory))


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
