"""Probabilities too small for a plain Monte Carlo campaign: one violation in a million runs.

Importance sampling (Melchers, Structural Reliability, 2nd edition, 3.4; design points by the method
of Hasofer, Lind, Rackwitz and Fiessler):

    z_(i+1) = ((s . z_i - g(z_i)) / (s . s)) s,   s = grad g          to the nearest violation
    p = mean of 1[g(z) < 0] w(z),   w = phi(z) / sum_k a_k phi(z - z_k)

Subset simulation (Au and Beck, Prob. Eng. Mech. 16 (2001), 263; chains of Papaioannou et al., Prob.
Eng. Mech. 41 (2015), 89):

    p = p_0^(m-1) P(last level),   z' = r z + sqrt(1 - r^2) u

    symbol    meaning                                                        unit
    z         standard normal numbers behind the inputs                      1
    g         margin of the requirement, negative where it is violated       of the output
    z_k, a_k  the design points found, and the share of the draws about each 1
    p_0, m    share of the runs that pass a level, and the levels            1, 1
    r, u      correlation of a step of a chain, standard normal numbers      1, 1
"""

__all__ = ["RareEvent", "rare_event"]

import math
from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..core import InputError, Scalar
from ..core.jit import quick_jit
from ..core.printing import printed
from ..integration.accuracy import Accuracy
from ..sampling.designs import map_normals, normal_columns
from ._campaign import Campaign, in_order
from ._whole import check_whole
from .evaluate import Evaluator, evaluate_traced

STARTS, ITERATIONS = 6, 25
LEVEL = 0.1
CORRELATION = 0.8
CHAINED = 4.5
"""How much the runs of a chain, which resemble one another, widen the interval: its variance is 1 +
this times that of independent runs. Of 40 repetitions for 1e-6 the logarithms scattered by 0.41."""


@printed()
class RareEvent(NamedTuple):
    """The probability of a violation.

    - `value`, from `low` to `high` with 95 % confidence (normal in the logarithm).
    - `variation`: standard error over the value.
    - `runs`: all runs made; `failed`: those that failed, which count as violations.
    - `points`: the design points, (points, dimensions); their distances from zero are the
      reliability indices. None for subset simulation.
    - `method`: how it was found."""

    value: float
    low: float
    high: float
    variation: float
    runs: int
    failed: int
    points: np.ndarray
    method: str


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
    """The probability that an output lies above, or below, a limit.

    **Arguments**

    - `campaign`: what runs.
    - `output`: its name; `above` or `below`: the limit.
    - `runs`: about how many.
    - `method`: "importance" looks for the nearest violations along the derivatives and draws about
      them: best where there are few of them. "subset" needs no derivatives, and no nearest point,
      and is less accurate.
    - `seed`, `accuracy`: as in `disperse`.

    **Raises** `InputError` unless exactly one limit is given, for another method, for an output
    that there is not, for `runs` and a `seed` that are no whole numbers, and where the search for a
    design point finds none (the violation cannot be reached, or the derivative is zero)."""
    if (above is None) == (below is None):
        raise InputError("above and below: exactly one of them must be given.")
    if method not in ("importance", "subset"):
        raise InputError(f"method is {method!r}: it must be importance or subset.")
    limit, sign = (above, -1.0) if above is not None else (below, 1.0)
    assert limit is not None
    check_whole("runs", runs, 2)
    check_whole("seed", seed, 0)
    accuracy = campaign.accuracy_for(accuracy)
    _check_output(campaign, accuracy, output)
    n = sum(map(len, normal_columns(campaign.inputs).values()))
    run = Evaluator(campaign, accuracy)
    failed = 0

    def margin(z: np.ndarray) -> np.ndarray:
        """g of runs, (runs,), from z, (runs, n); minus infinity where a run failed."""
        nonlocal failed
        result = run(map_normals(campaign.inputs, z))
        g = sign * (result.outputs[output].astype(float) - limit)
        failed += int(np.count_nonzero(~result.good))
        # An infinite output lies on one side of the limit; what is not a number meets none.
        return np.where(result.good & ~np.isnan(g), g, -np.inf)

    rng = np.random.default_rng(seed)
    if method == "subset":
        value, variation, made = _subset(margin, n, runs, rng)
        points = np.zeros((0, n))
    else:

        def slope(z: np.ndarray) -> tuple[float, np.ndarray]:
            y, dy = _value_and_slope(campaign, accuracy, jnp.asarray(z), output)
            return sign * (float(y) - limit), sign * np.asarray(dy)

        points = _design_points(slope, n, rng)
        value, variation, made = _importance(margin, points, runs, rng)
    # The deviation of the logarithm, of a lognormal value of this variation.
    spread = math.sqrt(math.log1p(variation**2)) if math.isfinite(variation) else math.inf
    low, high = (value * math.exp(s * 1.96 * spread) if value > 0.0 else 0.0 for s in (-1, 1))
    return RareEvent(value, low, min(high, 1.0), variation, made, failed, points, method)


def _check_output(campaign: Campaign, accuracy: Accuracy, output: str) -> None:
    """Raise `InputError` for an output that the campaign has not."""

    def outputs() -> dict[str, Array]:
        return evaluate_traced(campaign, accuracy, campaign.nominal())[0]

    # Traced only: the names are known without a run.
    names = in_order(campaign, eqx.filter_eval_shape(outputs))
    if output not in names:
        raise InputError(
            f"output is {output!r}: it must be one of {', '.join(names)}."
            f"{InputError.hint(output, names)}"
        )


@quick_jit
def _value_and_slope(
    campaign: Campaign, accuracy: Accuracy, z: Float[Array, " n"], output: str
) -> tuple[Array, Array]:
    """An output and its derivative in the standard normal numbers."""

    def value(z: Array) -> tuple[Array, Array]:
        samples = map_normals(campaign.inputs, z[None, :])
        y = evaluate_traced(campaign, accuracy, samples)[0][output][0]
        return y, y

    slope, y = jax.jacfwd(value, has_aux=True)(z)
    return y, slope


Slope = Callable[[np.ndarray], tuple[float, np.ndarray]]
Margin = Callable[[np.ndarray], np.ndarray]


def _design_points(slope: Slope, n: int, rng: np.random.Generator) -> np.ndarray:
    """The nearest violations, (points, n), from several starts."""
    result: list[np.ndarray] = []
    # Not at the origin, where magnitudes have no slope; each start has its opposite.
    away = rng.standard_normal((STARTS // 2, n))
    away /= np.linalg.norm(away, axis=1)[:, None]
    for start in np.concatenate([0.5 * away, -0.5 * away]):
        z = _nearest(slope, start)
        # Points nearer than this are the same one, about which runs must be drawn once only.
        if z is not None and all(np.linalg.norm(z - other) > 0.3 for other in result):
            result.append(z)
    if not result:
        raise InputError(
            "No violation was found along the derivatives: take method='subset', or check that "
            "the limit can be reached."
        )
    points = np.stack(result)
    distance = np.linalg.norm(points, axis=1)
    # What lies farther off by so much is rarer by a factor of a thousand or more.
    return points[0.5 * distance**2 < 0.5 * distance.min() ** 2 + 7.0]


def _nearest(slope: Slope, z: np.ndarray) -> np.ndarray | None:
    """The nearest violation by the damped iteration; `None` where it does not converge."""
    g, s = slope(z)
    scale = abs(g)
    for _ in range(ITERATIONS):
        square = float(s @ s)
        if not (np.isfinite(g) and np.isfinite(square) and square > 0.0):
            return None
        step = (s @ z - g) / square * s - z
        # A merit that the step lowers, for a penalty above |z| / |s| (Zhang and Der Kiureghian).
        penalty = 2.0 * (np.linalg.norm(z) + 1.0) / math.sqrt(square)
        merit = 0.5 * z @ z + penalty * abs(g)
        # If no step lowers the merit the shortest is taken, because the slope there may be another.
        for damping in (1.0, 0.5, 0.25, 0.125):
            trial = z + damping * step
            g_new, s_new = slope(trial)
            if np.isfinite(g_new) and 0.5 * trial @ trial + penalty * abs(g_new) < merit:
                break
        moved = float(np.linalg.norm(trial - z))
        z, g, s = trial, g_new, s_new
        if moved < 1e-3 and abs(g) < 1e-3 * scale:
            return z
    # Close enough to draw about, if it lies on the border at all.
    return z if np.isfinite(g) and abs(g) < 0.05 * scale else None


def _importance(
    margin: Margin, points: np.ndarray, runs: int, rng: np.random.Generator
) -> tuple[float, float, int]:
    """Probability, variation and runs, from draws about the design points."""
    squares = np.sum(points**2, axis=1)
    # In proportion to the density at each point, divided by the greatest against underflow.
    shares = np.exp(-0.5 * (squares - squares.min()))
    shares /= shares.sum()
    which = rng.choice(len(points), runs, p=shares)
    z = points[which] + rng.standard_normal((runs, points.shape[1]))
    # ln(phi(z - z_k) / phi(z)), which does not overflow.
    ratio = z @ points.T - 0.5 * squares
    top = ratio.max(axis=1)
    mixed = np.log(np.exp(ratio - top[:, None]) @ shares) + top
    terms = np.where(margin(z) < 0.0, np.exp(-mixed), 0.0)
    value = float(terms.mean())
    error = float(terms.std(ddof=1)) / math.sqrt(runs)
    return value, error / value if value > 0.0 else math.inf, runs


def _subset(
    margin: Margin, n: int, runs: int, rng: np.random.Generator
) -> tuple[float, float, int]:
    """Probability, variation and runs, level by level."""
    # Seven levels reach 1e-7 with this budget; more levels, if needed, make more runs.
    size = max(100, runs // 7)
    keep = max(int(LEVEL * size), 2)
    z = rng.standard_normal((size, n))
    g = margin(z)
    made = size
    value = 1.0
    variance = 0.0
    for level in range(30):
        # Stable, so that equal margins, as of failed runs, have one order on every machine.
        order = np.argsort(g, kind="stable")
        below, above = float(g[order[keep - 1]]), float(g[order[keep]])
        # Between failed runs and infinitely safe ones there is no middle.
        border = 0.5 * (below + above) if below > -math.inf else below
        # The runs of the first level are independent, those of the chains are not.
        widened = 1.0 if level == 0 else 1.0 + CHAINED
        if border <= 0.0:
            share = float(np.mean(g < 0.0))
            variance += (1.0 - share) / (share * size) * widened
            return value * share, math.sqrt(variance), made
        value *= LEVEL
        variance += (1.0 - LEVEL) / (LEVEL * size) * widened
        z, g, more = _chains(margin, z[order[:keep]], g[order[:keep]], border, size, rng)
        made += more
    # Thirty levels reach 1e-30: what is rarer still counts as impossible.
    return 0.0, math.inf, made


def _chains(
    margin: Margin,
    z: np.ndarray,
    g: np.ndarray,
    border: float,
    size: int,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray, int]:
    """`size` runs below the border, by chains from those there; all chains step at once."""
    every_z = [z]
    every_g = [g]
    made = 0
    while sum(map(len, every_g)) < size:
        u = rng.standard_normal(z.shape)
        # The step preserves the normal distribution, so that only the border can refuse it.
        trial = CORRELATION * z + math.sqrt(1.0 - CORRELATION**2) * u
        g_trial = margin(trial)
        made += len(g)
        better = g_trial < border
        # A refused step repeats its place: without it the chain would have another distribution.
        z, g = np.where(better[:, None], trial, z), np.where(better, g_trial, g)
        every_z.append(z)
        every_g.append(g)
    return np.concatenate(every_z)[:size], np.concatenate(every_g)[:size], made
