"""The phi functions of small matrices, at a quarter, a half and the whole of each.

    phi_0(Z) = e^Z,    phi_k(Z) = Z phi_{k+1}(Z) + 1/k!                      phi_1 = (e^Z - 1) / Z, and so on
    phi_k(2 Z) = 2^-k [ e^Z phi_k(Z) + sum_{j=1..k} phi_j(Z) / (k - j)! ]    doubling

A series serves Z / 2^m, m doublings lead back to Z. The digits lost are those that the phase of the
fastest motion in Z has lost already: eps |Z|, no more.

Source: Higham, Functions of Matrices, 10.7.4 (phi functions), 10.3 (scaling and squaring); Osborne
(1960), On pre-conditioning matrices, Journal of the ACM 7, 338 (balancing).
"""

import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

Square = Float[Array, "... n n"]

ORDERS = 5
TERMS = 17  # of the series of phi_5, for matrices of norm one
DOUBLINGS = 32  # more would leave no digit of the fastest phase
BALANCINGS = 8


def times(a: Square, b: Square) -> Square:
    """The product a b, in the precision of its factors on every device."""
    return jnp.matmul(a, b, precision="highest")


def phis(z: Square) -> list[Float[Array, "6 *runs n n"]]:
    """phi_0 to phi_5 of Z/4, of Z/2 and of Z; not finite where Z is not, or is larger than 2^32."""
    scale = _balance(z)
    z = z * scale[..., None, :] / scale[..., :, None]
    size = jax.lax.stop_gradient(jnp.max(jnp.sum(jnp.abs(z), axis=-2), axis=-1))
    doublings = jnp.clip(jnp.ceil(jnp.log2(jnp.maximum(size, 1.0))), 2.0, DOUBLINGS)[
        ..., None, None
    ]
    bad = ~(size <= 2.0**DOUBLINGS)[..., None, None]

    def once(p: Array, k: Array) -> tuple[Array, None]:
        wanted = k < doublings - 2.0
        return jax.lax.cond(
            jnp.any(wanted), lambda p: jnp.where(wanted, _doubled(p), p), lambda p: p, p
        ), None

    def again(p: Array, _: None) -> tuple[Array, Array]:
        p = _doubled(p)
        return p, p

    series = _series(jnp.where(bad, 0.0, z) * 2.0**-doublings)
    quarter = jax.lax.scan(once, series, jnp.arange(DOUBLINGS - 2, dtype=z.dtype))[0]
    half, whole = jax.lax.scan(again, quarter, length=2)[1]
    back = scale[..., :, None] / scale[..., None, :]
    return [jnp.where(bad, jnp.nan, p * back) for p in (quarter, half, whole)]


def _one(z: Square) -> Any:
    return jnp.eye(z.shape[-1], dtype=z.dtype)


def _series(z: Square) -> Float[Array, "6 *runs n n"]:
    """phi_0, phi_1, ... of a matrix of norm one: the last by its series, the others from it."""
    one = _one(z) + 0.0 * z
    last = jax.lax.fori_loop(
        0, TERMS, lambda k, p: times(z, p) / (TERMS + ORDERS - k).astype(z.dtype) + one, one
    )
    every = [last / math.factorial(ORDERS)]
    for k in range(ORDERS - 1, -1, -1):
        every.insert(0, times(z, every[0]) + one / math.factorial(k))
    return jnp.stack(every)


_SUMS = np.array(
    [
        [1 / math.factorial(k - j) if 1 <= j <= k else 0.0 for j in range(ORDERS + 1)]
        for k in range(ORDERS + 1)
    ]
)
_HALVES = 0.5 ** np.arange(ORDERS + 1)


def _doubled(p: Float[Array, "6 *runs n n"]) -> Float[Array, "6 *runs n n"]:
    """phi_0, phi_1, ... of 2 Z from those of Z."""
    halves = jnp.asarray(_HALVES, p.dtype).reshape(-1, *(1,) * (p.ndim - 1))
    return halves * (
        times(p[0], p) + jnp.tensordot(jnp.asarray(_SUMS, p.dtype), p, 1, precision="highest")
    )


def _balance(z: Square) -> Float[Array, "*runs n"]:
    """Powers of two that bring the rows and the columns of a matrix to like size, so that a choice
    of units doubles nothing."""
    size = jax.lax.stop_gradient(jnp.abs(z)) * (1.0 - _one(z))

    def once(_: Any, scale: Array) -> Array:
        now = size * scale[..., None, :] / scale[..., :, None]
        rows, columns = jnp.sum(now, axis=-1), jnp.sum(now, axis=-2)
        both = (rows > 0.0) & (columns > 0.0) & jnp.isfinite(rows) & jnp.isfinite(columns)
        ratio = jnp.where(both, rows, 1.0) / jnp.where(both, columns, 1.0)
        return scale * jnp.exp2(jnp.round(0.25 * jnp.log2(ratio)))

    return jax.lax.fori_loop(0, BALANCINGS, once, jnp.ones_like(z[..., 0]))
