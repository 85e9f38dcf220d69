"""Linear instruments: y' = A y + b with constant A and b, whose motion is known exactly.

    [y(t), 1] = exp([[A, b], [0, 0]] t) [y(0), 1]

The exponential is valid for every A, including singular ones, and so are its derivatives. An
instrument whose fast and slow motions differ by a factor of 1e6 costs no more than any other. The
relative error is that of the phase of the fastest motion, eps |A t|.

Of an angle and its rate A has entries of 1 and of w^2: the norm is w^2, where the phase is w t, and
single precision would lose its digits to the squarings. Each component therefore has a separate
unit, a power of two, in which rows and columns of A are balanced:

    exp(A) = D exp(D^-1 A D) D^-1

Source: Higham, Functions of Matrices, 10.3 (scaling and squaring); Osborne, J. ACM 7, 1960, 338
(balancing).
"""

from typing import final

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.linalg import expm
from jaxtyping import Array, Float, PyTree

from ..core import AbstractClosedForm, Scalar, State
from ..core.layout import component_axes_of
from ..core.shapes import with_rank
from ..core.types import precision_of

# Squarings for norms up to 2^48, beyond which the phase has no digit left.
SQUARINGS = 48
# Of the search for units: one finds those of two components, a dozen those of nine.
SWEEPS = 12


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


def linear_rate(matrix: Array, drive: Array, y: State) -> PyTree:
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
        # A state of Python numbers follows the system.
        x = x.astype(precision_of(x, self.matrix, self.drive))
        duration = jnp.asarray(duration, x.dtype)
        runs = jnp.broadcast_shapes(duration.shape, x.shape[1:], self.matrix.shape[2:])
        matrix, drive = with_rank(self.matrix, len(runs), axes=2), with_rank(self.drive, len(runs))
        a = jnp.broadcast_to(matrix * duration, (n, n, *runs))
        b = jnp.broadcast_to(drive * duration, (n, *runs))
        units = jax.lax.stop_gradient(_units(a))
        a, b = a * units / units[:, None], b / units
        share = jax.lax.stop_gradient(_share(a, b))
        # With b as one more column, and zeros below, the exponential contains the integral of the
        # motion that b drives, even where A has no inverse (Van Loan 1978).
        upper = jnp.concatenate([a, (b / share)[:, None]], axis=1)
        whole = jnp.concatenate([upper, jnp.zeros((1, n + 1, *runs), x.dtype)])
        front, back = (0, 1), (-2, -1)
        power = jnp.moveaxis(_exponential(jnp.moveaxis(whole, front, back)), back, front)
        x = jnp.broadcast_to(with_rank(x, len(runs)), (n, *runs)) / units
        moved = jnp.einsum("ij...,j...->i...", power[:n, :n], x) + share * power[:n, n]
        return unstacked(units * moved, y)


def _units(a: Float[Array, "n n *#runs"]) -> Float[Array, "n *#runs"]:
    """Powers of two d_i, in which rows and columns of d_i^-1 a_ij d_j have one size.

    Of all components at once, each by the fourth root of the ratio of its row to its column: both
    ends of an entry give way to it."""
    a = jax.lax.stop_gradient(a)
    n = a.shape[0]
    others = jnp.abs(a) * (1.0 - jnp.eye(n, dtype=a.dtype)).reshape(n, n, *(1,) * (a.ndim - 2))

    def better(carry: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        number, exponents, _ = carry
        size = others * jnp.exp2(exponents - exponents[:, None])
        # A norm below one needs no squaring, and zero has no better unit.
        row, column = (jnp.maximum(jnp.sum(size, axis=k), 1.0) for k in (1, 0))
        change = 0.25 * jnp.log2(row / column)
        # Each run separately: its units do not depend on its neighbours.
        far = jnp.any(jnp.abs(change) > 0.5, axis=0)
        return number + 1, jnp.where(far, exponents + change, exponents), far

    def goes_on(carry: tuple[Array, Array, Array]) -> Array:
        return (carry[0] < SWEEPS) & jnp.any(carry[2])

    start = jnp.zeros(a.shape[1:], a.dtype)
    whole = (jnp.asarray(0), start, jnp.ones(a.shape[2:], bool))
    return _power_of_two(jax.lax.while_loop(goes_on, better, whole)[1])


def _power_of_two(exponent: Float[Array, "..."]) -> Float[Array, "..."]:
    """The power of two next to 2^exponent: no digit is lost with such a factor."""
    kind = jnp.finfo(exponent.dtype)
    return jax.lax.reduce_precision(jnp.exp2(exponent), kind.nexp, mantissa_bits=0)


def _share(a: Float[Array, "n n *#runs"], b: Float[Array, "n *#runs"]) -> Float[Array, "*#runs"]:
    """The power of two by which b is divided so that it does not set the norm: the motion is linear
    in it."""
    norm = jnp.max(jnp.sum(jnp.abs(a), axis=0), axis=0)
    ratio = jnp.sum(jnp.abs(b), axis=0) / jnp.maximum(norm, 1.0)
    return _power_of_two(jnp.log2(jnp.maximum(ratio, 1.0)))


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
