"""Kalman's equations by roots of the covariance, P = L L^T: no variance is a difference.

    predict   L' = root of [Phi L, root(Q_d)]                     P' = Phi P Phi^T + Q_d
    update    with a reading of variance r and f = L^T h, one reading after the other:
              a_0 = r,  a_i = a_{i-1} + f_i^2
              L'_i = sqrt(a_{i-1}/a_i) L_i - f_i/sqrt(a_{i-1} a_i) sum_{j<i} f_j L_j
              K = L f/a_n                                         P' = P - K h^T P

    symbol   meaning
    L, L_i   a root of the covariance, its columns
    h, r     a reading's derivatives by the state; its variance
    K        gain of the reading

P - K S K^T loses the digits of a small variance that follows from a large one: all of them where
the ratio of both is above 1e16. Here each number retains its relative accuracy.

Source: Carlson (1973), Fast triangular formulation of the square root filter, AIAA J. 11, 1259;
Maybeck, Stochastic Models, Estimation, and Control, 7.3 to 7.6.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core.square_roots import inverse_sqrt, sqrt


def root_of(P: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """The lower L with L L^T = P, also for a rank-deficient P: an exactly known part of the state
    has columns of zeros."""
    n = P.shape[0]
    least = 16.0 * jnp.finfo(P.dtype).eps * jnp.diag(P)
    columns = []
    for j in range(n):
        d = P[j, j]
        # Remainders below rounding are not variances: their roots would be noise, or of negative
        # numbers.
        good = d > least[j]
        column = jnp.where(good, P[:, j], 0.0) * inverse_sqrt(jnp.where(good, d, 1.0))
        columns.append(column)
        P = P - jnp.outer(column, column)
    return jnp.stack(columns, axis=1)


def lower_root(A: Float[Array, "n k"]) -> Float[Array, "n n"]:
    """The lower L with L L^T = A A^T, by Gram-Schmidt orthogonalisation of the rows, which forms no
    product of A with itself; also for a rank-deficient A."""
    n = A.shape[0]
    columns = []
    for j in range(n):
        square = jnp.sum(A[j] * A[j])
        # Only exact zeros: a small remainder next to a large row may be significant, and one that
        # is rounding adds less than rounding to the variance.
        good = square > 0.0
        row = jnp.where(good, A[j], 0.0) * inverse_sqrt(jnp.where(good, square, 1.0))
        column = A @ row
        # What precedes the diagonal is orthogonal but for rounding.
        columns.append(jnp.where(jnp.arange(n) < j, 0.0, column))
        A = A - jnp.outer(column, row)
    return jnp.stack(columns, axis=1)


def updated(
    L: Float[Array, "n n"], HL: Float[Array, "m n"], R: Float[Array, "m m"], r: Float[Array, " m"]
) -> tuple[Float[Array, "n n"], Float[Array, " n"]]:
    """The root of the covariance after readings, and the change of the mean.

    **Arguments**

    - `L`: the root before.
    - `HL`: derivatives of the readings by the state, times L.
    - `R`: covariance of the readings.
    - `r`: the readings less their predictions."""
    m, n = HL.shape
    # Readings whose errors are independent: R = U D U^T with ones on the diagonal of U.
    root = root_of(R)
    scale = jnp.diag(root)
    exact = scale == 0.0
    U = jnp.where(exact, jnp.eye(m, dtype=root.dtype), root / jnp.where(exact, 1.0, scale))
    solved = jax.scipy.linalg.solve_triangular(
        U, jnp.concatenate([HL, r[:, None]], axis=1), lower=True, unit_diagonal=True
    )
    HL, r = solved[:, :n], solved[:, n]
    least = (64.0 * jnp.finfo(HL.dtype).eps) ** 2 * jnp.sum(HL * HL, axis=1)

    def one(carry: tuple[Array, Array], row: tuple[Array, Array, Array]) -> tuple:
        rows, rest = carry
        k, variance, least = row
        f = rows[k]
        # An exact reading of what is known already would divide a rounding by another.
        known = (variance == 0.0) & (jnp.sum(f * f) <= least)
        f = jnp.where(known, 0.0, f)
        sums = variance + jnp.cumsum(f * f)
        before = jnp.concatenate([variance[None], sums[:-1]])
        some, first = sums > 0.0, before > 0.0
        at, at_before = jnp.where(some, sums, 1.0), jnp.where(first, before, 1.0)
        keep = jnp.where(some, jnp.where(first, sqrt(at_before / at), 0.0), 1.0)
        mixed = jnp.cumsum(jnp.pad(rows * f, ((0, 0), (1, 0)))[:, :-1], axis=1)
        turned = jnp.where(first, f * inverse_sqrt(at) * inverse_sqrt(at_before), 0.0)
        gain = rows @ f / at[-1]
        return (rows * keep - turned * mixed, rest - gain * rest[k]), None

    # The rows of the readings change as those of the state do.
    start = (jnp.concatenate([HL, L]), jnp.concatenate([r, jnp.zeros(L.shape[0], r.dtype)]))
    (rows, rest), _ = jax.lax.scan(one, start, (jnp.arange(m), scale * scale, least))
    return rows[m:], -rest[m:]
