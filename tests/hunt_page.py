"""What the hunt found: `hunt.json`, and the page `docs/explanation/hunt.md` of it."""

import json
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from forms.public import left_out, public_names

PAGE = Path(__file__).parents[1] / "docs" / "explanation" / "hunt.md"
RECORD = Path(__file__).parent / "hunt.json"
# From here on the inputs are shown.
SHOWN = 30.0
DEFECT = 100.0

HEAD = """# The hunt

`make hunt` searches for the inputs at which the formulas are worst, and writes this page. Errors
are in roundings (2.2e-16) times the condition number of the place: what the rounding of the
inputs alone does is about 1, and more than 100 is a defect. A vector is rounded by its length: a
component that is nearly zero is that in one set of axes alone.

{summary}

## How it is measured

For each function the search takes random inputs, on and close to its singular places too, and
steps from the worst ones to worse ones. `python tests/hunt.py --seconds 60 NAME` searches longer.

The truth is an evaluation of the same formulas in forty digits. Derivatives, those of forward and
of reverse mode, are compared with central differences in sixty digits, each times its input.
Outputs of one kind are measured by the largest of them. This sees every rounding, cancellation
and overflow, and every wrong rule of a derivative. It does not see the truncation of a series, a
quadrature or a fixed number of steps, which it repeats: the [hard
cases](../reference/hard_cases.md), whose truths come from other formulas, do. Next to a singular
place the condition of a derivative is an estimate.
"""
TABLE = """
| Function | Places | Value | Places | Derivatives |
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
    "vehicles": "Vehicles in air",
    "control": "Control",
    "optimization": "Optimal flight",
}
SYSTEMS = "Vector fields and invariants of systems"
# What is known of the worst places, by the name of the function.
NOTES: dict[str, str] = {
    "stable_platform": "four gimbals turn three axes: the inertia of one counts against that of "
    "the platform",
    "looking": "in the zenith the sine of the elevation is greatest: what is left of its "
    "derivative is one rounding of the value",
    **dict.fromkeys(
        ("gyropendulum_motion", "rate_gyro_response", "error_motion", "compass"),
        "the exponential of A t loses a rounding of its norm |A t|, not only of its condition",
    ),
    "gyro_rates": "the outer rate is left of a momentum of which the spin has nearly all",
    "kepler": "a flyby from afar, whose derivatives by the velocity lose up to two digits",
    "impulse": "a difference of elements: `first_order=True` keeps the digits of a small impulse",
    "burning_stage": "of a mass far below the dry mass, which no run has: inertias cancel",
    "rolling_disk": "the disk lies flat, where it has no point of contact",
    "between_turns": "where both turning points meet, two digits of the derivatives",
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
    parts.append(
        "\n## The worst places\n\nWhere a figure above is over 30, and at which inputs:\n\n"
    )
    parts += [_place(r) for r in rows if max(r.value, r.slopes) > SHOWN] or ["- None.\n"]
    parts.append("\n## Left out\n\nPublic names without an error to search for:\n\n")
    hunted = {name for r in rows for name in r.computes}
    for why, names in left_out(public_names() - hunted).items():
        listed = ", ".join(f"`{name}`" for name in names)
        parts.append(f"- What {why}: {listed}.\n")
    if missing:
        parts.append(f"\nStill to be searched by `make hunt`: {', '.join(missing)}.\n")
    return "".join(parts)


def _summary(rows) -> str:
    places = sum(r.places for r in rows)
    over = [[r for r in rows if x(r) > DEFECT] for x in (lambda r: r.value, lambda r: r.slopes)]
    counts = [f"{len(some)} of them ({_listed(some)})" if some else "none" for some in over]
    rest = [
        max((x(r) for r in rows if x(r) <= DEFECT), default=0.0)
        for x in (lambda r: r.value, lambda r: r.slopes)
    ]
    return (
        f"The last search looked at {len(rows)} functions and systems, at {places:,} places. Over "
        f"100 in value: {counts[0]}; over 100 in a derivative: {counts[1]}. The others are within "
        f"{figure(rest[0])} in value and {figure(rest[1])} in derivatives."
    )


def _listed(rows) -> str:
    return ", ".join(f"`{r.name}`" for r in rows)


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
