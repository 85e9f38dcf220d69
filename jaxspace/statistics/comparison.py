"""Comparison of two campaigns: changed settings, differences of the outputs, changed verdicts.

    d_i = y_i' - y_i,    mean(d) +- t s(d) / sqrt(n)                    paired runs
    mean(y') - mean(y) +- t sqrt(s'^2 / n' + s^2 / n)                   independent runs

    symbol  meaning                                                     unit
    y, y'   an output of the first and of the second campaign           its own
    n       number of runs                                              1
    s       standard deviation                                          of the output
    t       quantile of Student's distribution; for independent runs    1
            with the degrees of freedom of Welch and Satterthwaite

Two campaigns with the same seed use the same random numbers in runs of the same number, so that the
difference of a pair is known far better than the difference of two independent means.
"""

__all__ = ["CampaignComparison", "Difference", "Setting", "VerdictChange", "compare"]

import difflib
import math
from typing import NamedTuple

import numpy as np

from ..core import InputError
from ..core.common_units import factor_between
from ..core.listed import Listed
from ..core.printing import printed
from ..core.suggestions import suggests
from ..core.text import aligned
from ._dispersion import Dispersion
from ._rounding import rounded
from .limits import check_share

# Entries of the record of a campaign that are compared as settings.
SETTINGS = ("planned_runs", "rtol", "atol", "method")


@printed()
class Setting(NamedTuple):
    """A setting that differs: its `name`, and its value `before` and `after`; empty where it is
    absent."""

    name: str
    before: str
    after: str


@printed()
class Difference(NamedTuple):
    """The change of an output from the first campaign to the second.

    - `before`, `after`: means over the runs that are compared, in `unit`.
    - `difference`: of the means; `low`, `high`: its confidence interval.
    - `spread_ratio`: standard deviation after over that before.
    - `runs`: the number of pairs, or of the smaller campaign if the runs are independent.
    - `significant`: whether the interval excludes zero."""

    output: str
    unit: str
    before: float
    after: float
    difference: float
    low: float
    high: float
    spread_ratio: float
    runs: int

    @property
    def significant(self) -> bool:
        """Whether the interval excludes zero."""
        return not self.low <= 0.0 <= self.high


@printed()
class VerdictChange(NamedTuple):
    """A requirement before and after: the `word` of its verdict, empty without an allowed share,
    and the `share` of runs that violate it, NaN where it is not required."""

    name: str
    word_before: str
    word_after: str
    share_before: float
    share_after: float


@suggests
class CampaignComparison(NamedTuple):
    """Differences between two campaigns; printing it shows all tables.

    - `settings`: the settings that differ.
    - `lines`: changed lines of the scene file, with "-" for the first and "+" for the second.
    - `differences`: one for each output that both have.
    - `verdicts`: one for each requirement of either campaign.
    - `left_out`: names of outputs that only one of them has, or whose units cannot be converted.
    - `paired`: whether runs of the same number were compared.
    - `confidence`: of the intervals."""

    settings: tuple[Setting, ...]
    lines: tuple[str, ...]
    differences: tuple[Difference, ...]
    verdicts: tuple[VerdictChange, ...]
    left_out: tuple[str, ...]
    paired: bool
    confidence: float

    @property
    def changed_verdicts(self) -> tuple[VerdictChange, ...]:
        """The verdicts that changed."""
        return Listed(x for x in self.verdicts if x.word_before != x.word_after)

    @property
    def rows(self) -> list[tuple[str, ...]]:
        """The table of the differences as text, below its heads."""
        heads = ("output", "unit", "before", "after", "difference", "interval", "std dev ratio")
        rows: list[tuple[str, ...]] = [heads]
        for x in self.differences:
            half = 0.5 * (x.high - x.low)
            before, after, change, low, high = (
                rounded(y, half) for y in (x.before, x.after, x.difference, x.low, x.high)
            )
            mark = "" if x.significant else " (not significant)"
            interval = f"{low} to {high}{mark}"
            rows.append(
                (x.output, x.unit, before, after, change, interval, f"{x.spread_ratio:.3g}")
            )
        return rows

    def __repr__(self) -> str:
        how = "pairs of runs with the same number" if self.paired else "independent runs"
        parts = [f"differences over {how}, {100.0 * self.confidence:g} % intervals"]
        parts.append(aligned(self.rows, left=2))
        if self.settings:
            parts.append(aligned([("setting", "before", "after"), *self.settings], left=3))
        if self.verdicts:
            heads = ("requirement", "violated before", "after", "verdict before", "after")
            shares = [
                (x.name, *(f"{100.0 * y:.3g} %" for y in x[3:]), x.word_before, x.word_after)
                for x in self.verdicts
            ]
            parts.append(aligned([heads, *shares], left=1))
        if self.lines:
            parts.append("\n".join(("changed lines of the scene file", *self.lines)))
        if self.left_out:
            parts.append(f"not compared: {', '.join(self.left_out)}")
        return "\n\n".join(parts)


def compare(
    before: Dispersion, after: Dispersion, *, paired: bool | None = None, confidence: float = 0.95
) -> CampaignComparison:
    """Compare two campaigns: settings, outputs and verdicts.

    **Arguments**

    - `before`, `after`: the results of both; outputs are compared in the units of `before`.
    - `paired`: whether runs of the same number belong together. By default they do if both
      campaigns have the same seed and as many rows of a sweep, and therefore used the same random
      numbers. The difference of a
      pair needs both runs to have succeeded with a finite output; otherwise the pair is left out.
    - `confidence`: of the intervals.

    **Raises** `InputError` for a confidence outside (0, 1), if the campaigns have no output in
    common, and if no run number is in both although paired runs are requested."""
    check_share("confidence", confidence)
    if paired is None:
        # Runs of the same number have other draws where a sweep has another number of rows.
        paired = before.seed == after.seed and before.rows == after.rows
    common = [name for name in before.outputs if name in after.outputs]
    factors = {
        name: factor_between(after.units.get(name, ""), before.units.get(name, ""))
        for name in common
    }
    if not any(factor is not None for factor in factors.values()):
        raise InputError(
            f"The campaigns have no output in common: the first has {', '.join(before.outputs)}, "
            f"the second {', '.join(after.outputs)}."
        )
    mine, other = _places(before, after, paired)
    differences = tuple(
        _difference(name, before, after, factor, (mine, other), paired, confidence)
        for name, factor in factors.items()
        if factor is not None
    )
    every = dict.fromkeys((*before.outputs, *after.outputs))
    left_out = tuple(name for name in every if factors.get(name) is None)
    return CampaignComparison(
        _settings(before, after),
        _changed_lines(before, after),
        differences,
        _verdicts(before, after),
        left_out,
        paired,
        confidence,
    )


def _places(before: Dispersion, after: Dispersion, paired: bool) -> tuple[np.ndarray, np.ndarray]:
    """Places of the runs that are compared, in both campaigns."""
    if not paired:
        return np.arange(before.runs), np.arange(after.runs)
    _, mine, other = np.intersect1d(before.run_numbers, after.run_numbers, return_indices=True)
    if mine.size == 0:
        raise InputError("The campaigns have no run number in common: paired must be False.")
    return mine, other


def _difference(
    name: str,
    before: Dispersion,
    after: Dispersion,
    factor: float,
    places: tuple[np.ndarray, np.ndarray],
    paired: bool,
    confidence: float,
) -> Difference:
    from scipy.special import stdtrit

    x, y = (
        np.where(there.good, there.values(name).astype(float), np.nan)[place]
        for there, place in zip((before, after), places, strict=True)
    )
    y = factor * y
    if paired:
        both = np.isfinite(x) & np.isfinite(y)
        x, y = x[both], y[both]
        n = x.size
        error = _deviation(y - x) / math.sqrt(n) if n else math.nan
        freedom = float(n - 1)
    else:
        x, y = x[np.isfinite(x)], y[np.isfinite(y)]
        n = min(x.size, y.size)
        a, b = (_deviation(z) ** 2 / z.size if z.size else math.nan for z in (x, y))
        error = math.sqrt(a + b)
        freedom = (a + b) ** 2 / (a**2 / (x.size - 1) + b**2 / (y.size - 1)) if error > 0.0 else 1.0
    half = float(stdtrit(freedom, 0.5 + 0.5 * confidence)) * error if error > 0.0 else error
    first, second = (float(np.mean(z)) if z.size else math.nan for z in (x, y))
    change = float(np.mean(y - x)) if paired and n else second - first
    spread = _deviation(x)
    ratio = _deviation(y) / spread if spread > 0.0 else math.nan
    unit = before.units.get(name, "")
    low, high = change - half, change + half
    return Difference(name, unit, first, second, change, low, high, ratio, n)


def _deviation(x: np.ndarray) -> float:
    """Standard deviation; NaN for fewer than two numbers."""
    return float(np.std(x, ddof=1)) if x.size > 1 else math.nan


def _settings(before: Dispersion, after: Dispersion) -> tuple[Setting, ...]:
    """The settings, inputs and requirements that differ."""
    first, second = (_all_settings(there) for there in (before, after))
    return tuple(
        Setting(name, first.get(name, ""), second.get(name, ""))
        for name in dict.fromkeys((*first, *second))
        if first.get(name, "") != second.get(name, "")
    )


def _all_settings(there: Dispersion) -> dict[str, str]:
    """The settings of a campaign as text, by name."""
    found = {"seed": str(there.seed), "runs": str(there.runs)}
    found |= {name: str(there.attributes.get(name, "")) for name in SETTINGS}
    versions = there.attributes.get("versions", {})
    found |= {f"version of {name}": str(text) for name, text in versions.items()}
    found |= {f"input {name}": "dispersed" for name in there.inputs}
    found |= {f"requirement on {name}": _required(there, name) for name in there.requirements}
    return found


def _required(there: Dispersion, name: str) -> str:
    unit = there.units.get(name, "")
    return f"{there.required(name)} {unit}".strip() if there.required(name) else ""


def _changed_lines(before: Dispersion, after: Dispersion) -> tuple[str, ...]:
    """Lines of the scene file, or of the text of the inputs, that only one campaign has."""
    first, second = (
        str(x.attributes.get("description") or x.attributes.get("inputs", "")).splitlines()
        for x in (before, after)
    )
    changed = difflib.ndiff(first, second)
    return tuple(line for line in changed if line.startswith(("- ", "+ ")) and line[2:].strip())


def _verdicts(before: Dispersion, after: Dispersion) -> tuple[VerdictChange, ...]:
    """Verdict and share of violations for each requirement of either campaign."""
    violations = before.violations(), after.violations()
    verdicts = before.verdicts, after.verdicts
    changes = []
    for name in dict.fromkeys((*violations[0], *violations[1])):
        words = [there[name].word if name in there else "" for there in verdicts]
        shares = [there[name].value if name in there else math.nan for there in violations]
        changes.append(VerdictChange(name, words[0], words[1], shares[0], shares[1]))
    return tuple(changes)
