"""Weights of formulas that integrate the polynomial through values at equal distances, from exact
fractions.

Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, III.1, III.10.
"""

import functools
import math
from collections.abc import Callable
from fractions import Fraction
from typing import NamedTuple, final

import numpy as np
from jaxtyping import Float


@final
class StormerWeights(NamedTuple):
    """Weights of the accelerations, the newest first: `step` (b) for the next step, `difference`
    of these from the order below, `velocity` (g) for the velocity at the newest."""

    step: tuple[float, ...]
    difference: tuple[float, ...]
    velocity: tuple[float, ...]


@functools.cache
def stormer_weights(k: int) -> StormerWeights:
    """The weights of order `k`."""

    def b(m: int) -> Fraction:
        # int_0^1 (1 - x) (x^m + (-x)^m) dx
        return Fraction(1 + (-1) ** m, (m + 1) * (m + 2))

    def g(m: int) -> Fraction:
        # int_0^1 (1 - x) (-x)^m dx
        return Fraction((-1) ** m, (m + 1) * (m + 2))

    step = _fitted(k, b)
    below = [*_fitted(k - 1, b), Fraction(0)]
    difference = [x - y for x, y in zip(step, below, strict=True)]
    return StormerWeights(
        _without_drag(step), *(tuple(map(float, w)) for w in (difference, _fitted(k, g)))
    )


def _without_drag(weights: list[Fraction]) -> tuple[float, ...]:
    """The rounded weights, corrected so that the sum of j w_j is exact.

    An error e of this sum would act in every step as a force e h da/dt along the motion: the energy
    would grow with the time, by 1e-17 a step for order 12. The last two weights, the smallest,
    compensate the error of the others."""

    def missing(rounded: list[float]) -> Fraction:
        pairs = enumerate(zip(weights, rounded, strict=False))
        return sum((j * (w - Fraction(x)) for j, (w, x) in pairs), Fraction(0))

    *others, before, _ = map(float, weights)
    result = []
    for n in range(-8, 9):
        rounded_weights = [*others, before + n * math.ulp(before)]
        last = float(weights[-1] + missing(rounded_weights) / len(rounded_weights))
        result.append((*rounded_weights, last))
    return min(result, key=lambda rounded: abs(missing(list(rounded))))


def _fitted(k: int, moment: Callable[[int], Fraction]) -> list[Fraction]:
    """The weights at 0, -1, ..., 1 - k that give x^m its `moment` for every m below `k`."""
    basis = _lagrange([Fraction(-j) for j in range(k)])
    return [sum((c * moment(m) for m, c in enumerate(p)), Fraction(0)) for p in basis]


def _lagrange(nodes: list[Fraction]) -> list[list[Fraction]]:
    """Coefficients, lowest first, of the polynomials that are one at one of the nodes and zero at
    the others."""
    basis = []
    for x in nodes:
        p = [Fraction(1)]
        for other in nodes:
            if other != x:
                # p times (X - other) / (x - other): p shifted by one power, minus `other` times p.
                shifted = zip([Fraction(0), *p], [*p, Fraction(0)], strict=True)
                p = [(up - other * here) / (x - other) for up, here in shifted]
        basis.append(p)
    return basis


def integrals_of(k: int) -> Float[np.ndarray, "2 powers k"]:
    """First and second integrals of the polynomials of `k` neighbouring nodes a unit apart.

    **Returns** the coefficients of the powers 0 to k + 1 on the second axis, for each node on the
    last. Both integrals are zero at the middle of the nodes.
    """
    table = np.zeros((2, k + 2, k))
    # About the middle, where the powers are smallest and lose the fewest digits.
    for i, p in enumerate(_lagrange([Fraction(2 * j - k + 1, 2) for j in range(k)])):
        for m, c in enumerate(p):
            table[0, m + 1, i] = c / (m + 1)
            table[1, m + 2, i] = c / ((m + 1) * (m + 2))
    return table
