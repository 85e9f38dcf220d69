"""Reports of the optimum of a search: its design variables, constraints and phases, and its largest
sensitivities."""

import math
from collections.abc import Sequence

import jax.numpy as jnp

from ...core.text import aligned
from ...simulation import MissionTrajectory
from .._requests.inputs import measures
from .._requests.output_entries import applicable_outputs
from .._search.optimum import Optimum
from .._search.task import values_of
from ..units import in_unit
from .rows import Row, label, number

# Outputs of each phase in the table of an optimum, if the file has their arguments.
OF_PHASES = ("end_time", "altitude", "radius", "speed", "radial_speed")


def optimum_report(
    optimum: Optimum, confirmed: Sequence[float] = (), run: MissionTrajectory | None = None
) -> str:
    """The table of an optimum: objective, design variables, constraints with their multipliers, and
    the reason why the search ended.

    **Arguments**

    - `confirmed`: the outputs as a run at the accuracy of the file has them.
    - `run`: that run, whose phases make one more table."""
    task, file = optimum.task, optimum.file
    # NaN is shown as a dash, where nothing has confirmed the optimum.
    checked = [*confirmed] or [math.nan] * (1 + len(task.demands))
    tables = [_objective_rows(optimum, checked[0]), _free_rows(optimum)]
    if task.demands:
        tables.append(_constraint_rows(optimum, checked[1:]))
    lines = [file.title, *map(aligned, tables)]
    goal = task.objective
    if not optimum.infeasible:
        lines.append(
            f"slope: change of {goal.name} [{goal.unit or '1'}] per unit of the bound or target"
        )
    if run is not None:
        lines.append(aligned(_phase_rows(optimum, run)))
    lines.append(f"relative error of the steps: {optimum.error:.1e}")
    return "\n\n".join([*lines, optimum.sentence()])


def _objective_rows(optimum: Optimum, confirmed: float) -> list[Row]:
    """The objective, as the search and as the run that confirms it have it."""
    goal = optimum.task.objective
    verb = "least" if optimum.task.sign > 0.0 else "greatest"
    cells = (_or_dash(goal.factor * x) for x in (optimum.objective, confirmed))
    return [("", "search", "verification run"), (label(f"{verb} {goal.name}", goal.unit), *cells)]


def _free_rows(optimum: Optimum) -> list[Row]:
    """Start, optimum and bounds of each design variable, and the sensitivity of the objective to an
    active bound."""
    goal, held = optimum.task.objective, optimum.bound_derivatives
    rows: list[Row] = [("design variable", "start", "optimum", "low", "high", "slope")]
    for free in optimum.task.free:
        numbers = (free.start, optimum.values[free.path], free.low, free.high)
        slope = goal.factor * held[free.path] / free.factor if free.path in held else math.nan
        shown = (number(free.factor * x) for x in numbers)
        rows.append((f"{free.path} [{free.unit or '1'}]", *shown, _or_dash(slope)))
    return rows


def _constraint_rows(optimum: Optimum, confirmed: Sequence[float]) -> list[Row]:
    """Target and values of each constraint, and how the objective moves with its target."""
    goal = optimum.task.objective
    rows: list[Row] = [("constraint", "", "target", "search", "verification run", "slope")]
    slopes = optimum.target_derivatives
    values = zip(optimum.task.demands, optimum.constraints, confirmed, slopes, strict=True)
    for demand, value, checked, slope in values:
        spec = demand.spec
        shown = [_or_dash(spec.factor * x) for x in (demand.target, value, checked)]
        # In the units that the table shows, above and below.
        shown.append(_or_dash(goal.factor * slope / spec.factor))
        rows.append((label(spec.name, spec.unit), demand.limit.replace("_", " "), *shown))
    return rows


def _phase_rows(optimum: Optimum, run: MissionTrajectory) -> list[Row]:
    """For each phase, the values at its end, before its jump, of a few outputs for which the file
    has all arguments."""
    file = optimum.file
    known = {s.name: s for s in applicable_outputs(file.parsed, file.units)}
    chosen = [known[name] for name in OF_PHASES if name in known]
    head = [label(s.name, s.unit) for s in chosen]
    unit = file.units.of("mass", "kg")
    # A body without propellant has a constant mass, which is not in the state.
    heavy = getattr(run.final, "mass", None) is not None
    rows: list[Row] = [("phase", *head, *([label("mass", unit)] if heavy else []))]
    numbers = file.parsed.numbers({p: jnp.asarray(x) for p, x in optimum.values.items()})
    for k, (name, phase) in enumerate(run.items()):
        states, ends = {-1: run.final, k: phase.final}, {-1: run.end, k: phase.ts[-1]}
        specs = tuple(spec._replace(at=k) for spec in chosen)
        values = values_of(file.parsed, numbers, specs, states, ends, {})
        cells = [number(s.factor * x) for s, x in zip(specs, values, strict=True)]
        mass = [number(in_unit("kg", unit) * phase.final.mass)] if heavy else []
        rows.append((name, *cells, *mass))
    return rows


def sensitivity_report(optimum: Optimum, count: int = 12) -> str:
    """The numbers of the file that move the best objective most, by one percent of each."""
    goal = optimum.task.objective
    numbers = dict(measures(optimum.file.values))
    slopes = optimum.sensitivities()
    moves = {p: 0.01 * goal.factor * float(numbers[p]) * x for p, x in slopes.items()}
    order = sorted(moves, key=lambda p: -abs(moves[p]))[:count]
    rows = [("increase by 1 %", f"change of {label(goal.name, goal.unit)}")]
    return aligned([*rows, *((p, f"{moves[p]:+.4g}") for p in order if moves[p] != 0.0)])


def _or_dash(x: float) -> str:
    return "-" if math.isnan(x) else number(x)
