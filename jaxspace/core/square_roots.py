"""Square roots and their reciprocals, in the forms that each processor computes fast.

The compiler turns `a / jnp.sqrt(x)` into `a * rsqrt(x)`. In double precision a processor without
AVX-512 has no instruction for it, and the code emitted by the compiler takes four times as long as
a root and a division; with AVX-512 the instruction takes half as long. These are new primitives,
because the form is chosen when a program is lowered to its device.
"""

__all__ = ["inverse_sqrt", "sqrt"]

import functools
import os
import re
from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.core import ShapedArray
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir
from jaxtyping import Array

from ._lists import takes_lists
from .types import Scalar

sqrt_p = Primitive("square_root")
inverse_sqrt_p = Primitive("inverse_sqrt")


@takes_lists
def sqrt(x: Scalar) -> Scalar:
    """The square root, which may also be divided by; NaN of a negative number.

    Its derivative is that of `jnp.sqrt`, infinite at zero: `core.safe` has a root without that.

    **Arguments**

    - `x`: numbers that are not negative."""
    return sqrt_p.bind(_number(x))


@takes_lists
def inverse_sqrt(x: Scalar, power: int = 1) -> Scalar:
    """1 / sqrt(x)^power.

    **Arguments**

    - `x`: positive numbers. Zero gives infinity, infinity zero and a negative number NaN; the
      derivative at zero is minus infinity, as that of 1 / sqrt(x).
    - `power`: a whole number of one or more.

    **Returns** the power. Computed with a root and a division, as on a CPU without AVX-512 in
    float64, its error is at most 1.5 units in the last place, and 3 `power` - 1 for a higher power;
    with the instruction of the processor 4 `power` - 2 units."""
    return inverse_sqrt_p.bind(_number(x), power=power)


def _number(x: Scalar) -> Array:
    x = jnp.asarray(x)
    return x if jnp.issubdtype(x.dtype, jnp.inexact) else x.astype(float)


@functools.cache
def has_instruction() -> bool:
    """Whether the processor has AVX-512, and it is not disabled in the compiler."""
    allowed = re.search(r"xla_cpu_max_isa=(\w+)", os.environ.get("XLA_FLAGS", ""))
    if allowed and allowed[1].upper() in ("SSE4_2", "AVX", "AVX2"):
        return False
    sets = np.show_config(mode="dicts").get("SIMD Extensions", {})
    names = [*sets.get("baseline", ()), *sets.get("found", ())]
    # The newer name of NumPy and the older one.
    return any(name == "X86_V4" or name.startswith("AVX512") for name in names)


def _is_slow(x: Array) -> bool:
    # In single precision every processor has the instruction.
    return x.dtype == jnp.float64 and not has_instruction()


def _hidden_root(x: Array) -> Array:
    root = jnp.sqrt(x)
    # The absolute value hides a quotient by the root from the compiler, and costs nothing extra.
    return jnp.abs(root) if _is_slow(x) else root


def _by_division(x: Array, *, power: int) -> Array:
    if not _is_slow(x):
        return _by_instruction(x, power=power)
    return _to_power(1.0 / _hidden_root(x), power)


def _by_instruction(x: Array, *, power: int) -> Array:
    return _to_power(lax.rsqrt(x), power)


def _to_power(p: Array, power: int) -> Array:
    # From one reciprocal root for every power, because the compiler then computes it once.
    square = p * p
    return functools.reduce(jnp.multiply, [square] * (power // 2) + [p] * (power % 2))


def _sqrt_tangent(
    primals: Sequence[Array], tangents: Sequence[Array | ad.Zero]
) -> tuple[Array, Array | ad.Zero]:
    (x,) = primals
    (dx,) = tangents
    root = sqrt_p.bind(x)
    if isinstance(dx, ad.Zero):
        return root, _no_tangent(root)
    return root, 0.5 * inverse_sqrt_p.bind(x, power=1) * dx


def _inverse_sqrt_tangent(
    primals: Sequence[Array], tangents: Sequence[Array | ad.Zero], *, power: int
) -> tuple[Array, Array | ad.Zero]:
    (x,) = primals
    (dx,) = tangents
    p = inverse_sqrt_p.bind(x, power=power)
    if isinstance(dx, ad.Zero):
        return p, _no_tangent(p)
    # From the relative change, because a higher power would leave the range of float32.
    return p, (-0.5 * power * p) * (inverse_sqrt_p.bind(x, power=2) * dx)


def _no_tangent(x: Array) -> ad.Zero:
    # The stub of the module does not have it.
    return ad.Zero.from_primal_value(x)  # pyright: ignore[reportAttributeAccessIssue]


def _shape(x: ShapedArray, **params: object) -> ShapedArray:
    del params
    return x


def _register(
    primitive: Primitive,
    tangent: Callable[..., object],
    on_cpu: Callable[..., Array],
    elsewhere: Callable[..., Array],
) -> None:
    """Give a primitive its rules, with one form for CPUs and one for other devices."""
    program = functools.partial(jax.jit, static_argnames="power")(primitive.bind)

    def alone(x: Array, **params: int) -> Array:
        # `jax.disable_jit` affects functions, not single operations: without a program this
        # one would call itself.
        with jax.disable_jit(False):
            return program(x, **params)

    primitive.def_impl(alone)
    primitive.def_abstract_eval(_shape)
    ad.primitive_jvps[primitive] = tangent
    batching.defvectorized(primitive)
    mlir.register_lowering(primitive, mlir.lower_fun(elsewhere, multiple_results=False))
    mlir.register_lowering(
        primitive, mlir.lower_fun(on_cpu, multiple_results=False), platform="cpu"
    )


_register(sqrt_p, _sqrt_tangent, _hidden_root, jnp.sqrt)
_register(inverse_sqrt_p, _inverse_sqrt_tangent, _by_division, _by_instruction)
