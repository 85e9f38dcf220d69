"""The phi functions of small matrices, at a quarter, a half and the whole of each matrix.

    phi_0(Z) = e^Z
    phi_k(Z) = Z phi_{k+1}(Z) + 1/k!                                         phi_1 = (e^Z - 1) / Z
    phi_k(2 Z) = 2^-k [ e^Z phi_k(Z) + sum_{j=1..k} phi_j(Z) / (k - j)! ]    doubling

A series gives them at Z / 2^m, and m doublings lead back to Z. The relative error is eps |Z|, that
of the phase of the fastest motion in Z.

Source: Higham, Functions of Matrices, 10.7.4 (phi functions), 10.3 (scaling and squaring); Osborne
(1960), On pre-conditioning matrices, Journal of the ACM 7, 338 (balancing).
"""

import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

Square = Float[Array, "... n n"]
Phis = Float[Array, "6 *runs n n"]

ORDERS = 5
# Terms of the series of phi_5: the next one is below a rounding for matrices of norm one.
TERMS = 17
# The most doublings: more would leave no digit of the phase of the fastest motion.
DOUBLINGS = 32
# Passes over the matrix, each of which reduces the ratio of its entries to the square root.
BALANCINGS = 8


def _matmul(a: Square, b: Square) -> Square:
    # In the precision of the factors on every device.
    return jnp.matmul(a, b, precision="highest")


def phi_functions(z: Square) -> list[Phis]:
    """phi_0 to phi_5 of Z/4, of Z/2 and of Z.

    NaN where Z is not finite, or its norm is above 2^32."""
    scale = _balance(z)
    z = z * scale[..., None, :] / scale[..., :, None]
    norm = jax.lax.stop_gradient(jnp.max(jnp.sum(jnp.abs(z), axis=-2), axis=-1))
    # At least two, because the last two doublings lead from Z/4 to Z/2 and to Z.
    doublings = jnp.clip(jnp.ceil(jnp.log2(jnp.maximum(norm, 1.0))), 2.0, DOUBLINGS)
    doublings = doublings[..., None, None]
    # True for NaN as well. A zero instead keeps the loop below short and its result finite.
    out_of_range = ~(norm <= 2.0**DOUBLINGS)[..., None, None]

    def double_if_due(p: Phis, k: Array) -> tuple[Phis, None]:
        due = k < doublings - 2.0
        # Skipped where no run needs it, because most runs need few doublings.
        p = jax.lax.cond(jnp.any(due), lambda p: jnp.where(due, _doubled(p), p), lambda p: p, p)
        return p, None

    def double(p: Phis, _: None) -> tuple[Phis, Phis]:
        p = _doubled(p)
        return p, p

    start = _series(jnp.where(out_of_range, 0.0, z) * 2.0**-doublings)
    quarter = jax.lax.scan(double_if_due, start, jnp.arange(DOUBLINGS - 2, dtype=z.dtype))[0]
    half, whole = jax.lax.scan(double, quarter, length=2)[1]
    back = scale[..., :, None] / scale[..., None, :]
    return [jnp.where(out_of_range, jnp.nan, p * back) for p in (quarter, half, whole)]


def _identity(z: Square) -> Float[Array, "n n"]:
    return jnp.eye(z.shape[-1], dtype=z.dtype)


def _series(z: Square) -> Phis:
    """phi_0 to phi_5 of a matrix of norm one at most: phi_5 by its series, the others by the
    recurrence."""
    # With the axes of the runs.
    one = _identity(z) + 0.0 * z

    def horner(k: Array, p: Square) -> Square:
        return _matmul(z, p) / (TERMS + ORDERS - k).astype(z.dtype) + one

    last = jax.lax.fori_loop(0, TERMS, horner, one)
    every = [last / math.factorial(ORDERS)]
    for k in range(ORDERS - 1, -1, -1):
        every.insert(0, _matmul(z, every[0]) + one / math.factorial(k))
    return jnp.stack(every)


_SUMS = np.array(
    [
        [1 / math.factorial(k - j) if 1 <= j <= k else 0.0 for j in range(ORDERS + 1)]
        for k in range(ORDERS + 1)
    ]
)
_HALVES = 0.5 ** np.arange(ORDERS + 1)


def _doubled(p: Phis) -> Phis:
    """phi_0 to phi_5 of 2 Z from those of Z."""
    halves = jnp.asarray(_HALVES, p.dtype).reshape(-1, *(1,) * (p.ndim - 1))
    sums = jnp.tensordot(jnp.asarray(_SUMS, p.dtype), p, 1, precision="highest")
    return halves * (_matmul(p[0], p) + sums)


def _balance(z: Square) -> Float[Array, "*runs n"]:
    """Powers of two that bring rows and columns of a matrix to similar size.

    Without them the number of doublings would depend on the units of the state."""
    off_diagonal = jax.lax.stop_gradient(jnp.abs(z)) * (1.0 - _identity(z))

    def once(_: Array | int, scale: Array) -> Array:
        now = off_diagonal * scale[..., None, :] / scale[..., :, None]
        rows = jnp.sum(now, axis=-1)
        columns = jnp.sum(now, axis=-2)
        both = (rows > 0.0) & (columns > 0.0) & jnp.isfinite(rows) & jnp.isfinite(columns)
        ratio = jnp.where(both, rows, 1.0) / jnp.where(both, columns, 1.0)
        # The fourth root of the ratio, because rows and columns change at once. A power of two
        # scales without rounding.
        return scale * jnp.exp2(jnp.round(0.25 * jnp.log2(ratio)))

    return jax.lax.fori_loop(0, BALANCINGS, once, jnp.ones_like(z[..., 0]))
