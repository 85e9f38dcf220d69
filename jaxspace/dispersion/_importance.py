"""Importance sampling of a rare event: draws where the violations are, each with its weight.

    p = mean of 1[g(z) < 0] w(z),   w = phi(z) / q(z)

    symbol  meaning                                                   unit
    z       standard normal numbers behind the inputs                 1
    g       margin of the requirement, negative where it is violated  of the output
    phi, q  density of independent standard normal numbers, and that  1
            of the draws (`_mixture.py`)

The density follows the design points, to which derivatives lead, and violations that two
independent subset simulations find without derivatives: short ones where the design points explain
what these find, longer ones where not. A first part of the draws reveals deficiencies of the
density, and improves that of the second part. Each part is weighted with the density from which it
was drawn, and both estimates by the variances that the violations of the simulations predict, so
that they remain unbiased.

The density from one simulation should cover the violations found by the other one. Violations that
neither density covers would be missed by both with the product of the probabilities, which widens
the interval (capture and recapture). Source: Melchers, Structural Reliability, 2nd edition, 3.4.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ._estimate import Estimate
from ._mixture import Mixture, mixture
from ._subset import Margin, explore

Likelihood = Callable[[np.ndarray], np.ndarray]
"""The factor by which the search draws runs too seldom, (runs,), from z, (runs, n)."""

# Runs in a level of a short and of a long simulation, as shares of all; and the least.
SHORT, LONG, LEAST = 1 / 70, 1 / 30, 100
# About one design point of a smooth limit the weights of violations are uniform from zero on: twice
# the median at most. Below so many times the median the points explain all violations found.
EXPLAINED = 6.0
CHEAP = 1 / 5
# A weight that is so many times the usual one belongs to a place that is not covered.
UNCOVERED = 4.0
FIRST_PART = 1 / 3


class Violations(NamedTuple):
    """Violations found: z, (runs, n), in two independent groups, and their shares, (runs,)."""

    z: np.ndarray
    first: np.ndarray
    share: np.ndarray


def importance(
    margin: Margin,
    likelihood: Likelihood,
    points: np.ndarray,
    runs: int,
    rng: np.random.Generator,
) -> Estimate | None:
    """The probability of a violation, from about so many `runs`; `None` where no violation is found
    and there are no design `points`, (points, n)."""
    found, made = _violations(margin, likelihood, points, runs, rng)
    if len(found.z) == len(points) == 0:
        return None
    first = mixture(points, found.z, found.first, found.share, rng)
    # However many runs the search took, the draws decide.
    left = max(runs - made, runs // 4, 4)
    counts = [max(int(FIRST_PART * left), 2)]
    counts.append(left - counts[0])
    z, weights = _drawn(margin, likelihood, first, counts[0], rng)
    hit = weights > 0.0
    seen = Violations(z[hit], np.arange(np.count_nonzero(hit)) % 2 == 0, weights[hit])
    both = _joined(found, seen)
    second = mixture(points, both.z, both.first, both.share, rng)
    parts = [weights, _drawn(margin, likelihood, second, counts[1], rng)[1]]
    # What the violations of the search, which no draw decided, weigh in both densities.
    factor = likelihood(found.z) if len(found.z) else np.zeros(0)
    expected = [factor * q.weights(found.z) for q in (first, second)]
    moments = [float(found.share @ w) if len(w) else 1.0 for w in expected]
    shares = np.array(counts) / moments
    shares /= shares.sum()
    value = float(sum(a * np.mean(w) for a, w in zip(shares, parts, strict=True)))
    square = 0.0
    for a, w, moment, count in zip(shares, parts, moments, counts, strict=True):
        # The variance that the search predicts counts where the draws miss the large weights.
        predicted = moment * value - value**2 if len(found.z) else 0.0
        square += a**2 * max(float(np.var(w, ddof=1)), predicted) / count
    scaled = [
        a / k * np.append(w, e) for a, k, w, e in zip(shares, counts, parts, expected, strict=True)
    ]
    return Estimate(
        value,
        math.sqrt(square) / value if value > 0.0 else math.inf,
        max(float(w.max()) for w in scaled),
        _unseen(points, found, factor, rng),
        made + left,
    )


def _violations(
    margin: Margin,
    likelihood: Likelihood,
    points: np.ndarray,
    runs: int,
    rng: np.random.Generator,
) -> tuple[Violations, int]:
    """Violations that are found without derivatives, and how many runs that took."""
    n = points.shape[1]
    result = Violations(np.zeros((0, n)), np.zeros(0, bool), np.zeros(0))
    made = 0
    for part, most in ((SHORT, runs // 6), (LONG, runs // 3)):
        groups, spent = explore(margin, max(LEAST, int(part * runs)), n, most, rng)
        made += spent
        z = np.concatenate(groups)
        if len(z) == 0:
            continue
        factor = likelihood(z)
        found = Violations(z, np.arange(len(z)) < len(groups[0]), factor)
        result = _joined(result, found)
        if len(points):
            density = mixture(points, z[:0], found.first[:0], factor[:0], rng)
            weights = factor * density.weights(z)
            # A short search that cost little may have missed some, too.
            if made > CHEAP * runs and np.max(weights) < EXPLAINED * np.median(weights):
                break
    return result, made


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


def _unseen(
    points: np.ndarray, found: Violations, factor: np.ndarray, rng: np.random.Generator
) -> float:
    """Estimated share of the violations that are not covered, from those of one group that the
    density of the other one does not cover."""
    if len(found.z) == 0:
        return 0.0
    missed = []
    for one in (found.first, ~found.first):
        some, share = found.z[one], found.share[one]
        # A search that finds nothing covers nothing, and shows nothing that the other one missed.
        if one.all() or not (len(points) or one.any()):
            missed.append(1.0)
            continue
        density = mixture(points, some, np.arange(len(some)) % 2 == 0, share, rng)
        weights = factor[~one] * density.weights(found.z[~one])
        far = weights > UNCOVERED * np.median(weights)
        missed.append(float(found.share[~one] @ far / found.share[~one].sum()))
    return min(missed[0] * missed[1], 0.9)
