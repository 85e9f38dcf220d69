"""The search of the table [optimize]."""

from collections.abc import Mapping

import jax.numpy as jnp
import numpy as np

from ...optimization import Progress, minimise
from ...optimization.optimisers import named_optimiser
from ...simulation import MissionTrajectory
from .._file_content import FileContent
from .._requests.optimize_table import Free, Task
from .optimum import Optimum
from .task import failed_phase, search_of


def optimise(
    file: FileContent,
    task: Task,
    progress: Progress | None = None,
    start: Mapping[str, float] | None = None,
    steps: int | None = None,
) -> Optimum:
    """The optimum of the `task`; see `SceneFile.optimize`."""
    table = file.values["optimize"]
    each: int = table["steps"] if steps is None else steps
    given = {free.path: float(free.start) for free in task.free} if start is None else start
    x0 = {path: jnp.asarray(float(x)) for path, x in given.items()}
    bounds = (
        {free.path: jnp.asarray(free.low) for free in task.free},
        {free.path: jnp.asarray(free.high) for free in task.free},
    )
    result = minimise(
        search_of(file, task, each),
        x0,
        optimiser=named_optimiser(table["optimiser"], table["rate"], table["max_steps"]),
        bounds=bounds,
        tolerance=table["tolerance"],
        max_steps=table["max_steps"],
        # An orbit's radius and an angle differ by many orders of magnitude: the search sees all of
        # size one.
        scale={free.path: jnp.asarray(size_of(free)) for free in task.free},
        progress=progress,
    )
    # From the last evaluation, so that the report needs no further run.
    objective, constraints, error, happened = result.criterion.report
    numbers = tuple(float(x) for x in constraints)
    met = tuple(bool(x) for x in happened)
    return Optimum(file, task, result, float(objective), numbers, float(error), each, met)


def failed_start(optimum: Optimum, run: MissionTrajectory) -> str:
    """The reason why a search has no finite values; empty if the `run` from its start is not the
    cause."""
    bad = failed_phase(run)
    if bad:
        return f"The run from the start: {bad}"
    missed = [name for name, met in zip(run.names, optimum.happened, strict=True) if not met]
    if not missed:
        return ""
    return (
        f"Phase {missed[0]} misses its event with {optimum.steps} steps but reaches it at the "
        "accuracy of the file: increase optimize.steps."
    )


def size_of(free: Free) -> float:
    """The scale of a design variable, SI."""
    if free.scale is not None:
        return free.scale
    # Without bounds the magnitude of the number is used as the span, at least one.
    span = free.high - free.low
    return span if np.isfinite(span) else max(abs(float(free.start)), 1.0)
