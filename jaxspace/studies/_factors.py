"""A covariance as a sum of squares, so that no digits are lost when it is propagated.

    P = U D U^T = sum_k D_k u_k u_k^T,     M P M^T = sum_k D_k (M u_k)(M u_k)^T

    symbol  meaning                                            unit
    P       covariance                                         of the state, squared
    u_k, U  columns; at first U is lower triangular            of the state
    D_k     their weights, at first variances, not negative    that of P, over that of u_k, squared

M P M^T is a difference of large numbers where one variance is far above another: of variances in a
ratio above 1e16 nothing of the small one is left, and it may be negative. A sum of squares is not.
There are no square roots either: the derivative by a variance of zero is finite.

Source: Bierman, Factorization Methods for Discrete Sequential Estimation, 1977, III and V.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


class Factors(NamedTuple):
    """Columns u_k and weights D_k of a covariance."""

    columns: Float[Array, "n k *#runs"]
    weights: Float[Array, "k *#runs"]

    @property
    def product(self) -> Float[Array, "n n *runs"]:
        """The covariance."""
        return jnp.einsum("ik...,k...,jk...->ij...", self.columns, self.weights, self.columns)

    def joined(self, other: "Factors") -> "Factors":
        """The factors of the sum of both covariances."""
        columns = jnp.concatenate([self.columns, other.columns], axis=1)
        return Factors(columns, jnp.concatenate([self.weights, other.weights]))


def factors_of(P: Float[Array, "n n *runs"]) -> Factors:
    """The factors of a covariance, also where it has no full rank."""
    n = P.shape[0]
    least = [16.0 * jnp.finfo(P.dtype).eps * P[j, j] for j in range(n)]
    columns = []
    weights = []
    for j in range(n):
        d = P[j, j]
        # Remainders below rounding are no variances. Their derivatives are those of variances.
        good = d > least[j]
        unit = jnp.zeros_like(P[j]).at[j].set(1.0)
        column = jnp.where(good, P[:, j] / jnp.where(good, d, 1.0), unit)
        weight = jnp.where(good, d, d - jax.lax.stop_gradient(d))
        columns.append(column)
        weights.append(weight)
        P = P - weight * column[:, None] * column[None]
    return Factors(jnp.stack(columns, axis=1), jnp.stack(weights))
