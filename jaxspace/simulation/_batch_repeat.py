"""Repetition of runs of a batch whose failure a repetition can cure."""

from collections.abc import Callable

import jax
import numpy as np
from jaxtyping import PyTree

from ..integration.accuracy import Accuracy
from ..integration.config import IntegrationConfig
from ..integration.events import Event
from ..integration.mapping import BLOCK
from ..integration.status import Status
from ._batch_runs import run_missions, run_systems
from .blocks import Blocks
from .finish import error_of_too_few_steps, with_exact_parts
from .mission_result import MissionResult
from .run_result import RunResult


def repeat_systems(
    result: RunResult,
    batched: PyTree,
    shared: PyTree,
    config: IntegrationConfig,
    config_for: Callable[..., IntegrationConfig],
    events: tuple[Event, ...],
    dense: bool,
) -> tuple[RunResult, IntegrationConfig]:
    """The result with failed runs of a system repeated, and the configuration of the last attempt.

    Runs whose block ran out of steps are repeated one by one, then by the method that suits their
    numbers, then with the exact part of their motion in closed form. Runs that missed the tolerance
    because of too few fixed steps are repeated with more of them.

    **Arguments**

    - `result`, `config`: the first attempt.
    - `batched`, `shared`: the parts that carry runs, and those that all runs share.
    - `config_for`: the configuration for the runs with these numbers; with `True`, the one with the
      exact part of their motion in closed form.
    - `events`, `dense`: as in `simulate_batch`.

    **Returns** the result and its configuration."""

    def again(
        result: RunResult, rows: np.ndarray, config: IntegrationConfig, block: int
    ) -> RunResult:
        # Padded to whole blocks, so that fewer shapes are compiled.
        filled = np.concatenate([rows, np.full(-rows.size % block, rows[-1])])
        part = run_systems(
            _runs_at(batched, filled), shared, config, events, Blocks(block, None), dense
        )
        part = jax.tree.map(lambda x: x[..., : rows.size], part)
        return _with_runs_at(result, rows, part)

    # The runs of a block share their steps, so that one slow run can use them up for all.
    rows = _out_of_steps(result)
    if rows.size and result.status.size > 1:
        result = again(result, rows, config, 1)
        rows = _out_of_steps(result)
        other = config_for(rows) if rows.size else config
        # The same method would fail again.
        if type(other.method) is not type(config.method):
            result = again(result, rows, other, 1)
            rows = _out_of_steps(result)
    # Steps recorded then are those of the rest alone, which cannot be combined with those of whole
    # runs.
    if rows.size and not dense:
        other = config_for(rows, True)
        if other.decoupled and not config.decoupled:
            result = again(result, rows, other, 1)
    # Each number of fixed steps is a separate program: only one more is compiled, for the worst of
    # the runs.
    error = error_of_too_few_steps(result, config)
    missed = np.flatnonzero(error)
    if missed.size:
        config = config.with_more_steps(float(np.max(error)))
        result = again(result, missed, config, BLOCK)
    return result, config


def repeat_missions(
    result: MissionResult,
    batched: PyTree,
    shared: PyTree,
    accuracy: Accuracy,
    configs: tuple[IntegrationConfig, ...],
    configs_by: Callable[[Accuracy], tuple[IntegrationConfig, ...]],
    num_saved: int,
) -> MissionResult:
    """The result with those missions repeated whose block ran out of steps: one by one, then with
    the exact parts of their motion in closed form.

    **Arguments**

    - `result`, `configs`: the first attempt.
    - `batched`, `shared`: the parts that carry runs, and those that all runs share.
    - `num_saved`: number of states that each phase saves.
    - `accuracy`, `configs_by`: the accuracy of the user, and the configurations for an accuracy."""

    def again(result: MissionResult, configs: tuple[IntegrationConfig, ...]) -> MissionResult:
        alone = run_missions(_runs_at(batched, rows), shared, configs, num_saved, Blocks(1, None))
        return _with_runs_at(result, rows, alone)

    rows = _out_of_steps(result)
    if rows.size and result.status.size > 1:
        result = again(result, configs)
        rows = _out_of_steps(result)
    exactly = with_exact_parts(accuracy, configs, configs_by) if rows.size else None
    return result if exactly is None else again(result, exactly)


def _out_of_steps(result: RunResult | MissionResult) -> np.ndarray:
    return np.flatnonzero(np.asarray(result.status) == Status.MAX_STEPS)


def _runs_at(batched: PyTree, rows: np.ndarray) -> PyTree:
    """Some of the runs."""
    return jax.tree.map(lambda x: x[..., rows], batched)


def _with_runs_at(result: PyTree, rows: np.ndarray, part: PyTree) -> PyTree:
    """The result with some of its runs replaced."""
    return jax.tree.map(lambda a, b: a.at[..., rows].set(b), result, part)
