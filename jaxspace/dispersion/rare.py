"""Probabilities too small for a plain Monte Carlo campaign: one violation in a million runs.

    method         file              finds violations by           density of the runs
    "importance"   `_importance.py`  derivatives, a wide search    mixture about violations
                                     and subset simulations
    "subset"       `_subset.py`      levels of one tenth each      chains within each level

Both search in the space of the standard normal variables behind the inputs, and among the values of
a list (`Discrete`) with modified probabilities, so that rare ones are drawn; the runs are weighted
by the ratio of the probabilities. A first sample selects the method: for a probability from a fifth
to four fifths plain Monte Carlo is better, and above it the complement is treated as the rare
event.
"""

__all__ = ["RareEvent", "rare_event"]

from collections.abc import Mapping
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from ..core import InputError, Scalar
from ..core.printing import printed
from ..integration.accuracy import Accuracy
from ..sampling.designs import map_normals, normal_columns, search_normals
from ..statistics.limits import clopper_pearson
from ._campaign import Campaign, check_no_sweep, in_order
from ._importance import importance
from ._interface import jit_of_campaign
from ._subset import subset
from ._whole import check_whole
from .evaluate import BLOCK, Evaluator, evaluate_traced

# Below, and above one minus this, an event is rare.
RARE = 0.2
MONTE_CARLO = "monte_carlo"


@printed()
class RareEvent(NamedTuple):
    """The probability of a violation.

    - `value`, from `low` to `high` with 95 % confidence: an interval for few weighted violations,
      which is above zero if none was found.
    - `variation`: standard error over the value.
    - `runs`: total number of runs, with or without derivatives; `failed`: the failed ones, which
      count as violations.
    - `points`: the design points, (points, dimensions); their distances from zero are the
      reliability indices. None for subset simulation.
    - `method`: the method used: the requested one, or "monte_carlo" where the event is not rare.
    - `warning`: a message if the value is based on few violations, or regions may have been missed
      by the search, which the interval accounts for; empty otherwise.
    - `reliable`: False if the interval may miss the probability in more than 5 % of cases:
      independent searches of importance sampling found violations in different regions, or a level
      of subset simulation has too few distinct seeds of its chains."""

    value: float
    low: float
    high: float
    variation: float
    runs: int
    failed: int
    points: np.ndarray
    method: str
    warning: str = ""
    reliable: bool = True


def rare_event(
    campaign: Campaign,
    output: str,
    *,
    above: float | None = None,
    below: float | None = None,
    runs: int = 10000,
    method: str = "importance",
    seed: int = 0,
    accuracy: Accuracy | Scalar | None = None,
) -> RareEvent:
    """The probability that an output is above, or below, a limit.

    **Arguments**

    - `campaign`: of the runs.
    - `output`: its name; `above` or `below`: the limit.
    - `runs`: approximate number of runs.
    - `method`: "importance" searches the nearest violations along the derivatives, and others
      without derivatives, and samples around all of them: the more accurate method. "subset" needs
      no derivatives, and is cheaper for many inputs and slow runs.
    - `seed`, `accuracy`: as in `disperse`.

    **Returns** a `RareEvent`. Inputs and outputs may be discrete. A probability that is not below
    a fifth comes from plain Monte Carlo, and one above four fifths from its complement.

    **Raises** `InputError` unless exactly one finite limit is given, for an unknown method or
    output, for `runs` and a `seed` that are not integers, and if importance sampling finds no
    violation (the limit cannot be reached)."""
    if (above is None) == (below is None):
        raise InputError("above and below: exactly one of them must be given.")
    if method not in ("importance", "subset"):
        raise InputError(f"method is {method!r}: it must be importance or subset.")
    limit, sign = (above, -1.0) if above is not None else (below, 1.0)
    assert limit is not None
    if not np.isfinite(limit):
        raise InputError(f"{'below' if above is None else 'above'} is {limit}: it must be finite.")
    check_whole("runs", runs, 2)
    check_whole("seed", seed, 0)
    check_no_sweep(campaign, "rare_event")
    accuracy = campaign.accuracy_for(accuracy)
    _check_output(campaign, accuracy, output)
    margins = _Margins(campaign, accuracy, output, limit, sign)
    rng = np.random.default_rng(seed)
    n = sum(map(len, normal_columns(campaign.inputs).values()))
    # Enough for a decision.
    first = rng.standard_normal((max(100, runs // 50), n))
    share = float(np.mean((margins(first) < 0.0) * margins.likelihood(first)))
    points = np.zeros((0, n))
    found = None
    if not RARE <= share <= 1.0 - RARE:
        margins.inverted = share > RARE
        if method == "subset":
            found = subset(margins, margins.likelihood, n, runs, rng)
        else:
            left = runs - margins.runs
            points, found = importance(margins, margins.likelihood, margins.slopes, n, left, rng)
        if found is None and not margins.inverted:
            raise InputError(
                f"No violation was found in {margins.runs} runs, neither along the derivatives nor "
                "without them: check that the limit can be reached."
            )
    if found is None:
        low, value, high = margins.plain(runs, rng)
        variation = float(np.sqrt((1.0 - value) / (value * runs))) if value > 0.0 else np.inf
        how = MONTE_CARLO
        warning, reliable = "", True
    else:
        value, variation, how = found.value, found.variation, method
        warning, reliable = found.warning, found.reliable
        low, high = found.interval()
        if margins.inverted:
            variation *= value / (1.0 - value)
            low, value, high = 1.0 - high, 1.0 - value, 1.0 - low
    return RareEvent(
        value,
        low,
        high,
        variation,
        margins.runs,
        margins.failed,
        points,
        how,
        warning,
        reliable,
    )


class _Margins:
    """The margin of a requirement as a function of the standard normal numbers of a search.

    `runs`, `failed`: number of runs used, and failed. If `inverted`, the event is that the
    requirement is satisfied."""

    def __init__(
        self, campaign: Campaign, accuracy: Accuracy, output: str, limit: float, sign: float
    ):
        self.campaign, self.accuracy, self.output = campaign, accuracy, output
        self.limit, self.sign = limit, sign
        self.run = Evaluator(campaign, accuracy)
        self.runs = self.failed = 0
        self.inverted = False

    def __call__(self, z: np.ndarray) -> np.ndarray:
        """g of runs, (runs,), from z, (runs, n); minus infinity where a run failed."""
        return self._of(_searched(self.campaign, z)[0])

    def likelihood(self, z: np.ndarray) -> np.ndarray:
        """The likelihood ratio of the runs: true density over that of the search, (runs,)."""
        return _searched(self.campaign, z)[1]

    def slopes(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """g, (starts,), and its derivatives, (starts, n), at z, (starts, n)."""
        self.runs += len(z)
        y, dy = _values_and_slopes(self.campaign, self.accuracy, jnp.asarray(z), self.output)
        sign = -self.sign if self.inverted else self.sign
        return sign * (np.asarray(y, float) - self.limit), sign * np.asarray(dy, float).T

    def plain(self, runs: int, rng: np.random.Generator) -> tuple[float, float, float]:
        """Limits and value of the probability from plain Monte Carlo."""
        self.inverted = False
        n = sum(map(len, normal_columns(self.campaign.inputs).values()))
        g = self._of(map_normals(self.campaign.inputs, rng.standard_normal((runs, n))))
        found = clopper_pearson(int(np.count_nonzero(g < 0.0)), runs)
        return found.low, found.value, found.high

    def _of(self, samples: Mapping[str, ArrayLike]) -> np.ndarray:
        result = self.run(samples)
        g = self.sign * (result.outputs[self.output].astype(float) - self.limit)
        self.runs += len(g)
        self.failed += int(np.count_nonzero(~result.good))
        # An infinite output is on one side of the limit; NaN satisfies none.
        g = np.where(result.good & ~np.isnan(g), g, -np.inf)
        # A margin of zero satisfies the requirement.
        return np.where(g == 0.0, -np.finfo(float).tiny, -g) if self.inverted else g


def _searched(campaign: Campaign, z: np.ndarray) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """The inputs of a search at z, (runs, n), each (runs,), and their likelihood, (runs,)."""
    runs = len(z)
    # In blocks, so that one program works for every number of runs.
    filled = np.concatenate([z, np.zeros((-runs % BLOCK, z.shape[1]))])
    blocks = [_block(campaign, jnp.asarray(x)) for x in np.split(filled, len(filled) // BLOCK)]
    samples, likelihood = jax.tree.map(lambda *x: np.concatenate(x)[:runs], *blocks)
    return samples, likelihood.astype(float)


@jit_of_campaign
def _block(
    campaign: Campaign, z: Float[Array, "runs n"]
) -> tuple[dict[str, Float[Array, " runs"]], Float[Array, " runs"]]:
    return search_normals(campaign.inputs, z)


def _check_output(campaign: Campaign, accuracy: Accuracy, output: str) -> None:
    """Raise `InputError` for an output that the campaign does not have."""

    def outputs() -> dict[str, Array]:
        return evaluate_traced(campaign, accuracy, campaign.nominal())[0]

    # Traced only: the names are known without a run.
    names = in_order(campaign, eqx.filter_eval_shape(outputs))
    if output not in names:
        raise InputError(
            f"output is {output!r}: it must be one of {', '.join(names)}."
            f"{InputError.hint(output, names)}"
        )


@jit_of_campaign
def _values_and_slopes(
    campaign: Campaign, accuracy: Accuracy, z: Float[Array, "starts n"], output: str
) -> tuple[Float[Array, " starts"], Float[Array, "n starts"]]:
    """An output at several points, and its derivatives with respect to the standard normal
    numbers."""

    def value(z: Array) -> tuple[Array, Array]:
        samples = search_normals(campaign.inputs, z)[0]
        y = evaluate_traced(campaign, accuracy, samples)[0][output]
        return y, y

    def along(direction: Array) -> tuple[Array, Array]:
        # Each run depends on its own point only: one direction is sufficient for all of them.
        _, slope, y = jax.jvp(value, (z,), (jnp.broadcast_to(direction, z.shape),), has_aux=True)
        return slope, y

    slopes, y = jax.vmap(along, out_axes=(0, None))(jnp.eye(z.shape[1], dtype=z.dtype))
    return y, slopes
