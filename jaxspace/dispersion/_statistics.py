"""Statistics of a dispersion: moments and limits of the outputs, contributors, failed runs.

The contributors follow from a regression on the standardised inputs and on their squares, made
orthogonal to them:

    (y - mean(y)) / s_y = sum_j (beta_j z_j + gamma_j q_j) + rest
    z_j = (x_j - mean(x_j)) / s_j,      q_j = z_j^2 - 1 - mean(z_j^3) z_j
    share_j = beta_j^2 + gamma_j^2 mean(q_j^2)

For independent inputs whose effects add, the shares add up to R^2 = 1; 1 - R^2 is due to their
products and higher powers. The squares matter for outputs that are magnitudes (a pointing error, a
cone angle), which no linear law describes.

    symbol           meaning                                  unit
    y                output over the good runs                that of the output
    x_j              input over the same runs                 that of the input
    s                standard deviation                       that of its quantity
    beta_j, gamma_j  regression coefficients                  1

A share smaller than about 1 / (number of runs) cannot be distinguished from none.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple, final

import equinox as eqx
import numpy as np

from ..core import InputError
from ..simulation import Status

if TYPE_CHECKING:
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

        **Returns** no shares, and NaN for R^2, where nothing scatters.

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
        if not columns or np.ptp(y) == 0.0:
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
        beta = coefficients[: len(columns)]
        gamma = coefficients[len(columns) :]
        shares = beta**2 + gamma**2 * np.mean(squares**2, axis=0)
        order = sorted(zip(columns, shares, strict=True), key=lambda pair: -pair[1])
        return Contributors(
            output, {name: float(share) for name, share in order[:count]}, r_squared
        )

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


def _standard(x: np.ndarray) -> np.ndarray:
    """The values shifted and scaled to mean zero and deviation one."""
    return (x - np.mean(x)) / np.std(x)
