"""The loosest tolerance sufficient for the purpose of a campaign, and the numerical errors of
outputs.

The mean of an output over n runs is known to its sampling error, s / sqrt(n), where s is its
standard deviation. The numerical error e(r) at a tolerance r may be a twentieth of that:

    e(r) <= s / (20 sqrt(n)),     e(r)^2 = mean of (y_i(r) - y_i(r_ref))^2

over the runs i of the first call, which are those of the campaign, by its program: a tolerance is a
number of it. r_ref is far tighter. The mean is off by less than e(r), and errors add in squares:
the sampling error grows by less than an eight-hundredth.
"""

import math
import warnings
from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import jax.numpy as jnp
import numpy as np

from ..core.record import Record
from ..core.status import SimulationError, Status
from ..integration.accuracy import DEFAULT_RTOL, least_tolerance
from ..statistics.purpose import Purpose
from ..stores.results import RunResults

SHARE = 0.05
# Two for each power of ten. At looser ones a step is as long as the motion itself.
RUNGS = tuple(float(f"{digit}e-{k}") for k in range(4, 12) for digit in (3, 1))[1:]
# How much tighter than the default those runs are with which others are compared: the first of them
# that can be run; and how much looser those others are at least.
REFERENCES, TOLERANCE_RATIO = (1e-3, 1e-2, 1e-1, 1.0), 10.0
# As of the runs with a given tolerance, which shows their errors to a tenth; and the least that
# shows any.
FINER, RESOLVED_BY = 0.1, 0.2
# An output is dispersed if its standard deviation is above this power of the rounding of its
# values.
RESOLVED = 2.0 / 3.0

Simulated: TypeAlias = Callable[[float], RunResults]
"""The runs of the first call of a campaign at a tolerance."""


class TunedTolerance(NamedTuple):
    """The result of a search: the purpose, and the numerical errors by output."""

    purpose: Purpose
    errors: dict[str, float]

    @property
    def record(self) -> Record:
        """The part of it that is stored."""
        return {"by_purpose": self.purpose._asdict(), **recorded(self.errors)}


def recorded(errors: dict[str, float]) -> Record:
    """The stored numerical errors: the known ones, and none for a closed form."""
    finite = {name: x for name, x in errors.items() if math.isfinite(x)}
    return {"numerical_errors": finite} if any(finite.values()) else {}


def tolerance_by_purpose(simulated: Simulated, runs: int) -> TunedTolerance:
    """The loosest sufficient tolerance, of those tried, for a campaign of `runs` runs; the default
    one for a closed form, which does not depend on the tolerance. Warns if none is sufficient.

    From the default tolerance the search jumps to the tolerance predicted from its errors, and
    continues stepwise: to tighter ones until one is sufficient, or to looser ones while they are.
    Raises `SimulationError` where the nominal run fails."""
    dtype = jnp.result_type(float)
    default = DEFAULT_RTOL[dtype.name]
    known: dict[float, RunResults] = {}

    def at(rtol: float) -> RunResults:
        if rtol not in known:
            known[rtol] = simulated(rtol)
        return known[rtol]

    least, reference = _reference(at, default, 2.0 * least_tolerance(dtype))
    rungs = [r for r in RUNGS if r >= 0.99 * TOLERANCE_RATIO * least or r == default > least]
    allowed = {n: SHARE * s / math.sqrt(runs) for n, s in deviations(reference).items()}

    def excess(rtol: float) -> float:
        """The largest error of an output in units of the allowed error."""
        errors = numerical_errors(at(rtol), reference)
        return max((errors[name] / x for name, x in allowed.items()), default=0.0)

    found = default if default in rungs else rungs[-1]
    there = excess(found)
    if 0.0 < there < math.inf:
        # Errors are about proportional to the tolerance.
        aim = found / there
        found = min(rungs, key=lambda r: abs(math.log(r / aim)))
        there = excess(found)
    while there > 1.0 and found > rungs[-1]:
        found = rungs[rungs.index(found) + 1]
        there = excess(found)
    while 0.0 < there <= 1.0 and found < rungs[0]:
        looser = rungs[rungs.index(found) - 1]
        if excess(looser) > 1.0:
            break
        found, there = looser, excess(looser)
    spent = [int(np.sum(at(r).evaluations)) for r in (found, default)]
    errors = {n: numerical_errors(at(found), reference)[n] for n in allowed}
    purpose = Purpose(found, default, spent[0] / max(spent[1], 1), there)
    if there > 1.0:
        name = max(allowed, key=lambda n: errors[n] / allowed[n])
        warnings.warn(f"{purpose.sentence} The limiting output is {name}.", stacklevel=4)
    return TunedTolerance(purpose, errors)


def _reference(at: Simulated, default: float, least: float) -> tuple[float, RunResults]:
    """The tightest runs that can be made, and their tolerance."""
    *better, last = [max(default * factor, least) for factor in REFERENCES]
    for rtol in better:
        # Their steps may run out.
        try:
            return rtol, at(rtol)
        except SimulationError:
            continue
    return last, at(last)


def errors_at(rtol: float, here: RunResults, simulated: Simulated) -> dict[str, float]:
    """The numerical errors of the dispersed outputs, by name, from the runs `here` with a tolerance
    `rtol` and those with a tenth of it. Empty where the precision does not resolve a tenth, or
    where the runs cannot be made."""
    finer = max(FINER * rtol, 2.0 * least_tolerance(jnp.result_type(float)))
    if finer > RESOLVED_BY * rtol:
        return {}
    try:
        reference = simulated(finer)
    except SimulationError:
        return {}
    errors = numerical_errors(here, reference)
    return {name: errors[name] for name in deviations(reference)}


def numerical_errors(here: RunResults, reference: RunResults) -> dict[str, float]:
    """The mean of the errors of each output, in squares, over the runs that end well in the
    reference; infinite where one of them does not end well here."""
    result = {}
    for name, exact, usable in _good(reference):
        # Errors of failed runs are NaN.
        with np.errstate(invalid="ignore"):
            apart = np.asarray(here.outputs[name], float)[usable] - exact[usable]
        square = float(np.mean(apart * apart)) if apart.size else 0.0
        result[name] = math.sqrt(square) if math.isfinite(square) else math.inf
    return result


def deviations(results: RunResults) -> dict[str, float]:
    """The standard deviation of each output whose dispersion exceeds rounding errors."""
    result = {}
    for name, x, usable in _good(results):
        x = x[usable]
        if x.size < 2:
            continue
        rounding = float(np.finfo(jnp.result_type(float)).eps) ** RESOLVED
        deviation = float(np.std(x, ddof=1))
        if deviation > rounding * float(np.max(np.abs(x))):
            result[name] = deviation
    return result


def _good(results: RunResults) -> list[tuple[str, np.ndarray, np.ndarray]]:
    """Name and values of each output, and which of them count."""
    good = np.asarray(results.status) <= Status.EVENT
    arrays = {name: np.asarray(x, float) for name, x in results.outputs.items()}
    return [(name, x, good & np.isfinite(x)) for name, x in arrays.items()]
