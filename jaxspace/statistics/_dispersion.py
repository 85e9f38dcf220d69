"""Statistics of a dispersion: moments and limits of the outputs, contributors, failed runs."""

import functools
import math
import warnings
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, final

import equinox as eqx
import numpy as np
from numpy.typing import ArrayLike

from ..core import InputError
from ..core.common_units import factor_between
from ..core.extras import extra
from ..core.listed import Listed
from ..core.record import resuming
from ..core.status import Status
from ..core.structure import HashedModule
from ..core.text import aligned, in_words
from ._failures import Failure, failures_of
from ._footprint import LANDING, SHARES, Footprint
from .contributors import Contributors, contributors
from .correlation import RankCorrelation, strongest_correlations
from .datasets import as_dataset, as_frame
from .limits import Percentile, Probability, clopper_pearson, percentile
from .purpose import Purpose
from .requirements import Requirement, Verdict, extreme_place, requirement_of, verdict_of
from .spread import Convergence, Ellipsoid, StopRule, convergence, ellipsoid
from .sweeps import SweepTable, sweep_table
from .table import Row, row_of

if TYPE_CHECKING:
    import os

    import pandas
    import xarray

# Rows of a printed result.
MOST_ROWS = 30


@final
class Dispersion(HashedModule):
    """The runs of a campaign; each array is (runs,).

    - `inputs`, `outputs`: values by name.
    - `status`: the code of the `Status` of each run.
    - `evaluations`: of the vector field, of each run.
    - `units`: of inputs and outputs, by name.
    - `seed`: of the random numbers.
    - `seconds`, s: wall time, with several hosts the longest one.
    - `attributes`: the record of the computation of the runs.
    - `numbers`: of the runs; from 0 on by default.
    - `store`: where they are stored; empty if they are not.
    """

    inputs: Mapping[str, np.ndarray]
    outputs: Mapping[str, np.ndarray]
    status: np.ndarray
    evaluations: np.ndarray
    units: dict[str, str]
    seed: int
    seconds: float = float("nan")
    attributes: dict[str, Any] = eqx.field(default_factory=dict)
    numbers: np.ndarray | None = None
    store: str = ""

    @property
    def runs(self) -> int:
        """The number of runs, successful and failed."""
        return len(self.status)

    @property
    def enough(self) -> int | None:
        """Number of runs after which the `StopRule` ended the campaign; `None` if it did not."""
        return self.attributes.get("enough_runs")

    @property
    def ending(self) -> str:
        """A message with the number of runs and the rule by which the campaign stopped early; empty
        if it did not."""
        if self.enough is None:
            return ""
        known = StopRule(**self.attributes["until"]).text().removeprefix("until ")
        return f"Stopped after {self.enough} runs: {known}."

    @property
    def planned_runs(self) -> int:
        """Number of runs of the complete campaign."""
        return int(self.enough or self.attributes.get("planned_runs", self.runs))

    @property
    def missing_runs(self) -> str:
        """A message with the number of available planned runs and the command for the rest; empty
        if the campaign is complete, or ended by its rule."""
        if self.runs >= self.planned_runs:
            return ""
        rest = resuming(self.attributes, self.store)
        return (
            f"{self.runs} of {self.planned_runs} planned runs are in the store: `{rest}` computes "
            f"the rest."
        )

    @property
    def requirements(self) -> dict[str, tuple[float | None, float | None]]:
        """The least and the greatest allowed value of each output with a requirement, `None`
        without a limit."""
        return {name: (one.low, one.high) for name, one in self._required.items()}

    @property
    def _required(self) -> dict[str, Requirement]:
        """The requirements on the outputs, by name."""
        result = self.attributes.get("requirements", {})
        return {name: requirement_of(x) for name, x in result.items() if name in self.outputs}

    @property
    def cores(self) -> int:
        """Number of cores that the campaign could use, on all its hosts; 0 where unknown."""
        own = self.attributes.get("machine", {}).get("cores", 0)
        return int(own) * int(self.attributes.get("hosts", 1))

    @property
    def utilisation(self) -> float:
        """The utilisation of these cores while the runs were computed; NaN if unknown."""
        computing = self.seconds - self.attributes.get("preparation_seconds", 0.0)
        busy = self.attributes.get("cpu_seconds", 0.0)
        # Zero if nothing was computed, or nothing was recorded.
        known = computing > 0.0 and busy > 0.0 and self.cores > 0
        return busy / (computing * self.cores) if known else float("nan")

    @property
    def purpose(self) -> Purpose | None:
        """The tolerance determined for an accuracy "by purpose"; `None` for a given one."""
        found = self.attributes.get("by_purpose")
        return None if found is None else Purpose(**found)

    @property
    def good(self) -> np.ndarray:
        """Whether each run succeeded, (runs,)."""
        return self.status <= Status.EVENT

    @property
    def failed(self) -> tuple[Failure, ...]:
        """The failures, the most frequent first; empty if every run succeeded."""
        return Listed(failures_of(self.status[~self.good]))

    def values(self, name: str) -> np.ndarray:
        """An output or input by name, over all runs.

        Raises `InputError` for an unknown name."""
        # One by one, because a column of a store is read on demand.
        for kind in (self.inputs, self.outputs):
            if name in kind:
                return kind[name]
        every = (*self.inputs, *self.outputs)
        raise InputError(
            f"{name!r} is not an output of this dispersion: it must be one of {', '.join(every)}."
            f"{InputError.hint(name, every)}"
        )

    def where(
        self, condition: ArrayLike | Callable[[Mapping[str, np.ndarray]], ArrayLike]
    ) -> "Dispersion":
        """The runs that satisfy a condition, with their numbers, as a separate dispersion.

        Its tables, requirements, verdicts, figures and page are those of the selected runs. A
        condition on an input splits the campaign: `result.where(lambda v: v["wind"] > 5.0)`. After
        a condition on outputs, intervals and contributors describe the selected runs only.

        **Arguments**

        - `condition`: booleans, (runs,), or a function from the inputs and outputs by name, each
          (runs,), to them.

        **Raises** `InputError` for another shape or type, and if no run satisfies the condition."""
        given = condition({**self.inputs, **self.outputs}) if callable(condition) else condition
        mask = np.asarray(given)
        if mask.dtype != bool or mask.shape != (self.runs,):
            raise InputError(
                f"condition is {mask.dtype} of shape {mask.shape}: it must be booleans of shape "
                f"({self.runs},)."
            )
        if not mask.any():
            raise InputError(f"condition is met by none of {self.runs} runs.")
        # Plans and measurements of the complete campaign do not apply to a part of it.
        whole = ("planned_runs", "enough_runs", "until", "numerical_errors")
        return Dispersion(
            {name: np.asarray(x)[mask] for name, x in self.inputs.items()},
            {name: np.asarray(x)[mask] for name, x in self.outputs.items()},
            self.status[mask],
            self.evaluations[mask],
            self.units,
            self.seed,
            attributes={name: x for name, x in self.attributes.items() if name not in whole},
            numbers=self.run_numbers[mask],
        )

    @property
    def rows(self) -> int:
        """Number of rows of the sweep of the campaign; 1 without one."""
        return int(self.attributes.get("sweep", {"rows": 1})["rows"])

    def by_row(self) -> SweepTable:
        """The statistics of each row of the sweep. Raises `InputError` for a campaign without
        one."""
        return sweep_table(self)

    def row(self, number: int) -> "Dispersion":
        """The runs in one row of the sweep, as `where` has them.

        **Arguments**

        - `number`: of the row, from 0.

        **Raises** `InputError` for other numbers, and if no run of the row is there."""
        if not 0 <= number < self.rows:
            raise InputError(f"number is {number}: it must be from 0 to {self.rows - 1}.")
        return self.where(self.run_numbers % self.rows == number)

    def __repr__(self) -> str:
        good = int(np.count_nonzero(self.good))
        lines = [f"Dispersion of {self.runs} runs, {good} of them successful"]
        lines += [f"  {failure.count} runs: {failure.sentence}" for failure in self.failed]
        heads = ("", "unit", "mean", "deviation", "least", "greatest")
        known = "numerical_errors" in self.attributes
        rows: list[tuple[str, ...]] = [(*heads, "numerical error") if known else heads]
        for row in (*self.table("inputs"), *self.table())[:MOST_ROWS]:
            numbers = [row.shown(x) for x in (row.mean, row.std, row.min, row.max)]
            rows.append((row.name, row.unit, *numbers, *([row.numerical_words] if known else [])))
        lines += [f"  {line}" for line in aligned(rows, left=2).splitlines()]
        more = len(self.inputs) + len(self.outputs) + 1 - len(rows)
        return "\n".join([*lines, f"  and {more} more"] if more else lines)

    def label(self, name: str) -> str:
        """A readable name with its unit, for tables and axes."""
        unit = self.units.get(name, "")
        return in_words(name) + (f" [{unit}]" if unit not in ("", "1") else "")

    def table(self, of: str = "outputs") -> list[Row]:
        """A `Row` for each of the "outputs" or "inputs", over the successful runs.

        Limits and extremes count infinite values, mean and standard deviation exclude them; the row
        reports their number (`Row.warning`). Raises `InputError` for any other value."""
        if of not in ("outputs", "inputs"):
            raise InputError(f"of is {of!r}: it must be 'outputs' or 'inputs'.")
        errors = self.attributes.get("numerical_errors", {})
        rows = [
            row_of(name, self.units.get(name, ""), x[self.good], self.run_numbers[self.good])
            for name, x in getattr(self, of).items()
        ]
        return [row._replace(numerical_error=errors.get(row.name, math.nan)) for row in rows]

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the numbers: missing runs of the store, and outputs that are infinite or
        NaN in successful runs."""
        sentences = (self.missing_runs, *(row.warning for row in self.table()))
        return Listed(sentence for sentence in sentences if sentence)

    def contributors(self, output: str, count: int | None = 5) -> Contributors:
        """The inputs with the largest shares of the variance of an output, over the successful
        runs.

        **Arguments**

        - `output`: name of the output.
        - `count`: number of inputs listed; `None` for all.

        **Returns** no shares, and NaN for R^2, where there is no dispersion beyond rounding; no
        shares where the inputs explain no more than chance.

        **Raises** `InputError` for an unknown output, and for fewer successful runs than the
        regression needs.
        """
        known = self._known_contributors
        if output not in known:
            known[output] = contributors(output, self.inputs, self.values(output), self.good)
        result = known[output]
        return result._replace(shares=dict(list(result.shares.items())[:count]))

    @functools.cached_property
    def _known_contributors(self) -> dict[str, Contributors]:
        """Result of the regression for each output, computed once for table, figure and page."""
        # No field: it follows from the fields, and a copy computes it again.
        return {}

    def covariance(self, *names: str) -> np.ndarray:
        """The covariance of the named quantities (all outputs, if none is named), (d, d), over the
        successful runs in which all of them are finite; NaN for fewer than two. Warns where there
        are other successful runs."""
        x = self._finite(*(names or self.outputs))
        if x.shape[1] < 2:
            return np.full((len(x), len(x)), np.nan)
        return np.atleast_2d(np.cov(x))

    def together(self, *names: str) -> np.ndarray:
        """The named quantities over the successful runs in which all of them are finite, (d,
        runs)."""
        x = np.stack([self.values(name).astype(float) for name in names])
        return x[:, self.good & np.all(np.isfinite(x), axis=0)]

    def _finite(self, *names: str) -> np.ndarray:
        """The same, with a warning about omitted successful runs."""
        x = self.together(*names)
        good = int(np.count_nonzero(self.good))
        if x.shape[1] < good:
            warnings.warn(
                f"{good - x.shape[1]} of {good} successful runs are omitted: {', '.join(names)} "
                "must be finite for a covariance.",
                stacklevel=3,
            )
        return x

    def _numbers(self, name: str) -> np.ndarray:
        """A quantity over the successful runs, infinite values among them, (runs,)."""
        x = self.values(name).astype(float)
        # An infinite value has its place among the others; NaN has none.
        return x[self.good & ~np.isnan(x)]

    def percentile(self, name: str, share: float, confidence: float = 0.95) -> Percentile:
        """The quantile `share` over the successful runs, with a distribution-free confidence
        interval (`jaxspace.statistics.limits.percentile`). Infinite values count; NaN is
        excluded."""
        return percentile(self._numbers(name), share, confidence)

    def ellipsoid(self, *names: str, probability: float = 0.99) -> Ellipsoid:
        """The ellipse or ellipsoid of the named quantities, over the successful runs in which all
        of them are finite. Warns where there are other successful runs."""
        return ellipsoid(self._finite(*names), probability)

    def footprint(self) -> Footprint | None:
        """Footprint of the landings, with ellipses of 50, 90 and 99 %; `None` unless `east` and
        `north` are outputs with the same unit, finite in at least three successful runs."""
        units = {self.units.get(name) for name in LANDING}
        # Lengths in two units have no bearing between them.
        if not set(LANDING) <= set(self.outputs) or len(units) > 1:
            return None
        points = self.together(*LANDING)
        # The ellipse of two points is a line.
        if points.shape[1] < 3:
            return None
        ellipses = tuple(ellipsoid(points, share) for share in SHARES)
        unit = self.units.get(LANDING[0], "")
        limit = (*self.requirements.get("distance", ()), None, None)[1]
        factor = factor_between(self.units.get("distance", ""), unit)
        required = None if limit is None or factor is None else factor * limit
        return Footprint(points, unit, ellipses, required)

    def convergence(self, name: str, share: float = 0.99) -> Convergence:
        """Convergence of mean, standard deviation and a percentile of a quantity over the
        successful runs."""
        return convergence(self._numbers(name), share)

    def violation(
        self,
        name: str,
        *,
        at_least: float = -np.inf,
        at_most: float = np.inf,
        confidence: float = 0.95,
    ) -> Probability:
        """The probability that a requirement on an output is violated, with the Clopper-Pearson
        interval.

        A failed run counts as a violation, as does an output that is NaN. An infinite one violates
        the limit on its side. Raises `InputError` for an unknown name, or without limits."""
        if at_least == -np.inf and at_most == np.inf:
            raise InputError("at_least and at_most are both missing: a requirement needs a limit.")
        x = self.values(name)
        # Comparisons with NaN are false, so that it violates the requirement.
        met = self.good & (x >= at_least) & (x <= at_most)
        return clopper_pearson(int(np.count_nonzero(~met)), self.runs, confidence)

    def violations(self) -> dict[str, Probability]:
        """Probability, for each output, that its requirement is violated (`violation`), with the
        confidence of the requirement."""
        return {
            name: self.violation(
                name,
                at_least=-np.inf if required.low is None else required.low,
                at_most=np.inf if required.high is None else required.high,
                confidence=required.confidence,
            )
            for name, required in self._required.items()
        }

    @property
    def verdicts(self) -> dict[str, Verdict]:
        """Whether the runs show that a requirement is satisfied, for each output with an allowed
        share of violations: "pass", "fail" or "not yet known"."""
        violations = self.violations()
        return {
            name: verdict_of(violations[name], required.allowed)
            for name, required in self._required.items()
            if required.allowed is not None
        }

    def run_of(self, which: str, output: str) -> int:
        """The number of the successful run with an extreme value of an output.

        **Arguments**

        - `which`: "least", "greatest", or "worst": the run that violates the requirement on the
          output the most, or comes closest to its limit.
        - `output`: name of the output.

        **Raises** `InputError` for an unknown name, for "worst" without a requirement, and if the
        output is not finite in any successful run."""
        x = np.where(self.good, self.values(output).astype(float), np.nan)
        low, high = self.requirements.get(output, (None, None))
        return int(self.run_numbers[extreme_place(which, output, x, low, high)])

    @property
    def run_numbers(self) -> np.ndarray:
        """Numbers of the runs in their campaign, (runs,)."""
        return np.arange(self.runs) if self.numbers is None else self.numbers

    def required(self, name: str) -> str:
        """The requirement on an output as text, such as "≥ 180 and ≤ 190"; empty without one."""
        low, high = self.requirements.get(name, (None, None))
        signs = (("≥", low), ("≤", high))
        return " and ".join(f"{sign} {x:g}" for sign, x in signs if x is not None)

    def rank_correlations(self, output: str, count: int = 5) -> dict[str, RankCorrelation]:
        """Spearman's rank correlation of an output with the inputs, the strongest first."""
        y = self.values(output)[self.good]
        given = {name: self.values(name)[self.good] for name in self.inputs}
        return strongest_correlations(given, y, count)

    def to_csv(self, path: "str | os.PathLike[str]") -> None:
        """Write the runs as a text table: a line for each run, with its number, its status, its
        inputs and outputs; the unit follows the name."""
        self._frame().to_csv(path, index_label="run")

    def to_parquet(self, path: "str | os.PathLike[str]") -> None:
        """Write the table of `to_csv` as a Parquet file, which requires `pip install
        jaxspace[parquet]`."""
        with extra("parquet"):
            import pyarrow  # noqa: F401  # by which the table is written

        self._frame().rename_axis("run").to_parquet(path, engine="pyarrow")

    def _frame(self) -> "pandas.DataFrame":
        columns = {**self.inputs, **self.outputs}
        return as_frame(columns, self.units, self.status, self.run_numbers)

    def to_dataset(self, first: int = 0) -> "xarray.Dataset":
        """The runs as an xarray dataset along `run`, with the unit of every variable and the record
        in the attributes; `first` is the number of the first run."""
        kinds = {"input": self.inputs, "output": self.outputs}
        numbers = np.arange(first, first + self.runs) if self.numbers is None else self.numbers
        record = {**self.attributes, "seed": self.seed, "seconds": self.seconds}
        return as_dataset(kinds, self.units, self.status, self.evaluations, numbers, record)
