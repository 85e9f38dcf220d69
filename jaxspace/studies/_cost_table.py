"""The table of what accuracy costs."""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple, final

from ..core import InputError, check_positive
from ..simulation import Accuracy
from ._table import aligned, duration

CLOSED_FORM = "closed form"


class Cost(NamedTuple):
    """One setting: what it reaches and what it takes.

    - `method`, `precision`, `tolerance`: the setting; a closed form has no tolerance.
    - `error`: of the final state, |difference| / |block| for the worst of its blocks.
    - `seconds`: the median run; `compile_seconds`: ahead of the first run of this method and
      precision.
    - `evaluations` of the vector field, accepted `steps`; `memory`, bytes, of the compiled run
      (`None`: not known).
    - `drift`: the largest relative change of every invariant at the times asked for.
    - `gradient_error`, `gradient_seconds`: of the gradient in the initial state; `None` where it
      was not asked for.
    - `trouble`: why the run is not to be used; empty for a good run."""

    method: str
    precision: str
    tolerance: float | None
    error: float
    seconds: float
    compile_seconds: float
    evaluations: int
    steps: int
    memory: int | None
    drift: dict[str, float]
    gradient_error: float | None = None
    gradient_seconds: float | None = None
    trouble: str = ""


@final
@dataclass(frozen=True, eq=False)
class AccuracyCost:
    """What accuracy costs in one very run: a row for every setting.

    - `rows`: in the order of precision, method and falling tolerance.
    - `reference`: what the errors are measured against, and `reference_error`, an estimate of its
      own error.
    - `precision`: of the state that was given; `cheapest` looks among its rows.
    - `notes`: what was left out, and why. `methods`: the solver of every name."""

    rows: tuple[Cost, ...]
    reference: str
    reference_error: float
    precision: str
    notes: tuple[str, ...]
    methods: dict[str, Any]

    def cheapest_row(self, error: float = 1e-8, precision: str | None = None) -> Cost:
        """The quickest of the good rows whose `error` is at most the one given, among those of one
        `precision`.

        Raises `InputError` when there is none; it says which error is the best one reached."""
        check_positive("error", error)
        precision = self.precision if precision is None else precision
        there = [
            r
            for r in self.rows
            if r.precision == precision and not r.trouble and math.isfinite(r.error)
        ]
        if not there:
            raise InputError(
                f"precision is {precision!r}: it must be one in which a run of the table ended well."
            )
        # Below the error of the reference an error is not known.
        known = [(max(r.error, self.reference_error), r) for r in there]
        good = [r for reached, r in known if reached <= error]
        if not good:
            best, row = min(known, key=lambda pair: pair[0])
            raise InputError(
                f"error is {error:.3g}: it must be at least {best:.2g}, the best that was reached ({_setting(row)}); "
                f"ask for tighter tolerances or another precision."
            )
        return min(good, key=lambda r: r.seconds)

    def cheapest(self, error: float = 1e-8, precision: str | None = None) -> Accuracy:
        """The `Accuracy` of the quickest run with at most this error in the final state, in the
        precision of the state given.

        Raises `InputError` when no run is that good; it says which error is the best one reached.
        """
        row = self.cheapest_row(error, precision)
        return (
            Accuracy()
            if row.tolerance is None
            else Accuracy(rtol=row.tolerance, method=self.methods[row.method])
        )

    def plot(self) -> Any:
        """The work-precision diagram, a matplotlib figure. Raises `ImportError` where matplotlib is
        not installed."""
        from ..plots import accuracy_cost_figure

        return accuracy_cost_figure(self)

    def __str__(self) -> str:
        gradient = any(r.gradient_seconds is not None for r in self.rows)
        head = [
            "method",
            "precision",
            "tolerance",
            "error",
            "time",
            "evaluations",
            "steps",
            "memory",
            "drift",
        ]
        rows = [head + (["gradient error", "gradient time"] if gradient else []) + ["to compile"]]
        rows += [_cells(row, self.reference_error, gradient) for row in self.rows]
        troubles = [f"{_setting(r)}: {r.trouble}" for r in self.rows if r.trouble]
        against = (
            f"Errors are against {self.reference}, itself good to about {self.reference_error:.1g}."
        )
        return "\n".join([aligned(rows, left=2), against, *self.notes, *troubles])


def _setting(row: Cost) -> str:
    at = "" if row.tolerance is None else f" at {row.tolerance:.0e}"
    return f"{row.method}{at} in {row.precision}"


def _cells(row: Cost, floor: float, gradient: bool) -> list[str]:
    """The text of a row. A star marks a run in trouble, a less-than sign an error below that of the
    reference."""
    error = f"{'< ' if row.error < floor else ''}{max(row.error, floor):.1e}{'*' if row.trouble else ''}"
    tolerance = "-" if row.tolerance is None else f"{row.tolerance:.0e}"
    memory = "-" if row.memory is None else f"{row.memory / 1024.0:.0f} KiB"
    drift = f"{max(row.drift.values()):.1e}" if row.drift else "-"
    counts = [str(row.evaluations), str(row.steps)] if row.tolerance is not None else ["-", "-"]
    cells = [
        row.method,
        row.precision,
        tolerance,
        error,
        duration(row.seconds),
        *counts,
        memory,
        drift,
    ]
    if gradient:
        there = row.gradient_error is not None and row.gradient_seconds is not None
        cells += (
            [f"{row.gradient_error:.1e}", duration(row.gradient_seconds or 0.0)]
            if there
            else ["-", "-"]
        )
    return [*cells, duration(row.compile_seconds)]
