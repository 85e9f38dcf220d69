"""Interpolation of measured values: piecewise cubic with a continuous slope, on one axis or as a
product on several.

    f(x) = (1 + 2s)(1 - s)^2 f_k + s^2 (3 - 2s) f_{k+1} + h s (1 - s)^2 d_k - h s^2 (1 - s) d_{k+1}

    d_k = (f_{k+1} - f_{k-1}) / (h_{k-1} + h_k)                                        chords

    d_k = (w_1 + w_2) / (w_1 / m_{k-1} + w_2 / m_k),   0 where m_{k-1} m_k <= 0        monotone
    w_1 = 2 h_k + h_{k-1},   w_2 = h_k + 2 h_{k-1}

    symbol     meaning
    s, h       (x - x_k) / h, length of the interval
    f_k, d_k   value and slope at a node
    m_k        mean slope (f_{k+1} - f_k) / h_k

Two kinds of slopes:

- Chords, for air and wind. They are linear in the values, and so is all that is read: a derivative
  by the values is exact, also where they vanish or stay the same. For any node distances, h d_k is
  at most the change in the two adjacent intervals: where the values are constant, the cubic
  deviates by at most a quarter of the change in the next interval.
- Monotone, for coefficients, which are concrete when a table is created. The cubic is monotone
  between monotone values, but the slopes are not differentiable with respect to the values where
  neighbours are equal: a zero wind would get a wrong derivative.

Outside of the nodes the value is that of the nearest one. Of several axes the slopes of the slopes
are taken in turn: of a product of functions of one axis each, that is the product of their cubics.
The first derivative is continuous, the second jumps at the nodes: within the table an adaptive
integration shows no loss of order, and gradients are those of the simulated flight.

Source: de Boor, A Practical Guide to Splines, IV and XVII; Catmull, Rom, in Computer Aided
Geometric Design, 1974, 317 (chords); Fritsch, Butland, SIAM J. Sci. Stat. Comput. 5, 1984, 300
(monotone).
"""

import itertools
from collections.abc import Sequence
from types import ModuleType
from typing import Any, TypeAlias

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from .barrier import barrier
from .checks import is_concrete
from .shapes import with_rank
from .types import Scalar

Known: TypeAlias = Array | np.ndarray


def chord_slopes(x: Known, y: Known) -> Known:
    """The slopes of the chords over both neighbours, at the ends over the one; the arguments are
    those of `monotone_slopes`."""
    h, m = _mean_slopes(x, y)
    xp = np if is_concrete(m) else jnp
    inner = (h[:-1] * m[:-1] + h[1:] * m[1:]) / (h[:-1] + h[1:])
    return xp.concatenate([m[:1], inner, m[-1:]])


def monotone_slopes(x: Known, y: Known) -> Known:
    """The slopes d at the nodes, along the first axis, of a cubic that is monotone between monotone
    values.

    **Arguments**

    - `x`: the nodes, ascending, two or more, (nodes, *); `y`: the values, (nodes, *).

    **Returns** the slopes, of the shape of `y`; at the ends those of the parabola through three
    nodes, held to three times the mean slope there and to its sign."""
    h, m = _mean_slopes(x, y)
    xp = np if is_concrete(m) else jnp
    if y.shape[0] == 2:
        return xp.concatenate([m, m])
    # A harmonic mean of slopes of one sign; where the sign changes the node is an extreme, flat.
    alike = m[:-1] * m[1:] > 0.0
    first, second = 2.0 * h[1:] + h[:-1], h[1:] + 2.0 * h[:-1]
    before, after = xp.where(alike, m[:-1], 1.0), xp.where(alike, m[1:], 1.0)
    inner = xp.where(alike, (first + second) / (first / before + second / after), 0.0)
    ends = [xp.asarray(_end_slope(xp, h[k], h[j], m[k], m[j]))[None] for k, j in ((0, 1), (-1, -2))]
    return xp.concatenate([ends[0], inner, ends[1]])


def _mean_slopes(x: Known, y: Known) -> tuple[Known, Known]:
    """Length h of each interval and the mean slope m in it."""
    # By NumPy where all is known, because jax would compile each operation for one call.
    xp = np if is_concrete(x) and is_concrete(y) else jnp
    x, y = xp.asarray(x), xp.asarray(y)
    x = x.reshape(*x.shape, *(1,) * (y.ndim - x.ndim))
    h = x[1:] - x[:-1]
    return h, (y[1:] - y[:-1]) / h


def _end_slope(
    xp: ModuleType, h: Known | float, next_h: Known | float, m: Known | float, next_m: Known | float
) -> Known | float:
    d = ((2.0 * h + next_h) * m - h * next_m) / (h + next_h)
    d = xp.where(d * m <= 0.0, 0.0, d)
    return xp.where((m * next_m <= 0.0) & (abs(d) > 3.0 * abs(m)), 3.0 * m, d)


def interval(nodes: Float[Array, "nodes *#runs"], x: Scalar) -> tuple[Int[Array, "..."], Array]:
    """The index of the interval that contains `x`, and `x` clipped to the nodes.

    **Arguments**

    - `nodes`: two or more; `x`: of any shape.

    At a node, the interval above it; the derivative of the clipped value is one at both ends."""
    nodes = of_all_runs(nodes)
    nodes = with_rank(nodes, max(jnp.ndim(x), nodes.ndim - 1)) if nodes.ndim > 1 else nodes
    # By comparisons, because `clip` has half a slope at both ends.
    held = jnp.where(x < nodes[0], nodes[0], jnp.where(x > nodes[-1], nodes[-1], x))
    # Without the ends: points beyond them belong to the first and the last interval.
    inner = nodes[1:-1]
    if nodes.ndim == 1:
        index = jnp.searchsorted(inner, held, side="right")
    else:
        index = jnp.sum(inner <= held, axis=0)
    # Of many runs the compiler would search again with every number that is read there.
    return barrier(index) if jnp.ndim(held) else index, held


def of_all_runs(nodes: Float[Array, "nodes *#runs"]) -> Array:
    """Nodes shared by all runs without a batch axis: interpolated values then have the shape of the
    position only."""
    return nodes.reshape(-1) if nodes.size == nodes.shape[0] else nodes


def weights(h: Scalar, x: Scalar) -> tuple[tuple[Scalar, Scalar], tuple[Scalar, Scalar]]:
    """Weights of the value and the slope at the lower and at the upper end of an interval of
    the length `h`, a distance `x` above its lower end."""
    s = x / h
    r = 1.0 - s
    return ((1.0 + 2.0 * s) * r * r, x * r * r), (s * s * (3.0 - 2.0 * s), -x * s * r)


def taken(values: Float[Array, "points numbers *#runs"], at: Int[Array, "..."]) -> Array:
    """The numbers of a node for each run, (numbers, *runs); `at` is the number of the node.

    `values` of one run are shared by all."""
    if values.ndim == 2 or values.size == values.shape[0] * values.shape[1]:
        rows = values.reshape(values.shape[:2])[at]
        return jnp.moveaxis(rows, -1, 0)
    rank = max(at.ndim, values.ndim - 2)
    values, at = with_rank(values, rank, axes=2), with_rank(at, rank, axes=0)
    return jnp.take_along_axis(values, at[None, None], axis=0)[0]


def cubic(
    nodes: Float[Array, "nodes *#runs"], data: Float[Array, "nodes numbers *#runs"], x: Scalar
) -> Float[Array, "..."]:
    """The functions of one axis at `x`, (numbers, *runs), from `with_slopes` of their values."""
    return product([nodes], data, [x])


def with_slopes(x: Known, y: Known) -> Array:
    """The values at the nodes followed by the slopes of their chords, in the form of `cubic`,
    (nodes, 2 numbers, *runs).

    `x`: (nodes, *runs); `y`: (nodes, numbers, *runs)."""
    xp = np if is_concrete(x) and is_concrete(y) else jnp
    x = x[:, None] if x.ndim > 1 else x
    return jnp.asarray(xp.concatenate([y, chord_slopes(x, y)], axis=1))


def stacked(x: Array, *values: Array) -> Array:
    """`with_slopes` of several functions at the nodes `x`, each (nodes, *runs)."""
    rank = max(v.ndim for v in (x, *values)) - 1
    columns = jnp.broadcast_arrays(*(with_rank(v, rank) for v in values))
    xp = np if all(is_concrete(v) for v in values) else jnp
    return with_slopes(x, xp.stack(columns, axis=1))


def product(
    axes: Sequence[Array], data: Float[Array, "points numbers *#runs"], at: Sequence[Scalar]
) -> Float[Array, "..."]:
    """The functions at the point `at`, (numbers, *runs).

    **Arguments**

    - `axes`: the nodes of each axis, two or more, each (nodes, *runs).
    - `data`: one row for each point of the grid, the last axis fastest: all functions, their slopes
      by the last axis, then all that by the last axis but one, and so on."""
    places, factors = [], []
    for nodes, x in zip(axes, at, strict=True):
        k, held = interval(nodes, x)
        low, high = (taken(nodes[:, None], k + i)[0] for i in (0, 1))
        places.append(k)
        factors.append(weights(high - low, held - low))
    kinds = list(itertools.product((0, 1), repeat=len(axes)))
    count = data.shape[1] // len(kinds)
    total: Any = 0.0
    for corner in kinds:
        place: Any = 0
        for nodes, k, i in zip(axes, places, corner, strict=True):
            place = place * nodes.shape[0] + k + i
        row = taken(data, place)
        for number, kind in enumerate(kinds):
            factor = 1.0
            for pair, i, j in zip(factors, corner, kind, strict=True):
                factor = factor * pair[i][j]
            total = total + factor * row[number * count : (number + 1) * count]
    return total
