"""Importance sampling of a rare event: draws where the violations are, each with its weight.

    p = mean of 1[g(z) < 0] w(z),   w = phi(z) / q(z)

    symbol  meaning                                                   unit
    z       standard normal numbers behind the inputs                 1
    g       margin of the requirement, negative where it is violated  of the output
    phi, q  density of independent standard normal numbers, and that  1
            of the draws (`_mixture.py`)

The density follows the design points, to which derivatives lead from the origin and from violations
found without derivatives, and these violations. A search among widely scattered numbers finds
separate regions of violation (`_wide_search.py`). Two independent subset simulations find
violations with their true shares: short ones where the design points explain these violations,
longer ones where not. A first part of the draws reveals deficiencies of the density, and improves
that of the second part. Each part is weighted with the density from which it was drawn, and both
estimates by the variances that the violations of the simulations predict, so that they remain
unbiased.

The density from one simulation, with the design points to which its violations lead, should cover
the violations found by the other one. The weights of these violations predict the variance of the
estimate, which the draws underestimate where they miss the largest weights. Violations that
neither density covers would be missed by both with the product of the probabilities, which widens
the interval (capture and recapture). A violation is covered if its weight is not many times the
probability, which is the weight of all violations under the best density.
Source: Melchers, Structural Reliability, 2nd edition, 3.4.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ._design_points import Slope, design_points, explained, points_from, united
from ._estimate import Estimate
from ._mixture import Mixture, mixture
from ._subset import Margin, explore
from ._wide_search import pulled_in, search_widely

Likelihood = Callable[[np.ndarray], np.ndarray]
"""The factor by which the search draws runs too seldom, (runs,), from z, (runs, n)."""

# Runs in a level of a short and of a long simulation, and violations of the wide search, as shares
# of all runs; and the least.
SHORT_LEVEL, LONG_LEVEL, LEAST = 1 / 70, 1 / 30, 100
WIDELY, LEAST_WIDELY = 1 / 100, 50
# Evaluations with derivatives for each of the searches for design points, as a share of all runs.
WITH_DERIVATIVES = 1 / 15
# About one design point of a smooth limit the weights of violations are uniform from zero on: twice
# the median at most. Below so many times the median the points explain all violations found.
EXPLAINED = 6.0
# A weight that is so many times the probability belongs to a place that is not covered.
UNCOVERED = 40.0
FIRST_PART = 1 / 3


class Violations(NamedTuple):
    """Violations found: z, (runs, n), in two independent groups, and their shares, (runs,)."""

    z: np.ndarray
    first: np.ndarray
    share: np.ndarray


class Searched(NamedTuple):
    """The results of the searches.

    - `points`: design points, (points, n).
    - `of_groups`: those known without the violations of the other group, for each group.
    - `apart`: violations of the wide search that no point explains, (runs, n).
    - `found`: violations of the subset simulations.
    - `made`: number of runs, without those with derivatives."""

    points: np.ndarray
    of_groups: tuple[np.ndarray, np.ndarray]
    apart: np.ndarray
    found: Violations
    made: int


def importance(
    margin: Margin,
    likelihood: Likelihood,
    slope: Slope | None,
    n: int,
    runs: int,
    rng: np.random.Generator,
) -> tuple[np.ndarray, Estimate | None]:
    """The design points, (points, n), and the probability of a violation, from about so many
    `runs`; `None` where no violation is found. `slope` is `None` where there are no derivatives."""
    points, of_groups, apart, found, made = _search(margin, likelihood, slope, n, runs, rng)
    if len(found.z) == len(points) == len(apart) == 0:
        return points, None
    first = mixture(points, found.z, found.first, found.share, rng, apart)
    # However many runs the search took, the draws decide.
    left = max(runs - made, runs // 4, 4)
    counts = [max(int(FIRST_PART * left), 2)]
    counts.append(left - counts[0])
    z, weights = _drawn(margin, likelihood, first, counts[0], rng)
    hit = weights > 0.0
    seen = Violations(z[hit], np.arange(np.count_nonzero(hit)) % 2 == 0, weights[hit])
    both = _joined(found, seen)
    second = mixture(points, both.z, both.first, both.share, rng, apart)
    parts = [weights, _drawn(margin, likelihood, second, counts[1], rng)[1]]
    # The weights in both densities of the violations from the search, which are not random draws.
    factor = likelihood(found.z) if len(found.z) else np.zeros(0)
    expected = [factor * q.weights(found.z) for q in (first, second)]
    moments = [float(found.share @ w) if len(w) else 1.0 for w in expected]
    shares = np.array(counts) / moments
    shares /= shares.sum()
    value = float(sum(a * np.mean(w) for a, w in zip(shares, parts, strict=True)))
    crossed = _crossed(of_groups, apart, found, factor, rng)
    square = 0.0
    for a, w, moment, count in zip(shares, parts, moments, counts, strict=True):
        # The variance that the search predicts counts where the draws miss the large weights. A
        # density is too large at the violations that shaped it, and their weights too small.
        predicted = max(moment, _moment(found, crossed)) * value - value**2
        predicted = predicted if len(found.z) else 0.0
        square += a**2 * max(float(np.var(w, ddof=1)), predicted) / count
    scaled = [
        a / k * np.append(w, e) for a, k, w, e in zip(shares, counts, parts, expected, strict=True)
    ]
    return points, Estimate(
        value,
        math.sqrt(square) / value if value > 0.0 else math.inf,
        max(float(w.max()) for w in scaled),
        _unseen(of_groups, found, crossed, value),
        made + left,
    )


def _search(
    margin: Margin,
    likelihood: Likelihood,
    slope: Slope | None,
    n: int,
    runs: int,
    rng: np.random.Generator,
) -> Searched:
    """Look for violations along the derivatives and without them."""
    most = max(int(WITH_DERIVATIVES * runs), 1)
    points = np.zeros((0, n))
    if slope is not None:
        points = design_points(slope, n, most, rng)
    wide, made = search_widely(margin, max(LEAST_WIDELY, int(WIDELY * runs)), n, rng)
    if slope is not None:
        points = points_from(slope, points, wide, most)
    apart, more = pulled_in(margin, wide[~explained(points, wide)])
    made += more
    found = Violations(np.zeros((0, n)), np.zeros(0, bool), np.zeros(0))
    of_groups = points, points
    # Without a point a short simulation explains nothing.
    parts = (
        ((SHORT_LEVEL, runs // 6), (LONG_LEVEL, runs // 3))
        if len(points)
        else ((LONG_LEVEL, runs // 3),)
    )
    for part, share in parts:
        groups, spent = explore(margin, max(LEAST, int(part * runs)), n, share, rng)
        made += spent
        z = np.concatenate(groups)
        if len(z) == 0:
            continue
        factor = likelihood(z)
        some = Violations(z, np.arange(len(z)) < len(groups[0]), factor)
        found = _joined(found, some)
        if slope is not None:
            # Separately, so that the violations of one group can check the points of the other.
            a, b = (
                points_from(slope, before, group, most // 2)
                for before, group in zip(of_groups, groups, strict=True)
            )
            of_groups = a, b
            points = united(a, b)
        if len(points):
            density = mixture(points, z[:0], some.first[:0], factor[:0], rng)
            weights = factor * density.weights(z)
            if np.max(weights) < EXPLAINED * np.median(weights):
                break
    return Searched(points, of_groups, apart, found, made)


def _joined(a: Violations, b: Violations) -> Violations:
    """Combination of both, each with half of the shares."""
    shares = [x.share / x.share.sum() for x in (a, b) if len(x.share)]
    return Violations(
        np.concatenate([a.z, b.z]),
        np.concatenate([a.first, b.first]),
        np.concatenate([np.zeros(0), *shares]) / max(len(shares), 1),
    )


def _drawn(
    margin: Margin,
    likelihood: Likelihood,
    density: Mixture,
    count: int,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:
    """Draws, (count, n), and their weights, zero where nothing is violated."""
    z = density.drawn(count, rng)
    weights = np.zeros(count)
    hit = margin(z) < 0.0
    if hit.any():
        weights[hit] = density.weights(z[hit]) * likelihood(z[hit])
    return z, weights


def _crossed(
    of_groups: tuple[np.ndarray, np.ndarray],
    apart: np.ndarray,
    found: Violations,
    factor: np.ndarray,
    rng: np.random.Generator,
) -> np.ndarray:
    """Weights of the violations of each group in the density of the other one, (runs,)."""
    weights = np.zeros(len(found.z))
    for one, points in zip((found.first, ~found.first), of_groups, strict=True):
        some, half = found.z[one], np.arange(np.count_nonzero(one)) % 2 == 0
        density = mixture(points, some, half, found.share[one], rng, apart)
        weights[~one] = factor[~one] * density.weights(found.z[~one])
    return weights


def _moment(found: Violations, crossed: np.ndarray) -> float:
    """Mean of the weights of violations, from those `crossed`; zero unless both groups have some,
    because a density without violations is not that of the draws."""
    if found.first.all() or not found.first.any():
        return 0.0
    return float(found.share @ crossed)


def _unseen(
    of_groups: tuple[np.ndarray, np.ndarray],
    found: Violations,
    crossed: np.ndarray,
    value: float,
) -> float:
    """Estimated share of the violations that are not covered, from those of one group that the
    density of the other one does not cover."""
    if len(found.z) == 0:
        return 0.0
    missed = []
    for one, points in zip((found.first, ~found.first), of_groups, strict=True):
        # A search that finds nothing covers nothing, and shows nothing that the other one missed.
        if one.all() or not (len(points) or one.any()):
            missed.append(1.0)
            continue
        share = found.share[~one]
        missed.append(float(share @ (crossed[~one] > UNCOVERED * value) / share.sum()))
    return min(missed[0] * missed[1], 0.9)
