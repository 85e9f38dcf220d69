"""The comparison of two stored campaigns: tables, figures and a page."""

import os
from pathlib import Path

from ..plots import designs_figure, designs_page
from ..statistics import Dispersion
from ..statistics.comparison import CampaignComparison, Difference, compare
from ..stores import open_store
from ._output import make_folder
from ._report import attempt
from ._warning_lines import warnings_as_lines


def diff(first: str, second: str, folder: str) -> int:
    """Print the comparison of two stores, draw its outputs and write its page; returns the exit
    status."""
    with warnings_as_lines():
        before, after = open_store(first), open_store(second)
        found = compare(before, after)
    print(found)
    make_folder(folder)
    names = [Path(path).name.removesuffix(".zarr") for path in (first, second)]
    if names[0] == names[1]:
        names = [first, second]
    both = dict(zip(names, (before, after), strict=True))
    start = os.path.join(folder, f"{Path(first).stem}_{Path(second).stem}")
    return max(
        attempt("figure", f"{start}.png", lambda path: _figure(both, found, path)),
        attempt("page", f"{start}.html", lambda path: _page(both, found, path)),
    )


def _figure(both: dict[str, Dispersion], found: CampaignComparison, path: str) -> None:
    """The output that changed most, as a multiple of the width of its interval."""

    def change(x: Difference) -> float:
        # Without a finite interval there is nothing to compare the difference with.
        return abs(x.difference) / (x.high - x.low) if x.high > x.low else 0.0

    most = max(found.differences, key=change)
    designs_figure(both, most.output, title=_title(both)).savefig(path, dpi=150)


def _page(both: dict[str, Dispersion], found: CampaignComparison, path: str) -> None:
    how = "pairs of runs with the same number" if found.paired else "independent runs"
    note = f"Differences over {how}, with {100.0 * found.confidence:g} % confidence intervals."
    sentences = [
        f"{x.name}: {x.before or 'absent'} → {x.after or 'absent'}" for x in found.settings
    ]
    sentences += [
        f"Requirement on {x.name}: violated in {100.0 * x.share_before:.3g} % → "
        f"{100.0 * x.share_after:.3g} % of the runs"
        # Only a requirement with an allowed share has a verdict.
        + (f"; {x.word_before or 'none'} → {x.word_after or 'none'}" if any(x[1:3]) else "")
        for x in found.verdicts
    ]
    sentences += found.lines
    figures = {x.output: designs_figure(both, x.output) for x in found.differences}
    designs_page(path, _title(both), note, found.rows, sentences, figures)


def _title(both: dict[str, Dispersion]) -> str:
    return " compared with ".join(reversed(both))
