"""Result of a verification: rows, a table, JSON, and a table for the manual."""

__all__ = ["CaseResult", "Verification"]

import json
import platform
from dataclasses import asdict, dataclass
from typing import final

import jax

from ..core.listed import no_method
from ..core.printing import printed
from ..core.text import aligned
from ._case import Case


@final
@dataclass(frozen=True)
@printed()
class CaseResult:
    """A case and its results.

    - `name`: of the case.
    - `error`: of the value, relative to the condition of the case.
    - `forward_error`, `reverse_error`: of the derivatives in both modes, relative to the largest
      derivative of the same output; `None` where the value has none.
    - `tolerance`, `slope_tolerance`: allowed errors of the value and of the derivatives.
    - `verdict`: "holds", "fails" or "left out".
    - `why`: the reason for the allowed errors."""

    name: str
    error: float | None
    forward_error: float | None
    reverse_error: float | None
    tolerance: float | None
    slope_tolerance: float | None
    verdict: str
    why: str

    @classmethod
    def left_out(cls, case: Case) -> "CaseResult":
        """The row of a case that float32 cannot represent."""
        # The reason takes the place of that of the tolerances.
        return cls(case.name, None, None, None, None, None, "left out", case.single)

    @property
    def slope_error(self) -> float | None:
        """The larger error of the two modes."""
        if self.forward_error is None or self.reverse_error is None:
            return None
        return max(self.forward_error, self.reverse_error)


@final
@dataclass(frozen=True)
class Verification:
    """The results of the edge cases.

    - `rows`: a `CaseResult` for each case.
    - `precision`: "float64" or "float32".
    - `device`: on which the cases were evaluated.
    - `seconds`, s: wall time."""

    rows: tuple[CaseResult, ...]
    precision: str
    device: str
    seconds: float

    @property
    def passed(self) -> bool:
        """Whether no case fails."""
        return not self.failed

    @property
    @no_method
    def failed(self) -> tuple[CaseResult, ...]:
        """The rows that fail."""
        return tuple(row for row in self.rows if row.verdict == "fails")

    def __repr__(self) -> str:
        head = ("case", "error", "allowed", "gradient error", "allowed", "verdict")
        table = aligned([head, *(_cells(row) for row in self.rows)])
        limits = [f"skipped, {row.name}: {row.why}" for row in self.rows if row.error is None]
        return "\n".join([table, *limits, self.summary()])

    def summary(self) -> str:
        """One line: numbers of passed, failed and skipped cases, platform, and duration."""
        counts = {verdict: 0 for verdict in ("holds", "fails", "left out")}
        for row in self.rows:
            counts[row.verdict] += 1
        return (
            f"{len(self.rows)} cases in {self.precision} on {self.device}: {counts['holds']} hold, "
            f"{counts['fails']} fail, {counts['left out']} left out, {self.seconds:.0f} s"
        )

    def json(self) -> str:
        """All rows and the versions, as JSON."""
        record = {
            "precision": self.precision,
            "device": self.device,
            "seconds": round(self.seconds, 1),
            "passed": self.passed,
            "versions": {"python": platform.python_version(), "jax": jax.__version__},
            "cases": [asdict(row) for row in self.rows],
        }
        # JSON has no infinity: it is text there.
        return json.dumps(_plain(record), indent=1, allow_nan=False) + "\n"


def _plain(x: object) -> object:
    """The same with JSON-compatible values."""
    if isinstance(x, dict):
        return {key: _plain(value) for key, value in x.items()}
    if isinstance(x, list | tuple):
        return [_plain(value) for value in x]
    # In this form, so that NaN is text, too.
    if isinstance(x, float) and not abs(x) < float("inf"):
        return str(x)
    return x


def _cells(row: CaseResult) -> tuple[str, ...]:
    numbers = (row.error, row.tolerance, row.slope_error, row.slope_tolerance)
    shown = ["-" if x is None else f"{x:.1e}" for x in numbers]
    if row.slope_error is None:
        # Nothing is allowed or forbidden of a derivative that is not there.
        shown[3] = "-"
    return (row.name, *shown, row.verdict)
