"""Choice of the method of a dispersion by the size of the second-order term of its outputs.

    q = max over outputs of |tr(H P)|/(2 s) and s_2/s_1 - 1,   e = 1/sqrt(runs)

    symbol    meaning                                                           unit
    H, P      second derivatives of an output, covariance of the inputs         of the output, ...
    s_1, s_2  standard deviation by first, and by second derivatives            of the output
    s         s_2
    e         error that is requested: the sampling error of so many runs       1

    q <= e          linear covariance: the term that it neglects is below the sampling error
    q^2 <= e        sigma points, which have this term, and neglect those of its square
    q^2 > e         runs

Runs are chosen, too, where an output is not smooth or has a requirement, whose verdict needs them,
for a sweep, and where a sample of runs contradicts the chosen method.
"""

__all__ = ["MethodChoice", "choose_method"]

import math
import warnings
from typing import NamedTuple

from ..core import Scalar
from ..core.printing import printed
from ..core.status import SimulationError
from ..integration.accuracy import Accuracy
from ._campaign import RUNS, Campaign
from ._whole import check_whole
from .covariance import MONTE_CARLO, Moments, moments


@printed()
class MethodChoice(NamedTuple):
    """The chosen method.

    - `method`: "lincov", "unscented" or "monte_carlo".
    - `reason`: a message with the numbers that decide.
    - `second_order`: the largest second-order term q; NaN where it was not computed.
    - `moments`: the result of the method, `None` for runs."""

    method: str
    reason: str
    second_order: float
    moments: Moments | None = None


def choose_method(
    campaign: Campaign, runs: int = RUNS, *, accuracy: Accuracy | Scalar | None = None
) -> MethodChoice:
    """Choose the cheapest method whose error is below the sampling error of so many runs.

    **Arguments**

    - `campaign`: as for `disperse`.
    - `runs`: the number of runs that would be accurate enough.
    - `accuracy`: as in `disperse`.

    **Returns** a `MethodChoice`.

    **Raises** `InputError` for a number of runs that is not whole and positive."""
    check_whole("runs", runs, 1)
    if campaign.sweep is not None:
        return _runs("the campaign has a sweep")
    required = [name for name, _ in campaign.requirements]
    if required:
        return _runs(f"the verdict on a requirement needs them ({', '.join(required)})")
    try:
        with warnings.catch_warnings():
            # The reason states what they would.
            warnings.simplefilter("ignore")
            first = moments(campaign, "lincov", accuracy=accuracy, check=0)
            second = moments(campaign, "second_order", accuracy=accuracy, check=0)
    except SimulationError as error:
        return _runs(f"the nominal run cannot be differentiated ({error})")
    terms = {name: _term(first, second, name) for name in second.names}
    rough = [name for name, q in terms.items() if not math.isfinite(q)]
    if rough:
        return _runs(f"{', '.join(rough)} is not smooth at the nominal run", math.nan)
    worst = max(terms, key=lambda name: terms[name])
    q, allowed = terms[worst], 1.0 / math.sqrt(runs)
    size = f"the second-order term of {worst} is {100.0 * q:.2g} % of its standard deviation"
    if q * q > allowed:
        return _runs(
            f"{size}, so that the terms beyond it exceed {100.0 * allowed:.2g} %, the sampling "
            f"error of {runs} runs",
            q,
        )
    method, name = (
        ("lincov", "linear covariance") if q <= allowed else ("unscented", "sigma points")
    )
    relation = "below" if q <= allowed else "above, and its square below,"
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = moments(campaign, method, accuracy=accuracy)
    except SimulationError as error:
        return _runs(f"a sigma point fails ({error})", q)
    unsure = [n for n in found.names if n in found.warnings or not math.isfinite(found.std(n))]
    if unsure:
        return _runs(f"a sample of runs contradicts {name} for {', '.join(unsure)}", q)
    reason = (
        f"{name}, because {size}, {relation} {100.0 * allowed:.2g} %, the sampling error of {runs} "
        "runs."
    )
    return MethodChoice(method, reason, q, found)


def _runs(why: str, q: float = math.nan) -> MethodChoice:
    return MethodChoice(MONTE_CARLO, f"runs, because {why}.", q)


def _term(first: Moments, second: Moments, name: str) -> float:
    """The second-order term of an output in its mean and in its standard deviation, relative to the
    latter."""
    k = second.names.index(name)
    spread = second.std(name)
    if not math.isfinite(spread):
        return math.nan
    if spread == 0.0:
        return 0.0
    linear = first.std(name)
    growth = spread / linear - 1.0 if linear > 0.0 else math.inf
    # An output that is quadratic at the nominal run has no linear part: runs.
    if not math.isfinite(growth):
        return 1e9
    return max(abs(float(second.mean[k] - first.mean[k])) / spread, abs(growth))
