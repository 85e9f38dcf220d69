"""Functions without NaN: values and derivatives are finite on both sides of every `where`.

JAX also differentiates the branch that a `where` does not select, and zero times infinity is NaN.
That branch therefore gets a harmless argument. A removable singularity gets its series where the
closed form has lost digits.

**Endpoint derivative convention.** Where a quantity ends in a square root (it exists, or differs
from zero, on one side only), its slope there is infinite: `end_sqrt` reports plus or minus inf in
both modes of differentiation along directions that change the radicand, and zero along the others.
`safe_sqrt` is for lengths and for roots whose infinite slope a vanishing factor cancels: its slope
at the end is zero. Where a value is itself infinite (a period on a separatrix), its derivatives are
zero: from there no step leads to a finite one."""

__all__ = [
    "end_sqrt",
    "phi1",
    "phi2",
    "safe_atan2",
    "safe_divide",
    "safe_sqrt",
    "sinc_squared",
    "times_slope",
]

from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp

from ._lists import takes_lists
from .square_roots import inverse_sqrt, sqrt
from .trigonometry import atan2
from .types import Scalar


@takes_lists
@jax.custom_jvp
def safe_sqrt(x: Scalar) -> Scalar:
    """Square root, with derivative zero instead of infinity at x = 0; NaN for negative x."""
    return sqrt(x)


@safe_sqrt.defjvp
def _safe_sqrt_rule(primals: tuple[Scalar], tangents: tuple[Scalar]) -> tuple[Scalar, Scalar]:
    (x,) = primals
    (dx,) = tangents
    zero = x == 0.0
    # Its own root, so that a second derivative is zero there as well.
    return safe_sqrt(x), jnp.where(zero, 0.0, 0.5 * inverse_sqrt(jnp.where(zero, 1.0, x))) * dx


@takes_lists
def times_slope(slope: Scalar, tangent: Scalar) -> Scalar:
    """slope * tangent for derivative rules, where an infinite slope times zero is zero.

    Linear in `tangent`, as both modes need it: infinity is applied as two finite factors.

    **Arguments**

    - `slope`: a derivative, which may be infinite.
    - `tangent`: the factor."""
    greatest = float(jnp.finfo(slope.dtype).max)
    endless = jnp.isinf(slope)
    first = jnp.where(endless, jnp.copysign(greatest, slope), slope)
    return (tangent * first) * jnp.where(endless, greatest, 1.0)


@takes_lists
@partial(jax.custom_jvp, nondiff_argnums=(0,))
def end_sqrt(radicand: Callable[..., Scalar], *args: Scalar) -> Scalar:
    """sqrt(radicand(*args)) at the end of a range; NaN for a negative radicand.

    **Arguments**

    - `radicand`: acts elementwise on the runs.
    - `args`: arrays of runs, or one number for all.

    **Returns** the root. Its derivative at zero is inf times the sign of the radicand's along each
    of the `args`, and zero where that is zero.
    """
    return sqrt(radicand(*args))


@end_sqrt.defjvp
def _end_sqrt_tangent(radicand, args, tangents):
    x = radicand(*args)
    end = x == 0.0
    root = sqrt(jnp.where(end, 1.0, x))
    total = jnp.zeros_like(root)
    for i, tangent in enumerate(tangents):
        # One argument at a time, because each slope has its own sign.
        def radicand_of(a, i=i):
            return radicand(*args[:i], a, *args[i + 1 :])

        _, partial_i = jax.jvp(radicand_of, (args[i],), (jnp.ones_like(args[i]),))
        endless = jnp.where(partial_i == 0.0, 0.0, jnp.copysign(jnp.inf, partial_i))
        total = total + times_slope(jnp.where(end, endless, 0.5 * partial_i / root), tangent)
    return jnp.where(end, 0.0, sqrt(x)), total


@takes_lists
@jax.custom_jvp
def safe_divide(a: Scalar, b: Scalar) -> Scalar:
    """Quotient a / b, with 0 where b = 0.

    **Arguments**

    - `a`, `b`: numbers, (*runs,)."""
    zero = b == 0.0
    return jnp.where(zero, 0.0, a / jnp.where(zero, 1.0, b))


@safe_divide.defjvp
def _safe_divide_rule(
    primals: tuple[Scalar, Scalar], tangents: tuple[Scalar, Scalar]
) -> tuple[Scalar, Scalar]:
    # By the quotient itself, because the square of a small divisor leaves the range of float32.
    (a, b), (da, db) = primals, tangents
    q = safe_divide(a, b)
    return q, safe_divide(1.0, b) * (da - q * db)


@takes_lists
def safe_atan2(y: Scalar, x: Scalar) -> Scalar:
    """Angle of the point (x, y), rad; value and derivative are zero at the origin, where the angle
    is undefined.

    **Arguments**

    - `y`, `x`: coordinates in one unit, (*runs,)."""
    origin = (x == 0.0) & (y == 0.0)
    return jnp.where(origin, 0.0, atan2(y, jnp.where(origin, 1.0, x)))


@takes_lists
def phi1(x: Scalar) -> Scalar:
    """(e^x - 1) / x, with its series about x = 0, so that every derivative is valid there, too."""
    # The derivative of the quotient loses 1/x of a rounding.
    small = jnp.abs(x) < 0.5
    s = jnp.where(small, x, 0.0)
    series = 1.0
    # 0.5^15 / 16! is below rounding, also for the first derivatives.
    for n in range(15, 1, -1):
        series = 1.0 + s / n * series
    return jnp.where(small, series, jnp.expm1(x) / jnp.where(small, 1.0, x))


@takes_lists
def phi2(x: Scalar) -> Scalar:
    """(e^x - 1 - x) / x^2, with a series about x = 0, as `phi1`."""
    # Farther out than in `phi1`: beyond it two differences are taken, each of which costs digits.
    small = jnp.abs(x) < 1.0
    s = jnp.where(small, x, 0.0)
    series = 1.0
    # 2 / 20! is below rounding, also for the first derivatives.
    for n in range(20, 2, -1):
        series = 1.0 + s / n * series
    far = jnp.where(small, 1.0, x)
    return jnp.where(small, 0.5 * series, (jnp.expm1(far) / far - 1.0) / far)


@takes_lists
def sinc_squared(z: Scalar) -> Scalar:
    """sin(sqrt(z)) / sqrt(z), analytic in z: hyperbolic for z < 0, a series near z = 0."""
    small = jnp.abs(z) < 0.1
    s = jnp.where(small, z, 0.0)
    # Each root gets one in place of the numbers for which it is NaN.
    p = jnp.where(z < 0.1, 1.0, z)
    n = jnp.where(z > -0.1, 1.0, -z)
    series = 1.0
    # 0.1^9 / 19! is below rounding, also for the first derivatives.
    for k in range(8, 0, -1):
        series = 1.0 - s / (2 * k * (2 * k + 1)) * series
    circular = jnp.sin(jnp.sqrt(p)) * inverse_sqrt(p)
    hyperbolic = jnp.sinh(jnp.sqrt(n)) * inverse_sqrt(n)
    return jnp.where(small, series, jnp.where(z > 0.0, circular, hyperbolic))
