"""Explicit methods of Nystrom: Runge-Kutta for r'' = a(t, r), where no stage needs its own
velocity.

    k_i = a(t + c_i h, r + c_i h v + h^2 sum_j a_ij k_j)
    r_1 = r + h v + h^2 sum_i b_i k_i            v_1 = v + h sum_i b'_i k_i

Every method of Runge and Kutta is one of Nystrom for such a system: a_ij are then the squares of
its matrix, b = b' a.

Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, II.14.
"""

from typing import Any, NamedTuple, final

import numpy as np
from jaxtyping import Array

from ..core import barrier
from . import _tableaus as tableau
from ._runge_kutta import Weights, weighted
from ._second_order import SecondOrder


@final
class Nystrom(NamedTuple):
    """A tableau: nodes `c`, rows `a`, weights of the position and of the velocity."""

    c: tuple[float, ...]
    a: tuple[Weights, ...]
    position: Weights
    velocity: Weights


def _row(weights: np.ndarray) -> Weights:
    return tuple((i, float(w)) for i, w in enumerate(weights) if abs(w) > 1e-15)


def of_runge_kutta(c: tuple[float, ...], a: tuple[Weights, ...], b: Weights) -> Nystrom:
    """The method of Nystrom that a method of Runge and Kutta becomes."""
    matrix, weights = np.zeros((len(c), len(c))), np.zeros(len(c))
    for i, row in enumerate(a):
        for j, w in row:
            matrix[i, j] = w
    for i, w in b:
        weights[i] = w
    return Nystrom(c, tuple(_row(row) for row in matrix @ matrix), _row(weights @ matrix), b)


DOP853_NYSTROM = of_runge_kutta(tableau.DOP853_C, tableau.DOP853_A, tableau.DOP853_B)
RKN12 = Nystrom(
    tableau.RKN1210_C, tableau.RKN1210_A, tableau.RKN1210_POSITION, tableau.RKN1210_VELOCITY
)


def nystrom_step(
    system: SecondOrder, method: Nystrom, s0: Any, h: Any, r: Array, v: Array
) -> tuple[Array, Array, Array, list[Array]]:
    """Position and velocity after a step, the mean velocity along it, and the accelerations at its
    stages."""
    h = h.astype(r.dtype)
    ks: list[Array] = []
    for c, row in zip(method.c, method.a, strict=True):
        way = c * v + h * weighted(row, ks) if row else c * v
        ks.append(system.acceleration(s0 + c * h.astype(s0.dtype), r + h * system.travel(way)))
    mean = barrier(v + h * weighted(method.position, ks))
    return *barrier((r + h * system.travel(mean), v + h * weighted(method.velocity, ks))), mean, ks
