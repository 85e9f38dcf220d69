"""The runs of a design on a fixed sample: objective and constraints of a search, and the results of
each run."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PyTree

from ..core import InputError
from ..core.checks import is_concrete
from ..dispersion import Campaign
from ..dispersion.evaluate import evaluate_allowed, fixed_normals, inputs_at
from ..integration.accuracy import Accuracy
from ..minimisation import Criterion
from ..minimisation.batch_descent import FORWARD_RATIO
from ..simulation import Status
from ..simulation.blocks import Blocks
from ._few_runs import by_few_runs
from .statistics import TAIL, AbstractStatistic, Constraint

Design: TypeAlias = PyTree[Float[Array, "..."]]
CampaignOf: TypeAlias = Callable[[Design], Campaign]


class RunsOfDesign(NamedTuple):
    """The results of the runs of a design: outputs by name, and the `Status` of each; (runs,)."""

    outputs: dict[str, Float[Array, " runs"]]
    status: Int[Array, " runs"]

    def good(self, output: str) -> Bool[Array, " runs"]:
        """Whether a run succeeded with a finite output."""
        return (self.status <= Status.EVENT) & jnp.isfinite(self.outputs[output])


class Problem(NamedTuple):
    """The minimised problem and its runs.

    - `campaign`: from a design to its campaign.
    - `objective`, `constraints`: statistics of outputs, and limits of them.
    - `normals`: the places of the runs (`fixed_normals`); `None` for the nominal run only.
    - `accuracy`: of each run.
    - `may_fail`: the share of the runs that may fail.
    - `sign`: 1 to minimise the objective, -1 to maximise it."""

    campaign: CampaignOf
    objective: AbstractStatistic
    constraints: tuple[Constraint, ...]
    normals: Float[Array, "runs dimensions"] | None
    accuracy: Accuracy
    may_fail: float
    sign: float = 1.0

    @property
    def statistics(self) -> tuple[AbstractStatistic, ...]:
        """The statistics of the objective and the constraints."""
        return self.objective, *(c.statistic for c in self.constraints)

    @property
    def outputs(self) -> tuple[str, ...]:
        """The names of the outputs that count, each once."""
        return tuple(dict.fromkeys(statistic.output for statistic in self.statistics))

    def check_runs(self, runs: int) -> None:
        """Raise `InputError` for fewer runs than a statistic needs."""
        for statistic in self.statistics:
            if runs < statistic.fewest_runs:
                raise InputError(
                    f"runs is {runs}, too few for the {statistic.text()}: it must be at least "
                    f"{statistic.fewest_runs}, so that {TAIL} runs are in the tail."
                )

    def runs(self, x: Design) -> RunsOfDesign:
        """The runs of the design `x`, on the same places for every design; differentiable.

        Raises `InputError` for an output that the campaign does not have."""
        campaign = self.campaign(x)
        return self._evaluated(campaign, self._samples(campaign))

    def _samples(self, campaign: Campaign) -> dict[str, Float[Array, " runs"]]:
        """The random inputs of the runs."""
        if self.normals is None:
            return campaign.nominal()
        return inputs_at(campaign, self.normals)

    def _evaluated(
        self, campaign: Campaign, samples: dict[str, Float[Array, " runs"]]
    ) -> RunsOfDesign:
        """The runs with these inputs."""

        def block(piece: dict[str, Array], campaign: Campaign) -> RunsOfDesign:
            outputs, status = evaluate_allowed(campaign, self.accuracy, piece)
            self._check_outputs(tuple(outputs))
            # An output may be a count or a flag, whose statistics are floats.
            dtype = jnp.result_type(float)
            return RunsOfDesign({x: outputs[x].astype(dtype) for x in self.outputs}, status)

        count = next(iter(samples.values())).size
        # The data of a block stay in the cache: five times as fast as all runs at once.
        blocks = Blocks.on(jax.local_devices()[:1], count)
        # A single block needs no loop around it.
        if count in (1, blocks.size):
            return block(samples, campaign)
        return blocks.map(block, samples, campaign)

    def _check_outputs(self, known: tuple[str, ...]) -> None:
        for name in self.outputs:
            if name not in known:
                raise InputError(
                    f"{name!r} is not an output of the campaign: it must be one of "
                    f"{', '.join(known)}.{InputError.hint(name, known)}"
                )

    def __call__(self, x: Design) -> Criterion:
        """Objective and constraints of the design `x`, with its `RunsOfDesign` as the report; of an
        objective that is to be greatest, its negative.

        Objective and constraints are differentiable; the report need not be."""
        unknowns = sum(jnp.size(leaf) for leaf in jax.tree.leaves(x))
        forward = unknowns <= FORWARD_RATIO * len(self.statistics)
        if self._few_count(forward):
            numbers, runs = by_few_runs(self, x, forward)
        else:
            numbers, runs = self.numbers(x)
        # Without this a search would leave out bad runs by making them fail.
        failed = jnp.mean(runs.status > Status.EVENT, dtype=numbers.dtype)
        objective = jnp.where(failed <= self.may_fail, numbers[0], jnp.inf)
        return Criterion(objective, None, numbers[1:] if self.constraints else None, runs)

    def numbers(self, x: Design) -> tuple[Float[Array, " rows"], RunsOfDesign]:
        """The objective and the margins of the constraints, and the runs."""
        runs = self.runs(x)
        if self.normals is not None:
            pairs = zip(self._measures, self.statistics, strict=True)
            values = [f(runs.outputs[s.output], runs.good(s.output)) for f, s in pairs]
        else:
            # A single run has neither quantile nor share.
            alone = {name: values[0] for name, values in runs.outputs.items()}
            values = [self.sign * self.objective.at_nominal(alone[self.objective.output])]
            values += [c.margin_at_nominal(alone[c.statistic.output]) for c in self.constraints]
        return jnp.stack(values), runs

    def weighted(
        self, runs: RunsOfDesign
    ) -> tuple[Float[Array, " rows"], Float[Array, "rows runs"]]:
        """The objective and the margins of the constraints, and the derivatives of each with
        respect to its output of every run."""
        pairs = [
            jax.value_and_grad(f)(runs.outputs[s.output], runs.good(s.output))
            for f, s in zip(self._measures, self.statistics, strict=True)
        ]
        values, slopes = zip(*pairs, strict=True)
        return jnp.stack(values), jnp.stack(slopes)

    @property
    def _measures(self) -> tuple[Callable[[Array, Array], Array], ...]:
        """The minimised value, and the margins of the constraints."""
        objective = lambda x, good: self.sign * self.objective.value(x, good)  # noqa: E731
        return objective, *(c.margin for c in self.constraints)

    @property
    def count(self) -> int:
        """The number of runs."""
        return 1 if self.normals is None else len(self.normals)

    def places_of_outputs(self) -> tuple[int, ...]:
        """The place of the output of each of the numbers among the `outputs`."""
        return tuple(self.outputs.index(statistic.output) for statistic in self.statistics)

    def runs_at(
        self, x: Design, places: Int[Array, " block"]
    ) -> tuple[Float[Array, "outputs block"], RunsOfDesign]:
        """The outputs that count of the runs at these places, and the runs."""
        assert self.normals is not None
        campaign = self.campaign(x)
        runs = self._evaluated(campaign, inputs_at(campaign, self.normals[places]))
        return jnp.stack([runs.outputs[name] for name in self.outputs]), runs

    def _few_count(self, forward: bool) -> bool:
        """Whether the numbers are differentiated by those of the runs that count."""
        if self.normals is None:
            return False
        few = [statistic.of_few for statistic in self.statistics]
        # Forward, a run is computed once for all numbers.
        return all(few) if forward else any(few)


def problem_of(
    campaign: CampaignOf,
    start: Design,
    minimise: AbstractStatistic | None,
    constraints: Sequence[Constraint],
    runs: int | None,
    seed: int,
    accuracy: Any,
    may_fail: float,
    maximise: AbstractStatistic | None = None,
) -> Problem:
    """The problem on a sample of `runs` runs; with `None`, on the nominal run only.

    Raises `InputError` without one of `minimise` and `maximise`, for an invalid campaign, statistic
    or constraint, a campaign without dispersion, and for fewer runs than a statistic requires."""
    if (minimise is None) == (maximise is None):
        raise InputError("A design must have exactly one of minimise and maximise.")
    goal, objective = "minimise" if maximise is None else "maximise", minimise or maximise
    for name, thing, kind, allowed in (
        (goal, objective, AbstractStatistic, 'a statistic such as Mean("miss")'),
        *(
            (f"subject_to[{k}]", c, Constraint, 'a limit such as Mean("miss").at_most(1.0)')
            for k, c in enumerate(constraints)
        ),
    ):
        if not isinstance(thing, kind):
            raise InputError(f"{name} is a {type(thing).__name__}: it must be {allowed}.")
    assert objective is not None
    if not 0.0 <= may_fail < 1.0:
        raise InputError(f"may_fail is {may_fail}: it must be from 0 to below 1.")
    first = campaign(start)
    if not isinstance(first, Campaign):
        raise InputError(
            f"campaign returns a {type(first).__name__} for the start: it must return a Campaign."
        )
    problem = Problem(
        campaign,
        objective,
        tuple(constraints),
        None,
        first.accuracy_for(accuracy),
        may_fail,
        1.0 if maximise is None else -1.0,
    )
    # The nominal run has no place among random ones.
    if runs is None:
        return problem
    _check_scatter(first)
    normals = fixed_normals(first, runs, seed)
    problem.check_runs(runs)
    return problem._replace(normals=normals)


def enough_runs(statistics: Sequence[AbstractStatistic], least: int) -> int:
    """The power of two, from `least` on, that all of these statistics can be known from."""
    most = max((statistic.fewest_runs for statistic in statistics), default=1)
    # Sobol points fill the unit cube evenly in powers of two.
    return max(least, 2 ** int(np.ceil(np.log2(most))))


def _check_scatter(campaign: Campaign) -> None:
    """Raise `InputError` if no input of the campaign is dispersed."""
    deviations = [d.deviation for d in campaign.inputs.values()]
    if all(is_concrete(s) and not np.any(np.asarray(s)) for s in deviations):
        raise InputError(
            f"The inputs {', '.join(campaign.inputs)} have zero standard deviation: at least one "
            "must be dispersed."
        )


def failures(runs: RunsOfDesign) -> str:
    """A message with the number of failed runs and their most frequent status; empty for none."""
    status = np.asarray(runs.status)
    bad = status[status > Status.EVENT]
    if not bad.size:
        return ""
    codes, counts = np.unique(bad, return_counts=True)
    # One sentence: with thousands of failures the most frequent cause is the one to mend.
    most = Status(int(codes[np.argmax(counts)]))
    return f"{bad.size} of {status.size} runs fail, most of them with this status: {most.sentence}"
