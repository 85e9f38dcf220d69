"""Choice of effects that may be left out together: proposed by scaled runs, confirmed by a full
one."""

import dataclasses
from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, PyTree

from ..core import State
from ..core.status import Status
from ..integration.accuracy import Accuracy
from ._runs import OutputOfRun, aot_compile, run_once, timed, value_of
from ._scaled_runs import ScaledRuns
from ._scene_effects import Runnable, remove_effects
from .budget_table import EffectBudget


def negligible(table: EffectBudget, runs: ScaledRuns) -> tuple[str, ...]:
    """The effects that may be left out together, from the least influence on."""
    assert table.tolerance is not None
    dropped: tuple[str, ...] = ()
    for row in reversed(table.rows):
        if row.failure or row.influence > table.tolerance:
            continue
        # With those already dropped, because small changes may add up.
        run = runs.run(without=(*dropped, row.effect))
        moved = np.linalg.norm(runs.change(run.value, table.nominal))
        if run.status.good and moved <= table.tolerance:
            dropped = (*dropped, row.effect)
    return dropped


def verified(
    table: EffectBudget,
    runs: ScaledRuns,
    dropped: tuple[str, ...],
    scene: Runnable,
    plain_run: Callable[[Runnable], tuple[np.ndarray, Status, float]],
) -> EffectBudget:
    """The table with the set confirmed by a run with exactly this set, and its savings.

    **Arguments**

    - `table`, `runs`: the rows, and the runs that they come from.
    - `dropped`: effects that may be omitted according to the scaled runs, least influential first.
    - `scene`: with all of its effects.
    - `plain_run`: an ordinary run of a scene: output, status and time, s.

    **Returns** the table, with the largest part of `dropped` that stays within the tolerance."""
    assert table.tolerance is not None
    every = tuple(row.effect for row in table.rows)
    while dropped:
        value, status, seconds_kept = plain_run(remove_effects(scene, dropped))
        change = float(np.linalg.norm(runs.change(value, table.nominal)))
        if status.good and change <= table.tolerance:
            return dataclasses.replace(
                table,
                kept=tuple(name for name in every if name not in dropped),
                dropped=dropped,
                change=change,
                seconds=plain_run(scene)[2],
                seconds_kept=seconds_kept,
            )
        # The last one to be dropped has the largest influence.
        dropped = dropped[:-1]
    return dataclasses.replace(table, kept=every)


def timed_run(
    system: Runnable,
    y0: State,
    ts: Array,
    output: OutputOfRun,
    accuracy: Accuracy,
    repeats: int,
) -> tuple[np.ndarray, Status, float]:
    """Output and status of a plain run, and its median time, s."""
    # Without factors: what is timed is the run as its users would write it.
    arrays, static = eqx.partition((system, y0, ts), eqx.is_array)

    def run(arrays: PyTree[Array], rtol: Array) -> tuple[Array, Array]:
        system, y0, ts = eqx.combine(arrays, static)
        outcome = run_once(system, y0, ts, dataclasses.replace(accuracy, rtol=rtol))
        return value_of(outcome, output), outcome.status

    rtol = jnp.asarray(accuracy.rtol)
    program = aot_compile(run, arrays, rtol)
    (value, status), seconds = timed(program.call, repeats, arrays, rtol)
    return np.asarray(value, float), Status(int(status)), seconds
