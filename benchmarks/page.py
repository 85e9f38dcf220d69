"""The page of the manual that shows the results kept beside this file."""

import json
from pathlib import Path

PAGE = Path(__file__).parents[1] / "docs" / "benchmarks.md"
HEAD = """# Speed beside accuracy

Measured by `make bench` and written by it: every method does the same work in one process, in turn; medians; the first call,
which compiles, apart. `cores` is how many cores were used on average: a figure per CPU-second compares methods that use
different numbers of them. Errors are those of the worst run. Machines differ: compare within a table.
"""


def _cell(value: object) -> str:
    return f"{value:.3g}" if isinstance(value, float) else "" if value is None else str(value)


def _table(seen: dict) -> str:
    rows = seen["rows"]
    columns = list(dict.fromkeys(key for row in rows.values() for key in row))
    lines = ["| | " + " | ".join(c.replace("_", " ") for c in columns) + " |", "|---" * (len(columns) + 1) + "|"]
    lines += [f"| {name} | " + " | ".join(_cell(row.get(c)) for c in columns) + " |" for name, row in rows.items()]
    return "\n".join(lines)


def write(results: Path, names: tuple[str, ...]) -> None:
    """Write the page from the results that there are."""
    parts = [HEAD]
    for name in names:
        if (file := results / f"{name}.json").exists():
            seen = json.loads(file.read_text())
            where = ", ".join(f"{k} {v}" for k, v in seen["machine"].items())
            parts.append(
                f"## {name.replace('_', ' ').capitalize()}\n\n{' '.join(seen['what'].split())}\n\n{_table(seen)}\n\n*{where}*\n"
            )
    PAGE.write_text("\n".join(parts))
