"""The tables of a campaign: its outputs, their extremes, requirements and causes, and how the runs
ended."""

from collections.abc import Mapping

import numpy as np

from ...core import InputError
from ...core.text import aligned
from ...statistics import Dispersion
from ...statistics.contributors import Contributors
from ...statistics.requirements import Verdict
from .rows import Row


def dispersion_report(
    result: Dispersion, nominal: Mapping[str, tuple[float, str]], count: int = 3
) -> str:
    """The outputs of a campaign: a table with their `nominal` values, their extremes, the violation
    rates of the requirements, the landing ellipses if any, the `count` main contributors to the
    variance of each output, and the final statuses of the runs. For a sweep, the table of its rows,
    the extremes and the final statuses."""
    if "sweep" in result.attributes:
        parts = [repr(result.by_row()), f"\nextremes and their runs\n{extreme_table(result)}"]
        return "\n".join([*parts, "", status_lines(result)])
    lines = [dispersion_table(result, nominal)]
    extremes = extreme_table(result)
    if extremes:
        lines.append(f"\nextremes and their runs\n{extremes}")
    requirements = requirement_table(result)
    if requirements:
        lines.append(f"\nrequirements\n{requirements}")
    landings = footprint_table(result)
    if landings:
        lines.append(f"\nlanding ellipses\n{landings}")
    shares = contributor_lines(result, count)
    if shares:
        lines.append(f"\ncontributions to the variance\n{shares}")
    return "\n".join([*lines, "", status_lines(result)])


def dispersion_table(result: Dispersion, nominal: Mapping[str, tuple[float, str]]) -> str:
    """Mean, standard deviation and 99 % limits of every output, with its nominal value and, where
    known, its numerical error; below it a line for each output that is not finite in successful
    runs, and one for a tolerance determined by purpose."""
    rows: list[Row] = [("output", "unit", "nominal", "mean", "std dev", "0.5 %", "99.5 %")]
    table = result.table()
    # Known of most campaigns; without any the column would be empty.
    known = any(row.numerical_words for row in table)
    rows[0] = (*rows[0], "numerical error") if known else rows[0]
    for row in table:
        numbers = [row.shown(x) for x in (row.mean, row.std, row.low, row.high)]
        # An output that was given in Python has no nominal value here.
        nominal_value = row.shown(nominal[row.name][0]) if row.name in nominal else "-"
        errors = [row.numerical_words or "-"] if known else []
        rows.append((row.name, row.unit, nominal_value, *numbers, *errors))
    warnings = [sentence for row in table if (sentence := row.warning)]
    warnings += [] if result.purpose is None else [result.purpose.sentence]
    return "\n".join([aligned(rows), *([""] if warnings else []), *warnings])


def extreme_table(result: Dispersion) -> str:
    """The least and the greatest value of every output, each with the number of its run; empty
    where no run succeeded."""
    rows: list[Row] = [("output", "unit", "least", "run", "greatest", "run")]
    for row in result.table():
        if row.min_run >= 0:
            ends = ((row.min, row.min_run), (row.max, row.max_run))
            cells = [cell for x, run in ends for cell in (row.shown(x), str(run))]
            rows.append((row.name, row.unit, *cells))
    return aligned(rows) if len(rows) > 1 else ""


def requirement_table(result: Dispersion) -> str:
    """The violation rate of each requirement, with its interval, and the verdict where a share is
    allowed; empty without requirements. A failed run counts as a violation."""
    verdicts = result.verdicts
    heads = ("output", "required", "violated", "share", "interval", "confidence")
    rows: list[Row] = [(*heads, "allowed", "verdict") if verdicts else heads]
    for name, violation in result.violations().items():
        required = f"{result.required(name)} {result.units.get(name, '')}".rstrip()
        share, low, high = (
            f"{100.0 * x:.3g} %" for x in (violation.value, violation.low, violation.high)
        )
        count = f"{violation.count} of {violation.runs}"
        cells = (name, required, count, share, f"{low} to {high}", _percent(violation.confidence))
        if name in verdicts:
            cells = (*cells, _percent(verdicts[name].allowed), verdicts[name].word)
        rows.append((*cells, *[""] * (len(rows[0]) - len(cells))))
    if len(rows) == 1:
        return ""
    return "\n".join([aligned(rows), *_runs_that_decide(verdicts)])


def _runs_that_decide(verdicts: Mapping[str, Verdict]) -> list[str]:
    """A line for each verdict that is not yet known: how many runs would decide it."""
    lines = []
    for name, verdict in verdicts.items():
        if verdict.word == "not yet known":
            share, allowed = _percent(round(verdict.violation.value, 6)), _percent(verdict.allowed)
            lines.append(
                f"{name}: about {verdict.runs_needed} runs decide if {share} of them violate it."
                if verdict.runs_needed is not None
                else f"{name}: more runs do not decide, because {share} of them violate it and "
                f"{allowed} are allowed."
            )
    return lines


def _percent(share: float) -> str:
    return f"{100.0 * share:.6g} %"


def footprint_table(result: Dispersion) -> str:
    """The ellipses of the landings; empty without landings."""
    footprint = result.footprint()
    return "" if footprint is None else aligned(footprint.words)


def contributor_lines(result: Dispersion, count: int = 3) -> str:
    """For every output the main contributors to its variance, and the remainder; empty for too few
    runs."""
    # With fewer runs than coefficients the regression would explain anything.
    if np.count_nonzero(result.good) <= 2 * len(result.inputs) + 1:
        return ""
    rows = []
    for name in result.outputs:
        try:
            contributors = result.contributors(name, None)
        # Raised for an output that is finite in few of the runs.
        except InputError:
            rows.append((name, "too few runs in which it is finite"))
            continue
        rows.append((name, ", ".join(_causes(contributors, count))))
    width = max(len(name) for name, _ in rows)
    return "\n".join(
        f"{name.ljust(width)}  {text or 'no single contributor'}" for name, text in rows
    )


def _causes(contributors: Contributors, count: int) -> list[str]:
    """The largest shares as text, the sum of all other inputs, and the part not explained by
    individual inputs."""
    if not contributors.shares:
        return []
    listed = dict(list(contributors.shares.items())[:count])
    # Shares below a percent are noise of the sampling.
    listed = {path: share for path, share in listed.items() if share >= 0.01}
    others, rest = contributors.r_squared - sum(listed.values()), 1.0 - contributors.r_squared
    listed |= {"other inputs": others} if others >= 0.01 else {}
    causes = [f"{path} {100.0 * share:.0f} %" for path, share in listed.items()]
    if rest >= 0.01:
        causes.append(f"interactions and nonlinear terms {100.0 * rest:.0f} %")
    return causes


def status_lines(result: Dispersion) -> str:
    """The numbers of successful and missing runs, the failures with their messages, and the reason
    why the campaign ended."""
    lines = [f"{int(np.count_nonzero(result.good))} of {result.runs} runs succeeded."]
    lines += [result.missing_runs] if result.missing_runs else []
    lines += [
        f"{f.count} {'run' if f.count == 1 else 'runs'} failed: {f.sentence}" for f in result.failed
    ]
    planned = int(result.attributes.get("planned_runs", result.runs))
    if result.runs < planned and "design: LatinHypercube" in str(result.attributes.get("inputs")):
        lines.append(
            f"These are {result.runs} of {planned} runs of a Latin hypercube: only the complete "
            "set is evenly distributed."
        )
    lines += [result.ending] if result.ending else []
    return "\n".join(lines)
