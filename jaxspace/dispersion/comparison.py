"""Comparison of the methods without many runs with Monte Carlo: their errors and their cost."""

__all__ = ["Comparison", "compare_methods"]

import math
from typing import NamedTuple

from ..core import Scalar
from ..core.printing import printed
from ..integration.accuracy import Accuracy
from ..statistics import Dispersion
from ..statistics.sample_check import standard_errors, warning_of
from ._campaign import Campaign
from .covariance import METHODS, MONTE_CARLO, moments


@printed(seconds="s")
class Comparison(NamedTuple):
    """Error and cost of a method in one output.

    - `method`, `output`: of the row.
    - `mean`, `std`: results of the method.
    - `mean_error`: its mean minus that of Monte Carlo, in standard deviations.
    - `std_error`: its standard deviation over that of Monte Carlo, minus one. For Monte Carlo
      itself both are its standard errors.
    - `runs`, `seconds`: of the method, without compiling.
    - `warning`: a message if the method is not valid; empty otherwise."""

    method: str
    output: str
    mean: float
    std: float
    mean_error: float
    std_error: float
    runs: int
    seconds: float
    warning: str = ""


def compare_methods(
    campaign: Campaign,
    reference: Dispersion,
    methods: tuple[str, ...] = METHODS,
    *,
    accuracy: Accuracy | Scalar | None = None,
) -> list[Comparison]:
    """Compare the methods without many runs with a Monte Carlo dispersion of the same campaign.

    **Arguments**

    - `campaign`: the common campaign.
    - `reference`: its runs.
    - `methods`: the methods of `disperse` without runs.
    - `accuracy`: as in `disperse`.

    **Returns** a row for each output and method, of each output that of the runs first."""
    # They need no sample to check against, because the reference is a larger one.
    result = [moments(campaign, method, accuracy=accuracy, check=0) for method in methods]
    table = []
    # Without compiling, as those of the other methods.
    seconds = reference.seconds - float(reference.attributes.get("preparation_seconds", 0.0))
    for row in reference.table():
        errors = standard_errors(reference.together(row.name)[0])
        x = reference.values(row.name)[reference.good].astype(float)
        table.append(
            Comparison(MONTE_CARLO, row.name, row.mean, row.std, *errors, row.runs, seconds)
        )
        for m in result:
            mean = float(m.mean[m.names.index(row.name)])
            std = m.std(row.name)
            off = (mean - row.mean) / row.std if row.std > 0.0 else math.nan
            ratio = std / row.std - 1.0 if row.std > 0.0 else math.nan
            warning = warning_of(mean, std, x)
            table.append(
                Comparison(m.method, row.name, mean, std, off, ratio, m.runs, m.seconds, warning)
            )
    return table
