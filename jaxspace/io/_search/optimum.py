"""Result of a search: its numbers, why it ended, and whether a run at the accuracy of the file
confirms it."""

import dataclasses
from collections.abc import Sequence
from typing import final

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ...core import InputError
from ...core.jit import quick_jit
from ...core.listed import no_method
from ...core.printing import printed
from ...optimization import Criterion, Minimum, StopReason
from ...simulation import MissionTrajectory
from .._file_content import FileContent
from .._requests.final_error import tolerance_of
from .._requests.inputs import measures
from .._requests.optimize_table import OWN_TABLES, Task
from .._requests.output_spec import OutputSpec
from .._runs.outputs import Curve, line_ends
from .optimum_file import with_numbers
from .task import Search, failed_phase, search_of, values_of

# Allowed relative error of an output by the steps of the search: far below the needs of a first
# design, and far above that of good steps, of which 40 in a phase reach 1e-5.
MISS = 1e-3
# Allowed error of an output about zero, in tolerances of search and confirmation: the errors of the
# steps accumulate over a run.
TOLERANCES = 100.0


@final
@dataclasses.dataclass(frozen=True, eq=False)
@printed()
class Optimum:
    """Result of `SceneFile.optimize`.

    - `file`: the scene file.
    - `task`: the content of its table [optimize].
    - `minimum`: the result of `optimization.minimise`, whose `x` are the design variables by path,
      SI; for an objective to maximise, it is the minimum of the negative.
    - `objective`, `constraints`: the values of the outputs, SI, in the order of the file.
    - `error`: estimate of the relative error of the states due to the steps of the search.
    - `steps`: number of integration steps of each phase.
    - `happened`: whether the event of each phase occurred.
    - `warning`: a message about a doubtful result: the run from the start fails, or the
      verification run of the optimum has different values."""

    file: FileContent
    task: Task
    minimum: Minimum
    objective: float
    constraints: tuple[float, ...]
    error: float
    steps: int
    happened: tuple[bool, ...] = ()
    warning: str = ""

    @property
    def converged(self) -> bool:
        """Whether the search met its tolerance, without a `warning`."""
        return bool(self.minimum.converged) and not self.warning

    @property
    def values(self) -> dict[str, float]:
        """The design variables of the optimum, SI, by path."""
        return {path: float(x) for path, x in self.minimum.x.items()}

    @property
    def infeasible(self) -> bool:
        """Whether the search ended at the least violation of constraints that it could not meet.
        Its multipliers are then weights of the search, and no derivatives."""
        return int(self.minimum.reason) == StopReason.INFEASIBLE

    def sentence(self) -> str:
        """Why the search ended; value and target of each constraint that is not met, in the units
        of the file; and the `warning`."""
        own = self._reason()
        return f"{own} {self.warning}" if self.warning else own

    def _reason(self) -> str:
        if int(self.minimum.reason) == StopReason.NOT_FINITE:
            bad = [
                f"{spec.name.replace('_', ' ')} is {value}"
                for spec, value in zip(self._specs, self._numbers, strict=True)
                if not np.isfinite(value)
            ]
            where = "at the start" if int(self.minimum.steps) == 0 else "where the search ended"
            return f"{', '.join(bad)} {where}." if bad else self.minimum.sentence()
        # Equalities and inequalities are each in the order of the file.
        equal, above = (iter(flags) for flags in self.minimum.unmet)
        clauses = []
        for demand, value in zip(self.task.demands, self.constraints, strict=True):
            if next(equal if demand.limit == "equal" else above):
                spec = demand.spec
                limit = demand.limit.replace("_", " ")
                best, target = (f"{spec.factor * x:.6g}" for x in (value, demand.target))
                unit = f" {spec.unit}" if spec.unit else ""
                name = spec.name.replace("_", " ")
                clauses.append(f"{name} is {best}{unit} where {limit} {target}{unit} is required")
        if self.infeasible:
            return (
                "The constraints cannot be satisfied from this start: at best, "
                f"{', '.join(clauses)}."
            )
        return self.minimum.sentence(clauses)

    @property
    def _specs(self) -> tuple[OutputSpec, ...]:
        return (self.task.objective, *(d.spec for d in self.task.demands))

    @property
    def _numbers(self) -> tuple[float, ...]:
        return (self.objective, *self.constraints)

    @property
    @no_method
    def target_derivatives(self) -> tuple[float, ...]:
        """For each constraint the derivative of the objective with respect to its target, SI: from
        the multipliers, zero where the constraint does not bind; NaN for an infeasible problem."""
        if self.infeasible:
            return (np.nan,) * len(self.task.demands)
        equal, above = _multipliers(self.minimum)
        result = []
        e = 0
        a = 0
        for demand in self.task.demands:
            if demand.limit == "equal":
                # The constraint is the value less its target, and falls where the target rises.
                slope = -equal[e]
                e = e + 1
            else:
                slope = above[a] if demand.limit == "at_least" else -above[a]
                a = a + 1
            result.append(self.task.sign * float(slope))
        return tuple(result)

    @property
    def bound_derivatives(self) -> dict[str, float]:
        """For each design variable at a bound the derivative of the objective with respect to that
        bound, SI; none for an infeasible problem."""
        result = {}
        if self.infeasible:
            return result
        for free in self.task.free:
            x = self.values[free.path]
            span = free.high - free.low
            near = min(x - free.low, free.high - x) <= 1e-6 * (span if span < np.inf else abs(x))
            if near:
                slope = float(self.minimum.bound_multipliers[free.path])
                result[free.path] = self.task.sign * slope
        return result

    def sensitivities(self) -> dict[str, float]:
        """The derivative of the optimal objective with respect to every other number of the file,
        SI, with re-optimised design variables: that of the Lagrangian (envelope theorem).

        Raises `InputError` for an infeasible problem, which has no optimum."""
        if self.infeasible:
            raise InputError(
                f"Sensitivities are available for a converged optimum only. {self.sentence()}"
            )
        # Numbers in the tables of the search control its course, not the location of its optimum.
        fixed = {
            path: float(x)
            for path, x in measures(self.file.values)
            if path.split(".")[0] not in OWN_TABLES and path not in self.values
        }
        numbers = {path: jnp.asarray(x) for path, x in fixed.items()}
        search = search_of(self.file, self.task, self.steps)
        slopes = _slopes(numbers, search, self.minimum.x, self.minimum.multipliers)
        return {path: float(x) for path, x in slopes.items()}

    def confirmed(self, run: MissionTrajectory, file: FileContent) -> tuple[float, ...]:
        """Objective and constraints, SI, of a `run` of the `file` of the optimum, as
        `SceneFile.nominal_mission` returns it; for extremes with five samples or more."""
        states, ends = line_ends(run)
        states |= {k: p.final for k, p in enumerate(run.phases)}
        ends |= {k: p.ts[-1] for k, p in enumerate(run.phases)}
        numbers = file.parsed.numbers()
        along = {k for spec in self._specs for k in spec.phases}
        curves = {k: Curve(run.phases[k].ts, run.phases[k].states) for k in along}
        values = values_of(file.parsed, numbers, self._specs, states, ends, curves)
        return tuple(float(x) for x in values)

    def checked(self, run: MissionTrajectory, confirmed: Sequence[float]) -> "Optimum":
        """The optimum with its `warning`, after the `run` of its file.

        It warns where the outputs `confirmed` by that run differ from those of the search by more
        than a thousandth, or about zero by more than a hundred tolerances."""
        if int(self.minimum.reason) == StopReason.NOT_FINITE:
            return self
        table = self.file.values["optimize"]
        weight = np.asarray(self.minimum.search.weight)
        # In the order of the search: the objective, equalities, inequalities.
        equal = [d.limit == "equal" for d in self.task.demands]
        order = [0, *(1 + k for k in np.argsort(~np.array(equal, bool), kind="stable"))]
        sizes = np.zeros(weight.size)
        sizes[order] = 1.0 / weight
        tolerance = max(table["tolerance"], tolerance_of(run.phases[0]))
        targets = (0.0, *(d.target for d in self.task.demands))
        rows = zip(self._specs, self._numbers, confirmed, targets, sizes, strict=True)
        clauses = []
        for spec, computed, other, target, size in rows:
            allowed = (
                MISS * max(abs(computed), abs(other), abs(target)) + TOLERANCES * tolerance * size
            )
            # Not a comparison that NaN would pass.
            if not abs(computed - other) <= allowed:
                shown = [f"{spec.factor * x:.6g}" for x in (other, computed)]
                unit = f" {spec.unit}" if spec.unit else ""
                clauses.append(f"{spec.name.replace('_', ' ')} {shown[0]}, not {shown[1]}{unit}")
        bad = failed_phase(run)
        if not clauses and not bad:
            return dataclasses.replace(self, warning="")
        what = f"has {', '.join(clauses)}" if clauses else "fails"
        # A run that fails has another reason than the steps.
        why = bad or (
            f"The {self.steps} steps per phase are too coarse: the relative error is "
            f"{self.error:.1e}."
        )
        warning = f"A run at the accuracy of the file does not confirm this: it {what}. {why}"
        return dataclasses.replace(self, warning=warning)

    def text(self) -> str:
        """The scene file with the design variables replaced by the optimum, preserving comments and
        units."""
        return with_numbers(self.file, self.task, self.values)


@quick_jit
@jax.grad
def _slopes(
    numbers: dict[str, Array], search: Search, x: dict[str, Array], dual: Criterion
) -> Array:
    """The derivatives of the Lagrangian, with these multipliers, with respect to the numbers."""
    result = search({**numbers, **x})
    total = result.objective
    if result.equal_zero is not None and dual.equal_zero is not None:
        total = total + dual.equal_zero @ result.equal_zero
    if result.non_negative is not None and dual.non_negative is not None:
        total = total - dual.non_negative @ result.non_negative
    return search.sign * total


def _multipliers(minimum: Minimum) -> tuple[np.ndarray, np.ndarray]:
    """Multipliers of the equalities and of the inequalities; empty where there are none."""
    dual = minimum.multipliers
    equal = np.zeros(0) if dual.equal_zero is None else np.asarray(dual.equal_zero)
    above = np.zeros(0) if dual.non_negative is None else np.asarray(dual.non_negative)
    return equal, above
