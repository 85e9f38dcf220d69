"""Lengths and quotients whose squares would leave the range of single precision.

In float32 the square of a number below 1e-19 is zero, and that of a number above 1e19 infinite,
although the length itself is an ordinary number. A power of two, which rounds nothing, moves the
components into the middle of the range first. In float64 the same happens at 1e-154 and 1e154,
which nothing reaches, and the factor costs nothing: it is left out.
"""

import functools

import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero

from .square_roots import sqrt
from .types import Scalar

_FAR = 2.0**40
_FACTOR = 2.0**80


def is_narrow(*parts: Scalar) -> bool:
    """Whether squares of such numbers may leave the range: in every precision below float64.

    **Arguments**

    - `parts`: numbers, (*runs,)."""
    kind = jnp.result_type(*parts)
    return bool(jnp.issubdtype(kind, jnp.floating)) and jnp.finfo(kind).bits < 64


def square_factor(*parts: Scalar) -> Scalar | float:
    """A factor for numbers whose squares are added: 1, or a power of two where the greatest of them
    is so small or large that its square leaves the range of the precision.

    **Arguments**

    - `parts`: numbers in one unit, (*runs,)."""
    if not is_narrow(*parts):
        return 1.0
    size = functools.reduce(jnp.maximum, map(jnp.abs, parts))
    factor = jnp.where(size < 1.0 / _FAR, _FACTOR, jnp.where(size > _FAR, 1.0 / _FACTOR, 1.0))
    return jax.lax.stop_gradient(factor.astype(size.dtype))


def unit_factor(*parts: Scalar) -> Scalar | float:
    """A factor that brings numbers to the size of one, for formulas with higher powers of them: a
    power of two next to 1 over the greatest one, and 1 in float64.

    **Arguments**

    - `parts`: numbers in one unit, (*runs,)."""
    if not is_narrow(*parts):
        return 1.0
    size = functools.reduce(jnp.maximum, map(jnp.abs, parts))
    per_size = 1.0 / jnp.where((size > 0.0) & jnp.isfinite(size), size, 1.0)
    return jax.lax.stop_gradient(jax.lax.reduce_precision(per_size, 8, mantissa_bits=0))


def root_of_squares(*parts: Scalar) -> Scalar:
    """The root of the sum of the squares, whose derivative at zero is not finite.

    **Arguments**

    - `parts`: numbers in one unit, (*runs,)."""
    factor = square_factor(*parts)
    squares = [jnp.square(factor * part) for part in parts]
    return sqrt(functools.reduce(jnp.add, squares)) / factor


@jax.custom_jvp
def safe_hypot(x: Scalar, y: Scalar) -> Scalar:
    """sqrt(x^2 + y^2); at the origin the derivative is zero, the mean of the one-sided ones.

    **Arguments**

    - `x`, `y`: numbers in one unit, (*runs,)."""
    return root_of_squares(x, y)


@safe_hypot.defjvp
def _safe_hypot_rule(
    primals: tuple[Scalar, Scalar], tangents: tuple[Scalar, Scalar]
) -> tuple[Scalar, Scalar]:
    (x, y), (dx, dy) = primals, tangents
    length = safe_hypot(x, y)
    zero = length == 0.0
    per_length = jnp.where(zero, 0.0, 1.0 / jnp.where(zero, 1.0, length))
    return length, (x * per_length) * dx + (y * per_length) * dy


@jax.custom_jvp
def difference_of_squares(x: Scalar, y: Scalar) -> Scalar:
    """x^2 - y^2 by its factors, which is accurate for nearly equal numbers. Its derivatives are 2 x
    and -2 y: those of the factors would cancel where one number is small.

    **Arguments**

    - `x`, `y`: numbers in one unit, (*runs,)."""
    return (x - y) * (x + y)


@difference_of_squares.defjvp
def _difference_of_squares_rule(
    primals: tuple[Scalar, Scalar], tangents: tuple[Scalar, Scalar]
) -> tuple[Scalar, Scalar]:
    (x, y), (dx, dy) = primals, tangents
    return difference_of_squares(x, y), 2.0 * (x * dx - y * dy)


@jax.custom_jvp
def power(x: Scalar, y: Scalar) -> Scalar:
    """x^y of a quantity of any size above zero.

    JAX's rule contains x^(y - 1), which leaves the range of float32 although its product with the
    change of x does not. This one uses the power itself.

    **Arguments**

    - `x`, `y`: numbers, (*runs,)."""
    return jnp.power(x, y)


@functools.partial(power.defjvp, symbolic_zeros=True)
def _power_rule(
    primals: tuple[Scalar, Scalar], tangents: tuple[Scalar | SymbolicZero, Scalar | SymbolicZero]
) -> tuple[Scalar, Scalar]:
    (x, y), (dx, dy) = primals, tangents
    p = power(x, y)
    parts = [] if isinstance(dx, SymbolicZero) else [y * quotient(dx, x)]
    parts += [] if isinstance(dy, SymbolicZero) else [jnp.log(x) * dy]
    return p, p * functools.reduce(jnp.add, parts)


@jax.custom_jvp
def quotient(a: Scalar, b: Scalar) -> Scalar:
    """Quotient a / b of quantities of any size, such as the gravitational parameter of the sun.

    JAX's rule for a / b squares b, which leaves the range of float32 above 1.8e19 and below 1e-19:
    the derivative is then zero or infinite. This one uses the quotient itself.

    **Arguments**

    - `a`, `b`: numbers, (*runs,)."""
    return a / b


@functools.partial(quotient.defjvp, symbolic_zeros=True)
def _quotient_rule(
    primals: tuple[Scalar, Scalar], tangents: tuple[Scalar | SymbolicZero, Scalar | SymbolicZero]
) -> tuple[Scalar, Scalar]:
    (a, b), (da, db) = primals, tangents
    q = quotient(a, b)
    parts = [] if isinstance(da, SymbolicZero) else [da]
    parts += [] if isinstance(db, SymbolicZero) else [-q * db]
    return q, quotient(functools.reduce(jnp.add, parts), b)
