"""The page of the manual that shows the results kept beside this file, and its pictures."""

import math
import re
from pathlib import Path

from jaxspace.plots._style import COLOURS, dress

from . import result_files

PAGE = Path(__file__).parents[1] / "docs" / "benchmarks.md"
SPEED = "runs_per_second"
ERRORS = ("worst_relative_error", "worst_error_of_the_rate")
# Stands at the end of a row's name; the rest names the method.
SETTING = re.compile(r",? \d+e[-+]\d+$|, [\d.]+ (steps|a revolution|s)$")
HEAD = """# Benchmarks: speed and accuracy

`make bench` runs these measurements and writes this page. All methods perform the same task in one
process, in turn. The values are medians; the first call, which compiles, is listed separately.
The column `cores` is the average number of cores used. Values per CPU second compare methods that
use different numbers of cores; they are inaccurate if a call is shorter than the resolution of the
CPU clock. Errors are those of the worst run. Results depend on the machine: compare within a
column.

The instruction set of the processor determines most results. Most servers and desktops support
AVX2; some support AVX-512, with twice as wide vectors and twice as many registers. Each table
contains the results of the first machine that is listed below it; rates for another instruction
set, if measured, are in the last columns. "avx2 of avx512" is a processor with AVX-512 whose wide
vectors were disabled for jaxspace; the other libraries in that column use them.
"""


def _cell(value: object) -> str:
    if not isinstance(value, float):
        return "" if value is None else str(value)
    if math.isnan(value):
        return "-"
    if 1e3 <= abs(value) < 1e6:
        return f"{float(f'{value:.3g}'):.0f}"
    return f"{value:.3g}"


def table(rows: dict) -> str:
    """The rows as a Markdown table, with a column for every quantity that a row has."""
    columns = list(dict.fromkeys(key for row in rows.values() for key in row))
    # Those of other instructions stand last.
    columns.sort(
        key=lambda column: column.endswith(tuple(f", {x}" for x in result_files.SETS.values()))
    )
    lines = [
        "| | " + " | ".join(c.replace("_", " ") for c in columns) + " |",
        "|---" * (len(columns) + 1) + "|",
    ]
    lines += [
        f"| {name} | " + " | ".join(_cell(row.get(c)) for c in columns) + " |"
        for name, row in rows.items()
    ]
    return "\n".join(lines)


def _diagram(name: str, rows: dict) -> str:
    """Draw speed against error where there are both, and return the line of the page that shows
    it."""
    error = next((e for e in ERRORS if sum(e in row for row in rows.values()) > 2), None)
    measured = [row for row in rows.values() if error in row]
    speed = next((s for s in (SPEED, "seconds") if all(s in row for row in measured)), None)
    if error is None or speed is None:
        return ""
    from matplotlib.figure import Figure
    from matplotlib.ticker import NullFormatter

    series: dict[str, list[tuple[float, float]]] = {}
    for label, row in rows.items():
        if row.get(error):
            series.setdefault(SETTING.sub("", label), []).append((row[error], row[speed]))
    figure = Figure(figsize=(7.2, 3.9), layout="constrained")
    axes = figure.subplots()
    for i, (label, points) in enumerate(series.items()):
        style = {
            "marker": "o" if "ours" in label else "s",
            "linestyle": "-" if "ours" in label else "--",
        }
        if i >= len(COLOURS):
            # The colours begin again.
            style["marker"] = "^"
        axes.loglog(
            *zip(*sorted(points), strict=True),
            label=label,
            color=COLOURS[i % len(COLOURS)],
            markersize=5,
            **style,
        )
    dress(
        axes, name.replace("_", " ").capitalize(), "error of the worst run", speed.replace("_", " ")
    )
    axes.invert_xaxis()
    # Numbers between the decades run into each other.
    axes.xaxis.set_minor_formatter(NullFormatter())
    figure.legend(
        *axes.get_legend_handles_labels(), fontsize=8, loc="outside right center", frameon=False
    )
    figure.savefig(PAGE.parent / "figures" / f"benchmark_{name}.png", dpi=130)
    return f"![Speed against error](figures/benchmark_{name}.png)\n\n"


def _by_width(name: str, rows: dict) -> str:
    """Draw the rates of an accelerator over the number of runs, and return the line of the page
    that shows them."""
    from matplotlib.figure import Figure

    series: dict[tuple[str, str], list[tuple[int, float]]] = {}
    for label, row in rows.items():
        work, runs, precision = label.rsplit(", ", 2)
        series.setdefault((work, precision), []).append((int(runs.split()[0]), row[SPEED]))
    figure = Figure(figsize=(7.2, 4.4), layout="constrained")
    axes = figure.subplots()
    works = list(dict.fromkeys(work for work, _ in series))
    for (work, precision), points in series.items():
        i, double = works.index(work), precision == "float64"
        axes.loglog(
            *zip(*points, strict=True),
            label=work if double else None,
            color=COLOURS[i % len(COLOURS)],
            marker="^" if i >= len(COLOURS) else "o",
            linestyle="-" if double else ":",
            markersize=5,
        )
    dress(axes, "Rates in double precision, and in single (dotted)", "runs", "runs per second")
    figure.legend(fontsize=8, loc="outside right center", frameon=False)
    figure.savefig(PAGE.parent / "figures" / f"benchmark_{name}.png", dpi=130)
    return f"![Rate against width](figures/benchmark_{name}.png)\n\n"


def _by_evaluations(name: str, rows: dict) -> str:
    """Draw evaluations against error, one panel a case, and return the line of the page that shows
    them."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import LogLocator, NullFormatter

    cases: dict[str, dict[str, list[tuple[float, float]]]] = {}
    for label, row in rows.items():
        case, setting = label.split(": ")
        series = cases.setdefault(case, {}).setdefault(setting.rsplit(" ", 1)[0], [])
        series.append((row["worst_relative_error"], row["evaluations_a_run"]))
    methods = list(dict.fromkeys(method for series in cases.values() for method in series))
    # Of the size at which the page shows it, so that its numbers can be read there.
    figure = Figure(figsize=(7.2, 5.8), layout="constrained")
    figure.get_layout_engine().set(hspace=0.06)
    for axes, (case, series) in zip(figure.subplots(2, 2).flat, cases.items(), strict=True):
        for method, points in series.items():
            colour = COLOURS[methods.index(method)]
            axes.loglog(*zip(*points, strict=True), "o-", label=method, color=colour, markersize=5)
        dress(axes, case, "error of the worst run", "evaluations a run")
        axes.invert_xaxis()
        # Numbers between the decades run into each other.
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.yaxis.set_minor_formatter(NullFormatter())
        axes.xaxis.set_major_locator(LogLocator(numticks=6))
    # One for all panels, as the colours are: within a panel it would lie on a line.
    lines = {line.get_label(): line for axes in figure.axes for line in axes.get_lines()}
    figure.legend(lines.values(), lines, loc="outside lower center", ncols=3, frameon=False)
    figure.savefig(PAGE.parent / "figures" / f"benchmark_{name}.png", dpi=140)
    return f"![Evaluations against error](figures/benchmark_{name}.png)\n\n"


DIAGRAMS = {"accelerator_gpu": _by_width, "which_method": _by_evaluations}
"""How the results of a benchmark are drawn, where not by speed against error."""


def _beside(rows: dict, others: dict[str, dict]) -> dict:
    """The rows with the rates, or the times, that the same rows have with other instructions."""
    found = {label: dict(row) for label, row in rows.items()}
    for kind, other in others.items():
        for label, row in other["rows"].items():
            for of in (SPEED, "seconds"):
                if of in row and label in found:
                    column = f"{of.replace('_', ' ')}, {result_files.SETS[kind]}"
                    found[label][column] = row[of]
                    break
    return found


def write(names: tuple[str, ...]) -> None:
    """Write the page from the results that there are."""
    parts = [HEAD]
    for name in names:
        by_set = result_files.read(name)
        if not by_set:
            continue
        (_, seen), *others = by_set.items()
        where = "; ".join(
            f"{result_files.SETS[k]}: " + ", ".join(f"{key} {v}" for key, v in s["machine"].items())
            for k, s in by_set.items()
        )
        title = name.replace("_", " ").capitalize()
        what = " ".join(seen["what"].split())
        picture = DIAGRAMS.get(name, _diagram)(name, seen["rows"])
        rows = table(_beside(seen["rows"], dict(others)))
        parts.append(f"## {title}\n\n{what}\n\n{picture}{rows}\n\n*{where}*\n")
    PAGE.write_text("\n".join(parts))
