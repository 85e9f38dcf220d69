"""What a dispersion shows: moments and limits of its outputs, what contributes to them, and which
runs failed.

The contributors follow from a regression on the standardised inputs and on the square of each, made
orthogonal to it,

    (y - mean(y)) / s_y = sum_j (beta_j z_j + gamma_j q_j) + rest,      share_j = beta_j^2 + gamma_j^2 mean(q_j^2)
    z_j = (x_j - mean(x_j)) / s_j,      q_j = z_j^2 - 1 - mean(z_j^3) z_j

For independent inputs that act each by itself the shares add up to R^2 = 1; 1 - R^2 is what their
products and higher powers do. The squares matter for outputs that are magnitudes (a pointing error,
a cone angle), which no linear law describes.

    symbol           meaning                                  unit
    y                output over the good runs                that of the output
    x_j              input over the same runs                 that of the input
    s                standard deviation                       that of its quantity
    beta_j, gamma_j  regression coefficients                  1

A share smaller than about 1 / (number of runs) cannot be told from none.
"""

from typing import TYPE_CHECKING, Any, NamedTuple, final

import equinox as eqx
import numpy as np

from ..core import InputError
from ..simulation import Status

if TYPE_CHECKING:
    import xarray

LIMITS = (0.005, 0.995)  # the interval that holds 99 % of the runs


class Row(NamedTuple):
    """One line of the table: a quantity over its good runs; `low` and `high` bound the middle 99 %
    of them.

    `runs` counts them: the good runs in which the quantity is finite."""

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
    """What makes an output scatter: share of its variance by input, largest first, and how much
    they explain together."""

    output: str
    shares: dict[str, float]
    r_squared: float


class Failure(NamedTuple):
    """How many runs ended with a bad status, and its sentence."""

    status: Status
    count: int
    sentence: str


@final
class Dispersion(eqx.Module):
    """The runs of a campaign, each array (runs,): `inputs` and `outputs` by name, the `status` of
    each run, the `evaluations` of the vector field that it took. `seconds` is the wall time,
    `attributes` the record of how it was made."""

    inputs: dict[str, np.ndarray]
    outputs: dict[str, np.ndarray]
    status: np.ndarray
    evaluations: np.ndarray
    units: dict[str, str]
    seed: int
    seconds: float = float("nan")
    attributes: dict[str, Any] = eqx.field(default_factory=dict)

    @property
    def runs(self) -> int:
        """How many runs there are, good and bad."""
        return len(self.status)

    @property
    def good(self) -> np.ndarray:
        """For each run whether it ended well."""
        return self.status <= Status.EVENT

    @property
    def failed(self) -> tuple[Failure, ...]:
        """The bad ends, the most frequent first; empty when every run is good."""
        codes, counts = np.unique(self.status[~self.good], return_counts=True)
        order = np.argsort(-counts, kind="stable")
        return tuple(
            Failure(Status(int(codes[k])), int(counts[k]), Status(int(codes[k])).sentence)
            for k in order
        )

    def values(self, name: str) -> np.ndarray:
        """An output or input by name, over all runs. Raises `InputError` for a name that is
        neither."""
        every = {**self.inputs, **self.outputs}
        if name not in every:
            raise InputError(
                f"{name!r} is no output of this dispersion: it must be one of {', '.join(every)}."
            )
        return every[name]

    def label(self, name: str) -> str:
        """The name in words with its unit, for tables and axes."""
        unit = self.units.get(name, "")
        return name.replace("_", " ") + (f" [{unit}]" if unit not in ("", "1") else "")

    def table(self, of: str = "outputs") -> list[Row]:
        """A `Row` for each of the `"outputs"` or `"inputs"`: moments, limits of the middle 99 %,
        extremes, over good runs."""
        if of not in ("outputs", "inputs"):
            raise InputError(f"of is {of!r}: it must be 'outputs' or 'inputs'.")
        return [
            self._row(name, x[self.good & np.isfinite(x)]) for name, x in getattr(self, of).items()
        ]

    def _row(self, name: str, x: np.ndarray) -> Row:
        unit = self.units.get(name, "")
        if x.size == 0:
            return Row(name, unit, *(float("nan"),) * 6, runs=0)
        x = x.astype(float)
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
        """The `count` inputs with the largest shares of the variance of an `output`, over good
        runs. No shares, and a NaN for R^2, where nothing scatters. Raises `InputError` for an
        unknown output and for fewer good runs than a regression needs."""
        y = self.values(output).astype(float)
        kept = self.good & np.isfinite(y)
        y = y[kept]
        columns = {
            name: x[kept].astype(float)
            for name, x in self.inputs.items()
            if x[kept].size and np.ptp(x[kept]) > 0.0
        }
        if not columns or np.ptp(y) == 0.0:
            return Contributors(output, {}, float("nan"))
        needed = 2 * len(columns) + 1
        if y.size <= needed:
            raise InputError(
                f"{y.size} good runs are too few to find contributors: there must be more than {needed}."
            )
        z = np.stack([_standard(x) for x in columns.values()], axis=1)
        squares = z**2 - 1.0 - np.mean(z**3, axis=0) * z
        u = _standard(y)
        beta = np.linalg.lstsq(np.concatenate([z, squares], axis=1), u, rcond=None)[0]
        r_squared = 1.0 - float(np.mean((u - np.concatenate([z, squares], axis=1) @ beta) ** 2))
        linear, bent = beta[: len(columns)], beta[len(columns) :]
        shares = linear**2 + bent**2 * np.mean(squares**2, axis=0)
        order = sorted(zip(columns, shares, strict=True), key=lambda pair: -pair[1])
        return Contributors(
            output, {name: float(share) for name, share in order[:count]}, r_squared
        )

    def to_dataset(self) -> "xarray.Dataset":
        """The runs as an xarray dataset along `run`, with the unit of every variable and the record
        in the attributes."""
        from ._store import dataset

        return dataset(self)


def _standard(x: np.ndarray) -> np.ndarray:
    """Mean zero, deviation one."""
    return (x - np.mean(x)) / np.std(x)
