"""The verb: from a system and an initial state to a trajectory whose accuracy is accounted for."""

import functools
from typing import Any, TypeVar, overload

import equinox as eqx
import jax
from jaxtyping import ArrayLike, Float, PyTree

from ..core import AbstractSystem, InputError, Scalar, is_concrete
from ..integration._accuracy import (
    Accuracy,
    as_accuracy,
    check_initial_state,
    check_start,
    without_weak_types,
)
from ..integration._config import IntegrationConfig, resolve
from ..integration._events import Event
from ..integration._exact_part import with_exact_part
from ..integration._status import Status
from ..integration._stiffness import InitialConditions
from ._after_run import warn_after
from ._checks import (
    as_events,
    as_times,
    check_arguments,
    check_dense,
    check_events,
    check_num_saved,
    check_structure,
    check_times,
    check_values,
)
from ._failures import nan_where_failed, place_of_failure
from ._finish import finish, mission_trajectory_of, raise_failures, with_exact_parts
from ._mission import Mission
from ._mission_runs import run_mission
from ._mission_trajectory import MissionTrajectory
from ._phases import resolve_phases
from ._runs import run_system
from ._switches import warn_of_switches
from ._trajectory import Trajectory

Result = TypeVar("Result", Trajectory, MissionTrajectory)


@overload
def simulate(
    system: AbstractSystem,
    y0: PyTree,
    ts: Float[ArrayLike, " times"],
    *,
    accuracy: Accuracy | Scalar | None = None,
    events: tuple[Event, ...] = (),
    dense: bool = False,
    throw: bool = True,
) -> Trajectory: ...


@overload
def simulate(
    system: Mission,
    y0: PyTree,
    t0: Scalar = 0.0,
    *,
    accuracy: Accuracy | Scalar | None = None,
    num_saved: int = 2,
    throw: bool = True,
) -> MissionTrajectory: ...


def simulate(system: Any, y0: PyTree, *args: Any, **kwargs: Any) -> Any:
    """Run a system or a mission from the state `y0`.

    `simulate(system, y0, ts, *, accuracy=None, events=(), dense=False, throw=True)` for a system,
    `simulate(mission, y0, t0=0.0, *, accuracy=None, num_saved=2, throw=True)` for a mission.

    **Arguments**

    - `system`: any `AbstractSystem`, such as a `Scene`; or a `Mission`.
    - `y0`: the initial state.
    - `ts`: save times of a system, s. The first is that of `y0`; descending times run backwards.
    - `t0`: the time at which a mission starts, s.
    - `accuracy`: the relative tolerance of each step, or an `Accuracy`; 1e-9 by default.
    - `events`: the run of a system stops at the first zero of one of these; of those with
      `terminal=False` every zero is collected (`Trajectory.crossings`), and after their jumps, if
      they have some, the run goes on. The phases of a mission
      bring their own.
    - `dense`: whether to keep the steps, for states between the save times (`Trajectory.at`).
    - `num_saved`: how many states each phase of a mission saves, from its start to its end.
    - `throw`: whether to raise `SimulationError` for a failed run; otherwise read its `status`.

    **Returns** a `Trajectory`, or a `MissionTrajectory`. Differentiable, forwards and backwards,
    with respect to every number in `system` and `y0`, and the times of the start and the end.
    Outside of `jit`, fixed steps of a system that prove too few are repeated with up to eight times
    as many, and a run whose steps run out once more with what turns by itself in closed form
    (`Accuracy.decoupled`). Mapped by `jax.vmap`, the runs go by the batch path of `simulate_batch`.
    Outside of `jit` it warns of what the system finds in its run, as a path below the ground
    (`Scene.warning`).

    **Raises** `InputError`, before anything is compiled, for times that are not finite, ascending
    or descending, a tolerance that the precision cannot reach, a method that the system does not
    serve, and an initial state that is not finite, of mixed precision or of another structure than
    its derivative. `SimulationError` for a run that failed; under `jit`, where the program runs."""
    if isinstance(system, Mission):
        check_arguments(_simulate_mission, system, y0, *args, **kwargs)
        return _simulate_mission(system, y0, *args, **kwargs)
    if not isinstance(system, AbstractSystem):
        raise InputError(
            f"system is of type {type(system).__name__}: it must be a system, a scene or a mission."
        )
    check_arguments(_simulate_system, system, y0, *args, **kwargs)
    return _simulate_system(system, y0, *args, **kwargs)


def _simulate_system(
    system: AbstractSystem,
    y0: PyTree,
    ts: Any,
    *,
    accuracy: Any = None,
    events: Any = (),
    dense: bool = False,
    throw: bool = True,
) -> Trajectory:
    check_initial_state(y0)
    check_start(y0)
    y0 = without_weak_types(y0)
    # Everything that can be refused is refused here, before anything is compiled.
    ts = check_times(ts, y0)
    start = jax.ShapeDtypeStruct((), ts.dtype)
    check_structure(system, y0, start, one_run=True)
    check_values(system, ts, y0)
    events = as_events(events)
    check_events(events, system, y0, start, 0)
    # The level of the call of `simulate`, from here.
    warn_of_switches(system, events, y0, start, stacklevel=3)
    check_dense(dense, events)
    given = as_accuracy(accuracy)
    starts = functools.partial(InitialConditions.of_one, system, y0, ts)

    def config_by(accuracy: Accuracy) -> IntegrationConfig:
        # Restarts are for mapped runs; where one that fails is an error for all, none goes on.
        return resolve(system, y0, accuracy, starts, restarts=not throw)

    config = config_by(with_exact_part(given, system, y0, ts))
    run = functools.partial(_run_system, system, y0, ts, events, run_axes=0)
    trajectory = finish(run, system, config, given, config_by, dense, throw)
    warn_after(trajectory, stacklevel=3)
    return trajectory


def _simulate_mission(
    mission: Mission,
    y0: PyTree,
    t0: Any = 0.0,
    *,
    accuracy: Any = None,
    num_saved: int = 2,
    throw: bool = True,
) -> MissionTrajectory:
    check_initial_state(y0)
    check_start(y0)
    y0 = without_weak_types(y0)
    t0 = as_times("t0", t0, y0, "one time, s")
    if t0.ndim != 0:
        raise InputError(f"t0 has the shape {t0.shape}: a mission starts at one time, in s.")
    check_num_saved(num_saved)
    given = as_accuracy(accuracy)
    configs = resolve_phases(mission, y0, given)
    result = run_mission(mission, y0, t0, num_saved, configs, 0)
    if is_concrete(result.status) and int(result.status) == Status.MAX_STEPS:
        exactly = with_exact_parts(given, configs, lambda more: resolve_phases(mission, y0, more))
        if exactly is not None:
            configs = exactly
            result = run_mission(mission, y0, t0, num_saved, configs, 0)
    # Where it is known that no run failed, there is nothing to do, and nothing to compile.
    if not is_concrete(result.status) or int(result.status) > Status.EVENT:
        result = _failed_are_nan(result)
    trajectory = mission_trajectory_of(result, mission, given, configs, 0)
    warn_after(trajectory, stacklevel=3)
    return raise_failures(trajectory, lambda: _failed_phase(trajectory)) if throw else trajectory


def _failed_phase(result: MissionTrajectory) -> str:
    """In which phase a mission failed, and where that began, as a sentence."""
    for name, phase in result.items():
        if int(phase.status) > Status.EVENT:
            # A mission keeps no steps: the start of the phase is what is known.
            start = place_of_failure(int(phase.status), None, float(phase.ts[0]), phase.initial)
            return start.replace("The run", f"The phase {name!r}")
    return ""


# Compiled, because each of its many operations would be a call of its own.
_failed_are_nan = eqx.filter_jit(nan_where_failed)
_run_system = eqx.filter_jit(run_system)
