"""The table of the cost of accuracy."""

__all__ = ["Cost", "Price"]

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, TypeAlias, final

import diffrax

from ..core import InputError
from ..core.checks import check_positive
from ..core.printing import printed
from ..core.suggestions import suggests
from ..core.text import aligned
from ..simulation import Accuracy
from ..solvers.protocol import solver_traits
from ._duration import duration

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CLOSED_FORM = "closed_form"

# Of the price list: from all that is wrong to more digits than any precision has.
ERRORS = tuple(10.0**-k for k in range(16))
# The default of the steps of a run.
MAX_STEPS = Accuracy().max_steps

# "auto" and "closed_form", or a solver, as in `Accuracy.method`.
Method: TypeAlias = str | diffrax.AbstractSolver


@printed(seconds="s", compile_seconds="s", memory="B", gradient_seconds="s")
class Cost(NamedTuple):
    """One setting: its error and its cost.

    - `method`, `precision`, `tolerance`: the setting; a closed form and a fixed-step method have no
      tolerance.
    - `error`: of the final state, |difference| / |block| for the worst of its blocks; NaN for a
      failed run, and without a reference.
    - `seconds`: the median run; `compile_seconds`: ahead of the first run of this method and
      precision.
    - `evaluations` of the vector field, accepted `steps`; `memory`, bytes, of the compiled run
      (`None`: unknown).
    - `drift`: the largest relative change of every invariant at the save times.
    - `gradient_error`, `gradient_seconds`: of the gradient with respect to the initial state;
      `None` if not measured.
    - `failure`: reason for excluding the run; empty for a valid run."""

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
    failure: str = ""


@printed(seconds="s")
class Price(NamedTuple):
    """The lowest cost of a final error.

    - `error`: relative, of the final state.
    - `setting`: a description of the method and the tolerance that reach it; `seconds`: the time of
      a run.
    - `tenth`: relative time for a tenth of this error; NaN if no run reaches it."""

    error: float
    setting: str
    seconds: float
    tenth: float


@suggests
@final
@dataclass(frozen=True, eq=False)
class AccuracyCost:
    """Cost of accuracy in one run: a row for every setting.

    - `rows`: in the order of precision, method and decreasing tolerance.
    - `reference`: the run from which the errors are measured; empty if no such run is valid, for
      the reason given by the first of the `notes`.
    - `reference_error`: estimated error of the reference; NaN without one.
    - `precision`: of the given state; `cheapest` selects among its rows.
    - `notes`: omissions and their reasons.
    - `methods`: the method of every name.
    - `max_steps`: maximum number of steps of a run."""

    rows: tuple[Cost, ...]
    reference: str
    reference_error: float
    precision: str
    notes: tuple[str, ...]
    methods: dict[str, Method]
    max_steps: int = MAX_STEPS

    def cheapest_row(self, error: float = 1e-8, precision: str | None = None) -> Cost:
        """The fastest of the valid rows with a sufficiently small error.

        **Arguments**

        - `error`: largest allowed relative error of the final state.
        - `precision`: "float64" or "float32"; by default that of the given state.

        **Raises** `InputError` if there is none, with the smallest reached error."""
        check_positive("error", error)
        if not self.reference:
            raise InputError(f"error is {error:.3g}, and none was measured. {self.notes[0]}")
        precision = self.precision if precision is None else precision
        good = [
            row
            for row in self.rows
            if row.precision == precision and not row.failure and math.isfinite(row.error)
        ]
        if not good:
            others = sorted({row.precision for row in self.rows if not row.failure})
            allowed = " or ".join(others) or "none of this table, whose runs have all failed"
            raise InputError(
                f"precision is {precision!r}, in which no run of the table succeeded: it must be "
                f"{allowed}."
            )
        # Below the error of the reference an error is not known.
        known = [(max(row.error, self.reference_error), row) for row in good]
        allowed = [row for reached, row in known if reached <= error]
        if not allowed:
            best, row = min(known, key=lambda pair: pair[0])
            raise InputError(
                f"error is {error:.3g}: it must be at least {best:.2g}, the best that was reached "
                f"({_setting(row)}); use tighter tolerances or another precision."
            )
        return min(allowed, key=lambda row: row.seconds)

    def cheapest(self, error: float = 1e-8, precision: str | None = None) -> Accuracy:
        """The `Accuracy` of `cheapest_row`, for `simulate`.

        Arguments and errors as in `cheapest_row`."""
        row = self.cheapest_row(error, precision)
        method = self.methods[row.method]
        if row.tolerance is not None:
            return Accuracy(rtol=row.tolerance, method=method, max_steps=self.max_steps)
        if isinstance(method, str):
            return Accuracy()
        # The error of the fixed steps is known from the reference, so that their cautious estimate
        # must not reject them.
        return Accuracy(rtol=FIXED_STEP_RTOL, method=method)

    def prices(self, precision: str | None = None) -> tuple[Price, ...]:
        """The price list: the lowest cost of each final error, from these runs.

        `precision`: as in `cheapest_row`."""

        def cheapest(error: float) -> tuple[str, float]:
            row = self.cheapest_row(error, precision)
            return _setting(row), row.seconds

        return price_list(cheapest)

    def plot(self) -> "Figure":
        """The work-precision diagram, a matplotlib figure.

        **Raises** `ImportError` if matplotlib is not installed."""
        from ..plots import accuracy_cost_figure

        return accuracy_cost_figure(self)

    def __repr__(self) -> str:
        gradient = any(row.gradient_seconds is not None for row in self.rows)
        head = ["method", "precision", "tolerance", "error", "time"]
        head += ["evaluations", "steps", "memory", "drift"]
        head += ["gradient error", "gradient time"] if gradient else []
        head.append("to compile")
        rows = [head, *(_cells(row, self.reference_error, gradient) for row in self.rows)]
        lines = [aligned(rows, left=2)]
        if self.reference:
            error = self.reference_error
            good = (
                f"with an error of about {error:.1g}"
                if math.isfinite(error)
                else "of unknown error"
            )
            lines.append(f"Errors are against {self.reference}, itself {good}.")
        return "\n".join([*lines, *self.notes, *_failures(self.rows)])


FIXED_STEP_RTOL = 0.99
"""The tolerance of a fixed-step method, which only assesses it: no local error exceeds the
state."""


def method_name(method: Method) -> str:
    """Name of a method in tables; the number of its steps is part of a fixed-step one."""
    if isinstance(method, str):
        return method
    # A wrapper that only counts steps is named after the method that takes them.
    name = getattr(method, "name", type(method).__name__)
    traits = solver_traits(method)
    return f"{name}({traits.steps} steps)" if traits.fixed_step else name


def _setting(row: Cost) -> str:
    at = "" if row.tolerance is None else f" at {row.tolerance:.0e}"
    return f"{row.method}{at} in {row.precision}"


def _failures(rows: Sequence[Cost]) -> list[str]:
    """Reasons of failed rows, one line for all rows of a method with the same reason."""

    def kind(row: Cost) -> tuple[str, str, str]:
        return row.method, row.precision, row.failure

    failed = [row for row in rows if row.failure]
    lines = []
    for (method, precision, failure), group in itertools.groupby(failed, kind):
        tolerances = [f"{row.tolerance:.0e}" for row in group if row.tolerance is not None]
        at = f" at {', '.join(tolerances)}" if tolerances else ""
        lines.append(f"{method}{at} in {precision}: {failure}")
    return lines


def _cells(row: Cost, least_error: float, gradient: bool) -> list[str]:
    """The text of a row.

    A star marks a failed run, a less-than sign an error below that of the reference."""
    # A dash for NaN, which represents an unknown number.
    error = "-"
    if not math.isnan(row.error):
        below = "< " if row.error < least_error else ""
        error = f"{below}{max(row.error, least_error):.1e}"
    drift = max(row.drift.values(), default=math.nan)
    counted = row.steps > 0
    cells = [
        row.method,
        row.precision,
        "-" if row.tolerance is None else f"{row.tolerance:.0e}",
        f"{error}{'*' if row.failure else ''}",
        duration(row.seconds),
        # A closed form takes no steps.
        str(row.evaluations) if counted else "-",
        str(row.steps) if counted else "-",
        "-" if row.memory is None else f"{row.memory / 1024.0:.0f} KiB",
        "-" if math.isnan(drift) else f"{drift:.1e}",
    ]
    if gradient:
        cells.append("-" if row.gradient_error is None else f"{row.gradient_error:.1e}")
        cells.append("-" if row.gradient_seconds is None else duration(row.gradient_seconds))
    return [*cells, duration(row.compile_seconds)]


def price_list(cheapest: Callable[[float], tuple[str, float]]) -> tuple[Price, ...]:
    """The prices of the errors that differ, one for each power of ten, from the largest on.

    `cheapest(error)` gives setting and time, s; it raises `InputError` for an error that no run
    reaches. Errors reached by the same setting are merged into one line, that of the smallest of
    them."""
    known = []
    for error in ERRORS:
        # Also where no run ended well.
        try:
            known.append((error, *cheapest(error)))
        except InputError:
            break
    following = [seconds for _, _, seconds in known[1:]] + [math.nan] * min(len(known), 1)
    prices = [
        Price(error, setting, seconds, tenth / seconds)
        for (error, setting, seconds), tenth in zip(known, following, strict=True)
    ]
    first = next((k for k, p in enumerate(prices) if p.setting != prices[0].setting), len(prices))
    return tuple(prices[max(first - 1, 0) :])


def price_table(prices: tuple[Price, ...]) -> str:
    """The price list as a table."""
    rows = [("error", "setting", "time", "a tenth of this error")]
    for price in prices:
        tenth = "-" if math.isnan(price.tenth) else f"{price.tenth:.2g} times the time"
        rows.append((f"{price.error:.0e}", price.setting, duration(price.seconds), tenth))
    return aligned(rows, left=2)
