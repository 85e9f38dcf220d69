"""`simulate`: the trajectory of a system from its initial state, with error estimates."""

import contextlib
import dataclasses
import functools
from collections.abc import Callable, Sequence

import jax
from jaxtyping import ArrayLike, Float, PyTree, Real

from ..core import AbstractSystem, InputError
from ..core.captured import captured_as_leaves
from ..core.status import Status
from ..core.tracing import is_traced
from ..integration.accuracy import Accuracy, as_accuracy, check_tolerances
from ..integration.config import resolve
from ..integration.events import Event
from ..integration.exact_part import exact, with_exact_part
from ..integration.initial_state import InitialState
from ..integration.result import DenseOutput
from ..integration.stiffness import InitialConditions
from ._final_error import FinalError
from ._mission import check_system
from ._runs import run_one_system
from ._to_final_error import to_final_error
from .checks import (
    as_events,
    check_dense,
    check_run,
    check_times,
    hints_of_arguments,
)
from .failures import cause_of_leaving, cause_of_nan, enough_steps, place_of_failure
from .finish import checked
from .repeat import Configs, rerun_failed
from .run_call import RunCall
from .trajectory import Trajectory


@hints_of_arguments
def simulate(
    system: AbstractSystem,
    y0: PyTree,
    ts: Real[ArrayLike, " times"] | Sequence[Real[ArrayLike, ""]],
    *,
    accuracy: Accuracy | FinalError | Float[ArrayLike, ""] | None = None,
    events: Sequence[Event] = (),
    dense: bool = False,
    throw: bool = True,
) -> Trajectory:
    """Simulate a system from the state `y0`; use `simulate_mission` for a mission.

    **Arguments**

    - `system`: any `AbstractSystem`, such as a `Scene`.
    - `y0`: the initial state.
    - `ts`: save times, s. The first is that of `y0`; descending times run backwards.
    - `accuracy`: the relative tolerance of each step, 1e-9 by default; an `Accuracy`; or a
      requested final error, a `FinalError`.
    - `events`: the run stops at the first zero of any of these. At the zeros of an event with
      `terminal=False` it continues, after the jump if the event has one, and every zero is returned
      (`Trajectory.crossings`).
    - `dense`: whether to save the steps, for states between the save times (`Trajectory.at`).
    - `throw`: whether to raise `SimulationError` for a failed run; otherwise read its `status`.

    **Returns** a `Trajectory`. It is differentiable, in forward and in reverse mode, with respect
    to every number in `system` and `y0`, and to the start and end times. Under `jax.vmap` the runs
    are integrated as by `simulate_batch`.

    Outside of `jit` a run is repeated in two cases: with up to eight times as many steps if fixed
    steps missed the tolerance, and with the exact part of its motion in closed form
    (`Accuracy.decoupled`) if it reached the maximum number of steps. Also outside of `jit`, it
    issues the warnings of the system about its run, such as a path below the surface
    (`Scene.warning`).

    **Raises** `InputError`, before anything is compiled, for times that are not finite or not
    monotonic; a tolerance that the precision cannot reach; a method that the system does not
    support; an initial state that is not finite, has mixed precision or differs in structure from
    its derivative; and a mission. `SimulationError` for a failed run; under `jit`, when the
    compiled program runs."""
    check_system("system", system, "simulate_mission")
    events = as_events(events)
    if isinstance(accuracy, FinalError):
        options = {"events": events, "dense": dense}
        return to_final_error(simulate, (system, y0, ts), accuracy, throw, options)
    system = captured_as_leaves(system)
    events = captured_as_leaves(events)
    # All input checks are done here, before anything is compiled.
    y0, dtype = InitialState.of(y0)
    ts = check_times(ts, dtype)
    given = as_accuracy(accuracy)
    check_tolerances(given, None)
    # Once for all that reads numbers, because to look through the arrays takes time.
    traced = is_traced((system, y0, ts, given))
    check_run(system, y0, ts, events, run_axes=0, traced=traced, stacklevel=3)
    check_dense(dense, events)
    # A function, because most choices of a method need no numbers, whose reading takes time.
    starts = None if traced else functools.partial(InitialConditions.of_one, system, y0, ts)

    def configs_for(rows: object, exactly: bool) -> Configs:
        accuracy = exact(given) if exactly else with_exact_part(given, system, y0, ts)
        return (resolve(system, y0, accuracy, starts),)

    def run(configs: Configs, dense: bool = dense) -> Trajectory:
        return run_one_system(system, y0, ts, events, configs[0], 0, dense)

    configs = configs_for(None, False)
    result, configs = rerun_failed(run(configs), configs, lambda *a: run(a[2]), configs_for)
    result = dataclasses.replace(result, call=RunCall(system, given, configs[0]))
    return checked(result, throw, lambda: _place(result, run), stacklevel=3)


def _place(result: Trajectory, run: Callable[..., Trajectory]) -> str:
    """Location of the failure of a run; computed by repeating `run` with its steps, for failed runs
    only."""
    status, steps = int(result.status), None
    # A closed form takes none, and there may be no memory for those of another method.
    if result.config.method != "closed_form":
        with contextlib.suppress(InputError):
            steps = run((result.config,), dense=True).dense
    t0, t1 = float(result.ts[0]), float(result.ts[-1])
    place = place_of_failure(status, steps, t0, result.initial)
    if status == Status.OUTSIDE_MODEL:
        return f"{_left_by(result, steps)} {place}".strip()
    if status == Status.NOT_FINITE and steps is not None:
        return f"{place} {cause_of_nan(result.system, steps)}".strip()
    if status != Status.MAX_STEPS or steps is None:
        return place
    return f"{place} {enough_steps(steps, t0, t1, result.config.max_steps)}"


def _left_by(result: Trajectory, steps: DenseOutput | None) -> str:
    """What left the range of validity of the model, as a message."""
    if steps is not None:
        return cause_of_leaving(result.system, steps.ts, steps.states)
    closed_form = result.system.closed_form()
    if closed_form is None:
        return ""
    # The states of a failed run are NaN; its closed form has them.
    after = result.ts - result.ts[0]
    states = jax.vmap(lambda t: closed_form.flow(t, result.initial), 0, -1)(after)
    cause = cause_of_leaving(result.system, result.ts, states)
    reason = closed_form.range_of_validity
    return cause or (f"{reason}." if reason else "")
