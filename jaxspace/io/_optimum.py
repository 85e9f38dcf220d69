"""The search that [optimize] asks for, its report, and the file of the optimum.

The run is `simulation.fly_compact`, which compiles in seconds; the optimum is confirmed by a run at
the accuracy of the file, and given up where that one has other numbers.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any, final

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..core import InputError, State
from ..optimization import Criterion, Minimum, StopReason, minimise
from ..simulation import MissionTrajectory, Status, fly_compact
from ._build import build_mission, replaced
from ._inputs import measures
from ._objects import Runs
from ._optimize_table import OWN_TABLES, Demand, Free, Task
from ._outputs import Outputs, OutputSpec
from ._units import read_number

Numbers = Mapping[str, float]
# Of an output, by which the steps of the search may be off: far below what a design asks of a first
# search, far above what sound steps leave, of which 40 a phase reach 1e-5.
MISS = 1e-3
# Of an output about zero, in tolerances of search and confirmation: what a run of many steps makes
# of the tolerance of each.
TOLERANCES = 100.0


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Optimum:
    """What `SceneFile.optimize` found.

    - `file`: the file; `task`: what its [optimize] asks for.
    - `minimum`: the result of `optimization.minimise`, whose `x` are the free numbers by path, SI;
      of an objective that is to be greatest, it is the minimum of the negative.
    - `objective`, `constraints`: the values of the outputs, SI, in the order of the file.
    - `error`: what the steps estimate of their relative error; `steps`: of each phase.
    - `happened`: whether each phase met its event.
    - `doubt`: what speaks against it beside the search, in words: that the flight from the start
      fails, or that the run that confirms it has other numbers."""

    file: Any  # a `SceneFile`, whose module imports this one
    task: Task
    minimum: Minimum
    objective: float
    constraints: tuple[float, ...]
    error: float
    steps: int
    happened: tuple[bool, ...] = ()
    doubt: str = ""

    @property
    def converged(self) -> bool:
        """Whether the search met its tolerance, and nothing speaks against the optimum."""
        return bool(self.minimum.converged) and not self.doubt

    @property
    def values(self) -> dict[str, float]:
        """The free numbers of the optimum, SI, by path."""
        return {path: float(x) for path, x in self.minimum.x.items()}

    @property
    def infeasible(self) -> bool:
        """Whether the search ended at the least violation of constraints that it could not meet.
        Its multipliers are then weights of the search, and no derivatives."""
        return int(self.minimum.reason) == StopReason.INFEASIBLE

    def sentence(self) -> str:
        """Why the search ended; what each constraint that is not met has reached and what was
        asked, in the units of the file; and what else speaks against the optimum."""
        own = self._own_sentence()
        return f"{own} {self.doubt}" if self.doubt else own

    def _own_sentence(self) -> str:
        if int(self.minimum.reason) == StopReason.NOT_FINITE:
            bad = [
                f"{spec.name.replace('_', ' ')} is {value}"
                for spec, value in zip(self._specs, self._numbers, strict=True)
                if not np.isfinite(value)
            ]
            where = "at the start" if int(self.minimum.steps) == 0 else "where the search ended"
            return f"{', '.join(bad)} {where}." if bad else self.minimum.sentence()
        # Equalities and the rest come back in the order of the file among their own kind.
        equal, above = (iter(flags) for flags in self.minimum.unmet())
        clauses = []
        for demand, value in zip(self.task.demands, self.constraints, strict=True):
            if next(equal if demand.limit == "equal" else above):
                spec, limit = demand.spec, demand.limit.replace("_", " ")
                best, target = (f"{spec.factor * x:.6g}" for x in (value, demand.target))
                unit = f" {spec.unit}" if spec.unit else ""
                name = spec.name.replace("_", " ")
                clauses.append(f"{name} is {best}{unit} where {limit} {target}{unit} is asked")
        if self.infeasible:
            return f"The constraints cannot be met from this start: at best {', '.join(clauses)}."
        return self.minimum.sentence(clauses)

    @property
    def _specs(self) -> tuple[OutputSpec, ...]:
        return (self.task.objective, *(d.spec for d in self.task.demands))

    @property
    def _numbers(self) -> tuple[float, ...]:
        return (self.objective, *self.constraints)

    @property
    def target_derivatives(self) -> tuple[float, ...]:
        """For each constraint the derivative of the objective by its target, SI: from the
        multipliers, zero where the constraint does not bind; NaN for an infeasible problem."""
        if self.infeasible:
            return (np.nan,) * len(self.task.demands)
        equal, above = _multipliers(self.minimum)
        found, e, a = [], 0, 0
        for demand in self.task.demands:
            if demand.limit == "equal":
                slope, e = -equal[e], e + 1
            else:
                slope, a = (above[a] if demand.limit == "at_least" else -above[a]), a + 1
            found.append(self.task.sign * float(slope))
        return tuple(found)

    @property
    def bound_derivatives(self) -> dict[str, float]:
        """For each free number at a bound the derivative of the objective by that bound, SI; none
        for an infeasible problem."""
        found = {}
        if self.infeasible:
            return found
        for free in self.task.free:
            x, span = self.values[free.path], free.high - free.low
            near = min(x - free.low, free.high - x) <= 1e-6 * (span if span < np.inf else abs(x))
            if near:
                slope = float(self.minimum.bound_multipliers[free.path])
                found[free.path] = self.task.sign * slope
        return found

    def sensitivities(self) -> dict[str, float]:
        """The derivative of the best objective by every other number of the file, SI, with the
        free numbers moved along: that of the Lagrangian (the envelope theorem).

        Raises `InputError` for an infeasible problem, which has no optimum."""
        if self.infeasible:
            raise InputError(f"An optimum alone has sensitivities. {self.sentence()}")
        fixed = {
            path: float(x)
            for path, x in measures(self.file.values)
            if path.split(".")[0] not in OWN_TABLES and path not in self.values
        }
        dual = self.minimum.multipliers

        def lagrangian(numbers: dict[str, Array]) -> Array:
            found = criterion(self.file, self.task, {**numbers, **self.minimum.x}, self.steps)
            total = found.objective
            if found.equal_zero is not None and dual.equal_zero is not None:
                total = total + dual.equal_zero @ found.equal_zero
            if found.non_negative is not None and dual.non_negative is not None:
                total = total - dual.non_negative @ found.non_negative
            return self.task.sign * total

        slopes = jax.jit(jax.grad(lagrangian))({p: jnp.asarray(x) for p, x in fixed.items()})
        return {path: float(x) for path, x in slopes.items()}

    def confirmed(self, run: MissionTrajectory, file: Any) -> tuple[float, ...]:
        """Objective and constraints, SI, of a `run` of the `file` of the optimum by `simulate`."""
        states = {-1: run.final, **{k: p.final for k, p in enumerate(run.phases)}}
        ends = {-1: run.end, **{k: p.ts[-1] for k, p in enumerate(run.phases)}}
        numbers = replaced(file.values, {})
        return tuple(float(x) for x in values_of(file, numbers, self._specs, states, ends))

    def judged(self, run: MissionTrajectory, confirmed: Sequence[float]) -> "Optimum":
        """The optimum with its `doubt`, after the `run` of its file and the outputs `confirmed` by
        that: where they differ from those found by more than a thousandth, or about zero by more
        than a hundred tolerances."""
        if int(self.minimum.reason) == StopReason.NOT_FINITE:
            return self
        table, weight = self.file.values["optimize"], np.asarray(self.minimum.search.weight)
        # In the order of the search: the objective, equalities, inequalities.
        equal = [d.limit == "equal" for d in self.task.demands]
        order = [0, *(1 + k for k in np.argsort(~np.array(equal, bool), kind="stable"))]
        sizes = np.zeros(weight.size)
        sizes[order] = 1.0 / weight
        tolerance = max(table["tolerance"], self.file.values["accuracy"])
        targets = (0.0, *(d.target for d in self.task.demands))
        rows = zip(self._specs, self._numbers, confirmed, targets, sizes, strict=True)
        clauses = []
        for spec, own, other, target, size in rows:
            allowed = MISS * max(abs(own), abs(other), abs(target)) + TOLERANCES * tolerance * size
            # Not a comparison that NaN would pass.
            if not abs(own - other) <= allowed:
                shown = [f"{spec.factor * x:.6g}" for x in (other, own)]
                unit = f" {spec.unit}" if spec.unit else ""
                clauses.append(f"{spec.name.replace('_', ' ')} {shown[0]}, not {shown[1]}{unit}")
        bad = failed_phase(run)
        if not clauses and not bad:
            return dataclasses.replace(self, doubt="")
        what = f"has {', '.join(clauses)}" if clauses else "fails"
        doubt = (
            f"A run at the accuracy of the file does not confirm this: it {what}. "
            f"{f'{bad} ' if bad else ''}The {self.steps} steps of a phase are too coarse, with a "
            f"relative error of {self.error:.1e}."
        )
        return dataclasses.replace(self, doubt=doubt)

    def text(self) -> str:
        """The scene file with the optimum in place of its free numbers, comments and units kept."""
        # Only this function needs the library that keeps comments.
        import tomlkit

        document = tomlkit.parse(self.file.text)
        for free in self.task.free:
            # A bare number is SI, whatever the table of the report shows.
            factor = free.factor if free.start.unit else 1.0
            number = _written(self.values[free.path], free, factor)
            _put(document, free.path.split("."), number)
        # The text may be written into another folder, where a relative name would find nothing.
        for path, named in self.file.files.entries.items():
            _put(document, path.split("."), str(named.path))
        return tomlkit.dumps(document)


def optimise(
    file: Any,
    task: Task,
    progress: Callable | None = None,
    start: Numbers | None = None,
    steps: int | None = None,
) -> Optimum:
    """The optimum that the `task` asks for; see `SceneFile.optimize`."""
    table = file.values["optimize"]
    each: int = table["steps"] if steps is None else steps
    given = {free.path: float(free.start) for free in task.free} if start is None else start
    x0 = {path: jnp.asarray(float(x)) for path, x in given.items()}
    bounds = (
        {free.path: jnp.asarray(free.low) for free in task.free},
        {free.path: jnp.asarray(free.high) for free in task.free},
    )
    found = minimise(
        lambda x: criterion(file, task, x, each),
        x0,
        bounds=bounds,
        method=table["method"],
        tolerance=table["tolerance"],
        max_steps=table["max_steps"],
        scale={free.path: jnp.asarray(_size(free)) for free in task.free},
        progress=progress,
    )
    objective, constraints, error, happened = found.criterion.report
    numbers = tuple(float(x) for x in constraints)
    met = tuple(bool(x) for x in happened)
    made = Optimum(file, task, found, float(objective), numbers, float(error), each, met)
    if int(found.reason) == StopReason.NOT_FINITE:
        return dataclasses.replace(made, doubt=_failed_start(made))
    return made


def _failed_start(found: Optimum) -> str:
    """Why the flight from the start of a search has no finite numbers, in words; empty where that
    is not the flight's fault."""
    # The search itself keeps of a flight only its ends.
    run = found.file.nominal_mission(samples=2)
    bad = failed_phase(run)
    if bad:
        return f"The flight from the start: {bad}"
    missed = [name for name, met in zip(run.names, found.happened, strict=True) if not met]
    if not missed:
        return ""
    return (
        f"Phase {missed[0]} misses its event with {found.steps} steps, and meets it at the "
        f"accuracy of the file: raise optimize.steps."
    )


def failed_phase(run: MissionTrajectory) -> str:
    """The first phase of a flight that ended badly, with the sentence of its status; or nothing."""
    for name, phase in zip(run.names, run.phases, strict=True):
        status = Status(int(phase.status))
        if not status.good:
            return f"{name} ended badly. {status.sentence}"
    return ""


def criterion(file: Any, task: Task, x: Mapping[str, Array], steps: int) -> Criterion:
    """Objective and constraints of the run with the numbers `x` at their paths."""
    values = replaced(file.values, x)
    mission, y0 = build_mission(file.parsed, values, Runs())
    flight = fly_compact(mission, y0, file.start, steps=steps)
    states = {-1: flight.final, **{k: p.before for k, p in enumerate(flight.phases)}}
    ends = {-1: flight.end, **{k: p.ts[-1] for k, p in enumerate(flight.phases)}}
    specs = (task.objective, *(d.spec for d in task.demands))
    objective, *numbers = values_of(file, values, specs, states, ends)
    equal = [v - d.target for v, d in zip(numbers, task.demands, strict=True) if d.limit == "equal"]
    above = [
        _margin(v, d) for v, d in zip(numbers, task.demands, strict=True) if d.limit != "equal"
    ]
    happened = jnp.stack([p.happened for p in flight.phases])
    # A phase that misses its event ends anywhere: the search turns back.
    reported, objective = objective, jnp.where(jnp.all(happened), objective, jnp.nan)
    return Criterion(
        task.sign * objective,
        jnp.stack(equal) if equal else None,
        jnp.stack(above) if above else None,
        report=(reported, numbers, flight.error, happened),
    )


def values_of(
    file: Any,
    values: Any,
    specs: tuple[OutputSpec, ...],
    states: dict[int, State],
    ends: dict[int, Array],
) -> list[Array]:
    """The outputs, SI, from the states and the times, s, at the end of each phase (-1: of all)."""
    # Outputs are written for runs on the last axis: this is a batch of one.
    batch, times = jax.tree.map(lambda x: jnp.asarray(x)[..., None], (states, ends))
    # By number, for an objective may be constrained too.
    named = tuple(s._replace(name=str(k), factor=1.0) for k, s in enumerate(specs))
    found = Outputs(file, named, values, None).numbers(batch, times, {})
    return [found[spec.name][0] for spec in named]


def _margin(value: Array, demand: Demand) -> Array:
    return value - demand.target if demand.limit == "at_least" else demand.target - value


def _size(free: Any) -> float:
    if free.scale is not None:
        return free.scale
    # Without bounds there is no span: the number's own size stands in, at least one.
    span = free.high - free.low
    return span if np.isfinite(span) else max(abs(float(free.start)), 1.0)


def _multipliers(minimum: Minimum) -> tuple[np.ndarray, np.ndarray]:
    dual = minimum.multipliers
    none = np.zeros(0)
    equal, above = dual.equal_zero, dual.non_negative
    return none if equal is None else np.asarray(equal), none if above is None else np.asarray(
        above
    )


def _written(value: float, free: Free, factor: float) -> str | float:
    """A number as the file writes it: with its unit where it had one."""
    value, written = min(max(value, free.low), free.high), 0.0
    # More digits than a search knows, and none of the rounding by a change of unit; all of them
    # only at a bound, beyond which the file could not be read again.
    for digits in (12, 15, 16, 17):
        number = float(f"{factor * value:.{digits}g}")
        written = f"{number!r} {free.start.unit}" if free.start.unit else number
        if free.low <= read_number(written, free.start.quantity)[0] <= free.high:
            break
    return written


def _put(table: Any, path: list[str], value: str | float) -> None:
    """Set the entry at a path of a document; tables on the way are made where there are none."""
    for step, following in zip(path[:-1], path[1:], strict=True):
        # A step of digits is an index in lists alone: a table may have such a key.
        key: Any = int(step) if step.isdigit() and isinstance(table, list) else step
        if not isinstance(table, list) and key not in table:
            if following.isdigit():
                raise InputError(f"{'.'.join(path)} has its default: write the list into the file.")
            table[key] = {}
        table = table[key]
    last: Any = int(path[-1]) if isinstance(table, list) else path[-1]
    if not isinstance(table, list | dict):
        raise InputError(f"{'.'.join(path)} cannot be written: its table is given by one number.")
    table[last] = value
