"""The search that [optimize] asks for, its report, and the file of the optimum.

The run is `simulation.fly_compact`, which compiles in seconds; the optimum is confirmed by a run at
the accuracy of the file.
"""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any, final

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..core import InputError, State
from ..optimization import Criterion, Minimum, StopReason, minimise
from ..simulation import MissionTrajectory, fly_compact
from ._build import build_mission, replaced
from ._inputs import measures
from ._objects import Runs
from ._optimize_table import OWN_TABLES, Demand, Task
from ._outputs import Outputs, OutputSpec

Numbers = Mapping[str, float]


@final
@dataclasses.dataclass(frozen=True, eq=False)
class Optimum:
    """What `SceneFile.optimize` found.

    - `file`: the file; `task`: what its [optimize] asks for.
    - `minimum`: the result of `optimization.minimise`, whose `x` are the free numbers by path, SI;
      of an objective that is to be greatest, it is the minimum of the negative.
    - `objective`, `constraints`: the values of the outputs, SI, in the order of the file.
    - `error`: what the steps estimate of their relative error."""

    file: Any  # a `SceneFile`, whose module imports this one
    task: Task
    minimum: Minimum
    objective: float
    constraints: tuple[float, ...]
    error: float

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
        asked, in the units of the file."""
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
            found = criterion(self.file, self.task, {**numbers, **self.minimum.x})
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
        specs = (self.task.objective, *(d.spec for d in self.task.demands))
        states = {-1: run.final, **{k: p.final for k, p in enumerate(run.phases)}}
        ends = {-1: run.end, **{k: p.ts[-1] for k, p in enumerate(run.phases)}}
        numbers = replaced(file.values, {})
        return tuple(float(x) for x in values_of(file, numbers, specs, states, ends))

    def text(self) -> str:
        """The scene file with the optimum in place of its free numbers, comments and units kept."""
        # Only this function needs the library that keeps comments.
        import tomlkit

        document = tomlkit.parse(self.file.text)
        for free in self.task.free:
            # A bare number is SI, whatever the table of the report shows.
            factor = free.factor if free.start.unit else 1.0
            number = _written(factor * self.values[free.path], free.start.unit)
            _put(document, free.path.split("."), number)
        return tomlkit.dumps(document)


def optimise(file: Any, task: Task, progress: Callable | None = None) -> Optimum:
    """The optimum that the `task` asks for; see `SceneFile.optimize`."""
    table = file.values["optimize"]
    start = {free.path: jnp.asarray(float(free.start)) for free in task.free}
    bounds = (
        {free.path: jnp.asarray(free.low) for free in task.free},
        {free.path: jnp.asarray(free.high) for free in task.free},
    )
    found = minimise(
        lambda x: criterion(file, task, x),
        start,
        bounds=bounds,
        method=table["method"],
        tolerance=table["tolerance"],
        max_steps=table["max_steps"],
        scale={free.path: jnp.asarray(_size(free)) for free in task.free},
        progress=progress,
    )
    objective, constraints, error = found.criterion.report
    return Optimum(
        file, task, found, float(objective), tuple(float(x) for x in constraints), float(error)
    )


def criterion(file: Any, task: Task, x: Mapping[str, Array]) -> Criterion:
    """Objective and constraints of the run with the numbers `x` at their paths."""
    values = replaced(file.values, x)
    mission, y0 = build_mission(file.parsed, values, Runs())
    flight = fly_compact(mission, y0, file.start, steps=file.values["optimize"]["steps"])
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
    objective = jnp.where(jnp.all(happened), objective, jnp.nan)
    return Criterion(
        task.sign * objective,
        jnp.stack(equal) if equal else None,
        jnp.stack(above) if above else None,
        report=(objective, numbers, flight.error),
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


def _written(number: float, unit: str) -> str | float:
    """A number as the file writes it: with its unit where it had one."""
    # More digits than a search knows, and none of the rounding by a change of unit.
    number = float(f"{number:.12g}")
    return f"{number!r} {unit}" if unit else number


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
