"""Runs of a closed loop: checks of the arguments, the program, and its repetition with finer
steps."""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple, final

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float, PRNGKeyArray, PyTree

from ..core import InputError, Scalar, State
from ..integration.accuracy import Accuracy, as_accuracy
from ..integration.events import Event
from ..integration.initial_state import InitialState
from ..simulation import Trajectory
from ..simulation.finish import raise_failures
from ..simulation.reading import AbstractRun
from ..simulation.run_call import RunCall
from ..simulation.trajectory import run_of
from ._clocks import known_times
from ._controller import AbstractController
from ._program import LoopInputs, Static, as_events, as_key, compiled
from ._repeats import config_of, repeated, steps_of
from ._sampled_loop import AbstractSampledLoop


class LoopOptions(NamedTuple):
    """Options of one simulation of a loop, as given to `ClosedLoop.simulate`."""

    key: PRNGKeyArray | None
    accuracy: Accuracy | Float[ArrayLike, ""] | None
    steps: int | None
    events: Event | Sequence[Event]
    start: Scalar | None
    memory: PyTree


class LoopRequest(NamedTuple):
    """The arguments of a run."""

    loop: AbstractSampledLoop
    y0: State
    ts: PyTree
    options: LoopOptions
    run_axes: int


@final
class LoopRun(AbstractRun):
    """A run of a loop, or a batch of runs.

    Reads and prints as a `Trajectory`: `ts`, `states`, `initial`, `final`, `status`, `event`,
    `stats`, `accuracy`, `len(run)`, `run[k]`, `along`, `to_xarray`, `plot` and `show`.

    - `trajectory`: times, states and status, as of any run; a run that failed has NaN.
    - `steps`: fixed steps between two nodes.
    - `request`: the arguments of the run, for `error`."""

    trajectory: Trajectory
    steps: int = eqx.field(static=True)
    request: LoopRequest

    @property
    def commands(self) -> PyTree:
        """The commands in force after each of the times: components first, then times, batch axis
        last. The last one is that at the end."""
        return self._control["commands"]

    @property
    def readings(self) -> dict[str, PyTree]:
        """The readings of each sensor by name, the last one at each time."""
        return self._control["readings"]

    @property
    def memory(self) -> PyTree:
        """The memory of the controller at the end."""
        return self._control["memory"]

    @property
    def _control(self) -> dict[str, PyTree]:
        assert self.trajectory.control is not None
        return self.trajectory.control

    @property
    def end(self) -> Array:
        """The last time, s, (*runs,)."""
        return self.trajectory.ts[-1]

    def of(self, i: int) -> "LoopRun":
        """The i-th run of a batch, as a run of one loop, with the noise that it had.

        Raises `InputError` if this is one run already, and for a number that no run has."""
        trajectory = self.trajectory.of(i)
        loop, y0, ts, options, _ = self.request
        key = as_key(loop.key if options.key is None else options.key)
        if key is not None:
            # As the batch has split it, so that the run repeats its noise.
            key = jax.random.split(key, self.status.shape[-1])[i]
        loop = run_of(dataclasses.replace(loop, key=None), i)
        y0, start, memory = run_of((y0, options.start, options.memory), i, 1)
        options = options._replace(key=key, start=start, memory=memory)
        return LoopRun(trajectory, self.steps, LoopRequest(loop, y0, ts, options, 0))

    def error(self) -> State:
        """Estimate of the error of the final state: its change with steps of half the length.

        The noise is the same; a command that is rounded to quanta may switch, which then adds to
        the change."""
        loop, y0, ts, options, run_axes = self.request
        finer = options._replace(steps=2 * self.steps)
        # Without raising: where the finer run fails, the error is NaN.
        again = run_loop(loop, y0, ts, finer, run_axes, throw=False)
        return jax.tree.map(lambda a, b: jnp.abs(a - b), self.final, again.final)

    def facts(self) -> list[tuple[str, ...]]:
        loop = self.request.loop
        law = type(loop.controller).__name__
        return [("control", f"{law}, a sample every {loop.period:.6g} s, {loop.hold}-order hold")]


def run_loop(
    loop: AbstractSampledLoop,
    y0: State,
    ts: ArrayLike | Sequence[float],
    options: LoopOptions,
    run_axes: int,
    *,
    throw: bool,
) -> LoopRun:
    """`ClosedLoop.simulate` and `simulate_batch`, with `run_axes` axes of runs."""
    y0, dtype = _checked(loop, y0, run_axes)
    request = LoopRequest(loop, y0, ts, options, run_axes)
    times = known_times(ts)
    events = as_events(options.events)
    accuracy = as_accuracy(options.accuracy)
    config = config_of(loop, y0, accuracy, options.steps)
    start = times[0] if options.start is None else options.start
    start = jnp.asarray(start, dtype)
    key = as_key(loop.key if options.key is None else options.key)
    numbers = LoopInputs(loop.numbers, y0, start, key, options.memory, events, None)
    # Fixed steps have no control of their error: the run is repeated until its largest one passes.
    result, config = repeated(compiled, numbers, config, Static.of(loop, times, run_axes))
    trajectory = dataclasses.replace(result, call=RunCall(loop.system, accuracy, config))
    if throw:
        trajectory = raise_failures(trajectory)
    return LoopRun(trajectory, steps_of(config), request)


def _checked(loop: AbstractSampledLoop, y0: PyTree, run_axes: int) -> InitialState:
    """The initial state. Raises `InputError` for arguments with which no loop can run."""
    if not isinstance(loop.controller, AbstractController):
        raise InputError(
            f"ClosedLoop.controller is of type {type(loop.controller).__name__}: it must be a "
            "controller or a function of the measurements."
        )
    return InitialState.of(y0, batch=run_axes > 0)
