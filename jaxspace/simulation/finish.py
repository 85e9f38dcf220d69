"""Results of the verbs from those of runs: with the call, errors for failed runs, and the warnings
of their systems."""

import dataclasses
import warnings
from collections.abc import Callable

import jax.numpy as jnp
from jaxtyping import Array

from ..core.checks import is_concrete
from ..core.status import Status, raise_on_failure
from ..core.tracing import is_traced
from ..integration.accuracy import Accuracy
from ..integration.config import IntegrationConfig
from ._mission import Mission
from .failures import raise_if_failed
from .legs import legs_of
from .mission_result import MissionTrajectory, Result
from .run_call import RunCall
from .trajectory import Trajectory


def with_calls(
    result: MissionTrajectory,
    mission: Mission,
    accuracy: Accuracy,
    configs: tuple[IntegrationConfig, ...],
) -> MissionTrajectory:
    """The result with the call of each phase."""
    legs, _ = legs_of(mission)
    phases = []
    for run, leg, config in zip(result.phases, legs, configs, strict=True):
        system = leg.phase.moving
        # Only where it is needed: outside of `jit` the first of the times is a program.
        if leg.phase.counts_from_start:
            system = system.started_at(run.ts[0])
        phases.append(dataclasses.replace(run, call=RunCall(system, accuracy, config)))
    return dataclasses.replace(result, phases=tuple(phases))


def checked(
    result: Result, throw: bool, where: Callable[[], str] | None = None, *, stacklevel: int
) -> Result:
    """The result of a verb, with the warnings of its systems. Raises for a failed run, if `throw`,
    and reports `where`; `stacklevel` is that of the verb."""
    if throw:
        result = raise_failures(result, where)
    return warn_after(result, stacklevel + 1)


def raise_failures(result: Result, where: Callable[[], str] | None = None) -> Result:
    """The result, unless a run in it failed: then `SimulationError`, which reports `where`.

    Under a transformation the error is attached to every array of the result and to its
    derivatives."""
    # Without the system and the configuration: those of a known run are known.
    numbers = [(phase.ts, phase.states) for phase in result.phases]
    traced = is_traced((result.status, numbers))
    if is_concrete(result.status):
        # Also where the rest is differentiated eagerly: the place of the failure is then unknown.
        raise_on_failure(result.status, None if traced else where)
    return raise_if_failed(result) if traced else result


def warn_after(result: Result, stacklevel: int) -> Result:
    """The result with the status `BELOW_GROUND` for completed runs of which their system warns
    (`AbstractSystem.warning`), if its numbers are known; the warnings are issued.

    `stacklevel` is that of the caller."""
    phases, every = [], False
    for run in result.phases:
        doubtful = _warned(run, stacklevel + 1)
        phases.append(run if doubtful is None else with_doubts(run, doubtful))
        every = every if doubtful is None else every | doubtful
    if every is False:
        return result
    return with_doubts(result.with_phases(phases, result.status), every)


def _warned(run: Trajectory, stacklevel: int) -> Array | None:
    """Issue the warning of a run; the runs of which it warns, (*runs,), or `None`."""
    # Warnings of a traced system are traced, too.
    if is_traced((run.ts, run.states)):
        return None
    # By its class: the method of an instance is a separate module, slow to create.
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
