"""Reports of a campaign besides its table: a run in detail, the failed runs, and the methods
without many runs."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from ...core.text import aligned
from ...dispersion.comparison import Comparison
from ...dispersion.covariance import MONTE_CARLO, Moments
from ...dispersion.replay import Replay
from ...simulation import Status
from ...statistics import Dispersion
from .._scene_file import SceneFile
from ..units import in_unit
from .rows import Row, drift_rows, number, state_rows, status_line

# Marks of a doubtful number, and of an absent one.
WARNING, NO_NUMBER = "warning", "none"


def replay_report(file: SceneFile, run: Replay, dispersion: Dispersion | None) -> str:
    """One run of a campaign: its inputs compared with the nominal ones, its outputs compared with
    those of the store (`dispersion`), the state at the end of every phase, and the final status."""
    rows = [("input", "unit", "nominal", "this run")]
    for name, value in run.inputs.items():
        unit, factor, nominal = "", 1.0, ""
        if name in file.inputs:
            given = file.inputs[name].nominal
            # In the unit in which the file gives the number.
            unit = given.unit or file.units.of(name, given.quantity.unit)
            factor = in_unit(given.quantity.unit, unit)
            nominal = number(factor * float(given))
        rows.append((name, unit, nominal, number(factor * value)))
    lines = [f"{file.title}: run {run.number}, seed {run.seed}", "", aligned(rows)]
    stored = _row_of(dispersion, run.number)
    rows = [("output", "unit", "stored", "repeated")]
    for spec in file.outputs:
        there = number(stored[spec.name]) if spec.name in stored else "-"
        rows.append((spec.name, spec.unit, there, number(run.outputs[spec.name])))
    lines += ["", aligned(rows)]
    clock = file.units.of("end", "s")
    factor = in_unit("s", clock)
    for name, phase in run.trajectory.items():
        first, last = (number(factor * float(t)) for t in (phase.ts[0], phase.ts[-1]))
        lines += ["", f"{name}: from {first} {clock} to {last} {clock}"]
        # A controller changes invariants of the system, so that a drift is not an error.
        drift = phase.drift() if phase.control is None else {}
        lines.append(aligned([*state_rows(phase.final, file.units), *drift_rows(drift)]))
    return "\n".join([*lines, "", f"{status_line(run.status)} {run.refusal}".rstrip()])


def _row_of(dispersion: Dispersion | None, run: int) -> dict[str, float]:
    """The outputs of a run in a store; empty if the store does not have it."""
    if dispersion is None or dispersion.numbers is None:
        return {}
    where = np.flatnonzero(dispersion.numbers == run)
    if not where.size:
        return {}
    return {name: float(x[where[0]]) for name, x in dispersion.outputs.items()}


def failures_report(file: SceneFile | None, dispersion: Dispersion, most: int = 20) -> str:
    """The failed runs of a store by status: number and reason of each, up to `most` of a kind, with
    a remedy; and the successful runs with an output that is not finite.

    `file`: the scene of the store, which determines the inputs that are out of range in a rejected
    run."""
    numbers = np.arange(dispersion.runs) if dispersion.numbers is None else dispersion.numbers
    lines = [f"{int(np.count_nonzero(dispersion.good))} of {dispersion.runs} runs succeeded."]
    lines += [dispersion.missing_runs] if dispersion.missing_runs else []
    # Read once, because each column comes from the disk.
    inputs = dict(dispersion.inputs) if dispersion.failed else {}
    moments = {name: (float(np.mean(x)), float(np.std(x))) for name, x in inputs.items()}
    for failure in dispersion.failed:
        rows = np.flatnonzero(dispersion.status == failure.status)
        runs = "run" if failure.count == 1 else "runs"
        lines += ["", f"{failure.count} {runs}, {failure.status.name}: {failure.sentence}"]
        for row in rows[:most]:
            values = {name: float(x[row]) for name, x in inputs.items()}
            # The cause of a rejection is known; for other failures unusual inputs are the best
            # clue.
            refused = failure.status == Status.REFUSED
            reason = _refusal(file, values) if refused else _farthest(values, moments)
            lines.append(f"  run {numbers[row]}: {reason}")
        lines += _rest(rows.size, most)
    undefined = {name: np.isnan(x) & dispersion.good for name, x in dispersion.outputs.items()}
    rows = np.flatnonzero(np.any(list(undefined.values()), axis=0))
    if rows.size:
        runs = "run" if rows.size == 1 else "runs"
        lines += ["", f"{rows.size} {runs} succeeded with an output that is not finite:"]
        for row in rows[:most]:
            names = [name for name, where in undefined.items() if where[row]]
            verb = "is" if len(names) == 1 else "are"
            lines.append(f"  run {numbers[row]}: {', '.join(names)} {verb} not finite.")
        lines += _rest(rows.size, most)
    return "\n".join(lines)


def _rest(count: int, most: int) -> list[str]:
    """The line for those of a list that it does not show."""
    return [f"  and {count - most} more (use --all to list them)"] if count > most else []


def _refusal(file: SceneFile | None, inputs: dict[str, float]) -> str:
    for name, how in (file.inputs if file is not None else {}).items():
        limit = how.nominal.quantity
        if not np.all(limit.contains(np.asarray(inputs[name]))):
            value = f"{inputs[name]:.6g} {limit.unit}".rstrip()
            return f"{name} is {value}: it must be {limit.allowed()}."
    return "an input is out of its range."


def _farthest(
    inputs: dict[str, float], moments: Mapping[str, tuple[float, float]], count: int = 2
) -> str:
    """The inputs farthest from the mean of all runs, in standard deviations."""
    off = {
        name: (value - moments[name][0]) / moments[name][1]
        for name, value in inputs.items()
        # A constant input is not a cause, and has no standard deviation to divide by.
        if moments[name][1] > 0.0
    }
    most = sorted(off, key=lambda name: -abs(off[name]))[:count]
    return ", ".join(f"{name} is {inputs[name]:.6g} ({off[name]:+.1f} sigma)" for name in most)


def comparison_table(rows: Sequence[Comparison]) -> str:
    """Comparison of the cheaper methods with Monte Carlo: deviation, number of runs and time; the
    sampling error of the Monte Carlo reference; and a warning next to each unreliable number, with
    its reason below."""
    shown: list[Row] = [
        (
            "output",
            "method",
            "mean",
            "error of mean",
            "std dev",
            "error of std dev",
            "runs",
            "seconds",
            "",
        )
    ]
    for c in rows:
        word = WARNING if c.warning else ""
        if not math.isfinite(c.mean + c.std):
            empty = (NO_NUMBER,) * 4
            shown.append((c.output, c.method, *empty, str(c.runs), f"{c.seconds:.2g}", word))
            continue
        # The errors of Monte Carlo are standard errors, which have no sign.
        sign = "±" if c.method == MONTE_CARLO else "+" if c.mean_error >= 0.0 else "-"
        off = f"{sign}{abs(c.mean_error):.3f} std dev"
        sign = "±" if c.method == MONTE_CARLO else "+" if c.std_error >= 0.0 else "-"
        more = f"{sign}{100.0 * abs(c.std_error):.2f} %"
        # Digits below a percent of the standard deviation would show the error of the method.
        mean, std = number(c.mean, 0.01 * c.std), number(c.std, 0.01 * c.std)
        took = f"{c.seconds:.2g}"
        shown.append((c.output, c.method, mean, off, std, more, str(c.runs), took, word))
    warnings = [f"{WARNING}: {c.output}, {c.method}: {c.warning}" for c in rows if c.warning]
    return "\n".join([aligned(shown), *([""] if warnings else []), *warnings])


def moments_report(
    title: str, moments: Moments, units: Mapping[str, str], nominal: Mapping[str, tuple[float, str]]
) -> str:
    """Mean and standard deviation of every output from a method without many runs, with a warning
    next to those contradicted by a sample of runs, and its reason below.

    **Arguments**

    - `title`: the first line.
    - `moments`: the moments.
    - `units`: of the outputs, by name.
    - `nominal`: values of the nominal run, with their units, by name."""
    rows: list[Row] = [("output", "unit", "nominal", "mean", "std dev", "")]
    for k, name in enumerate(moments.names):
        std = moments.std(name)
        numbers = (nominal[name][0], float(moments.mean[k]), std)
        cells = (number(x, 0.01 * std) if math.isfinite(x) else NO_NUMBER for x in numbers)
        word = WARNING if name in moments.warnings else ""
        rows.append((name, units.get(name, ""), *cells, word))
    warnings = [f"{WARNING}: {name}: {words}" for name, words in moments.warnings.items()]
    runs = "run" if moments.runs == 1 else "runs"
    return "\n".join(
        [
            f"{title}: {moments.method}",
            aligned(rows),
            "",
            *warnings,
            *([""] if warnings else []),
            f"{moments.runs} {runs}, {moments.seconds:.2g} s after compilation",
        ]
    )
