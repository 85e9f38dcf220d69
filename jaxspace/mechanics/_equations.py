"""Equations of motion by the derivatives of a Lagrangian.

    M(q, v) v' = dL/dq - d(p)/dq v - d(p)/dt + Q + A^T lambda
    p = dL/dv,  M = dp/dv,  Q = force - dD/dv

Every function acts on components first and runs last: the gradient of the sum over the runs is the
gradient of each, and the columns of M are derivatives along the unit vectors of all runs at once.

Source: Thomson 9.3 to 9.5.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import Scalar

Coordinates = Float[Array, "n *#runs"]
Columns = Float[Array, "n k *#runs"]
Square = Float[Array, "n n *#runs"]
# A function of time, coordinates and rates that returns a number for each run.
ScalarFunction = Callable[[Scalar, Array, Array], Array]

# The order up to which an elimination written out for all runs is faster than a call of LAPACK for
# each run.
WRITTEN_OUT = 6


def momenta(function: ScalarFunction, t: Scalar, q: Coordinates, v: Coordinates) -> Coordinates:
    """The generalised momenta dL/dv, (n, *runs)."""
    # The gradient of the sum over the runs: each run depends on its own rates only, so that one
    # reverse pass is sufficient for all.
    return jax.grad(lambda v: jnp.sum(function(t, q, v)))(v)


def columns(function: Callable[[Array], Array], x: Coordinates) -> Array:
    """The Jacobian of a function of each run, (m, n, *runs), at `x`, (n, *runs)."""
    n = x.shape[0]
    units = jnp.eye(n, dtype=x.dtype).reshape(n, n, *(1,) * (x.ndim - 1))
    # Forward mode: there are as many directions as coordinates, and each run stays in its column.
    along = jax.vmap(lambda e: jax.jvp(function, (x,), (jnp.broadcast_to(e, x.shape),))[1])
    return jnp.moveaxis(along(units), 0, 1)


def mass_matrix(function: ScalarFunction, t: Scalar, q: Coordinates, v: Coordinates) -> Columns:
    """The mass matrix d^2 L / dv^2, (n, n, *runs)."""
    return columns(lambda v: momenta(function, t, q, v), v)


def inertial_force(
    function: ScalarFunction, t: Scalar, q: Coordinates, v: Coordinates
) -> Coordinates:
    """dL/dq - d(dL/dv)/dt at constant rates, (n, *runs)."""
    t = jnp.asarray(t, q.dtype)
    slope = jax.grad(lambda q: jnp.sum(function(t, q, v)))(q)
    # Along (1, v): the explicit time and the moving coordinates in one pass, without the matrix of
    # mixed derivatives.
    _, change = jax.jvp(lambda t, q: momenta(function, t, q, v), (t, q), (jnp.ones_like(t), v))
    return slope - change


def solve(m: Square, b: Columns) -> Columns:
    """The solution x, (n, k, *runs), of m x = b for a matrix (n, n, *runs) whose leading minors do
    not vanish, such as a positive definite one."""
    n = m.shape[0]
    if n > WRITTEN_OUT:
        front, back = (0, 1), (-2, -1)
        result = jnp.linalg.solve(jnp.moveaxis(m, front, back), jnp.moveaxis(b, front, back))
        return jnp.moveaxis(result, back, front)
    # Written out, so that each operation acts on all runs at once, where LAPACK takes one after the
    # other. Minors that do not vanish need no pivots.
    rows = [jnp.concatenate([m[i], b[i]]) for i in range(n)]
    for i in range(n):
        for j in range(i + 1, n):
            rows[j] = rows[j] - rows[j][i] / rows[i][i] * rows[i]
    x: list[Array] = [rows[0]] * n
    for i in reversed(range(n)):
        known = sum((rows[i][j] * x[j] for j in range(i + 1, n)), jnp.zeros_like(rows[i][n:]))
        x[i] = (rows[i][n:] - known) / rows[i][i]
    return jnp.stack(x)


def least_squares(m: Square, b: Columns) -> Columns:
    """The shortest x, (m, k, *runs), with the least |m x - b|; differentiable where the rank of m
    does not change."""
    front, back = (0, 1), (-2, -1)
    inverse: Array = jnp.linalg.pinv(
        jnp.moveaxis(m, front, back), rtol=RANK * _eps(m), hermitian=True
    )
    return jnp.moveaxis(inverse @ jnp.moveaxis(b, front, back), back, front)


# Singular values below this number of roundings of the greatest one count as zero.
RANK = 1e4


def _eps(x: Array) -> float:
    return float(jnp.finfo(x.dtype).eps)


def matmul(a: Float[Array, "m n *#runs"], b: Columns) -> Float[Array, "m k *#runs"]:
    """The product of two matrices with the runs last."""
    return jnp.einsum("ij...,jk...->ik...", a, b)
