"""The search of [optimize] over the runs of [dispersion]."""

import dataclasses
import os
from collections.abc import Mapping
from typing import final

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from ...core import InputError
from ...dispersion import Campaign
from ...optimization import Progress
from ...optimization.optimisers import named_optimiser
from ...robust import DesignOptimum, optimise_design
from ...robust.statistics import (
    AbstractStatistic,
    Constraint,
    CVaR,
    Mean,
    MeanPlus,
    Quantile,
    Violation,
    Worst,
)
from .._file_content import FileContent
from .._kinds.kind import Values
from .._mission.building import replaced
from .._mission.parsed import Parsed
from .._requests.optimize_table import Demand, Task
from .._requests.output_spec import OutputSpec
from .._requests.run_statistics import ABOVE, BEYOND, MEAN, QUANTILE, SPREAD, WORST, RunStatistic
from .._runs.campaign import BuildOfFile
from .._runs.outputs import Outputs
from .optimise import size_of

# The kernel of a quantile has corners of this size.
TOLERANCE = 1e-4
AVERAGE = RunStatistic(MEAN)


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
    return optimise_design(
        campaign,
        start,
        **_goal(task),
        subject_to=[_constraint(demand) for demand in task.demands],
        bounds=(
            {free.path: jnp.asarray(free.low) for free in task.free},
            {free.path: jnp.asarray(free.high) for free in task.free},
        ),
        scale={free.path: jnp.asarray(size_of(free)) for free in task.free},
        optimiser=named_optimiser(table["optimiser"], table["rate"], table["max_steps"]),
        runs=table["runs"],
        seed=file.dispersion["seed"],
        nominal=nominal,
        may_fail=table["may_fail"],
        # A finer tolerance than these corners would never be met.
        tolerance=max(table["tolerance"], TOLERANCE),
        max_steps=table["max_steps"],
        progress=progress,
        store=store,
        resume=resume,
    )


@final
class CampaignOfFile(eqx.Module):
    """The campaign of a file as a function of its design variables, SI, by path: a tree of arrays,
    so that searches of one file share their programs.

    - `parsed`, `values`: the structure of the file, and its numbers.
    - `base`: the campaign of the file with the settings of the search.
    - `specs`: the outputs that count."""

    parsed: Parsed = eqx.field(static=True)
    values: Values
    base: Campaign
    specs: tuple[OutputSpec, ...] = eqx.field(static=True)

    def __call__(self, x: Mapping[str, Array]) -> Campaign:
        values = replaced(self.values, x)
        return dataclasses.replace(
            self.base,
            build=BuildOfFile(self.parsed, values),
            outputs=Outputs(self.parsed, self.specs, values, None),
        )


def campaign_function(file: FileContent, task: Task, base: Campaign) -> CampaignOfFile:
    """The campaign of the file for the search of the `task`, which is `base` but for its outputs.

    Raises `InputError` for two outputs of one name."""
    specs = tuple(dict.fromkeys((task.objective, *(d.spec for d in task.demands))))
    extremes = any(spec.take for spec in specs)
    names = [spec.name for spec in specs]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(f"optimize has two outputs named {twice[0]}: rename one of them.")
    base = dataclasses.replace(
        base,
        units=base.units | {spec.name: spec.unit for spec in specs},
        requirements=(),
        # Without extremes no states along the run are saved, which would fill the memory.
        num_saved=file.dispersion["extreme_samples"] if extremes else 2,
    )
    return CampaignOfFile(file.parsed.structure, file.parsed.numbers(), base, specs)


def _goal(task: Task) -> dict[str, AbstractStatistic]:
    """The statistic that is to be least or greatest."""
    name, taken = task.objective.name, task.of_runs or AVERAGE
    if task.sign > 0.0:
        return {"minimise": _statistic(name, taken)}
    if taken.is_share:
        # Few runs below are many above.
        return {"minimise": _share_of_bad(name, taken, 1.0)}
    return {"maximise": _lower(name, taken)}


def _constraint(demand: Demand) -> Constraint:
    """The limit of a statistic, in the unit of the file."""
    spec, taken = demand.spec, demand.of_runs or AVERAGE
    upper = demand.limit == "at_most"
    if taken.is_share:
        # At least 99 % above are at most 1 % that are not.
        if upper:
            return _statistic(spec.name, taken).at_most(demand.target)
        return _share_of_bad(spec.name, taken, 1.0).at_most(1.0 - demand.target)
    # The statistics are of outputs in the unit of the file, the target is in SI.
    limit = spec.factor * demand.target
    if upper:
        return _statistic(spec.name, taken).at_most(limit)
    return _lower(spec.name, taken).at_least(limit)


def _lower(name: str, taken: RunStatistic) -> AbstractStatistic:
    """The statistic of an output of which less is worse."""
    if taken.kind == QUANTILE:
        # The value exceeded by 99 % of the runs is the 1 % quantile.
        return Quantile(name, 1.0 - taken.number)
    if taken.kind == BEYOND:
        return CVaR(name, taken.number, lower=True)
    return Worst(name, lower=True) if taken.kind == WORST else _statistic(name, taken)


def _statistic(name: str, taken: RunStatistic) -> AbstractStatistic:
    """The statistic of an output of which more is worse."""
    if taken.is_share:
        return _share_of_bad(name, taken, -1.0)
    kinds = {SPREAD: MeanPlus, QUANTILE: Quantile, BEYOND: CVaR}
    if taken.kind in kinds:
        return kinds[taken.kind](name, taken.number)
    return Worst(name) if taken.kind == WORST else Mean(name)


def _share_of_bad(name: str, taken: RunStatistic, sign: float) -> Violation:
    """The share of the runs that are above (or below) the number, or for a positive `sign` of those
    that are not."""
    above = (taken.kind == ABOVE) == (sign < 0.0)
    return Violation(name, high=taken.number) if above else Violation(name, low=taken.number)
