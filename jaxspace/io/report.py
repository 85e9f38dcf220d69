"""Reports of a run of a file: states, outputs, errors and tables, in its units."""

import math
from collections.abc import Mapping, Sequence
from typing import SupportsFloat, SupportsInt

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import PyTree

from ..control import LoopRun
from ..core import State
from ..core.quantities import quantities
from ..core.text import aligned
from ..rotations import Quaternion, to_euler_angles
from ..simulation import MissionTrajectory, Status, Trajectory
from ..simulation.mission_result import BranchEnd
from ._build import replaced
from ._final_error import final_error_rows
from ._inputs import measures
from ._optimum import Optimum
from ._output_entries import applicable_outputs
from ._scene_file import SceneFile
from ._search_task import values_of
from .by_numpy import by_numpy
from .units import WrittenUnits, in_unit

Row = tuple[str, ...]
# One program: outside of `jit` each of its operations would be compiled by itself.
_euler_angles = jax.jit(to_euler_angles)
# Smallest relative error that is shown, because of the rounding of a long run.
MOST_DIGITS = 12
# Outputs of each phase in the table of an optimum, if the file has their arguments.
OF_PHASES = ("end_time", "altitude", "radius", "speed", "radial_speed")


def number(x: SupportsFloat, error: float = math.nan) -> str:
    """A number with the digits that it has: down to its `error`, or six significant ones if that
    is not known."""
    x = float(x)
    # Digits below the error have no meaning.
    if math.isfinite(x) and 0.0 < error < math.inf and abs(x) < 1e15:
        whole = math.floor(math.log10(abs(x))) + 1 if x else 0
        decimals = min(math.ceil(-math.log10(error)), MOST_DIGITS - max(whole, 0))
        text = f"{x:.{max(decimals, 0)}f}"
        # Not "-0.00", which a rounded negative number gives.
        return "0" if float(text) == 0.0 else text
    return "0" if abs(x) < 1e-10 else f"{x:.6g}"


def state_rows(
    y: State, units: WrittenUnits, error: PyTree[ArrayLike] | None = None
) -> list[tuple[str, str]]:
    """Names with units, and values, of the parts of a state.

    **Arguments**

    - `units`: those of the file, to report in.
    - `error`: the error of the state, if it is known: it decides on the digits.
    """
    rows = []
    for name, declared in quantities(type(y)).items():
        part = getattr(y, name)
        if part is None:
            continue
        unit = units.of(name, declared.unit)
        factor = in_unit(declared.unit, unit)
        miss = math.nan if error is None else factor * _largest(getattr(error, name))
        if isinstance(part, Quaternion):
            # With Euler's angles, in the angle unit of the file, because a quaternion is hard to
            # read.
            angle = units.of(name, "rad")
            turned = in_unit("rad", angle) * np.asarray(_euler_angles(part))
            rows.append((name, _listed(part.wxyz, miss)))
            rows.append((f"Euler angles 3-1-3 [{angle}]", _listed(turned)))
        else:
            rows.append((_label(name, unit), _listed(factor * np.asarray(part), miss)))
    return rows


def error_rows(error: PyTree[ArrayLike], units: WrittenUnits) -> list[tuple[str, str]]:
    """The largest component of the error of every part, with its unit."""
    rows = []
    for name, declared in quantities(type(error)).items():
        part = getattr(error, name)
        if part is not None:
            unit = units.of(name, declared.unit)
            size = in_unit(declared.unit, unit) * _largest(part)
            rows.append((_label(f"error of {name}", unit), _rough(size)))
    return rows


def drift_rows(drift: Mapping[str, ArrayLike]) -> list[tuple[str, str]]:
    """The largest relative change of every invariant."""
    return [
        (f"drift of {name.replace('_', ' ')}", _rough(float(np.max(np.abs(d)))))
        for name, d in drift.items()
    ]


def output_rows(outputs: Mapping[str, tuple[float, str]]) -> list[tuple[str, str]]:
    """Names with units, and values, of outputs."""
    return [(_label(name, unit), number(value)) for name, (value, unit) in outputs.items()]


@by_numpy()
def run_report(file: SceneFile, run: Trajectory | LoopRun) -> str:
    """How a run of a system or a scene ended: time, state, outputs, drifts, errors, status."""
    error = run.error()
    rows = [("time [s]", number(run.ts[-1])), *state_rows(run.final, file.units, error)]
    rows += output_rows(file.nominal_outputs(run, every=True))
    # Under a controller nothing is conserved, whatever the scene alone conserves.
    drift = run.drift() if isinstance(run, Trajectory) else {}
    checks = [*drift_rows(drift), *error_rows(error, file.units)]
    asked = final_error_rows(file.values["final_error"], run)
    tables = [aligned(table) for table in (rows, checks, asked) if table]
    return "\n".join([file.title, *tables, status_line(run.status)])


@by_numpy()
def mission_report(file: SceneFile, run: MissionTrajectory, finer: MissionTrajectory) -> str:
    """How a mission went, phase by phase. `finer`: the same at a tighter tolerance, from which the
    errors follow."""
    lines = [file.title]
    for name, phase in run.items():
        ts = np.asarray(phase.ts)
        lines.append(f"\n{name}: from {number(ts[0])} s to {number(ts[-1])} s")
        drift = phase.drift() if phase.control is None else {}
        lines.append(aligned([*state_rows(phase.final, file.units), *drift_rows(drift)]))
    outputs = output_rows(file.nominal_outputs(run, every=True))
    lines += ["\nat the end, after the last jump", _end_table(file, run, finer, outputs)]
    for name, end, other in zip(run.branch_names, run.branches, finer.branches, strict=True):
        lines += [f"\nat the end of {name}, after its last jump", _end_table(file, end, other)]
    if asked := final_error_rows(file.values["final_error"], run):
        lines += ["", aligned(asked)]
    return "\n".join([*lines, status_line(run.status)])


def _end_table(
    file: SceneFile,
    run: MissionTrajectory | BranchEnd,
    finer: MissionTrajectory | BranchEnd,
    outputs: Sequence[tuple[str, str]] = (),
) -> str:
    """How a mission or a branch ended, with its `outputs`, and the errors, from a `finer` run."""
    error = jax.tree.map(np.subtract, run.final, finer.final)
    rows = [("time [s]", number(run.end)), *state_rows(run.final, file.units, error)]
    return aligned([*rows, *outputs, *error_rows(error, file.units)])


def optimum_report(
    optimum: Optimum, confirmed: Sequence[float] = (), run: MissionTrajectory | None = None
) -> str:
    """The table of an optimum: objective, free numbers, constraints with their multipliers, and why
    the search ended.

    **Arguments**

    - `confirmed`: the outputs as a run at the accuracy of the file has them.
    - `run`: that run, whose phases make one more table."""
    task, file = optimum.task, optimum.file
    # NaN is shown as a dash, where nothing has confirmed the optimum.
    checked = [*confirmed] or [math.nan] * (1 + len(task.demands))
    goal = task.objective
    verb = "least" if task.sign > 0.0 else "greatest"
    label = _label(f"{verb} {goal.name}", goal.unit)
    lines = [file.title, aligned([
        ("", "found", "confirmed"),
        (label, _or_dash(goal.factor * optimum.objective), _or_dash(goal.factor * checked[0])),
    ])]  # fmt: skip
    held = optimum.bound_derivatives
    rows: list[Row] = [("free", "start", "optimum", "low", "high", "slope")]
    for free in task.free:
        numbers = (free.start, optimum.values[free.path], free.low, free.high)
        # By its bound, where one holds it.
        slope = goal.factor * held[free.path] / free.factor if free.path in held else math.nan
        shown = (number(free.factor * x) for x in numbers)
        rows.append((f"{free.path} [{free.unit or '1'}]", *shown, _or_dash(slope)))
    lines.append(aligned(rows))
    rows = [("constraint", "", "target", "found", "confirmed", "slope")]
    derivatives = optimum.target_derivatives
    for k, demand in enumerate(task.demands):
        spec = demand.spec
        numbers = (demand.target, optimum.constraints[k], checked[k + 1])
        shown = [_or_dash(spec.factor * x) for x in numbers]
        # In the units that the table shows, above and below.
        slope = _or_dash(goal.factor * derivatives[k] / spec.factor)
        name = demand.limit.replace("_", " ")
        rows.append((_label(spec.name, spec.unit), name, *shown, slope))
    if task.demands:
        lines.append(aligned(rows))
    if not optimum.infeasible:
        lines.append(
            f"slope: change of {goal.name} [{goal.unit or '1'}] for one unit of the bound or target"
        )
    if run is not None:
        lines.append(aligned(_phase_rows(optimum, run)))
    lines.append(f"relative error of the steps: {optimum.error:.1e}")
    return "\n\n".join([*lines, optimum.sentence()])


def _phase_rows(optimum: Optimum, run: MissionTrajectory) -> list[Row]:
    """For each phase, how its run ended, before its jump: those of a few outputs that the file
    has all for."""
    file = optimum.file
    known = {s.name: s for s in applicable_outputs(file.parsed, file.units)}
    chosen = [known[name] for name in OF_PHASES if name in known]
    head = [_label(s.name, s.unit) for s in chosen]
    unit = file.units.of("mass", "kg")
    # A body without propellant has a constant mass, which is not in the state.
    heavy = getattr(run.final, "mass", None) is not None
    rows: list[Row] = [("phase", *head, *([_label("mass", unit)] if heavy else []))]
    numbers = replaced(file.values, {p: jnp.asarray(x) for p, x in optimum.values.items()})
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
    rows = [("one percent more of", f"moves {_label(goal.name, goal.unit)} by")]
    return aligned([*rows, *((p, f"{moves[p]:+.4g}") for p in order if moves[p] != 0.0)])


def _or_dash(x: float) -> str:
    return "-" if math.isnan(x) else number(x)


def status_line(status: SupportsInt) -> str:
    """The sentence of a status."""
    return Status(int(status)).sentence


def _label(name: str, unit: str) -> str:
    name = name.replace("_", " ")
    return f"{name} [{unit}]" if unit else name


def _rough(x: float) -> str:
    """A size of an error: of what is exact a zero."""
    return f"{x:.1e}" if x else "0"


def _largest(tree: PyTree[ArrayLike]) -> float:
    return max(float(np.max(np.abs(np.asarray(leaf)))) for leaf in jax.tree.leaves(tree))


def _listed(xs: ArrayLike, error: float = math.nan) -> str:
    return ", ".join(number(x, error) for x in np.asarray(xs).reshape(-1))
