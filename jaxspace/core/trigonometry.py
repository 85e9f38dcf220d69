"""Sine and cosine, and the angle of a point, of many numbers at a time.

    x = n pi/2 + r, |r| <= pi/4                  sin r = r + r^3 S(r^2)
                                                 cos r = 1 - r^2/2 + r^4 C(r^2)
    t = min(|x|, |y|) / max(|x|, |y|)            atan t = t + t^3 A(t^2)
    t > tan(pi/8): (t - 1) / (t + 1) and pi/4

In double precision XLA calls the mathematical library of a CPU for one number after the other.
These polynomials, vectorised, take a tenth of that time, with errors of at most two units in the
last place. In single precision XLA has vectors itself, and is asked.

Source: the reductions are those of Cody and Waite (1980), Software Manual for the Elementary
Functions; the polynomials interpolate at Chebyshev's places, with errors below 3e-17 of the result.
"""

import jax
import jax.numpy as jnp

from .barrier import computed_once
from .squares import square_factor
from .types import Scalar

_QUARTER = (float.fromhex("0x1.921fb544p0"), float.fromhex("0x1.0b4611a6p-34"))
# Each of the first two has 33 bits: times a whole number below 2^20 it is exact.
_QUARTER_REST = float.fromhex("0x1.3198a2e037073p-69")
_PER_QUARTER = 0.6366197723675814
_SINE = (
    *(-0.16666666666666666, 0.008333333333330936, -0.00019841269836740532),
    *(2.7557316093198404e-06, -2.5051129896450185e-08, 1.5917988979397435e-10),
)
_COSINE = (
    *(0.041666666666666664, -0.0013888888888887389, 2.48015872987544e-05),
    *(-2.755731726587808e-07, 2.087614504941318e-09, -1.138254464534925e-11),
)
_ARCTANGENT = (
    *(-0.3333333333333333, 0.199999999999998, -0.14285714285659326, 0.11111111105106705),
    *(-0.09090908751076636, 0.0769229630497447, -0.06666423628069258, 0.058789145444006215),
    *(-0.052303478730160745, 0.04551108126325172, -0.034558092551413795, 0.01627194475162406),
)
_TANGENT = 0.41421356237309503  # of pi/8


def _polynomial(coefficients: tuple[float, ...], x: Scalar) -> Scalar:
    total = jnp.full_like(x, coefficients[-1])
    for c in coefficients[-2::-1]:
        total = total * x + c
    return total


@jax.custom_jvp
def sincos(x: Scalar) -> tuple[Scalar, Scalar]:
    """Sine and cosine of `x`, rad: beyond 1e6 rad to a rounding of `x`."""
    return _sincos(jnp.asarray(x))


@computed_once
def sincos_once(x: Scalar) -> tuple[Scalar, Scalar]:
    """`sincos`, where several components of a result read both."""
    return sincos(x)


@jax.jit
def _sincos(x: Scalar) -> tuple[Scalar, Scalar]:
    if x.dtype != jnp.float64:
        return jnp.sin(x), jnp.cos(x)
    n = jnp.round(x * _PER_QUARTER)
    # The greatest part first: the digits cancel while the products are still exact.
    r = ((x - n * _QUARTER[0]) - n * _QUARTER[1]) - n * _QUARTER_REST
    z = r * r
    s = r + r * z * _polynomial(_SINE, z)
    half = 0.5 * z
    near = 1.0 - half
    # Plus the rounding error of 1 - half, which is up to half a unit in the last place.
    c = near + (((1.0 - near) - half) + z * z * _polynomial(_COSINE, z))
    quarter = n - 4.0 * jnp.floor(0.25 * n)
    odd = (quarter == 1.0) | (quarter == 3.0)
    sine, cosine = jnp.where(odd, c, s), jnp.where(odd, s, c)
    return (
        jnp.where(quarter >= 2.0, -sine, sine),
        jnp.where((quarter == 1.0) | (quarter == 2.0), -cosine, cosine),
    )


@sincos.defjvp
def _sincos_rule(primals, tangents):
    s, c = sincos(*primals)
    return (s, c), (c * tangents[0], -s * tangents[0])


@jax.custom_jvp
def atan2(y: Scalar, x: Scalar) -> Scalar:
    """The angle of the point (x, y) from the x axis, rad, within [-pi, pi]; of finite numbers."""
    return _atan2(*jnp.broadcast_arrays(y, x))


@jax.jit
def _atan2(y: Scalar, x: Scalar) -> Scalar:
    if jnp.result_type(y, x) != jnp.float64:
        return jnp.arctan2(y, x)
    ax, ay = jnp.abs(x), jnp.abs(y)
    least, most = jnp.minimum(ax, ay), jnp.maximum(ax, ay)
    far = least > _TANGENT * most
    over = jnp.where(far, least + most, most)
    # One in place of zero at the origin, whose angle then is zero as that of `arctan2`.
    t = jnp.where(far, least - most, least) / jnp.where(over == 0.0, 1.0, over)
    z = t * t
    # Each multiple of pi/4 with what its rounding leaves out.
    angle = jnp.where(far, 0.7853981633974483, 0.0) + (
        t + (t * z * _polynomial(_ARCTANGENT, z) + jnp.where(far, 3.061616997868383e-17, 0.0))
    )
    angle = jnp.where(ay > ax, 1.5707963267948966 - (angle - 6.123233995736766e-17), angle)
    angle = jnp.where(x < 0.0, 3.141592653589793 - (angle - 1.2246467991473532e-16), angle)
    # By the sign bit, because the angle of (-1, -0) is -pi and not pi.
    return jnp.where(jnp.signbit(y), -angle, angle)


@atan2.defjvp
def _atan2_rule(primals, tangents):
    (y, x), (dy, dx) = primals, tangents
    factor = square_factor(y, x)
    y1, x1 = factor * y, factor * x
    square = x1 * x1 + y1 * y1
    return atan2(y, x), (factor * (x1 / square)) * dy - (factor * (y1 / square)) * dx
