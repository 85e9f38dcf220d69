"""Subset simulation: a rare event as the last of a sequence of frequent ones.

    P(F) = prod_j P(g <= b_j | g <= b_(j-1)) P(g < 0 | g <= b_m),   z' = r z + sqrt(1 - r^2) u

    symbol  meaning                                                              unit
    z       standard normal numbers behind the inputs                            1
    g       margin of the requirement, negative where it is violated             of the output
    b_j     border of a level: a margin that a tenth of its runs do not exceed   of the output
    F       the violations, g < 0                                                -
    r, u    correlation of a step of a chain, standard normal numbers            1, 1

Where many runs have the same margin, as for outputs and inputs with discrete values, a level
retains all of them, and its share is counted; a step that almost no run descends is sampled
further, because it cannot be divided. Sources: Au and Beck, Prob. Eng. Mech. 16 (2001), 263; chains
of Papaioannou et al., Prob. Eng. Mech. 41 (2015), 89.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ._estimate import Estimate

Margin = Callable[[np.ndarray], np.ndarray]
"""g of runs, (runs,), from z, (runs, n)."""

LEVEL = 0.1
# In a search for violations the share is larger: many starts of chains lose fewer directions.
SEARCHED = 0.25
CORRELATION = 0.8
CHAINED = 4.5
"""Least widening of the interval by the correlation of the runs of a chain: its variance is 1 +
this times that of independent runs. Of 40 repetitions for 1e-6 the logarithms scattered by 0.41.
The correlation within a level is measured; that between levels, of chains from one ancestor, is
not."""
# A level that retains more than this share of its runs makes no progress.
DIVIDES = 0.5
MOST_LEVELS = 40


class Population(NamedTuple):
    """Runs of one level, with their margins: z, (runs, n), and g, (runs,)."""

    z: np.ndarray
    g: np.ndarray

    def taken(self, places: np.ndarray) -> "Population":
        """The runs at these places."""
        return Population(self.z[places], self.g[places])

    def joined(self, other: "Population") -> "Population":
        """These runs, and then those of another population."""
        return Population(np.concatenate([self.z, other.z]), np.concatenate([self.g, other.g]))


class Levels(NamedTuple):
    """The results of the levels.

    - `reached`: probability of the last level.
    - `share`: of its runs that violate the requirement.
    - `size`: the number of independent runs that would know the share as well.
    - `variance`: of `reached`, relative.
    - `violations`: runs of the last level that violate, distributed as all violations are.
    - `seeds`: the least number of distinct runs from which the chains of a level start; infinite
      without chains.
    - `made`: number of runs made."""

    reached: float
    share: float
    size: float
    variance: float
    violations: Population
    seeds: float
    made: int


def drawn(margin: Margin, shape: tuple[int, ...], rng: np.random.Generator) -> Population:
    """Independent runs, from z of this shape, (runs, n)."""
    z = rng.standard_normal(shape)
    return Population(z, margin(z))


def descend(
    margin: Margin, first: Population, level_share: float, most: int, rng: np.random.Generator
) -> Levels:
    """Descend level by level, by this share of the runs, from the `first` runs, which are
    independent, to the violations; at most about `most` runs are made."""
    size = len(first.g)
    keep = max(int(level_share * size), 2)
    here, made, reached, variance, top = first, 0, 1.0, 0.0, math.inf
    chains, distinct = 0, math.inf
    for level in range(MOST_LEVELS):
        while True:
            ordered = np.sort(here.g)
            border = float(ordered[keep - 1])
            inside = here.g <= border
            ends = border < 0.0 or made >= most
            if ends or np.mean(inside) <= DIVIDES:
                break
            # More runs of the same level, until enough of them are below the step.
            last = here.taken(np.arange(len(here.g) - size, len(here.g)))
            more = _moved(margin, last, top, rng) if level else drawn(margin, last.z.shape, rng)
            here = here.joined(more)
            made += size
        if ends:
            break
        widened = _widening(inside[:size], chains)
        passed = float(np.mean(inside))
        reached *= passed
        variance += (1.0 - passed) / (passed * len(here.g)) * widened
        top = border
        seeds = here.taken(np.flatnonzero(inside))
        chains = _number_of_chains(seeds, size)
        here, spent = extended(margin, seeds, top, size, rng)
        distinct = min(distinct, len(np.unique(here.z[:chains], axis=0)))
        made += spent
    violated = np.flatnonzero(here.g < 0.0)
    share = len(violated) / len(here.g)
    independent = len(here.g) / _widening(here.g[:size] < 0.0, chains)
    return Levels(reached, share, independent, variance, here.taken(violated), distinct, made)


def _widening(inside: np.ndarray, chains: int) -> float:
    """Variance of the share of runs inside, (runs,), over that of independent runs.

    Step by step of so many `chains`; none are independent runs. Source: Au and Beck, eq. 28 and
    29."""
    if chains == 0:
        return 1.0
    steps = len(inside) // chains
    x = inside[: steps * chains].reshape(steps, chains).astype(float)
    x -= x.mean()
    square = float(np.mean(x**2))
    if square == 0.0:
        return 1.0 + CHAINED
    lags = np.arange(1, steps)
    correlation = np.array([np.mean(x[k:] * x[:-k]) for k in lags]) / square
    return 1.0 + max(CHAINED, 2.0 * float((1.0 - lags / steps) @ correlation))


def _number_of_chains(seeds: Population, size: int) -> int:
    """How many of the seeds start a chain of a level with `size` runs."""
    return min(len(seeds.g), max(size // 2, 1))


def _moved(margin: Margin, here: Population, border: float, rng: np.random.Generator) -> Population:
    """One step of a chain from each of these runs, which stays at or below the border."""
    u = rng.standard_normal(here.z.shape)
    # The step preserves the normal distribution, so that only the border can reject it.
    trial = CORRELATION * here.z + math.sqrt(1.0 - CORRELATION**2) * u
    g = margin(trial)
    inside = g <= border
    # A rejected step repeats its point: without it the chain would have another distribution.
    return Population(np.where(inside[:, None], trial, here.z), np.where(inside, g, here.g))


def extended(
    margin: Margin, seeds: Population, border: float, size: int, rng: np.random.Generator
) -> tuple[Population, int]:
    """`size` runs at or below the border, by chains from the `seeds`, which all step at once; and
    number of runs used."""
    # Chosen at random where there are many, because the first ones come from the first chains.
    order = rng.permutation(len(seeds.g))[: _number_of_chains(seeds, size)]
    result = last = seeds.taken(order)
    made = 0
    while len(result.g) < size:
        last = _moved(margin, last, border, rng)
        result = result.joined(last)
        made += len(last.g)
    return result.taken(np.arange(size)), made


def explore(
    margin: Margin, size: int, n: int, most: int, rng: np.random.Generator
) -> tuple[list[np.ndarray], int]:
    """Violations, (runs, n), of two independent descents with `size` runs in each level, of which
    each makes about `most` runs; and number of runs used."""
    groups, made = [], 0
    for _ in range(2):
        found = descend(margin, drawn(margin, (size, n), rng), SEARCHED, most, rng)
        made += size + found.made
        violations = found.violations
        if len(violations.g):
            # Margins below zero: the next number towards it.
            last = float(np.nextafter(0.0, -1.0))
            violations, more = extended(margin, violations, last, size, rng)
            made += more
        groups.append(violations.z)
    return groups, made


def subset(
    margin: Margin,
    likelihood: Callable[[np.ndarray], np.ndarray],
    n: int,
    runs: int,
    rng: np.random.Generator,
) -> Estimate:
    """The probability of a violation, from about so many `runs`; `likelihood` of z, (runs, n), is
    the factor by which runs are drawn too seldom, (runs,)."""
    # Seven levels reach 1e-7 with this budget; more levels, if needed, make more runs.
    size = max(100, runs // 7)
    found = descend(margin, drawn(margin, (size, n), rng), LEVEL, runs, rng)
    made = size + found.made
    if found.share == 0.0:
        return Estimate(0.0, math.inf, found.reached / found.size, 0.0, made, found.seeds)
    factor = likelihood(found.violations.z)
    value = found.reached * found.share * float(np.mean(factor))
    # The part of the last level: of the share, and of the factors of its violations.
    last = float(np.mean(factor**2) / np.mean(factor) ** 2) - found.share
    variance = found.variance + last / (found.share * found.size)
    return Estimate(value, math.sqrt(variance), value * variance, 0.0, made, found.seeds)
