"""Runs that are repeated because of the way in which they failed: for all verbs.

Steps that ran out: a run of a batch is repeated by the method that suits its own numbers, and after
that with the exact part of its motion in closed form. Fixed steps that missed the tolerance: with
more of them.
"""

import dataclasses
from collections.abc import Callable
from typing import TypeAlias, TypeVar

import numpy as np

from ..core.checks import is_concrete
from ..integration.accuracy import Accuracy
from ..integration.config import IntegrationConfig
from ..integration.mapping import BLOCK
from ..integration.status import Status
from .mission_result import MissionTrajectory
from .trajectory import Trajectory

# One for each phase; a system is one phase.
Configs: TypeAlias = tuple[IntegrationConfig, ...]
Result = TypeVar("Result", bound=Trajectory | MissionTrajectory)


def cured(
    result: Result,
    configs: Configs,
    again: Callable[[Result, np.ndarray, Configs, int], Result],
    configs_for: Callable[[np.ndarray, bool], Configs],
    *,
    exactly: bool = True,
) -> tuple[Result, Configs]:
    """The result with the runs repeated that a repetition may cure, and the configurations of the
    last attempt at all of them. Unchanged where their status is traced.

    **Arguments**

    - `result`, `configs`: of the first attempt.
    - `again(result, rows, configs, block)`: the result with the runs of these numbers repeated, in
      blocks of this size.
    - `configs_for(rows, exact)`: what suits the numbers of these runs; with the exact part of their
      motion in closed form, where there is one, if it shall be `exact`.
    - `exactly`: whether that may be tried."""
    if not is_concrete(result.status):
        return result, configs
    runs = result.status.size
    rows = out_of_steps(result)
    if rows.size and runs > 1:
        other = configs_for(rows, False)
        # The same methods would fail again.
        if [type(c.method) for c in other] != [type(c.method) for c in configs]:
            result = again(result, rows, other, 1)
            rows = out_of_steps(result)
    if rows.size and exactly:
        other = configs_for(rows, True)
        if any(b.decoupled and not a.decoupled for a, b in zip(configs, other, strict=True)):
            result = again(result, rows, other, 1)
            configs = other if rows.size == runs else configs
    # Each number of fixed steps is a separate program: only one more is compiled, for the worst of
    # the runs. One that still misses the tolerance has the status for it.
    error = _error_of_too_few_steps(result, configs)
    rows = np.flatnonzero(error)
    if rows.size:
        configs = tuple(config.with_more_steps(float(np.max(error))) for config in configs)
        result = again(result, rows, configs, BLOCK)
    return result, configs


def exact(accuracy: Accuracy) -> Accuracy:
    """The accuracy that asks for the exact part of the motion in closed form, where the user leaves
    that open."""
    if accuracy.decoupled is not None or accuracy.method != "auto":
        return accuracy
    return dataclasses.replace(accuracy, decoupled=True)


def out_of_steps(result: Trajectory | MissionTrajectory) -> np.ndarray:
    """The numbers of the runs that ran out of steps."""
    # By NumPy, because a comparison of arrays of JAX takes ten times as long.
    return np.flatnonzero(np.asarray(result.status) == Status.MAX_STEPS)


def _error_of_too_few_steps(result: Trajectory | MissionTrajectory, configs: Configs) -> np.ndarray:
    """The largest local error of each run of a system that missed the tolerance by too few fixed
    steps, in units of the tolerance; zero for all other runs."""
    missed = np.asarray(result.status) == Status.TOLERANCE_MISSED
    if isinstance(result, MissionTrajectory) or not configs[0].fixed_step or not np.any(missed):
        return np.zeros(missed.shape)
    error = np.asarray(result.stats["largest_local_error"])
    return np.where(missed & np.isfinite(error), error, 0.0)
