"""Linear instruments: y' = A y + b with constant A and b, whose motion is known exactly.

    [y(t), 1] = exp([[A, b], [0, 0]] t) [y(0), 1]

The exponential holds for every A, also where it is singular, and so do its derivatives. An
instrument whose fast and slow motions differ by a factor of 1e6 costs no more than any other. The
relative error is that of the phase of the fastest motion, eps |A t|.

Source: Higham, Functions of Matrices, 10.3 (scaling and squaring).
"""

from typing import Any, final

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.linalg import expm
from jaxtyping import Array, Float

from ..core import AbstractClosedForm, Scalar, State
from ..core.layout import component_axes_of
from ..core.shapes import with_rank

# Squarings for norms up to 2^48, beyond which the phase has no digit left.
SQUARINGS = 48


def rows(*of_row: tuple[Scalar, ...]) -> Float[Array, "n m *#runs"]:
    """A matrix from its entries, each a scalar or (*runs,)."""
    flat = jnp.broadcast_arrays(*(jnp.asarray(x) for row in of_row for x in row))
    return jnp.stack(flat).reshape(len(of_row), -1, *flat[0].shape)


def stacked(y: State) -> Float[Array, "n *#runs"]:
    """All components of a state, in the order of its fields."""
    parts = [
        x if k > 0 else x[None]
        for x, k in zip(jax.tree.leaves(y), jax.tree.leaves(component_axes_of(y)), strict=True)
    ]
    runs = jnp.broadcast_shapes(*(x.shape[1:] for x in parts))
    return jnp.concatenate([jnp.broadcast_to(x, (x.shape[0], *runs)) for x in parts])


def unstacked(x: Float[Array, "n *#runs"], like: State) -> State:
    """The state of these components, in the form of `like`."""
    leaves, structure = jax.tree.flatten(like)
    axes = jax.tree.leaves(component_axes_of(like))
    sizes = [leaf.shape[0] if k > 0 else 1 for leaf, k in zip(leaves, axes, strict=True)]
    parts = jnp.split(x, np.cumsum(sizes)[:-1].tolist())
    result = [part if k > 0 else part[0] for part, k in zip(parts, axes, strict=True)]
    return jax.tree.unflatten(structure, result)


def linear_rate(matrix: Array, drive: Array, y: State) -> Any:
    """A y + b as a rate of the form of the state.

    **Arguments**

    - `matrix`, `drive`: A, (n, n, *runs), and b, (n, *runs)."""
    x = stacked(y)
    rank = max(matrix.ndim - 2, drive.ndim - 1, x.ndim - 1)
    x = with_rank(x, rank)
    drive = with_rank(drive, rank)
    matrix = with_rank(matrix, rank, axes=2)
    return unstacked(jnp.einsum("ij...,j...->i...", matrix, x) + drive, y)


@final
class LinearFlow(AbstractClosedForm):
    """The exact motion under A, (n, n, *runs), and b, (n, *runs)."""

    matrix: Float[Array, "n n *#runs"]
    drive: Float[Array, "n *#runs"]

    def flow(self, duration: Scalar, y: State) -> State:
        x = stacked(y)
        n = x.shape[0]
        duration = jnp.asarray(duration, x.dtype)
        runs = jnp.broadcast_shapes(duration.shape, x.shape[1:], self.matrix.shape[2:])
        matrix, drive = with_rank(self.matrix, len(runs), axes=2), with_rank(self.drive, len(runs))
        a = jnp.broadcast_to(matrix * duration, (n, n, *runs))
        b = jnp.broadcast_to(drive * duration, (n, *runs))
        # With b as one more column, and zeros below, the exponential contains the integral of the
        # motion that b drives, even where A has no inverse (Van Loan 1978).
        upper = jnp.concatenate([a, b[:, None]], axis=1)
        whole = jnp.concatenate([upper, jnp.zeros((1, n + 1, *runs), x.dtype)])
        front, back = (0, 1), (-2, -1)
        power = jnp.moveaxis(_exponential(jnp.moveaxis(whole, front, back)), back, front)
        x = jnp.broadcast_to(with_rank(x, len(runs)), (n, *runs))
        return unstacked(jnp.einsum("ij...,j...->i...", power[:n, :n], x) + power[:n, n], y)


def _exponential(a: Float[Array, "*runs n n"]) -> Float[Array, "*runs n n"]:
    """exp(a), by squaring that of a matrix whose norm is at most 4.

    The exponential of JAX squares once too little between powers of two, with errors of up to
    1e-7."""
    norm = jax.lax.stop_gradient(jnp.max(jnp.sum(jnp.abs(a), axis=-2), axis=-1))[..., None, None]
    number = jnp.clip(jnp.ceil(jnp.log2(0.25 * jnp.maximum(norm, 4.0))), 0, SQUARINGS)
    power = expm(a * 2.0**-number)

    def square(power: Array, k: Array) -> tuple[Array, None]:
        def once(x: Array) -> Array:
            return jnp.where(k < number, jnp.matmul(x, x, precision="highest"), x)

        # Skipped when no run of the batch needs a further squaring: a product of matrices costs
        # more than the test.
        return jax.lax.cond(jnp.any(k < number), once, lambda x: x, power), None

    # A scan with a fixed number of iterations can be differentiated in reverse, and compiles one of
    # them.
    power, _ = jax.lax.scan(square, power, jnp.arange(SQUARINGS, dtype=a.dtype))
    # Further squarings would leave no digit: the result is NaN in place of a wrong number.
    return jnp.where(norm <= 2.0**SQUARINGS, power, jnp.nan)
