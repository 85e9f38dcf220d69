"""Functions of time given at nodes, such as a control, a wind or a thrust: linear or cubic between.

    x = t - t_k,  h = t_{k+1} - t_k
    Table    f(t) = f_k + (f_{k+1} - f_k) x / h
    Spline   f(t) = f_k + x (m_k + x (M_k / 2 + x (M_{k+1} - M_k) / (6 h)))
             m_k = (f_{k+1} - f_k) / h - h (2 M_k + M_{k+1}) / 6

The second derivatives M of the spline follow from continuous slopes and M = 0 at both ends (the
natural spline). Before the first node and after the last one both are constant.

The derivative of a table by one of its values is a hat that the steps of an integration pass over
unseen: the run is right, and its gradient is not. Every integration of a system that contains a
table therefore steps exactly onto its nodes (`breaks_of`).

Source: de Boor, A Practical Guide to Splines, IV.
"""

__all__ = ["breaks_of", "polygon", "within"]

import functools
from types import FunctionType, MethodType
from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import numpy.typing as npt
from jax import lax
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array, ArrayLike, Float, PyTree

from ._lists import takes_lists
from ._system import AbstractSystem
from .checks import InputError, check, check_finite, is_concrete
from .field_types import check_types
from .printing import printed
from .shapes import with_rank
from .structure import HashedModule
from .types import Scalar, as_float, precision_of


@takes_lists
@jax.custom_jvp
def within(x: ArrayLike, low: ArrayLike, high: ArrayLike) -> Array:
    """`x`, but at least `low` and at most `high`. At either end the slope is the mean of those of
    both sides.

    **Arguments**

    - `x`, `low`, `high`: shapes that broadcast; the limits may be infinite."""
    return jnp.minimum(jnp.maximum(x, low), high)


@functools.partial(within.defjvp, symbolic_zeros=True)
def _within_rule(
    primals: tuple[ArrayLike, ...], tangents: tuple[Array | SymbolicZero, ...]
) -> tuple[Scalar, Scalar]:
    # A field contains many of them, and those of `jax.numpy` use four times as many operations.
    x, low, high = primals
    # Sign one above the end, minus one below, zero at it.
    above_low, above_high = (jnp.sign(jnp.subtract(x, end)) for end in (low, high))
    slopes = 0.5 * (above_low - above_high), 0.5 * (1.0 - above_low), 0.5 * (1.0 + above_high)
    pairs = zip(slopes, tangents, strict=True)
    moves = [slope * d for slope, d in pairs if not isinstance(d, SymbolicZero)]
    return within(x, low, high), functools.reduce(jnp.add, moves)


@takes_lists
def polygon(
    x: Scalar, nodes: Float[Array, "nodes *#runs"], values: Float[Array, "nodes *#runs"]
) -> Scalar:
    """The value at `x` on the polygon through the `values` at ascending `nodes`, constant outside;
    to a rounding of the largest of them.

    **Arguments**

    - `x`: any shape.
    - `nodes`, `values`: (nodes,) or (nodes, *runs)."""
    rank = max(jnp.ndim(x), nodes.ndim - 1, values.ndim - 1)
    return _polygon(x, with_rank(nodes, rank), with_rank(values, rank))


@jax.custom_jvp
def _polygon(x: Scalar, nodes: Array, values: Array) -> Array:
    """Like `polygon`, for nodes and values with batch axes."""
    widths = nodes[1:] - nodes[:-1]
    # A sum over all intervals: a search and a gather for each run cost more than a few
    # multiplications for each node.
    return values[0] + _sum(
        (values[1:] - values[:-1]) / widths, within(x - nodes[:-1], 0.0, widths)
    )


@functools.partial(_polygon.defjvp, symbolic_zeros=True)
def _polygon_rule(
    primals: tuple[Scalar, Array, Array], tangents: tuple[Array | SymbolicZero, ...]
) -> tuple[Array, Array]:
    """df = s (dx - dn(x)) + dv(x), with s the slope at x, and dn and dv the polygons through the
    changes of the nodes and of the values. The formula itself, differentiated term by term, has
    four times as many operations for each node."""
    x, nodes, values = primals
    dx, dn, dv = (None if isinstance(d, SymbolicZero) else d for d in tangents)
    widths = nodes[1:] - nodes[:-1]
    ahead = x - nodes[:-1]
    # At a node the mean of both sides, as of `within`.
    there = 0.5 * (jnp.sign(ahead) - jnp.sign(ahead - widths))
    slope = _sum((values[1:] - values[:-1]) / widths, there)
    passed = within(ahead, 0.0, widths) / widths

    def at_x(change: Array) -> Array:
        return change[0] + _sum(change[1:] - change[:-1], passed)

    moves = [
        *([] if dx is None else [slope * dx]),
        *([] if dn is None else [-slope * at_x(dn)]),
        *([] if dv is None else [at_x(dv)]),
    ]
    value = _polygon(x, nodes, values)
    return value, functools.reduce(jnp.add, moves, jnp.zeros_like(value))


def _sum(weights: Array, x: Array) -> Array:
    """The sum of the products over all intervals, on the first axis of both."""
    if weights.size > weights.shape[0]:
        return jnp.sum(weights * x, axis=0)
    # As a product of matrices where all runs share the table: the compiler vectorises that,
    # and none of a sum over a leading axis. An accelerator would by default round the factors of a
    # product of matrices to fewer digits.
    return jnp.tensordot(weights.reshape(-1), x, 1, precision=lax.Precision.HIGHEST)


class AbstractTable(HashedModule):
    """A function of time with nodes, at which it or a derivative of it jumps."""

    times: eqx.AbstractVar[Float[Array, "nodes *#runs"]]
    values: eqx.AbstractVar[Float[Array, "nodes *#runs"]]

    def _check(self) -> None:
        check_types(self, "times", "values")
        name = type(self).__name__
        # Placeholders of a tree transformation have no shape.
        times, values = (getattr(x, "shape", (2,)) for x in (self.times, self.values))
        if times[:1] != values[:1] or times in ((), (0,), (1,)):
            raise InputError(
                f"{name} has times of the shape {times} and values of the shape {values}: "
                f"it must have the same number of both, at least two."
            )
        check_finite(f"{name}.values", self.values)
        if is_concrete(self.times):
            steps = np.diff(np.asarray(self.times), axis=0)
            check(steps > 0.0, f"{name}.times", self.times, "ascending")

    def _intervals(self, t: Scalar) -> tuple[Array, Array, Array]:
        """Lengths of the intervals, how far each is passed at the time `t`, and the values."""
        rank = max(jnp.ndim(t), self.times.ndim - 1, self.values.ndim - 1)
        times = with_rank(self.times, rank)
        lengths = times[1:] - times[:-1]
        # A sum over all intervals: a search and a gather for each run cost more than a few
        # multiplications for each node.
        return lengths, within(t - times[:-1], 0.0, lengths), with_rank(self.values, rank)


@final
@printed(times="s")
class Table(AbstractTable):
    """A function of time, linear between its nodes: `Table(times, values)(t)`.

    - `times`, s: ascending, (nodes, *runs).
    - `values`: at these times, (nodes, *runs). A vector requires a table for each component.

    As a part of a system, of an effect or of a function in one, its nodes are `breaks` of every
    integration. Raises `InputError` for times that do not ascend, or another number of values."""

    times: Float[Array, "nodes *#runs"] = eqx.field(converter=as_float)
    values: Float[Array, "nodes *#runs"] = eqx.field(converter=as_float)

    def __check_init__(self):
        self._check()

    def __call__(self, t: Scalar) -> Scalar:
        """The value at the time `t`, s, (*runs,)."""
        return polygon(t, self.times, self.values)


@final
@printed(times="s")
class Spline(AbstractTable):
    """A function of time, cubic between its nodes, with continuous slope and curvature.

    - `times`, s: ascending, (nodes, *runs).
    - `values`: at these times, (nodes, *runs). A vector requires a spline for each component.

    Breaks and errors are as for a `Table`. The `curvatures` are computed from the values when the
    spline is created; for other values create another spline."""

    times: Float[Array, "nodes *#runs"]
    values: Float[Array, "nodes *#runs"]
    curvatures: Float[Array, "nodes *#runs"]

    def __init__(self, times: npt.ArrayLike, values: npt.ArrayLike):
        self.times = as_float(times)
        self.values = as_float(values)
        self._check()
        self.curvatures = _natural_curvatures(self.times, self.values)

    def __call__(self, t: Scalar) -> Scalar:
        """The value at the time `t`, s, (*runs,)."""
        h, x, f = self._intervals(t)
        # A solution of equations forgets that it was made of Python numbers.
        kind = precision_of(t, self.times, self.values)
        bend = with_rank(self.curvatures, f.ndim - 1).astype(kind)
        slope = (f[1:] - f[:-1]) / h - h * (2.0 * bend[:-1] + bend[1:]) / 6.0
        cubic = (bend[1:] - bend[:-1]) / (6.0 * h)
        return f[0] + jnp.sum(x * (slope + x * (0.5 * bend[:-1] + x * cubic)), axis=0)


def _natural_curvatures(times: Array, values: Array) -> Array:
    """The second derivatives M at the nodes: zero at the ends, and between them from

    h_{k-1} M_{k-1} + 2 (h_{k-1} + h_k) M_k + h_k M_{k+1} = 6 (d_k - d_{k-1}),  d: mean slopes."""
    rank = max(times.ndim, values.ndim) - 1
    times, values = with_rank(times, rank), with_rank(values, rank)
    h = times[1:] - times[:-1]
    kind = precision_of(times, values)
    jumps = (6.0 * jnp.diff((values[1:] - values[:-1]) / h, axis=0)).astype(kind)
    inner = jumps.shape[0]
    if inner == 0:
        return jnp.zeros_like(values)
    rows = np.arange(inner)
    # Dense and not tridiagonal: a spline has few nodes, and is solved once, when it is made.
    matrix = jnp.zeros((inner, inner, *h.shape[1:]), kind)
    matrix = matrix.at[rows, rows].set(2.0 * (h[:-1] + h[1:]))
    matrix = matrix.at[rows[1:], rows[:-1]].set(h[1:-1])
    matrix = matrix.at[rows[:-1], rows[1:]].set(h[1:-1])
    # The solver takes the runs first.
    system = jnp.moveaxis(matrix, (0, 1), (-2, -1))
    bends = jnp.linalg.solve(system, jnp.moveaxis(jumps, 0, -1)[..., None])[..., 0]
    bends = jnp.moveaxis(bends, -1, 0)
    end = jnp.zeros((1, *bends.shape[1:]), bends.dtype)
    return jnp.concatenate([end, bends, end])


def breaks_of(system: AbstractSystem) -> Float[Array, "times *#runs"] | None:
    """The break times of a system, s: those that it declares, and the nodes of every `Table` and
    `Spline` in it, also those that a function in it closes over. `None` where there is none."""
    declared = system.breaks()
    times = [] if declared is None else [declared]
    times += [table.times for table in _tables(system)]
    if not times:
        return None
    runs = jnp.broadcast_shapes(*(x.shape[1:] for x in times))
    times = [jnp.broadcast_to(with_rank(x, len(runs)), (x.shape[0], *runs)) for x in times]
    return jnp.concatenate(times) if len(times) > 1 else times[0]


def _tables(tree: PyTree) -> list[AbstractTable]:
    """Every table in a tree, also those in the closures of its functions."""
    result = []
    for leaf in jax.tree.leaves(tree, is_leaf=lambda x: isinstance(x, AbstractTable)):
        if isinstance(leaf, AbstractTable):
            result.append(leaf)
        # A function is a leaf, and its closure is not part of the tree. By its type: an
        # object of a user may answer to any name, or raise for it.
        function = leaf.__func__ if isinstance(leaf, MethodType) else leaf
        cells = function.__closure__ if isinstance(function, FunctionType) else None
        for cell in cells or ():
            try:
                result += _tables(cell.cell_contents)
            # The cell of a function that refers to itself may still be empty.
            except ValueError:
                continue
    return result
