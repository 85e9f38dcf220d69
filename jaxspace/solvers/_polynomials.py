"""Weights of formulae that integrate the polynomial through values at equal distances, from exact
fractions.

Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, III.1, III.10."""

import functools
from fractions import Fraction
from typing import Any, NamedTuple, final

import numpy as np


@final
class Weights(NamedTuple):
    """Of the accelerations, the newest first: for the step that follows (b), the `change` of these
    from the order below, and for the velocity at the newest (g)."""

    next: tuple[float, ...]
    change: tuple[float, ...]
    now: tuple[float, ...]


@functools.cache
def weights_of(k: int) -> Weights:
    """The weights of order k."""
    b, lower = (
        _fitted(n, lambda m: Fraction(1 + (-1) ** m, (m + 1) * (m + 2))) for n in (k, k - 1)
    )
    g = _fitted(k, lambda m: Fraction((-1) ** m, (m + 1) * (m + 2)))
    change = [x - y for x, y in zip(b, [*lower, Fraction(0)], strict=True)]
    return Weights(tuple(map(float, b)), tuple(map(float, change)), tuple(map(float, g)))


def _fitted(k: int, moment: Any) -> list[Fraction]:
    """The weights at 0, -1, ..., 1 - k that give x^m its `moment` for every m below k."""
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
                p = [
                    (up - other * here) / (x - other)
                    for up, here in zip([Fraction(0), *p], [*p, Fraction(0)], strict=True)
                ]
        basis.append(p)
    return basis


def integrals_of(k: int) -> np.ndarray:
    """Coefficients of the first and the second integrals, from their middle, of the polynomials of
    k neighbouring nodes a unit apart: (2, k + 2, k), the powers, lowest first, on the second axis,
    and zero at the middle."""
    table = np.zeros((2, k + 2, k))
    for i, p in enumerate(_lagrange([Fraction(2 * j - k + 1, 2) for j in range(k)])):
        for m, c in enumerate(p):
            table[0, m + 1, i] = c / (m + 1)
            table[1, m + 2, i] = c / ((m + 1) * (m + 2))
    return table
