"""The reciprocal of a square root, in the form that each processor computes fast.

The compiler turns `a / sqrt(x)` into `a * rsqrt(x)`. In double precision a processor without
AVX-512 has no instruction for it, and what the compiler writes in its place takes four times as
long as a root and a division. It is a new primitive, because the form is chosen when a program is
lowered to its device.
"""

__all__ = ["inverse_sqrt"]

from collections.abc import Sequence
from functools import partial, reduce

import jax
import jax.numpy as jnp
from jax import lax
from jax.core import ShapedArray
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir
from jaxtyping import Array

from .types import Scalar

inverse_sqrt_p = Primitive("inverse_sqrt")


def inverse_sqrt(x: Scalar, power: int = 1) -> Scalar:
    """1 / sqrt(x)^power.

    **Arguments**

    - `x`: positive numbers. Zero gives infinity, infinity zero and a negative number NaN; the
      derivative at zero is minus infinity, as that of 1 / sqrt(x).
    - `power`: a whole number of one or more.

    **Returns** the power. On a CPU in float64 its error is at most 1.5 units in the last place, and
    3 `power` - 1 of a higher power."""
    x = jnp.asarray(x)
    if not jnp.issubdtype(x.dtype, jnp.inexact):
        x = x.astype(float)
    return inverse_sqrt_p.bind(x, power=power)


def _to_power(p: Array, power: int) -> Array:
    square = p * p
    return reduce(jnp.multiply, [square] * (power // 2) + [p] * (power % 2))


def _by_instruction(x: Array, *, power: int) -> Array:
    return _to_power(lax.rsqrt(x), power)


def _by_division(x: Array, *, power: int) -> Array:
    # Every processor has an instruction for single precision.
    if x.dtype != jnp.float64:
        return _by_instruction(x, power=power)
    # The absolute value hides the quotient from the compiler, and is free beside the root.
    # From one quotient for every power, because the compiler then computes it once.
    return _to_power(1.0 / jnp.abs(jnp.sqrt(x)), power)


@partial(jax.jit, static_argnames="power")
def _alone(x: Array, *, power: int) -> Array:
    return inverse_sqrt_p.bind(x, power=power)


def _shape(x: ShapedArray, *, power: int) -> ShapedArray:
    del power
    return x


def _tangent(
    primals: Sequence[Array], tangents: Sequence[Array | ad.Zero], *, power: int
) -> tuple[Array, Array | ad.Zero]:
    (x,) = primals
    (dx,) = tangents
    p = inverse_sqrt_p.bind(x, power=power)
    if isinstance(dx, ad.Zero):
        return p, ad.Zero.from_primal_value(p)
    # From the relative change, because a higher power would leave the range of float32.
    return p, (-0.5 * power * p) * (inverse_sqrt_p.bind(x, power=2) * dx)


inverse_sqrt_p.def_impl(_alone)
inverse_sqrt_p.def_abstract_eval(_shape)
ad.primitive_jvps[inverse_sqrt_p] = _tangent
batching.defvectorized(inverse_sqrt_p)
mlir.register_lowering(inverse_sqrt_p, mlir.lower_fun(_by_instruction, multiple_results=False))
mlir.register_lowering(
    inverse_sqrt_p, mlir.lower_fun(_by_division, multiple_results=False), platform="cpu"
)
