"""Vector algebra on the first axis: a vector is `(3, *runs)`.

Written out by components, because a reduction over an axis of length three hinders the compiler's
fusion."""

import functools
from typing import Any

import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array, Float

from ._barrier import barrier
from ._safe import safe_sqrt
from ._types import Matrix, Scalar, Vector


@jax.custom_jvp
def dot(a: Vector, b: Vector) -> Scalar:
    """Scalar product a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@functools.partial(dot.defjvp, symbolic_zeros=True)
def _dot_rule(given: tuple[Vector, Vector], change: tuple[Any, Any]) -> tuple[Scalar, Any]:
    # As a sum over the axis, because reverse mode then spreads the result in one go. That of the
    # components would fill up each one with zeros, and compute the derivative of all that came
    # after three times (measured: half of the time of a step).
    rank = max(x.ndim for x in given)
    a, b = (x.reshape(x.shape + (1,) * (rank - x.ndim)) for x in given)
    moved = [
        (d, other)
        for d, other in zip(change, (b, a), strict=True)
        if not isinstance(d, SymbolicZero)
    ]
    products = [d.reshape(d.shape + (1,) * (rank - d.ndim)) * other for d, other in moved]
    return dot(*given), jnp.sum(functools.reduce(jnp.add, products), axis=0)


@functools.partial(jax.custom_jvp, nondiff_argnums=(1,))
def inverse_norm(a: Vector, power: int = 1) -> Scalar:
    """1 / |a|^power: for any power the compiler takes the same root."""
    p = 1.0 / jnp.sqrt(dot(a, a))
    square = p * p
    return functools.reduce(jnp.multiply, [square] * (power // 2) + [p] * (power % 2))


@inverse_norm.defjvp
def _inverse_norm_rule(
    power: int, given: tuple[Vector], change: tuple[Vector]
) -> tuple[Scalar, Scalar]:
    # In one go: by the rules for root, quotient and products a derivative along many directions
    # would take several times as many operations. From the relative change, because in metres a
    # higher power would leave the range of float32.
    (a,), (da,) = given, change
    p = inverse_norm(a, power)
    return p, (-power * p) * (inverse_norm(a, 2) * dot(a, da))


@jax.custom_jvp
def scale(scalar: Scalar, a: Vector) -> Vector:
    """Scalar times vector."""
    return scalar * a


@functools.partial(scale.defjvp, symbolic_zeros=True)
def _scale_rule(given: tuple[Scalar, Vector], change: tuple[Any, Any]) -> tuple[Vector, Vector]:
    # What the scalar changes by is held: the compiler would compute it again for every component.
    (scalar, a), (d_scalar, da) = given, change
    parts = [] if isinstance(d_scalar, SymbolicZero) else [barrier(d_scalar) * a]
    parts += [] if isinstance(da, SymbolicZero) else [scalar * da]
    return scale(scalar, a), functools.reduce(jnp.add, parts)


def cross(a: Vector, b: Vector) -> Vector:
    """Vector product a x b."""
    return jnp.stack(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


def norm(a: Vector) -> Scalar:
    """Length |a|, with the derivative zero at a = 0 (the mean of its one-sided derivatives), never
    NaN."""
    return safe_sqrt(dot(a, a))


def unit(a: Vector) -> Vector:
    """a / |a|; the zero vector stays zero."""
    length = norm(a)
    return jnp.where(length > 0.0, a / jnp.where(length > 0.0, length, 1.0), 0.0)


def matvec(m: Matrix, a: Vector) -> Vector:
    """Matrix times vector, m a."""
    return m[:, 0] * a[0] + m[:, 1] * a[1] + m[:, 2] * a[2]


def solve3(m: Matrix, b: Vector) -> Vector:
    """The solution x of m x = b for a regular 3 x 3 matrix, by cofactors (Cramer's rule)."""
    c0, c1, c2 = m[:, 0], m[:, 1], m[:, 2]
    n0 = cross(c1, c2)
    return jnp.stack([dot(n0, b), dot(cross(c2, c0), b), dot(cross(c0, c1), b)]) / dot(c0, n0)


def axis(index: int, like: Scalar) -> Vector:
    """The unit vector along the axis `index` (0, 1, 2), with the runs and the precision of the
    scalar `like`."""
    like = jnp.asarray(like)
    one, zero = jnp.ones_like(like), jnp.zeros_like(like)
    return jnp.stack([one if i == index else zero for i in range(3)])


def expand(scalar: Float[Array, "*runs"], rank: int) -> Array:
    """A per-run scalar with `rank` leading axes of length one, to meet a field of that many
    component axes."""
    return scalar.reshape((1,) * rank + scalar.shape)
