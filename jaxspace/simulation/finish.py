"""Trajectories from the results of runs: with a repetition where the steps were too few, errors for
failed runs, and the warnings of their systems."""

import dataclasses
import warnings
from collections.abc import Callable
from typing import TypeVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..core import AbstractSystem, InputError
from ..core.checks import is_concrete
from ..core.tracing import is_traced
from ..integration.accuracy import Accuracy
from ..integration.config import IntegrationConfig
from ..integration.result import DenseOutput
from ..integration.status import Status, raise_on_failure
from ._mission import Mission
from .failures import enough_steps, loud, place_of_failure
from .legs import legs_of
from .mission_result import MissionTrajectory
from .trajectory import RunCall, Trajectory

Result = TypeVar("Result", bound=Trajectory | MissionTrajectory)


def with_calls(
    result: MissionTrajectory,
    mission: Mission,
    accuracy: Accuracy,
    configs: tuple[IntegrationConfig, ...],
) -> MissionTrajectory:
    """The result with what was run in each phase."""
    legs, _ = legs_of(mission)
    phases = [
        dataclasses.replace(run, call=RunCall(leg.phase.moving, accuracy, config))
        for run, leg, config in zip(result.phases, legs, configs, strict=True)
    ]
    return dataclasses.replace(result, phases=tuple(phases))


def finish(
    run: Callable[..., Trajectory],
    system: AbstractSystem,
    config: IntegrationConfig,
    accuracy: Accuracy,
    config_by: Callable[[Accuracy], IntegrationConfig],
    dense: bool,
    throw: bool,
) -> Trajectory:
    """The trajectory of `run`; repeated if the first attempt failed for a reason that a repetition
    can cure. Raises for a failure, if `throw`.

    **Arguments**

    - `run`: integrates with a configuration. `system`, `dense`, `throw`: as in `simulate`.
    - `config`: of the first attempt.
    - `accuracy`, `config_by`: the accuracy of the user, and the configuration for an accuracy."""
    result = run(config=config, dense=dense)
    if is_concrete(result.status):
        # By NumPy, because `int` of an array of JAX takes ten times as long.
        if np.asarray(result.status) == Status.MAX_STEPS:
            exactly = with_exact_parts(accuracy, (config,), lambda more: (config_by(more),))
            if exactly is not None:
                (config,) = exactly
                result = run(config=config, dense=dense)
        error = error_of_too_few_steps(result, config) if config.fixed_step else 0.0
        # Once only: a run that still misses the tolerance has the status for it.
        if np.any(error):
            config = config.with_more_steps(float(np.max(error)))
            result = run(config=config, dense=dense)
    trajectory = dataclasses.replace(result, call=RunCall(system, accuracy, config))
    if not throw:
        return trajectory

    # Integrated again, because only a failed run needs its steps.
    def where() -> str:
        steps = _steps_of(run, config)
        status = int(trajectory.status)
        t0, t1 = float(trajectory.ts[0]), float(trajectory.ts[-1])
        place = place_of_failure(status, steps, t0, trajectory.initial)
        if status != Status.MAX_STEPS or steps is None:
            return place
        return f"{place} {enough_steps(steps, t0, t1, config.max_steps)}"

    return raise_failures(trajectory, where)


def _steps_of(run: Callable[..., Trajectory], config: IntegrationConfig) -> DenseOutput | None:
    """The steps of a run; `None` for a closed form, and where there is no memory for them."""
    if config.method == "closed_form":
        return None
    try:
        return run(config=config, dense=True).dense
    except InputError:
        return None


def with_exact_parts(
    accuracy: Accuracy,
    configs: tuple[IntegrationConfig, ...],
    configs_by: Callable[[Accuracy], tuple[IntegrationConfig, ...]],
) -> tuple[IntegrationConfig, ...] | None:
    """The configurations for another attempt after the steps ran out, with the exact part of the
    motion in closed form; `None` where there is no such part, or `Accuracy.decoupled` is given.

    **Arguments**

    - `accuracy`: that of the user.
    - `configs`: of the first attempt, of each phase.
    - `configs_by`: the configurations for an accuracy."""
    if accuracy.decoupled is not None or accuracy.method != "auto":
        return None
    others = configs_by(dataclasses.replace(accuracy, decoupled=True))
    pairs = zip(configs, others, strict=True)
    return others if any(b.decoupled and not a.decoupled for a, b in pairs) else None


def raise_failures(result: Result, where: Callable[[], str] | None = None) -> Result:
    """The result, unless a run in it failed: then `SimulationError`, which says `where`.

    Under a transformation the error is attached to every array of the result and to its
    derivatives."""
    # Without the system and the configuration: those of a known run are known.
    numbers = (result.ts, result.states) if isinstance(result, Trajectory) else result.phases
    traced = is_traced((result.status, numbers))
    if is_concrete(result.status):
        # Also where the rest is differentiated eagerly: the place of the failure is then unknown.
        raise_on_failure(result.status, None if traced else where)
    return loud(result) if traced else result


def warn_after(result: Result, stacklevel: int) -> Result:
    """The result with the status `BELOW_GROUND` for completed runs of which their system warns
    (`AbstractSystem.warning`), if its numbers are known; the warnings are issued.

    `stacklevel` is that of the caller."""
    if not isinstance(result, MissionTrajectory):
        doubtful = _warned(result, stacklevel + 1)
        return result if doubtful is None else with_doubts(result, doubtful)
    phases, every = [], False
    for run in result.phases:
        doubtful = _warned(run, stacklevel + 1)
        phases.append(run if doubtful is None else with_doubts(run, doubtful))
        every = every if doubtful is None else every | doubtful
    if every is False:
        return result
    return with_doubts(dataclasses.replace(result, phases=tuple(phases)), every)


def _warned(run: Trajectory, stacklevel: int) -> Array | None:
    """Issue the warning of a run; the runs of which it warns, (*runs,), or `None`."""
    # Those of a traced system are traced, too.
    if is_traced((run.ts, run.states)):
        return None
    # By its class: the method of an instance is a module of its own, slow to make.
    warning = type(run.system).warning(run.system, run.ts, run.states, run.undisturbed)
    if warning is None:
        return None
    warnings.warn(warning.words, stacklevel=stacklevel + 1)
    return jnp.asarray(warning.runs)


def with_doubts(result: Result, doubtful: Array) -> Result:
    """The result with the status of completed runs that are `doubtful`."""
    doubtful = doubtful & (result.status == Status.COMPLETED)
    status = jnp.where(doubtful, Status.BELOW_GROUND, result.status).astype(jnp.int32)
    return dataclasses.replace(result, status=status)


def error_of_too_few_steps(result: Trajectory, config: IntegrationConfig) -> np.ndarray:
    """The largest local error of each run that missed the tolerance by too few fixed steps.

    In units of the tolerance; zero for all other runs."""
    missed = np.asarray(result.status) == Status.TOLERANCE_MISSED
    if not config.fixed_step or not np.any(missed):
        return np.zeros(missed.shape)
    error = np.asarray(result.stats["largest_local_error"])
    return np.where(missed & np.isfinite(error), error, 0.0)
