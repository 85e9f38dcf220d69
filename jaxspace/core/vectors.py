"""Vector algebra on the first axis: a vector is (3, *runs), or (3, times, *runs).

Every function checks the first axis statically. The products are written out by components,
because a reduction over an axis of length three hinders the compiler's fusion.
"""

__all__ = [
    "axis",
    "components",
    "cross",
    "dot",
    "identity",
    "inverse_norm",
    "matvec",
    "norm",
    "over_norm",
    "scale",
    "solve3",
    "unit",
]

import functools
from typing import TypeAlias

import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero
from jaxtyping import Array

from ._lists import takes_lists
from .barrier import barrier
from .safe import safe_divide
from .shapes import check_components, with_rank
from .square_roots import inverse_sqrt, sqrt
from .squares import is_narrow, square_factor
from .types import Matrix, Scalar, Vector

Tangent: TypeAlias = Array | SymbolicZero


@takes_lists
@jax.custom_jvp
def dot(a: Vector, b: Vector) -> Scalar:
    """Scalar product a . b.

    **Arguments**

    - `a`, `b`: vectors, (3, *runs).

    **Raises** `InputError` where the first axis does not have three components."""
    check_components("dot: a", a, 3)
    check_components("dot: b", b, 3)
    rank = max(a.ndim, b.ndim) - 1
    x, y, z = components(with_rank(a, rank) * with_rank(b, rank))
    return x + y + z


@functools.partial(dot.defjvp, symbolic_zeros=True)
def _dot_rule(
    primals: tuple[Vector, Vector], tangents: tuple[Tangent, Tangent]
) -> tuple[Scalar, Scalar]:
    # As a sum over the axis, because reverse mode then spreads the result in one operation. The
    # transpose of the components would pad each one with zeros, and compute the derivative of all
    # that comes before it three times (measured: half of the time of a step).
    rank = max(x.ndim for x in primals) - 1
    a, b = (with_rank(x, rank) for x in primals)
    products = [
        with_rank(d, rank) * other
        for d, other in zip(tangents, (b, a), strict=True)
        if not isinstance(d, SymbolicZero)
    ]
    return dot(*primals), jnp.sum(functools.reduce(jnp.add, products), axis=0)


@takes_lists
@functools.partial(jax.custom_jvp, nondiff_argnums=(1,))
def inverse_norm(a: Vector, power: int = 1) -> Scalar:
    """1 / |a|^power.

    **Arguments**

    - `a`: a vector, (3, *runs).
    - `power`: a whole number of one or more.

    **Raises** `InputError` where the first axis does not have three components."""
    check_components("inverse_norm: a", a, 3)
    return inverse_sqrt(dot(a, a), power)


@inverse_norm.defjvp
def _inverse_norm_rule(
    power: int, primals: tuple[Vector], tangents: tuple[Vector]
) -> tuple[Scalar, Scalar]:
    # In one rule, because those of root, quotient and products take several times as many
    # operations along many directions. From the relative change, because in metres a higher power
    # would leave the range of float32.
    (a,) = primals
    (da,) = tangents
    p = inverse_norm(a, power)
    return p, (-power * p) * _relative_change(a, da)


def _relative_change(a: Vector, da: Vector) -> Scalar:
    """Relative change of the length of `a` due to a change `da`: a . da / |a|^2."""
    # As a sum over the axis, as in `dot`, and held, so that reverse mode computes what it spreads
    # over the components once.
    if is_narrow(a):
        # By the direction, because 1 / |a|^2 leaves the range of float32 in products.
        p = inverse_norm(a)
        return p * barrier(jnp.sum((p * a) * da, axis=0))
    return inverse_norm(a, 2) * barrier(jnp.sum(a * da, axis=0))


@takes_lists
@functools.partial(jax.custom_jvp, nondiff_argnums=(2,))
def over_norm(scalar: Scalar, a: Vector, power: int = 1) -> Scalar:
    """scalar / |a|^power, where 1 / |a|^power by itself may leave the range of float32: for the
    distance of Neptune, in metres, it is zero there.

    **Arguments**

    - `scalar`: a number, (*runs,).
    - `a`: a vector, (3, *runs).
    - `power`: a whole number of one or more.

    **Raises** `InputError` where the first axis of `a` does not have three components."""
    p = inverse_norm(a)
    return functools.reduce(jnp.multiply, [p] * power, scalar)


@over_norm.defjvp
def _over_norm_rule(
    power: int, primals: tuple[Scalar, Vector], tangents: tuple[Scalar, Vector]
) -> tuple[Scalar, Scalar]:
    # In one rule, as in `inverse_norm`.
    scalar, a = primals
    d_scalar, da = tangents
    q = over_norm(scalar, a, power)
    bend = (-power * q) * _relative_change(a, da)
    return q, over_norm(d_scalar, a, power) + bend


@takes_lists
@jax.custom_jvp
def scale(scalar: Scalar, a: Vector) -> Vector:
    """Scalar times vector.

    **Arguments**

    - `scalar`: a number, (*runs,).
    - `a`: a vector, (3, *runs).

    **Raises** `InputError` where the first axis of `a` does not have three components."""
    check_components("scale: a", a, 3)
    return scalar * with_rank(a, jnp.ndim(scalar))


@functools.partial(scale.defjvp, symbolic_zeros=True)
def _scale_rule(
    primals: tuple[Scalar, Vector], tangents: tuple[Tangent, Tangent]
) -> tuple[Vector, Vector]:
    scalar, a = primals
    d_scalar, da = tangents
    rank = max(jnp.ndim(scalar), a.ndim - 1)
    parts = []
    if not isinstance(d_scalar, SymbolicZero):
        # Behind a barrier, because the compiler would compute the change of the scalar again for
        # every component.
        parts.append(barrier(d_scalar) * with_rank(a, rank))
    if not isinstance(da, SymbolicZero):
        parts.append(scalar * with_rank(da, rank))
    return scale(scalar, a), functools.reduce(jnp.add, parts)


@takes_lists
def cross(a: Vector, b: Vector) -> Vector:
    """Vector product a x b.

    **Arguments**

    - `a`, `b`: vectors, (3, *runs).

    **Raises** `InputError` where the first axis does not have three components."""
    check_components("cross: a", a, 3)
    check_components("cross: b", b, 3)
    a0, a1, a2 = components(a)
    b0, b1, b2 = components(b)
    return jnp.stack([a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0])


@takes_lists
def components(a: Array) -> list[Scalar]:
    """The components of a vector, (n, *runs), each (*runs,).

    Computed with one split, whose transpose joins the cotangents of reverse mode. That of an index
    would pad each with zeros and add them up (measured: a third of the time of a step)."""
    a = jnp.asarray(a)
    return [jnp.squeeze(x, 0) for x in jax.lax.split(a, (1,) * a.shape[0])]


@takes_lists
@jax.custom_jvp
def norm(a: Vector) -> Scalar:
    """Length |a|; at a = 0 the derivative is zero, the mean of the one-sided ones, and never NaN.

    Raises `InputError` where the first axis does not have three components."""
    check_components("norm: a", a, 3)
    factor = square_factor(*components(a))
    if isinstance(factor, float):
        return sqrt(dot(a, a))
    a = factor * a
    return sqrt(dot(a, a)) / factor


@norm.defjvp
def _norm_rule(primals: tuple[Vector], tangents: tuple[Vector]) -> tuple[Scalar, Scalar]:
    # In one rule, and as a sum over the axis, as in `inverse_norm`.
    (a,) = primals
    (da,) = tangents
    length = norm(a)
    per_length = safe_divide(1.0, length)
    if is_narrow(a):
        # The direction first, because the products of a small vector leave the range.
        return length, jnp.sum((per_length * a) * da, axis=0)
    return length, per_length * jnp.sum(a * da, axis=0)


@takes_lists
@jax.custom_jvp
def unit(a: Vector) -> Vector:
    """Direction a / |a|; the zero vector stays zero.

    Along `a` itself the derivative vanishes up to the rounding of 1/|a|.

    Raises `InputError` where the first axis does not have three components."""
    check_components("unit: a", a, 3)
    return safe_divide(a, norm(a))


@unit.defjvp
def _unit_rule(primals: tuple[Vector], tangents: tuple[Vector]) -> tuple[Vector, Vector]:
    # In one rule, as in `inverse_norm`: the part of the change across the direction.
    (a,) = primals
    (da,) = tangents
    u = unit(a)
    return u, safe_divide(1.0, norm(a)) * (da - jnp.sum(u * da, axis=0) * u)


def identity(rank: int) -> Matrix:
    """The unit matrix with `rank` batch axes, (3, 3, 1, ...), in the precision of its operand.

    **Arguments**

    - `rank`: number of time and batch axes that follow."""
    return with_rank(jnp.where(jnp.eye(3, dtype=bool), 1.0, 0.0), rank, axes=2)


@takes_lists
def matvec(m: Matrix, a: Vector) -> Vector:
    """Matrix times vector, m a; one matrix may meet many vectors.

    **Arguments**

    - `m`: a matrix, (3, 3, *runs).
    - `a`: a vector, (3, *runs).

    **Raises** `InputError` where the leading axes do not have 3 x 3 and three components."""
    check_components("matvec: m", m, 3, axes=2)
    check_components("matvec: a", a, 3)
    m = with_rank(m, a.ndim - 1, axes=2)
    return m[:, 0] * a[0] + m[:, 1] * a[1] + m[:, 2] * a[2]


@takes_lists
def solve3(m: Matrix, b: Vector) -> Vector:
    """The solution x of m x = b for a regular 3 x 3 matrix, by cofactors (Cramer's rule).

    **Arguments**

    - `m`: a matrix, (3, 3, *runs).
    - `b`: a vector, (3, *runs).

    **Raises** `InputError` where the leading axes do not have 3 x 3 and three components."""
    check_components("solve3: m", m, 3, axes=2)
    check_components("solve3: b", b, 3)
    # Written out: `jnp.linalg.solve` calls a library for each matrix and fuses with nothing.
    c0, c1, c2 = m[:, 0], m[:, 1], m[:, 2]
    n0 = cross(c1, c2)
    return jnp.stack([dot(n0, b), dot(cross(c2, c0), b), dot(cross(c0, c1), b)]) / dot(c0, n0)


def axis(index: int, like: Scalar) -> Vector:
    """The unit vector along an axis, (3, *runs).

    **Arguments**

    - `index`: 0, 1 or 2.
    - `like`: a scalar that gives the shape of the runs and the precision.
    """
    like = jnp.asarray(like)
    one = jnp.ones_like(like)
    zero = jnp.zeros_like(like)
    return jnp.stack([one if i == index else zero for i in range(3)])
