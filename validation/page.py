"""The page of the manual that shows the rows kept in `results`."""

import json
import math
from pathlib import Path

from ._row import JUDGED, Row

HERE = Path(__file__).parent
RESULTS = HERE / "results"
PAGE = HERE.parent / "docs" / "explanation" / "validation.md"

HEAD = """---
hide: [navigation, toc]
---

# Validation

`make validation` compares jaxspace with independent sources (check-cases, textbooks, published
optima and other programs) and writes this page. {summary}

Each row compares one quantity: the value of jaxspace, the reference value, their difference, and
the difference that the source allows, with its reason. For vectors and time histories it shows the
component or time with the largest difference. A row that is not within its limit is marked
**differs**, with an explanation. {judged}

Errors with respect to exact values are listed in [fuzz testing](fuzz_testing.md) and
[edge cases](https://jaxspace.github.io/jaxspace/latest/reference/hard_cases/), and final errors as
a function of the tolerance in [requested vs. achieved accuracy](requested.md).
"""
TABLE = """| Case | Source | Quantity | jaxspace | Reference | Difference | Allowed | |
|---|---|---|--:|--:|--:|--:|---|"""


def stored(name: str) -> list[Row]:
    """The rows of one group as last computed; none where it never was."""
    file = RESULTS / f"{name}.json"
    return [Row(**row) for row in json.loads(file.read_text())] if file.exists() else []


def keep(name: str, rows: list[Row]) -> None:
    """Put the rows of a group into the record."""
    RESULTS.mkdir(exist_ok=True)
    lines = ",\n".join(json.dumps(vars(row)) for row in rows)
    (RESULTS / f"{name}.json").write_text(f"[\n{lines}\n]\n")


def text(groups: dict[str, str]) -> str:
    """The page: a section of each group, from its name and its text, `## Title` first."""
    found = {name: stored(name) for name in groups}
    rows = [row for some in found.values() for row in some]
    parts = [HEAD.format(summary=_summary(rows), judged=_judged(rows))]
    for name, about in groups.items():
        if found[name]:
            parts.append(_section(about.strip(), found[name]))
    return "\n".join(parts)


def _summary(rows: list[Row]) -> str:
    apart = [row for row in rows if not row.agrees]
    if not apart:
        return f"All {len(rows)} rows agree with their source."
    return (
        f"Of {len(rows)} rows {len(rows) - len(apart)} agree with their source, and {len(apart)} "
        "differ."
    )


def _judged(rows: list[Row]) -> str:
    """What the rows prove whose limit no source gives."""
    judged = sum(row.why.startswith(JUDGED) for row in rows)
    return (
        "If a source states its digits, or several programs show how much they differ, the limit "
        f"follows from them. For {judged} rows the source does not determine a limit: the reason "
        "begins with *our judgement*, because the limit was chosen with knowledge of the "
        "difference. The verdict of such a row only expresses that the difference is considered "
        "small."
    )


def _section(about: str, rows: list[Row]) -> str:
    lines = [about, "", TABLE, *map(_line, rows), ""]
    lines.append("Allowed differences:\n")
    for why in dict.fromkeys(row.why for row in rows):
        names = dict.fromkeys(row.what for row in rows if row.why == why)
        lines.append(f"- {'; '.join(names)}: {why}.")
    for note in dict.fromkeys(row.note for row in rows if row.note):
        names = dict.fromkeys(row.what for row in rows if row.note == note)
        lines.append(f"\n**{'; '.join(names)}**: {note}")
    return "\n".join(lines).rstrip() + "\n"


def _line(row: Row) -> str:
    verdict = "agrees" if row.agrees else "**differs**"
    digits = _digits(row)
    numbers = (f"{row.ours:.{digits}g}", f"{row.theirs:.{digits}g}")
    cells = (row.what, row.source, row.quantity, *numbers)
    cells += (f"{row.difference:.1e}", f"{row.allowed:.1e}", verdict)
    # A bar would end the cell.
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _digits(row: Row) -> int:
    """As many as show the difference, or the limit where that is larger: from 4 to 16."""
    size, small = abs(row.theirs), max(row.difference, 0.1 * row.allowed)
    if not (size > 0.0 and small > 0.0 and math.isfinite(small)):
        return 6
    return min(16, max(4, math.ceil(math.log10(size / small)) + 1))


def write(groups: dict[str, str]) -> None:
    """Write the page from the rows that there are."""
    PAGE.write_text(text(groups))
