"""Eigenvalues of small real matrices, with derivatives also where some of them meet.

    d(lambda_i) = w_i dA v_i            v_i, w_i: right and left eigenvectors, w_i v_i = 1

Where eigenvalues are equal but have as many eigenvectors, the slope of each is the mean of their
slopes, which is the mean of either one-sided derivative of the ordered values. Where eigenvectors
coincide as well, as for a free translation or at critical damping, the eigenvalue changes as a root
of the perturbation: its slope is not finite, and zero along directions that do not change it. The
values are accurate in all of these cases, in the last one to the square root of rounding.

Source: Magnus (1985), On differentiating eigenvalues and eigenvectors, Econometric Theory 1, 179.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Complex, Float

Square = Float[Array, "... n n"]

# Eigenvalues closer than this number of roundings of the matrix are equal.
EQUAL = 1e3
# Eigenvectors belong to a multiple root where the inverse of their matrix has rows longer than
# this power of a rounding.
DEFECTIVE = -0.4


@jax.custom_jvp
def eigenvalues(a: Square) -> Complex[Array, "... n"]:
    """Eigenvalues in the order of their size; of a pair the one with positive frequency first."""
    return ordered(a)[0]


def ordered(a: Square) -> tuple[Complex[Array, "... n"], Complex[Array, "... n n"]]:
    """Eigenvalues in order and their eigenvectors, as columns of length one; without
    derivatives."""
    values, vectors = jnp.linalg.eig(jax.lax.stop_gradient(a))
    # Both of a pair have the same size to the last bit.
    order = jnp.lexsort((-values.imag, values.real, jnp.abs(values)), axis=-1)
    values = jnp.take_along_axis(values, order, axis=-1)
    return values, jnp.take_along_axis(vectors, order[..., None, :], axis=-1)


@eigenvalues.defjvp
def _eigenvalues_tangent(primals, tangents):
    (a,), (change,) = primals, tangents
    values, right = ordered(a)
    left = jnp.linalg.inv(right)
    eps = jnp.finfo(a.dtype).eps
    size = jnp.sqrt(jnp.sum(jnp.abs(left) ** 2, axis=-1))
    defective = ~(size <= float(eps) ** DEFECTIVE)
    left = jnp.where(defective[..., None], jnp.ones_like(left), left)
    # Linear in the change, as both modes of differentiation need it.
    each = jnp.sum(left * jnp.swapaxes(change.astype(right.dtype) @ right, -1, -2), axis=-1)
    scale = EQUAL * eps * jnp.max(jnp.abs(a), axis=(-1, -2))[..., None, None]
    equal = jnp.abs(values[..., :, None] - values[..., None, :]) <= scale
    equal = equal & ~defective[..., :, None] & ~defective[..., None, :]
    equal = (equal | jnp.eye(a.shape[-1], dtype=bool)).astype(a.dtype)
    weights = equal / jnp.sum(equal, axis=-1, keepdims=True)
    slope = jnp.squeeze(weights.astype(each.dtype) @ each[..., None], -1)
    # Infinity as two finite factors, so that zero times it is zero.
    factor = jnp.where(defective, jnp.finfo(a.dtype).max, 1.0).astype(a.dtype)
    slope = jax.lax.complex(slope.real * factor * factor, slope.imag * factor * factor)
    return values, slope
