"""Runs that are repeated because of the way in which they failed: for all verbs.

Runs of a batch that reached the maximum number of steps are repeated with the method that suits
their numbers, and after that with the exact part of their motion in closed form. Fixed steps that
missed the tolerance: with more of them.
"""

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from ..core.checks import is_concrete
from ..core.status import Status
from ..integration.config import IntegrationConfig
from ..integration.mapping import BLOCK
from .mission_result import Result, Simulated
from .trajectory import Trajectory

# One for each phase; a system is one phase.
Configs: TypeAlias = tuple[IntegrationConfig, ...]


def rerun_failed(
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
    - `configs_for(rows, exact)`: the settings that suit the numbers of these runs; with the exact
      part of their motion in closed form, where available, if `exact`.
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
    errors = []
    for phase, config in zip(result.phases, configs, strict=True):
        # A closed loop repeats itself.
        chosen = config.fixed_step and phase.control is None
        errors.append(error_of_too_few_steps(phase) if chosen else np.zeros(phase.status.shape))
    rows = np.flatnonzero(np.max(errors, axis=0))
    if rows.size:
        pairs = zip(configs, errors, strict=True)
        configs = tuple(c.with_more_steps(float(np.max(e))) if np.any(e) else c for c, e in pairs)
        result = again(result, rows, configs, BLOCK)
    return result, configs


def out_of_steps(result: Simulated) -> np.ndarray:
    """The numbers of the runs that ran out of steps."""
    # By NumPy, because a comparison of arrays of JAX takes ten times as long.
    return np.flatnonzero(np.asarray(result.status) == Status.MAX_STEPS)


def error_of_too_few_steps(run: Trajectory) -> np.ndarray:
    """The largest local error of each run that missed the tolerance by fixed steps that were too
    few, in units of the tolerance, (*runs,); zero for all other runs."""
    missed = np.asarray(run.status) == Status.TOLERANCE_MISSED
    if not np.any(missed):
        return np.zeros(missed.shape)
    error = np.asarray(run.stats["largest_local_error"])
    return np.where(missed & np.isfinite(error), error, 0.0)
