"""Reports of a run of a file: states, outputs, drifts and errors, in its units."""

import math
from collections.abc import Sequence

import jax
import numpy as np

from ...control import LoopRun
from ...core.text import aligned
from ...simulation import MissionTrajectory, Trajectory
from ...simulation.mission_result import BranchEnd, Simulated
from .._kinds.kind import Value
from .._requests.final_error import Written, named_blocks, tolerance_of
from .._scene_file import SceneFile
from ..by_numpy import by_numpy
from .rows import drift_rows, error_rows, number, output_rows, state_rows, status_line


@by_numpy()
def run_report(file: SceneFile, run: Trajectory | LoopRun) -> str:
    """The end of a run of a system or a scene: time, state, outputs, drifts, errors, status."""
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
    """Report of a mission, phase by phase. `finer`: the same at a tighter tolerance, from which the
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
    """The end of a mission or a branch, with its `outputs`, and the errors, from a `finer` run."""
    error = jax.tree.map(np.subtract, run.final, finer.final)
    rows = [("time [s]", number(run.end)), *state_rows(run.final, file.units, error)]
    return aligned([*rows, *outputs, *error_rows(error, file.units)])


def final_error_rows(value: Value, run: Simulated | LoopRun) -> list[tuple[str, str]]:
    """The requested error, the estimated error, the required accuracy, and the cost of other
    errors.

    **Arguments**

    - `value`: that of `final_error`; no rows without it.
    - `run`: the nominal run."""
    if value is None or isinstance(run, LoopRun):
        return []
    stats = {name: np.asarray(x) for name, x in run.phases[-1].stats.items()}
    estimate, price = float(stats["final_error"]), float(stats["final_error_price"])
    runs, spent = int(stats["final_error_runs"]), int(stats["final_error_evaluations"])

    def listed(factor: float) -> str:
        if isinstance(value, Written):
            return f"{value.text(factor)} of every part of the state"
        return ", ".join(f"{name} {x.text(factor)}" for name, x in named_blocks(value).items())

    rows = [("requested final error", listed(1.0))]
    if all(phase.config.method == "closed_form" for phase in run.phases):
        return [
            *rows,
            ("estimated final error", f"{listed(estimate)}, the rounding error of a closed form"),
        ]
    rows.append(("estimated final error", listed(estimate)))
    # The searched tolerance itself, of which campaigns take two digits.
    tolerance = tolerance_of(run.phases[-1])
    found = f"{tolerance:.2g}, found with {runs} runs and {spent} evaluations in total"
    rows.append(("required accuracy", found))
    if math.isfinite(price):
        rows.append(("a tenth of this estimate", f"{price:.2g} times the evaluations of a run"))
        rows.append(
            ("ten times this estimate", f"{100.0 * (1.0 - 1.0 / price):.0f} % fewer evaluations")
        )
    return rows
