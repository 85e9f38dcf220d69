"""Statistics of a dispersion: moments and limits of the outputs, contributors, failed runs.

The contributors follow from a regression on the standardised inputs and on their squares, made
orthogonal to them:

    u = (y - mean(y)) / s_y = sum_j f_j + rest,      f_j = beta_j z_j + gamma_j q_j
    z_j = (x_j - mean(x_j)) / s_j,      q_j = z_j^2 - 1 - mean(z_j^3) z_j
    share_j = mean(u f_j),      sum_j share_j = R^2

The shares add up to R^2 exactly; of independent inputs share_j is
beta_j^2 + gamma_j^2 mean(q_j^2).
The rest, 1 - R^2, is due to products of inputs, to higher powers and to what is no input. The
squares matter for outputs that are magnitudes (a pointing error, a cone angle), which no linear law
describes.

    symbol           meaning                                  unit
    y                output over the good runs                that of the output
    x_j              input over the same runs                 that of the input
    s                standard deviation                       that of its quantity
    f_j              what the law ascribes to input j         1
    beta_j, gamma_j  regression coefficients                  1

A share smaller than about 1 / (number of runs) cannot be distinguished from none. Where all inputs
together explain no more than as many random columns would (an F test at 0.1 %), there are none.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple, final

import equinox as eqx
import numpy as np

from ..core import InputError
from ..simulation import Status
from ._limits import Percentile, Probability, clopper_pearson, percentile
from ._moments import Convergence, Ellipsoid, convergence, ellipsoid
from ._rounding import rounded, scatters
from ._sensitivity import RankCorrelation, rank_correlation

if TYPE_CHECKING:
    import os

    import pandas
    import xarray

LIMITS = (0.005, 0.995)
"""Quantiles that bound the middle 99 % of the runs."""


class Row(NamedTuple):
    """One line of the table: a quantity over its good runs.

    - `mean`, `std`, `min`, `max`: its moments and extremes.
    - `low`, `high`: the limits of the middle 99 % of the runs.
    - `runs`: the number of good runs in which it is finite.
    """

    name: str
    unit: str
    mean: float
    std: float
    low: float
    high: float
    min: float
    max: float
    runs: int

    def shown(self, value: float) -> str:
        """A value of this quantity in digits that its deviation justifies: the rule of every
        table."""
        return rounded(value, self.std)


class Contributors(NamedTuple):
    """The contributors to the variance of an output.

    - `shares`: of the variance, by input, largest first.
    - `r_squared`: the part of the variance that all inputs explain together.
    """

    output: str
    shares: dict[str, float]
    r_squared: float


class Failure(NamedTuple):
    """The number of runs that ended with a bad status, and the sentence of this status."""

    status: Status
    count: int
    sentence: str


@final
class Dispersion(eqx.Module):
    """The runs of a campaign; each array is (runs,).

    - `inputs`, `outputs`: values by name.
    - `status`: the code of the `Status` of each run.
    - `evaluations`: of the vector field, of each run.
    - `units`: of inputs and outputs, by name.
    - `seed`: of the random numbers; `seconds`: wall time.
    - `attributes`: the record of how the runs were made.
    - `numbers`: of the runs; from 0 on by default.
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

    @property
    def runs(self) -> int:
        """The number of runs, good and bad."""
        return len(self.status)

    @property
    def enough(self) -> int | None:
        """After how many runs the campaign ended itself (`StopRule`); `None` if it did not."""
        return self.attributes.get("enough_runs")

    @property
    def wanted(self) -> int:
        """How many runs there are when the campaign is complete."""
        return int(self.enough or self.attributes.get("planned_runs", self.runs))

    @property
    def good(self) -> np.ndarray:
        """Whether each run ended well, (runs,)."""
        return self.status <= Status.EVENT

    @property
    def failed(self) -> tuple[Failure, ...]:
        """The bad ends, the most frequent first; empty when every run is good."""
        codes, counts = np.unique(self.status[~self.good], return_counts=True)
        # Stable, so that equal counts stay in the order of their codes.
        order = np.argsort(-counts, kind="stable")
        statuses = [Status(int(code)) for code in codes[order]]
        return tuple(
            Failure(status, int(count), status.sentence)
            for status, count in zip(statuses, counts[order], strict=True)
        )

    def values(self, name: str) -> np.ndarray:
        """An output or input by name, over all runs.

        Raises `InputError` for a name that is neither."""
        # One by one, because a column of a store is read when it is asked for.
        for kind in (self.inputs, self.outputs):
            if name in kind:
                return kind[name]
        every = ", ".join((*self.inputs, *self.outputs))
        raise InputError(f"{name!r} is no output of this dispersion: it must be one of {every}.")

    def label(self, name: str) -> str:
        """A name in words with its unit, for tables and axes."""
        unit = self.units.get(name, "")
        return name.replace("_", " ") + (f" [{unit}]" if unit not in ("", "1") else "")

    def table(self, of: str = "outputs") -> list[Row]:
        """A `Row` for each of the "outputs" or "inputs", over the good runs.

        Raises `InputError` for any other word."""
        if of not in ("outputs", "inputs"):
            raise InputError(f"of is {of!r}: it must be 'outputs' or 'inputs'.")
        return [
            self._row(name, x[self.good & np.isfinite(x)]) for name, x in getattr(self, of).items()
        ]

    def _row(self, name: str, x: np.ndarray) -> Row:
        """The row of a quantity with these values."""
        unit = self.units.get(name, "")
        if x.size == 0:
            return Row(name, unit, *(float("nan"),) * 6, runs=0)
        # In double precision, so that the moments of many runs of single precision lose nothing.
        x = x.astype(float)
        # With one degree of freedom less, because the mean comes from the same runs.
        deviation = float(np.std(x, ddof=1)) if x.size > 1 else 0.0
        low, high = (float(q) for q in np.quantile(x, LIMITS))
        return Row(
            name,
            unit,
            float(np.mean(x)),
            deviation,
            low,
            high,
            float(x.min()),
            float(x.max()),
            x.size,
        )

    def contributors(self, output: str, count: int = 5) -> Contributors:
        """The inputs with the largest shares of the variance of an output, over the good runs.

        **Arguments**

        - `output`: name of the output.
        - `count`: how many inputs are listed.

        **Returns** no shares, and NaN for R^2, where nothing scatters but for rounding; no shares
        where the inputs explain no more than chance.

        **Raises** `InputError` for an unknown output, and for fewer good runs than the regression
        needs.
        """
        y = self.values(output).astype(float)
        good = self.good & np.isfinite(y)
        y = y[good]
        # An input that does not scatter explains nothing, and has a deviation of zero.
        columns = {
            name: x[good].astype(float)
            for name, x in self.inputs.items()
            if x[good].size and np.ptp(x[good]) > 0.0
        }
        # What is constant but for rounding has no contributors, only coincidences.
        if not columns or not scatters(self.values(output)[good]):
            return Contributors(output, {}, float("nan"))
        # Two coefficients for each input; with so few runs any output would be explained.
        needed = 2 * len(columns) + 1
        if y.size <= needed:
            raise InputError(
                f"{y.size} good runs are too few to find contributors: "
                f"there must be more than {needed}."
            )
        z = np.stack([_standard(x) for x in columns.values()], axis=1)
        # Orthogonal to z, so that the shares of an input's two terms add.
        squares = z**2 - 1.0 - np.mean(z**3, axis=0) * z
        u = _standard(y)
        regressors = np.concatenate([z, squares], axis=1)
        coefficients = np.linalg.lstsq(regressors, u, rcond=None)[0]
        r_squared = 1.0 - float(np.mean((u - regressors @ coefficients) ** 2))
        if not _significant(r_squared, 2 * len(columns), y.size):
            return Contributors(output, {}, r_squared)
        # Covariances with what each input does, which add up to R^2, while squares of coefficients
        # do not in a sample, where the regressors are not quite orthogonal.
        parts = u @ (regressors * coefficients) / u.size
        shares = parts[: len(columns)] + parts[len(columns) :]
        order = sorted(zip(columns, shares, strict=True), key=lambda pair: -pair[1])
        return Contributors(
            output, {name: float(share) for name, share in order[:count]}, r_squared
        )

    def covariance(self, *names: str) -> np.ndarray:
        """The covariance of the named quantities (all outputs, if none is named), (d, d), over the
        good runs in which all of them are finite; NaN for fewer than two."""
        x = self.together(*(names or self.outputs))
        if x.shape[1] < 2:
            return np.full((len(x), len(x)), np.nan)
        return np.atleast_2d(np.cov(x))

    def together(self, *names: str) -> np.ndarray:
        """The named quantities over the good runs in which all of them are finite, (d, runs)."""
        x = np.stack([self.values(name).astype(float) for name in names])
        return x[:, self.good & np.all(np.isfinite(x), axis=0)]

    def percentile(self, name: str, share: float, confidence: float = 0.95) -> Percentile:
        """The value below which a `share` of the good runs lies, with a confidence interval that
        assumes no law (`jaxspace.dispersion.percentile`)."""
        return percentile(self.together(name)[0], share, confidence)

    def ellipsoid(self, *names: str, probability: float = 0.99) -> Ellipsoid:
        """The ellipse or ellipsoid of the named quantities, over the good runs."""
        return ellipsoid(self.together(*names), probability)

    def convergence(self, name: str, share: float = 0.99) -> Convergence:
        """How mean, deviation and a percentile of a quantity settled with the good runs."""
        return convergence(self.together(name)[0], share)

    def violation(
        self,
        name: str,
        *,
        at_least: float = -np.inf,
        at_most: float = np.inf,
        confidence: float = 0.95,
    ) -> Probability:
        """The probability that a requirement on an output is not met, with the interval of Clopper
        and Pearson.

        A failed run meets no requirement, and counts as a violation; so does an output that is not
        finite. Raises `InputError` for an unknown name, or without any limit."""
        if at_least == -np.inf and at_most == np.inf:
            raise InputError("at_least and at_most are both left out: a requirement needs a limit.")
        x = self.values(name)
        # NaN compares false, so that it is no met requirement.
        met = self.good & (x >= at_least) & (x <= at_most)
        return clopper_pearson(int(np.count_nonzero(~met)), self.runs, confidence)

    def rank_correlations(self, output: str, count: int = 5) -> dict[str, RankCorrelation]:
        """Spearman's rank correlation of an output with the inputs, the strongest first."""
        found = {}
        for name in self.inputs:
            x, y = self.together(name, output)
            if x.size >= 5 and np.ptp(x) > 0.0:
                found[name] = rank_correlation(x, y)
        order = sorted(found.items(), key=lambda pair: -abs(pair[1].value))
        return dict(order[:count])

    def to_csv(self, path: "str | os.PathLike[str]") -> None:
        """Write the runs as a table of text: a line for each run, with its number, its status, its
        inputs and outputs; the unit stands behind the name."""
        self._frame().to_csv(path, index_label="run")

    def to_parquet(self, path: "str | os.PathLike[str]") -> None:
        """Write the table of `to_csv` as a Parquet file, which needs `pip install
        jaxspace[parquet]`."""
        self._frame().rename_axis("run").to_parquet(path, engine="pyarrow")

    def _frame(self) -> "pandas.DataFrame":
        import pandas

        every = {**self.inputs, **self.outputs}
        columns = {
            name + (f" [{u}]" if (u := self.units.get(name, "")) else ""): x
            for name, x in every.items()
        }
        words = np.array([s.name for s in Status])
        places = np.searchsorted([s.value for s in Status], self.status)
        return pandas.DataFrame({"status": words[places], **columns})

    def to_dataset(self, first: int = 0) -> "xarray.Dataset":
        """The runs as an xarray dataset along `run`, with the unit of every variable and the record
        in the attributes; `first` is the number of the first run."""
        import xarray

        variables: dict[str, tuple[str, np.ndarray, dict[str, object]]] = {}
        for kind, values in (("input", self.inputs), ("output", self.outputs)):
            # The place of a variable is kept, because a store sorts by name.
            for place, (name, x) in enumerate(values.items()):
                attributes: dict[str, object] = {
                    "units": self.units.get(name, ""),
                    "kind": kind,
                    "place": place,
                }
                variables[name] = ("run", np.asarray(x), attributes)
        meanings = ", ".join(f"{s.value} {s.name}" for s in Status)
        variables["status"] = (
            "run",
            np.asarray(self.status),
            {"units": "", "meanings": meanings},
        )
        variables["evaluations"] = ("run", np.asarray(self.evaluations), {"units": ""})
        numbers = np.arange(first, first + self.runs) if self.numbers is None else self.numbers
        return xarray.Dataset(
            variables,
            {"run": ("run", numbers, {"long_name": "number of the run"})},
            {**self.attributes, "seed": self.seed, "seconds": self.seconds},
        )


def _significant(r_squared: float, regressors: int, runs: int) -> bool:
    """Whether so many random columns would explain less, but for one case in a thousand."""
    from scipy.stats import f

    rest = runs - regressors - 1
    # A law that holds to rounding leaves nothing to compare with.
    if r_squared >= 1.0 - 1e-12:
        return True
    statistic = (r_squared / regressors) / ((1.0 - r_squared) / rest)
    return bool(f.sf(statistic, regressors, rest) < 1e-3)


def _standard(x: np.ndarray) -> np.ndarray:
    """The values shifted and scaled to mean zero and deviation one."""
    return (x - np.mean(x)) / np.std(x)
