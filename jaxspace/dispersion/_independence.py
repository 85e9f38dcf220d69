"""The check that the outputs of a run depend on that run only.

The nominal run and the first runs of a campaign are computed, and then their outputs twice: with
each run among the others, and with copies of it in place of all."""

import dataclasses
import functools
import inspect
from collections.abc import Callable, Mapping
from typing import NamedTuple, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PyTree

from ..core import InputError
from ..core.jit import compiled, jit_quickly
from ..core.status import SimulationError, Status
from ..integration.accuracy import Accuracy
from ..simulation.mission_result import MissionTrajectory
from ..simulation.trajectory import Trajectory
from ._campaign import Campaign
from ._interface import OutputFunction, jit_of_campaign
from ._isolation import isolate
from ._outputs import outputs_of, raised
from ._program import Drawn
from ._runs import run_inputs

CHECKED = 15
"""Number of runs besides the nominal one: enough to see one among others."""
# Relative change allowed in a row when other rows are replaced: the runs of a block share some
# iterations, whose last digits then change.
ROUNDING = {"float64": 1e-9}
COARSE = 1e-4
# Which of the first runs: concrete numbers, or those of a trace.
Rows: TypeAlias = Int[Array, " runs"] | Int[np.ndarray, " runs"]


class FirstRuns(NamedTuple):
    """The nominal run and the first runs of a campaign, on which the outputs are checked."""

    result: MissionTrajectory
    samples: dict[str, Float[Array, " runs"]]


def check_outputs(
    campaign: Campaign, accuracy: Accuracy, draw: Callable[[np.ndarray], Drawn]
) -> None:
    """Check that the outputs of a run depend on that run only (`check_apart`).

    `draw(used)` are the inputs of the first runs, of which those `used` raise no error. No mission
    runs where the outputs are those of the library."""
    if outputs_to_check(campaign.outputs) is None:
        return

    def runs(used: np.ndarray) -> FirstRuns:
        result = _first_runs(campaign, accuracy, draw(used).used)
        return jax.tree.map(lambda x: np.asarray(x) if eqx.is_array(x) else x, result)

    check_apart(campaign.outputs, campaign.num_saved, isolate(runs, CHECKED))


@functools.partial(jit_of_campaign, jit=jit_quickly)
def _first_runs(
    campaign: Campaign, accuracy: Accuracy, drawn: dict[str, Float[Array, " runs"]]
) -> FirstRuns:
    """The nominal run, and then the first runs of those drawn."""
    nominal = campaign.nominal()
    samples = {name: jnp.concatenate([x, drawn[name][:CHECKED]]) for name, x in nominal.items()}
    # Few runs, whose program takes far longer to compile than to run.
    result, _ = run_inputs(campaign, accuracy, samples, 2, rolled=True)
    return FirstRuns(result, samples)


def outputs_to_check(function: OutputFunction) -> OutputFunction | None:
    """The outputs of a campaign that other functions than those of the library compute, which are
    tested to treat each run by itself; `None` where there are none.

    Outputs may declare this with `to_check`."""
    outputs = getattr(function, "to_check", function)
    module = outputs.__module__ if inspect.isfunction(outputs) else ""
    return None if module.partition(".")[0] == __name__.partition(".")[0] else outputs


def check_apart(function: OutputFunction, num_saved: int, first: FirstRuns) -> None:
    """Check that the outputs of a run, of `num_saved` states of each phase, depend on that run
    only.

    The outputs of the `first` runs are computed again with copies of one run in place of all: each
    row must equal that of the run among the others. Outputs of the library are exempt
    (`outputs_to_check`).

    **Raises** `InputError` for an output that depends on other runs, or on the place of a run among
    them; `SimulationError` where an output of the nominal run raises an error."""
    unknown = outputs_to_check(function)
    if unknown is None:
        return
    count = len(next(iter(first.samples.values())))
    status = np.broadcast_to(first.result.status, (count,))

    def compute(used: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        # A run that raises an error is computed with the nominal inputs.
        rows = np.where(used, np.arange(count), 0)
        return rows, _numbers(_at(unknown, num_saved, first, rows))

    try:
        rows, among = isolate(compute, count)
    except SimulationError as error:
        nominal = compiled(_taken)(first, np.zeros(count, int), num_saved)
        raise raised("The nominal run", unknown, *nominal, error) from error
    used = (rows == np.arange(count)) & (status <= Status.EVENT)
    # Two runs: the greatest of all runs, as an output, equals that of one of them.
    for row in [*(np.flatnonzero(used[1:])[:1] + 1).tolist(), 0]:
        alone = _numbers(_at(unknown, num_saved, first, np.full(count, row)))
        for name, x in alone.items():
            here = among[name][row].item()
            other = ~_same(x, here, among[name])
            if other.any():
                place = row if other[row] else int(np.flatnonzero(other)[0])
                _refuse(name, row, here, x[place].item(), place == row)


def _refuse(name: str, row: int, here: float, other: float, alone: bool) -> None:
    # The first row is the nominal run, the next one is run 0.
    run = f"run {row - 1}" if row else "the nominal run"
    where = "alone" if alone else "at another position in a block"
    raise InputError(
        f"The output {name!r} mixes runs: {run} gives {here:.9g} among other runs and {other:.9g} "
        f"{where}. It must be computed for each run separately: the last axis is the batch axis, "
        "over which nothing may be summed, averaged, sorted or counted."
    )


def _same(x: np.ndarray, here: float, among: np.ndarray) -> np.ndarray:
    """Whether numbers equal those of a row, within rounding."""
    share = ROUNDING.get(jnp.result_type(float).name, COARSE)
    finite = np.abs(among[np.isfinite(among)])
    # Near zero the error is relative to the other runs, because the output may be a difference.
    size = max(abs(here), np.median(finite).item() if finite.size else 0.0)
    with np.errstate(invalid="ignore"):
        near = np.abs(x - here) <= share * size
    return near | (x == here) | (np.isnan(x) & np.isnan(here))


def _numbers(outputs: Mapping[str, Array]) -> dict[str, np.ndarray]:
    return {name: np.asarray(x).astype(float) for name, x in outputs.items()}


@jit_quickly
def _at(
    function: OutputFunction,
    num_saved: int,
    first: FirstRuns,
    rows: Rows,
) -> dict[str, Array]:
    """The outputs of the runs of these rows."""
    return outputs_of(function, *_taken(first, rows, num_saved))


def _taken(first: FirstRuns, rows: Rows, num_saved: int) -> FirstRuns:
    """The runs of these rows, with `num_saved` states of each phase."""
    count = rows.shape[0]

    def taken(x: PyTree) -> PyTree:
        # The runs are last; shared arrays have no such axis.
        return x[..., rows] if eqx.is_array(x) and x.shape[-1:] == (count,) else x

    phases = tuple(_filled(phase, num_saved) for phase in first.result.phases)
    result = dataclasses.replace(first.result, phases=phases)
    return jax.tree.map(taken, first._replace(result=result))


def _filled(phase: Trajectory, num_saved: int) -> Trajectory:
    """A phase with `num_saved` states, on a straight line from its start to its end.

    This is not the motion, but has the same shapes, which is enough to see which runs an output
    reads."""
    share = np.linspace(0.0, 1.0, num_saved)[:, None]

    def line(x: Array) -> Array:
        first, last = x[..., :1, :], x[..., -1:, :]
        if not eqx.is_inexact_array(x):
            return jnp.where(share < 1.0, first, last)
        return first + jnp.asarray(share, x.dtype) * (last - first)

    states = jax.tree.map(line, phase.states)
    return dataclasses.replace(phase, ts=line(phase.ts), states=states)
