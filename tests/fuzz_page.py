"""The results of the fuzz test: `fuzz_errors.json`, and their page
`docs/explanation/fuzz_testing.md`."""

import json
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from forms.public import left_out, public_names

PAGE = Path(__file__).parents[1] / "docs" / "explanation" / "fuzz_testing.md"
RECORD = Path(__file__).parent / "fuzz_errors.json"
# From here on the inputs are shown.
SHOWN = 30.0
DEFECT = 100.0

HEAD = """# Fuzz testing

`make fuzz` searches all formulas for the inputs with the largest numerical errors, and writes this
page. Errors are in units of the rounding error (2.2e-16) times the condition number: the
effect of rounding the inputs is about 1, and a value above 100 is a defect. The rounding error of a
vector is relative to its norm, because a component that is nearly zero depends on the choice of
axes.

{summary}

## Method

For each function the search evaluates random inputs, including inputs at and near its
singularities, and continues from the worst ones to inputs with larger errors.
`python tests/fuzz_errors.py --seconds 60 NAME` extends the search for one function.

The reference is an evaluation of the same formulas with forty digits. Forward- and reverse-mode
derivatives are compared with central differences with sixty digits, each multiplied by its input.
Outputs of the same kind are measured relative to the largest of them. This detects every rounding
error, cancellation and overflow, and every incorrect derivative rule. It does not detect the
truncation error of a series, a quadrature or a fixed number of steps, because the reference uses
the same formulas. These errors are detected by the
[edge cases](https://jaxspace.github.io/jaxspace/latest/reference/hard_cases/), whose references are
computed from other formulas. Near a singularity the condition number of a derivative
is an estimate.
"""
TABLE = """
| Function | Inputs | Value | Inputs | Derivatives |
|---|--:|--:|--:|--:|
"""
TITLES = {
    "core": "Functions without NaN, vectors",
    "rotations": "Rotations",
    "bodies": "Bodies",
    "orbits": "Orbits",
    "attitude": "Attitude",
    "gyros": "Gyros",
    "mechanics": "Mechanics",
    "rockets": "Rockets",
    "vehicles": "Rockets in air",
    "control": "Control",
    "optimization": "Optimisation",
}
SYSTEMS = "Vector fields and invariants of systems"
# Explanations of the worst inputs, by the name of the function.
NOTES: dict[str, str] = {
    "stable_platform": "four gimbals rotate three axes: the inertia of one cancels against that "
    "of the platform",
    "looking": "at the zenith the sine of the elevation is maximal, and its derivative is "
    "one rounding error of the value",
    **dict.fromkeys(
        ("gyropendulum_motion", "rate_gyro_response", "error_motion", "compass"),
        "the error of the exponential of A t is proportional to the norm |A t|",
    ),
    "gyro_rates": "the outer rate follows from a small difference between the momentum and that of "
    "the spin",
    "kepler": "a distant flyby, whose derivatives with respect to velocity lose up to two digits",
    "burning_stage": "a mass far below the dry mass, which no run reaches: inertias cancel",
    "rolling_disk": "a flat disk, whose contact point is undefined",
    "between_turns": "two digits of the derivatives are lost where both turning points coincide",
}


def keep(row: Any) -> None:
    """Put one row into the record."""
    record = {**stored(), row.name: vars(row)}
    lines = ",\n".join(f"{json.dumps(name)}: {json.dumps(x)}" for name, x in record.items())
    RECORD.write_text("{\n" + lines + "\n}\n")


def stored() -> dict[str, dict[str, Any]]:
    """The record: a row of each function."""
    return json.loads(RECORD.read_text()) if RECORD.exists() else {}


def write(names: Sequence[str]) -> None:
    """The page of these functions, in this order."""
    record = stored()
    rows = [SimpleNamespace(**record[name]) for name in names if name in record]
    PAGE.write_text(page(rows, [name for name in names if name not in record]))


def page(rows, missing: Sequence[str] = ()) -> str:
    """All rows, by package; then the worst places, and what is left out or still `missing`."""
    parts = [HEAD.format(summary=_summary(rows))]
    by_package = [
        (title, [r for r in rows if r.package == package]) for package, title in TITLES.items()
    ]
    for title, some in [*by_package, (SYSTEMS, [r for r in rows if r.package == "systems"])]:
        if some:
            lines = "\n".join(_row(r) for r in some)
            parts.append(f"\n## {title}\n{TABLE}{lines}\n")
    parts.append("\n## Worst inputs\n\nInputs with an error above 30:\n\n")
    parts += [_place(r) for r in rows if max(r.value, r.slopes) > SHOWN] or ["- None.\n"]
    parts.append(
        "\n## Excluded names\n\nPublic names that are excluded from the search, by reason:\n\n"
    )
    searched = {name for r in rows for name in r.computes}
    for why, names in left_out(public_names() - searched).items():
        listed = ", ".join(f"`{name}`" for name in names)
        parts.append(f"- {why[0].upper()}{why[1:]}: {listed}.\n")
    if missing:
        parts.append(f"\nNot yet searched by `make fuzz`: {', '.join(missing)}.\n")
    return "".join(parts)


def _summary(rows) -> str:
    places = sum(r.places for r in rows)
    over = [[r for r in rows if x(r) > DEFECT] for x in (lambda r: r.value, lambda r: r.slopes)]
    counts = [_counted(some) for some in over]
    rest = [
        max((x(r) for r in rows if x(r) <= DEFECT), default=0.0)
        for x in (lambda r: r.value, lambda r: r.slopes)
    ]
    return (
        f"The last search evaluated {len(rows)} functions and systems at {places:,} inputs. The "
        f"error of the value exceeds 100 for {counts[0]}, and that of a derivative for "
        f"{counts[1]}. The largest errors of the others are {figure(rest[0])} in the value and "
        f"{figure(rest[1])} in the derivatives."
    )


def _counted(rows) -> str:
    names = ", ".join(f"`{r.name}`" for r in rows)
    return f"{len(rows)} of them ({names})" if rows else "none of them"


def figure(number: float) -> str:
    """Two digits, and no power of ten below ten thousand."""
    return f"{float(f'{number:.2g}'):.0f}" if 99.5 <= number < 1e4 else f"{number:.2g}"


def _row(r) -> str:
    names = ", ".join(f"`{name.partition('.')[2]}`" for name in r.computes)
    names = f"{r.name}: {names}" if r.package == "systems" else f"{names} ({r.name})"
    cells = (names, r.places, figure(r.value), r.slope_places, figure(r.slopes))
    return "| " + " | ".join(map(str, cells)) + " |"


def _place(r) -> str:
    lines = [f"**{r.name}**" + (f": {NOTES[r.name]}" if r.name in NOTES else "")]
    for what, size, x in (
        ("value", r.value, r.inputs),
        ("derivatives", r.slopes, r.slope_inputs),
    ):
        if size > SHOWN:
            lines.append(f"{what} {figure(size)} at `({', '.join(f'{c:.17g}' for c in x)})`")
    return "- " + "; ".join(lines) + "\n"
