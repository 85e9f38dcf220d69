"""Statistics of each row of a sweep: a table of the swept inputs and the outputs, and grids of it.

Run i of r rows belongs to the row i mod r.
"""

__all__ = ["SweepTable", "sweep_table"]

import csv
import math
import os
from collections.abc import Mapping
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from ..core import InputError
from ..core.listed import no_method
from ..core.suggestions import suggests
from ..core.text import aligned
from ._rounding import NOISE, rounded

EPS = float(np.finfo(float).eps)
STATISTICS = ("mean", "std", "violated")
# Rows of a printed table.
MOST_ROWS = 60


class SweepGrid(NamedTuple):
    """A statistic over two swept inputs: the values on both axes, x and y, each sorted, and
    `values`, (y, x), NaN where the sweep has no row."""

    x: np.ndarray
    y: np.ndarray
    values: np.ndarray


@suggests
class SweepTable(NamedTuple):
    """Statistics of each row of a sweep; printing it shows the table.

    - `columns`: the values of the swept inputs, each (rows,), by name.
    - `runs`, `good`: numbers of computed and of successful runs, each (rows,).
    - `mean`, `std`: moments of each output over the successful runs in which it is finite, each
      (rows,), by name; NaN without such runs, and a standard deviation of NaN for a single one.
    - `violated`: for each output with a requirement, the share of runs that violate it, each
      (rows,); a failed run counts as a violation.
    - `units`: of inputs and outputs, by name."""

    columns: dict[str, np.ndarray]
    runs: np.ndarray
    good: np.ndarray
    mean: dict[str, np.ndarray]
    std: dict[str, np.ndarray]
    violated: dict[str, np.ndarray]
    units: Mapping[str, str]

    @property
    @no_method
    def varying(self) -> tuple[str, ...]:
        """The swept inputs with more than one value."""
        return tuple(name for name, x in self.columns.items() if np.unique(x).size > 1)

    def statistic(self, output: str, take: str = "mean") -> np.ndarray:
        """A statistic of an output, (rows,).

        **Arguments**

        - `output`: its name.
        - `take`: "mean", "std", or "violated" for an output with a requirement.

        **Raises** `InputError` for an unknown output or statistic."""
        if take not in STATISTICS:
            raise InputError(f"take is {take!r}: it must be one of {', '.join(STATISTICS)}.")
        known: Mapping[str, np.ndarray] = getattr(self, take)
        if output not in known:
            what = "an output with a requirement" if take == "violated" else "an output"
            listed = f"one of {', '.join(known)}" if known else "there is none"
            raise InputError(
                f"{output!r} is not {what} of this sweep: {listed}.{InputError.hint(output, known)}"
            )
        return known[output]

    def grid(
        self,
        output: str,
        x: str,
        y: str,
        take: str = "mean",
        at: Mapping[str, float] | None = None,
    ) -> SweepGrid:
        """A statistic of an output over two swept inputs, for a heat map.

        **Arguments**

        - `output`, `take`: as for `statistic`.
        - `x`, `y`: the swept inputs on the axes.
        - `at`: the values of further swept inputs; by default the first of each.

        **Returns** a `SweepGrid`.

        **Raises** `InputError` for names that are not swept, for x equal to y, and where several
        rows have the same place."""
        values = self.statistic(output, take)
        for name in (x, y, *(at or {})):
            if name not in self.columns:
                raise InputError(
                    f"{name!r} is not a swept input: it must be one of {', '.join(self.columns)}."
                    f"{InputError.hint(name, self.columns)}"
                )
        if x == y:
            raise InputError(f"x and y are both {x!r}: they must differ.")
        chosen = np.ones(len(self.runs), bool)
        for name, column in self.columns.items():
            if name not in (x, y):
                chosen &= column == (at or {}).get(name, column[0])
        across, i = np.unique(self.columns[x][chosen], return_inverse=True)
        up, j = np.unique(self.columns[y][chosen], return_inverse=True)
        if np.unique(j * across.size + i).size < i.size:
            raise InputError(f"Several rows have the same values of {x} and {y}.")
        result = np.full((up.size, across.size), np.nan)
        result[j, i] = values[chosen]
        return SweepGrid(across, up, result)

    @property
    def table(self) -> list[tuple[str, ...]]:
        """The table as text, below its heads: a line for each row of the sweep."""
        many = bool(np.any(self.runs > 1))
        heads = ["row", *(self._label(name) for name in self.columns)]
        heads += ["runs"] if many else []
        for name in self.mean:
            heads += [self._label(name), *(["std dev"] if many else [])]
            heads += ["violated"] if name in self.violated else []
        failed = bool(np.any(self.good < self.runs))
        heads += ["failed"] if failed else []
        lines = [tuple(heads)]
        for k in range(len(self.runs)):
            cells = [str(k), *(f"{column[k]:.6g}" for column in self.columns.values())]
            cells += [str(self.runs[k])] if many else []
            for name, mean in self.mean.items():
                std = float(self.std[name][k])
                # The rounding of sums over the steps is no dispersion.
                std = 0.0 if std <= NOISE * EPS * abs(mean[k]) else std
                cells += [rounded(float(mean[k]), std) if self.good[k] else "-"]
                cells += [rounded(std, std) if math.isfinite(std) else "-"] if many else []
                if name in self.violated:
                    cells.append(f"{100.0 * self.violated[name][k]:.3g} %")
            cells += [str(self.runs[k] - self.good[k])] if failed else []
            lines.append(tuple(cells))
        return lines

    def _label(self, name: str) -> str:
        unit = self.units.get(name, "")
        return f"{name} [{unit}]" if unit not in ("", "1") else name

    def __repr__(self) -> str:
        lines = self.table
        head = f"Sweep of {len(self.runs)} rows"
        more = len(lines) - 1 - MOST_ROWS
        shown = aligned(lines[: MOST_ROWS + 1], left=1)
        return "\n".join([head, shown, *([f"and {more} more"] if more > 0 else [])])

    def to_csv(self, path: "str | os.PathLike[str]") -> None:
        """Write the table with all digits: a line for each row of the sweep."""
        columns: dict[str, np.ndarray] = {"row": np.arange(len(self.runs))}
        columns |= {self._label(name): x for name, x in self.columns.items()}
        columns |= {"runs": self.runs, "successful": self.good}
        for name in self.mean:
            columns[f"mean of {self._label(name)}"] = self.mean[name]
            columns[f"standard deviation of {self._label(name)}"] = self.std[name]
            if name in self.violated:
                columns[f"share of violations of {name}"] = self.violated[name]
        with open(path, "w", newline="", encoding="utf-8") as out:
            writer = csv.writer(out)
            writer.writerow(columns)
            writer.writerows(zip(*(x.tolist() for x in columns.values()), strict=True))


@runtime_checkable
class SweptRuns(Protocol):
    """The parts of a `Dispersion` that the table of a sweep is made of."""

    @property
    def attributes(self) -> dict: ...

    @property
    def requirements(self) -> dict: ...

    @property
    def units(self) -> dict: ...

    @property
    def run_numbers(self) -> np.ndarray: ...

    @property
    def outputs(self) -> Mapping: ...

    @property
    def good(self) -> np.ndarray: ...

    def values(self, name: str) -> np.ndarray: ...


def sweep_table(result: SweptRuns) -> SweepTable:
    """The statistics of each row of the sweep of a campaign: see `Dispersion.by_row`.

    **Raises** `InputError` if the campaign has no sweep."""
    sweep = result.attributes.get("sweep")
    if sweep is None:
        raise InputError(
            "This campaign has no sweep: Campaign.at(rows), or [sweep] in a scene file, defines "
            "one."
        )
    rows = int(sweep["rows"])
    of_run = result.run_numbers % rows
    columns = {}
    for name in sweep["inputs"]:
        columns[name] = np.full(rows, np.nan)
        columns[name][of_run] = result.values(name)
    mean, std, violated = {}, {}, {}
    for name in result.outputs:
        x = result.values(name).astype(float)
        mean[name], std[name] = _moments(x, of_run, result.good & np.isfinite(x), rows)
    runs = np.bincount(of_run, minlength=rows)
    for name, (low, high) in result.requirements.items():
        x = result.values(name)
        met = result.good.copy()
        met &= True if low is None else x >= low
        met &= True if high is None else x <= high
        lost = np.bincount(of_run, ~met, rows)
        violated[name] = lost / np.where(runs > 0, runs, np.nan)
    good = np.bincount(of_run, result.good, rows).astype(int)
    names = (*columns, *mean)
    units = {name: result.units[name] for name in names if name in result.units}
    return SweepTable(columns, runs, good, mean, std, violated, units)


def _moments(
    x: np.ndarray, of_run: np.ndarray, used: np.ndarray, rows: int
) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard deviation in each row, (rows,), over the runs that are used."""
    x, place = x[used], of_run[used]
    count = np.bincount(place, minlength=rows).astype(float)
    some = np.where(count > 0, count, np.nan)
    mean = np.bincount(place, x, rows) / some
    # About the mean of each row: squares of large numbers would lose a small deviation.
    square = np.bincount(place, (x - mean[place]) ** 2, rows)
    return mean, np.sqrt(square / np.where(count > 1, count - 1.0, np.nan))
