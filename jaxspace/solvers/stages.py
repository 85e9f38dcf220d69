"""The stages of an explicit Runge-Kutta step, unrolled or as a loop, and sums over them.

k_i = f(t + c_i h, y + h sum_j a_ij k_j)            y + h sum_i w_i k_i
"""

import functools
from collections.abc import Callable, Sequence
from typing import TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..core import Scalar, State

Weights: TypeAlias = tuple[tuple[int, float], ...]
"""A row of a tableau: stages and their weights, without those of weight zero."""
# Up to this number of components, sums over the stages are products and a sum. A product of
# matrices would call a library, and a loop with such a call is not compiled as one kernel.
NARROW = 64


def dense_rows(rows: Sequence[Weights], columns: int) -> Float[np.ndarray, "rows columns"]:
    """Rows of a tableau as a matrix."""
    matrix = np.zeros((len(rows), columns))
    for row, weights in zip(matrix, rows, strict=True):
        for i, w in weights:
            row[i] = w
    return matrix


def weighted(weights: Weights, ks: Sequence[Array] | Array) -> Array:
    """sum_i w_i k_i, of a list or of an array with the stages on its first axis."""
    if isinstance(ks, jax.Array):
        (row,) = dense_rows((weights,), ks.shape[0])
        return jnp.tensordot(row.astype(ks.dtype), ks, 1)
    # With operations of `lax`, because a step has hundreds of them, and those of `jax.numpy` take
    # four times as long to trace.
    terms = [jax.lax.mul(ks[i], ks[i].dtype.type(w)) for i, w in weights]
    return functools.reduce(jax.lax.add, terms)


def weighted_rows(weights: Float[Array, "rows *#runs"], rows: Array) -> Array:
    """sum_k w_k a_k over the first axis of an array, with weights shared by the runs or of each
    run."""
    if weights.ndim == 1 and rows[0].size > NARROW:
        return jnp.tensordot(weights, rows, 1)
    missing = (1,) * (rows.ndim - weights.ndim)
    return jnp.sum(weights.reshape(weights.shape[0], *missing, *weights.shape[1:]) * rows, axis=0)


def combine(y: State | None, h: Array, weights: Weights, ks: list[State] | State) -> State:
    """y + h sum_i w_i k_i, leaf by leaf; a `y` of `None` means zero.

    `ks` is a list, or one tree with the stages on the first axis of its leaves (`stage_loop`)."""
    if isinstance(ks, list):
        change = jax.tree.map(lambda *kl: h.astype(kl[0].dtype) * weighted(weights, kl), *ks)
    else:
        change = jax.tree.map(lambda k: h.astype(k.dtype) * weighted(weights, k), ks)
    return change if y is None else jax.tree.map(jnp.add, y, change)


def stages(
    f: Callable[[Array, State], State],
    t0: Float[Array, ""],
    h: Float[Array, ""],
    y0: State,
    c: tuple[float, ...],
    a: tuple[Weights, ...],
    ks: list[State],
    rolled: bool = False,
) -> list[State] | State:
    """The derivatives at the stages of a step.

    **Arguments**

    - `f`: the vector field, dy/dt = f(t, y).
    - `t0`, `h`: start and length of the step.
    - `y0`: the state from which the stages start.
    - `c`, `a`: nodes and rows of the stages to evaluate.
    - `ks`: the derivatives at the stages before these; none of them for a loop.
    - `rolled`: whether the stages are a loop of the program (`stage_loop`).

    **Returns** `ks`, followed by one derivative for each row of `a`; of a loop one tree, with the
    stages on the first axis of its leaves.
    """
    # Not before the start, because a step may be as short as a rounding.
    end = jnp.maximum(t0, t0 + h - 4.0 * jnp.finfo(t0.dtype).eps * (jnp.abs(t0) + h))

    def derivative(ci: Scalar, change: State | None) -> State:
        y = y0
        if change is not None:
            y = jax.tree.map(lambda y, d: y + h.astype(y.dtype) * d, y0, change)
        return f(jnp.minimum(t0 + h * jax.lax.convert_element_type(ci, h.dtype), end), y)

    if rolled:
        return stage_loop(derivative, y0, c, a)
    for ci, row in zip(c, a, strict=True):
        change = jax.tree.map(lambda *kl, row=row: weighted(row, kl), *ks) if row else None
        ks = [*ks, derivative(ci, change)]
    return ks


def stage_loop(
    derivative: Callable[[Array, State], State],
    like: State,
    c: tuple[float, ...],
    a: tuple[Weights, ...],
) -> State:
    """k_i = derivative(c_i, sum_j a_ij k_j) for each row of `a`, by a loop, as one tree.

    The program contains the vector field once, instead of once for each stage. It compiles several
    times sooner, derivatives most of all. Simple fields run somewhat slower, because each stage
    reads all derivatives, also those of weight zero. `like` has the structure of the
    derivatives."""

    # Evaluated again in reverse mode, because storing what it computes at every stage takes more
    # time. The sum is outside: it is linear, and reverse mode needs nothing of it.
    # Between the passes of a loop nothing is common, and a barrier would hide which arrays are
    # constant: what two effects compute from equal ones would be there twice.
    rate = jax.checkpoint(derivative, prevent_cse=False)

    def stage(ks: State, row: tuple[Array, Array, Array]) -> tuple[State, None]:
        i, ci, weights = row
        change = jax.tree.map(lambda k: jnp.tensordot(weights.astype(k.dtype), k, 1), ks)
        k = rate(ci, change)
        put = jax.lax.dynamic_update_index_in_dim
        return jax.tree.map(lambda every, k: put(every, k, i, 0), ks, k), None

    # Zeros that move with the state: JAX differentiates the body of a loop once more where a
    # tangent is zero at the start and not at the end.
    empty = jax.tree.map(
        lambda x: jnp.broadcast_to(jnp.where(False, x, 0), (len(c), *x.shape)), like
    )
    rows = (jnp.arange(len(c)), jnp.asarray(c), jnp.asarray(dense_rows(a, len(c))))
    return jax.lax.scan(stage, empty, rows)[0]
