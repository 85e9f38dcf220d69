"""Explicit Runge-Kutta-Nystrom methods: Runge-Kutta for r'' = a(t, r), whose stages have no
velocity.

    k_i = a(t + c_i h, r + c_i h v + h^2 sum_j a_ij k_j)
    r_1 = r + h v + h^2 sum_i b_i k_i            v_1 = v + h sum_i b'_i k_i

Every Runge-Kutta method becomes a Runge-Kutta-Nystrom method for such a system: its matrix is
squared, and b = b' a. The velocities at its stages are not needed: their weighted sum is

    sum_i w_i v_i = (sum_i w_i) v + h sum_j (w a)_j k_j

Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, II.14.
"""

from typing import NamedTuple, final

import jax
import numpy as np
from jaxtyping import Array, Float

from ..core import Scalar, State
from ..core.barrier import barrier
from . import tableaus as tableau
from .second_order import SecondOrder, Vectors
from .stages import Weights, dense_rows, stage_loop, weighted

# Rounding of a product of matrices with entries of order one: smaller entries are zero.
ROUNDING = 1e-15


@final
class NystromTableau(NamedTuple):
    """Nodes `c`, rows `a`, weights b of the `position` and b' of the `velocity`."""

    c: tuple[float, ...]
    a: tuple[Weights, ...]
    position: Weights
    velocity: Weights


@final
class NystromStep(NamedTuple):
    """Result of a step: position `r` and velocity `v` at its end, the `mean_velocity` along it, and
    the accelerations `ks` at its stages."""

    r: Vectors
    v: Vectors
    mean_velocity: Vectors
    ks: list[Array] | Float[Array, "stages ..."]


def _row(weights: Float[np.ndarray, " stages"]) -> Weights:
    return tuple((i, float(w)) for i, w in enumerate(weights) if abs(w) > ROUNDING)


def from_runge_kutta(c: tuple[float, ...], a: tuple[Weights, ...], b: Weights) -> NystromTableau:
    """The Runge-Kutta-Nystrom form of the Runge-Kutta method with nodes `c`, rows `a` and weights
    `b`."""
    matrix = dense_rows(a, len(c))
    (weights,) = dense_rows((b,), len(c))
    rows = tuple(_row(row) for row in matrix @ matrix)
    return NystromTableau(c, rows, position=_row(weights @ matrix), velocity=b)


def row_of_rates(weights: Weights, a: tuple[Weights, ...]) -> tuple[float, Weights]:
    """sum_i w_i and the row w a: the velocities at the stages of the Runge-Kutta method with rows
    `a`, summed with these weights, by the velocity at the start and the accelerations."""
    (row,) = dense_rows((weights,), len(a))
    total = float(row.sum())
    return (total if abs(total) > ROUNDING else 0.0), _row(row @ dense_rows(a, len(a)))


DOP853_NYSTROM = from_runge_kutta(tableau.DOP853_C, tableau.DOP853_A, tableau.DOP853_B)
# With the stages of the dense output, the first of which is at the end.
DOP853_DENSE_ROWS = (*tableau.DOP853_A, tableau.DOP853_B, *tableau.DOP853_DENSE_A)
DOP853_NYSTROM_DENSE = from_runge_kutta(
    (*tableau.DOP853_C, 1.0, *tableau.DOP853_DENSE_C), DOP853_DENSE_ROWS, tableau.DOP853_B
)
RKN12 = NystromTableau(
    tableau.RKN1210_C, tableau.RKN1210_A, tableau.RKN1210_POSITION, tableau.RKN1210_VELOCITY
)


@jax.custom_jvp
def _held_in_derivatives(x: Vectors) -> Vectors:
    """The same vectors, with a `barrier` in their derivative only.

    Reverse mode then computes the contribution of a sum of stages once, and not for each of its
    rates. A barrier of the values would compile longer."""
    return x


@_held_in_derivatives.defjvp
def _held_rule(primals: tuple[Vectors], tangents: tuple[Vectors]) -> tuple[Vectors, Vectors]:
    return primals[0], barrier(tangents[0])


def nystrom_step(
    system: SecondOrder,
    method: NystromTableau,
    s0: Float[Array, ""],
    h: Float[Array, ""],
    r: Vectors,
    v: Vectors,
    rolled: bool = False,
) -> NystromStep:
    """One step of length `h` in normalised time, from position `r` and velocity `v` at `s0`.

    `rolled`: whether the stages are a loop of the program (`stage_loop`)."""
    # The precision of the time is unchanged: a state in single precision may have a time in double.
    h = h.astype(r.dtype)

    def derivative(c: Scalar, change: Vectors | None) -> Vectors:
        mean = jax.lax.convert_element_type(c, v.dtype) * v
        mean = mean if change is None else mean + h * change
        s = s0 + jax.lax.convert_element_type(c, s0.dtype) * h.astype(s0.dtype)
        return system.acceleration(s, r + h * system.position_rate(mean))

    if rolled:
        ks = stage_loop(derivative, r, method.c, method.a)
    else:
        ks = []
        for c, row in zip(method.c, method.a, strict=True):
            change = _held_in_derivatives(weighted(row, ks)) if row else None
            ks.append(derivative(c, change))
    # One barrier for both, because the compiler would sum the stages again for each reader.
    mean = barrier(v + h * weighted(method.position, ks))
    r1, v1 = barrier((r + h * system.position_rate(mean), v + h * weighted(method.velocity, ks)))
    return NystromStep(r1, v1, mean, ks)


def stage_sum(
    system: SecondOrder,
    a: tuple[Weights, ...],
    h: Float[Array, ""],
    ks: list[Array] | Array,
    weights: Weights,
) -> State:
    """h sum_i w_i k_i of the derivatives of the state at the stages of the Runge-Kutta method with
    rows `a`, of which the accelerations `ks` are known."""
    h = h.astype(system.r.dtype)
    total, row = row_of_rates(weights, a)
    mean = h * weighted(row, ks)
    mean = mean if total == 0.0 else total * system.v + mean
    return system.state(h * system.position_rate(mean), h * weighted(weights, ks))
