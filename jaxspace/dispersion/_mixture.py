"""The density from which importance sampling of a rare event draws: a mixture about violations.

    q(z) = a_0 phi(z) + sum_k a_k phi(z - z_k) + a_s N(z; m, S)

    symbol  meaning                                                     unit
    z       standard normal numbers behind the inputs                   1
    phi     density of independent standard normal numbers              1
    q       density of the draws; a_0 + sum_k a_k + a_s = 1             1
    z_k     design points, and other violations                         1
    m, S    mean and covariance of the violations                       1, 1

Half of the draws are made about the design points. The others follow violations that were found
without derivatives, with the shares that make these violations most likely. The covariance S covers
violations in all directions, for which there would be too few z_k, and the share a_0 bounds every
weight phi / q. Sources: Au and Beck, Struct. Saf. 21 (1999), 135 (kernels about violations);
Hesterberg, Technometrics 37 (1995), 185 (the share a_0).
"""

import math
from typing import NamedTuple

import numpy as np

DEFENSIVE, ALONG_DERIVATIVES = 0.05, 0.5
# Shares, of the draws that follow violations, of the term with S and of all the others about them
# at least.
WIDE, EVEN = 0.2, 0.2
# Share of the draws about violations whose distribution is not known.
KERNEL_SHARE = 0.25
# Violations of each group about which draws are made.
KERNELS = 100
# Rounds of the iteration for the shares.
ROUNDS = 50
# The violations come from chains: so many of them count as an independent one.
RESEMBLING = 5.0


class Mixture(NamedTuple):
    """Density q of the draws.

    - `centres`: of the terms with unit covariance, (terms, n); `shares`, (terms,).
    - `mean`, `axes`, `sizes`: those of S, which is 1 except for the variances `sizes`, (m,), along
      the `axes`, (n, m).
    - `share`: of the term with S."""

    centres: np.ndarray
    shares: np.ndarray
    mean: np.ndarray
    axes: np.ndarray
    sizes: np.ndarray
    share: float

    def drawn(self, runs: int, rng: np.random.Generator) -> np.ndarray:
        """Draws, (runs, n)."""
        shares = np.append(self.shares, self.share)
        which = rng.choice(len(shares), runs, p=shares / shares.sum())
        u = rng.standard_normal((runs, len(self.mean)))
        wide = u + (u @ self.axes * (np.sqrt(self.sizes) - 1.0)) @ self.axes.T
        centres = np.concatenate([self.centres, self.mean[None]])
        return centres[which] + np.where((which == len(self.centres))[:, None], wide, u)

    def terms(self, z: np.ndarray) -> np.ndarray:
        """ln(N_k(z) / phi(z)) of every term, (runs, terms + 1)."""
        apart = z - self.mean
        square = np.sum(apart**2, axis=1)
        square -= (apart @ self.axes) ** 2 @ (1.0 - 1.0 / self.sizes)
        wide = 0.5 * (np.sum(z**2, axis=1) - square) - 0.5 * np.sum(np.log(self.sizes))
        unit = z @ self.centres.T - 0.5 * np.sum(self.centres**2, axis=1)
        return np.concatenate([unit, wide[:, None]], axis=1)

    def weights(self, z: np.ndarray) -> np.ndarray:
        """phi / q, (runs,)."""
        terms = self.terms(z)
        # The greatest is taken out, so that nothing overflows.
        top = terms.max(axis=1)
        sums = np.exp(terms - top[:, None]) @ np.append(self.shares, self.share)
        return np.exp(-np.log(sums) - top)


def mixture(
    points: np.ndarray,
    z: np.ndarray,
    group: np.ndarray,
    likelihood: np.ndarray,
    rng: np.random.Generator,
    apart: np.ndarray | None = None,
) -> Mixture:
    """The density of the draws.

    **Arguments**

    - `points`: the design points, (points, n), about which half of the draws are made.
    - `z`: violations, (runs, n), distributed as all violations but for the factor `likelihood`,
      (runs,), in two independent groups, given by `group`, (runs,).
    - `apart`: further violations, (runs, n), whose distribution is not known."""
    density = _followed(points, z, group, likelihood, rng)
    if apart is None or len(apart) == 0:
        return density
    # Where nothing else was found, they are all that is known.
    part = KERNEL_SHARE if len(points) + len(z) else 1.0 - DEFENSIVE
    even = np.full(len(apart), part / len(apart))
    shares = np.append((1.0 - part) * density.shares, even)
    centres = np.concatenate([density.centres, apart])
    return density._replace(centres=centres, shares=shares, share=(1.0 - part) * density.share)


def _followed(
    points: np.ndarray,
    z: np.ndarray,
    group: np.ndarray,
    likelihood: np.ndarray,
    rng: np.random.Generator,
) -> Mixture:
    """The density of the draws that follow design points, and violations of known distribution."""
    n = points.shape[1]
    rest, half = 1.0 - DEFENSIVE, ALONG_DERIVATIVES if len(points) else 0.0
    squares = np.sum(points**2, axis=1)
    # In proportion to the density at each point, divided by the greatest against underflow.
    along = np.exp(-0.5 * (squares - squares.min(initial=np.inf)))
    centres, shares = [np.zeros((1, n)), points], [np.array([DEFENSIVE])]
    if len(z) == 0:
        everything = np.concatenate(centres), np.append(shares[0], rest * along / along.sum())
        if len(points) == 0:
            everything = centres[0], np.ones(1)
        return Mixture(*everything, np.zeros(n), np.zeros((n, 0)), np.zeros(0), 0.0)
    # With many design points the scatter is informative, too.
    among = half * along / along.sum() if len(points) else along
    weights = np.append(among, (1.0 - half) * likelihood / likelihood.sum())
    wide = _wide(np.concatenate([points, z]), weights, len(z) / RESEMBLING)
    # One group places the terms and the other one decides their shares, and vice versa: a run would
    # be too likely under a term about itself.
    fitted = np.zeros(len(points) + 1)
    for placing, deciding in ((group, ~group), (~group, group)):
        kernels = z[_chosen(np.flatnonzero(placing), likelihood, rng)]
        some = Mixture(np.concatenate([points, kernels]), np.zeros(0), *wide, 0.0)
        found = _shares(some.terms(z[deciding]), likelihood[deciding])
        # Some for every kernel, because the other group may have missed this region.
        even = np.append(np.zeros(len(points)), np.full(len(kernels), 1.0 / max(len(kernels), 1)))
        found = (1.0 - WIDE - EVEN) * found + EVEN * np.append(even, 0.0)
        found[-1] += 1.0 - found.sum()
        found *= 0.5 * rest * (1.0 - half)
        fitted += found[[*range(len(points)), -1]]
        centres.append(kernels)
        shares.append(found[len(points) : -1])
    shares.insert(1, fitted[:-1] + rest * among)
    return Mixture(np.concatenate(centres), np.concatenate(shares), *wide, float(fitted[-1]))


def _chosen(places: np.ndarray, likelihood: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """At most `KERNELS` of these places, by their likelihood."""
    if len(places) <= KERNELS:
        return places
    share = likelihood[places] / likelihood[places].sum()
    return rng.choice(places, min(KERNELS, np.count_nonzero(share)), replace=False, p=share)


def _wide(
    z: np.ndarray, share: np.ndarray, independent: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean of violations with these shares, and directions in which their variance exceeds one,
    with these variances."""
    mean = share @ z
    apart = z - mean
    # In the other directions the variance is one: a smaller one would make weights without bound.
    sizes, axes = np.linalg.eigh((apart * share[:, None]).T @ apart)
    # More than so many runs show by chance (Marchenko and Pastur).
    known = sizes > (1.0 + math.sqrt(len(mean) / independent)) ** 2
    return mean, axes[:, known], sizes[known]


def _shares(terms: np.ndarray, likelihood: np.ndarray) -> np.ndarray:
    """The shares of the terms, (terms,), that make these runs most likely, from the logarithms of
    their densities, (runs, terms)."""
    count = terms.shape[1]
    if len(terms) == 0:
        return np.full(count, 1.0 / count)
    densities = np.exp(terms - terms.max(axis=1)[:, None])
    shares = np.full(count, 1.0 / count)
    for _ in range(ROUNDS):
        parts = densities * np.maximum(shares, 1e-300)
        shares = likelihood @ (parts / parts.sum(axis=1)[:, None])
        shares /= shares.sum()
    return shares
