"""The search of [optimize] over the runs of [dispersion]."""

import dataclasses
import os
from collections.abc import Callable, Mapping
from typing import Any, final

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from ..core import InputError
from ..dispersion import Campaign
from ..optimization import Progress
from ..optimization.optimisers import named_optimiser
from ..robust import DesignOptimum, optimise_design, optimise_nominal
from ..robust.statistics import AbstractStatistic, Constraint, Mean, Quantile
from ..simulation import MissionTrajectory
from ._build import replaced
from ._file_content import FileContent
from ._optimise import size_of
from ._optimize_table import Demand, Task
from ._outputs import Outputs
from ._scene_campaign import BuildOfFile

# The kernel of a quantile has corners of this size.
TOLERANCE = 1e-4
# Before the name of an output that is to be greatest.
NEGATIVE = "minus_"


def optimise_over_runs(
    file: FileContent,
    task: Task,
    base: Campaign,
    progress: Progress | None,
    store: str | os.PathLike[str] | None,
    resume: bool,
    nominal: bool,
) -> DesignOptimum:
    """The optimum of the `task`, over the runs of the campaign `base`; see
    `SceneFile.optimize_design`."""
    table = file.values["optimize"]
    campaign = campaign_function(file, task, base)
    start = {free.path: jnp.asarray(float(free.start)) for free in task.free}
    common: dict[str, Any] = {
        "minimise": _objective(task),
        "subject_to": [_constraint(demand) for demand in task.demands],
        "bounds": (
            {free.path: jnp.asarray(free.low) for free in task.free},
            {free.path: jnp.asarray(free.high) for free in task.free},
        ),
        "scale": {free.path: jnp.asarray(size_of(free)) for free in task.free},
        "optimiser": named_optimiser(table["optimiser"], table["rate"], table["max_steps"]),
        # A finer tolerance than these corners would never be met.
        "tolerance": max(table["tolerance"], TOLERANCE),
        "max_steps": table["max_steps"],
        "progress": progress,
    }
    if nominal:
        return optimise_nominal(campaign, start, **common)
    common |= {name: table[name] for name in ("runs", "may_fail")}
    common["seed"] = file.dispersion["seed"]
    return optimise_design(campaign, start, store=store, resume=resume, **common)


def campaign_function(
    file: FileContent, task: Task, base: Campaign
) -> Callable[[Mapping[str, Array]], Campaign]:
    """The function from the free numbers, SI, by path, to the campaign of the file with them, which
    is `base` but for its outputs.

    Raises `InputError` for two outputs of one name."""
    specs = tuple(dict.fromkeys((task.objective, *(d.spec for d in task.demands))))
    extremes = any(spec.take for spec in specs)
    names = [spec.name for spec in specs]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(
            f"optimize has two outputs of the name {twice[0]}: one of them must have another name."
        )
    base = dataclasses.replace(
        base,
        units=base.units
        | {spec.name: spec.unit for spec in specs}
        | {NEGATIVE + task.objective.name: task.objective.unit},
        requirements=(),
        # Without extremes no states along the run are saved, which would fill the memory.
        along=file.dispersion["extreme_samples"] if extremes else 2,
    )

    def campaign(x: Mapping[str, Array]) -> Campaign:
        values = replaced(file.values, x)
        outputs = Outputs(file.parsed, specs, values, None)
        greatest = task.objective.name if task.sign < 0.0 else ""
        return dataclasses.replace(
            base,
            build=BuildOfFile(file.parsed, values),
            outputs=OutputsOfDesign(outputs, greatest),
        )

    return campaign


@final
class OutputsOfDesign(eqx.Module):
    """The `outputs` of a campaign, and the negative of the `greatest` one, if there is a name."""

    outputs: Outputs
    greatest: str = eqx.field(static=True)

    def __call__(self, result: MissionTrajectory, samples: dict[str, Array]) -> dict[str, Array]:
        # The search minimises a statistic: of the greatest quantile it takes the least of the
        # negative.
        numbers = dict(self.outputs(result, samples))
        if self.greatest:
            numbers[NEGATIVE + self.greatest] = -numbers[self.greatest]
        return numbers


def _objective(task: Task) -> AbstractStatistic:
    name = task.objective.name
    return _statistic(NEGATIVE + name if task.sign < 0.0 else name, task.share)


def _constraint(demand: Demand) -> Constraint:
    """The limit of a statistic, in the unit of the file."""
    spec, share = demand.spec, demand.share
    # The statistics are of outputs in the unit of the file, the target is in SI.
    limit = spec.factor * demand.target
    if demand.limit == "at_most":
        return _statistic(spec.name, share).at_most(limit)
    # What 99 % of the runs exceed is the quantile of 1 %.
    return _statistic(spec.name, None if share is None else 1.0 - share).at_least(limit)


def _statistic(name: str, share: float | None) -> AbstractStatistic:
    return Mean(name) if share is None else Quantile(name, share)
