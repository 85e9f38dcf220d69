"""Jacobi's elliptic functions and the third integral, written without a modulus.

    S' = c d,  c' = -x S d,  d' = -y S c          S(0) = 0,  c(0) = d(0) = 1
    c^2 = 1 - x S^2,   d^2 = 1 - y S^2,   x, y >= 0
    third(t) = rho int_0^t M S^2 / p dt
             = rho M S^3/3 R_J(c^2, d^2, 1, p),    p = 1 + M S^2,  rho^2 M = (M + x)(M + y)

For x > y: S = sn(Nt)/N, c = cn, d = dn, with N^2 = x and k^2 = y/x; for x < y the two change
places. All are analytic in t, x and y, also where one or both vanish (circular functions, S = t)
and where they are equal (hyperbolic functions).

    N^2 = max(x, y),   k'^2 = |x - y|/N^2,   m = min(k^2, k'^2),   m' = 1 - m
    l = (1 - m'^(1/4))/(1 + m'^(1/4))/2
    q = l + 2 l^5 + 15 l^9 + 150 l^13 + ...      nome of m; q < 0.0433, so that four terms of a
                                                 theta series are exact
    K = pi/2 theta_3(q)^2 for m = k^2,   K = ln(1/q)/2 theta_3(q)^2 for m = k'^2

    symbol       meaning                                            unit
    t            time                                               s
    x, y         parameters                                         1/s^2
    N            argument of sn, cn, dn per second                  1/s
    k, k'        modulus and its complement                         1
    q            nome of k or, where k^2 > 1/2, of k'               1
    K            quarter period, in the argument                    1
    M            pole of the third integral                         1/s^2
    rho          its rate                                           rad/s

Source: Abramowitz and Stegun 16.27, 16.38, 17.3 (theta series, imaginary transformation, nome);
16.22 (series in t); DLMF 22.6.5 (doubled argument), 19.25.14, 19.26.18 (R_J); Carlson (1995),
Numer. Algorithms 10, 13 (duplication). A step of the duplication adds an arc tangent, because
rho^2 M = (M + x)(M + y). The difference x - y is a separate argument: it is decisive near the
separatrix, and must not be computed from x and y.
"""

__all__ = ["Jacobi", "jacobi", "third"]

import functools
import math
from typing import NamedTuple

import jax
import jax.numpy as jnp

from ._lists import takes_lists
from .barrier import barrier
from .printing import printed
from .square_roots import sqrt
from .types import Scalar

# A step takes the root of c d where both are small: three steps bring 1e-4 to order one, and six
# from there leave terms of order six below rounding. Six more bring 1e-150 to 1e-4.
_DUPLICATIONS = 9
_MORE_DUPLICATIONS = 6
_SMALL = 1e-4
# The quotient sn(Nt)/N loses a factor 3/(N^2 t^2) of the digits of its derivatives: the series in
# t^2 is used up to this N^2 t^2, with its argument halved so often that six terms suffice.
_SHORT = 0.2
_DOUBLINGS = 3


@printed(time="s")
class Jacobi(NamedTuple):
    """S, s, and c, d of a `time`, s, within a quarter period, reached from t by taking off
    `half_periods` times 2K/N."""

    s: Scalar
    c: Scalar
    d: Scalar
    time: Scalar
    half_periods: Scalar
    quarter: Scalar
    "K/N, s; 1 where the motion never returns."


@takes_lists
def jacobi(t: Scalar, x: Scalar, y: Scalar, difference: Scalar) -> Jacobi:
    """S, c and d of a time.

    **Arguments**

    - `t`: time, s.
    - `x`, `y`: parameters, 1/s^2, not negative.
    - `difference`: x - y, 1/s^2.

    **Returns** them within a quarter period, with the subtracted multiples.
    """
    swapped = difference < 0.0
    top, low = jnp.where(swapped, y, x), jnp.where(swapped, x, y)
    # Below it the next term of the series, of order six in top t^2, is under rounding.
    short = top * t * t < _SHORT
    still = top == 0.0
    top = jnp.where(still, 1.0, top)
    n = sqrt(top)
    complement = jnp.where(still, 1.0, jnp.where(swapped, -difference, difference) / top)
    # Beyond k^2 = 1/2 the nome of k' is the smaller one, and its series the shorter.
    hyperbolic = complement < 0.5
    q = _nome(
        jnp.where(hyperbolic, complement, low / top), jnp.where(hyperbolic, low / top, complement)
    )
    # Below it the nome is that of the separatrix: c and d of 1e-152 are the end of the range.
    least = 2.0**10 * float(jnp.finfo(q.dtype).tiny)
    # Barriers cut the graph into parts that the compiler fuses each: the whole compiles slowly.
    q, n, complement = barrier((q, n, complement), everywhere=True)
    scale = (1.0 + 2.0 * q * (1.0 + q**3 * (1.0 + q**5))) ** 2
    log_q = jnp.log(jnp.where(q > least, q, least))
    quarter = scale * jnp.where(hyperbolic, -0.5 * log_q, 0.5 * math.pi) / n
    returns = ~(hyperbolic & (q <= least)) & ~still
    half_periods = jnp.where(returns, jnp.round(t / (2.0 * quarter)), 0.0)
    # The factor zero alone would not do: close to the separatrix the derivative of the quarter
    # period leaves the range of numbers.
    quarter = jnp.where(half_periods == 0.0, 1.0, quarter)
    time = t - 2.0 * quarter * half_periods
    argument = n * time / scale
    argument, time = barrier((argument, time), everywhere=True)
    # Each branch gets the argument zero where the other applies, so that its derivative is finite.
    circular = _circular(jnp.where(hyperbolic, 0.0, argument), q)
    exponential = _hyperbolic(jnp.where(hyperbolic, argument, 0.0), q, -0.5 * math.log(least))
    sn, cn, dn = (jnp.where(hyperbolic, b, a) for a, b in zip(circular, exponential, strict=True))
    near = _series(jnp.where(short, time, 0.0), x, y)
    c, d = jnp.where(swapped, dn, cn), jnp.where(swapped, cn, dn)
    s, c, d = (jnp.where(short, a, b) for a, b in zip(near, (sn / n, c, d), strict=True))
    return Jacobi(s, c, d, time, half_periods, quarter)


@takes_lists
def third(s: Scalar, c: Scalar, d: Scalar, p: Scalar, weight: Scalar) -> Scalar:
    """The third integral, rad, within a quarter period.

    **Arguments**

    - `s`, `c`, `d`: S, c and d there.
    - `p`: 1 + M S^2 there, 1; positive. Where it vanishes, M near -x, the caller forms it as the
      sum c^2 + (M + x) S^2.
    - `weight`: rho M, 1/s^3.

    **Returns** the integral; best conditioned for |M| <= sqrt(xy).
    """
    size = weight * s**3

    def duplicated(carry: tuple[Scalar, ...], _: None) -> tuple[tuple[Scalar, ...], None]:
        x, y, z, p, a, b, e, total, two, eighth = carry
        r = jnp.sqrt(p)
        total = total + two * jnp.arctan(eighth * size / ((r + a) * (r + b) * (r + e)))
        shift = a * b + b * e + e * a
        x, y, z, p = (0.25 * (v + shift) for v in (x, y, z, p))
        roots = jnp.sqrt(x), jnp.sqrt(y), jnp.sqrt(z)
        return (x, y, z, p, *roots, total, 2.0 * two, 0.125 * eighth), None

    # A scan and not an unrolled loop, so that the body of a step is compiled once.
    def repeated(times: int, carry: tuple[Scalar, ...]) -> tuple[Scalar, ...]:
        return jax.lax.scan(duplicated, carry, None, length=times)[0]

    one = jnp.ones_like(p)
    carry = (c * c, d * d, one, p, c, d, one, 0.0 * one, jnp.asarray(2.0, p.dtype))
    carry = (*carry, jnp.asarray(1.0, p.dtype))
    small = (jnp.maximum(c, d) < _SMALL) | (p < _SMALL * _SMALL)
    more = functools.partial(repeated, _MORE_DUPLICATIONS)
    # For all runs if one of them needs it: a choice for each run computes both branches.
    carry = jax.lax.cond(jnp.any(small), more, lambda carry: carry, carry)
    x, y, z, p, *_, total, two, _ = repeated(_DUPLICATIONS, carry)
    # Carlson's series of the fifth order in the relative differences of the arguments.
    mean = (x + y + z + 2.0 * p) / 5.0
    x, y, z = (1.0 - v / mean for v in (x, y, z))
    p = -0.5 * (x + y + z)
    e2 = x * y + x * z + y * z - 3.0 * p * p
    e3 = x * y * z + 2.0 * e2 * p + 4.0 * p**3
    e4 = (2.0 * x * y * z + e2 * p + 3.0 * p**3) * p
    e5 = x * y * z * p * p
    rest = (
        1.0
        - 3.0 * e2 / 14.0
        + e3 / 6.0
        + 9.0 * e2 * e2 / 88.0
        - 3.0 * e4 / 22.0
        - 9.0 * e2 * e3 / 52.0
        + 3.0 * e5 / 26.0
    )
    # Each step has quartered the sum.
    return total + (2.0 / two) ** 2 / 3.0 * size * rest / (mean * jnp.sqrt(mean))


def _nome(m: Scalar, rest: Scalar) -> Scalar:
    """q of the squared modulus m <= 1/2, of which 1 - m is the `rest`."""
    root = jnp.sqrt(rest)
    near = 0.5 * m / ((1.0 + root) * (1.0 + jnp.sqrt(root)) ** 2)
    z = near**4
    return near * (1.0 + z * (2.0 + z * (15.0 + 150.0 * z)))


def _constants(q: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    """theta_2 / (2 q^(1/4)), theta_3 and theta_4 at zero."""
    even, odd = 2.0 * q**4, 2.0 * q * (1.0 + q**8)
    return 1.0 + q**2 * (1.0 + q**4), 1.0 + odd + even, 1.0 - odd + even


def _circular(z: Scalar, q: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    """sn, cn, dn at the argument theta_3^2 z, from the nome of k."""
    t2, t3, t4 = _constants(q)
    s1, c1 = jnp.sin(z), jnp.cos(z)
    w = 2.0 - 4.0 * s1 * s1
    s3, c3 = s1 * (w + 1.0), c1 * (w - 1.0)
    sine = s1 - q**2 * (s3 - q**4 * (w * s3 - s1))
    cosine = c1 + q**2 * (c3 + q**4 * (w * c3 - c1))
    odd, even = q * w * (1.0 + q**8 * (w * w - 3.0)), q**4 * (w * w - 2.0)
    below = 1.0 - odd + even
    return t3 / t2 * sine / below, t4 / t2 * cosine / below, t4 / t3 * (1.0 + odd + even) / below


def _hyperbolic(v: Scalar, q: Scalar, most: float) -> tuple[Scalar, Scalar, Scalar]:
    """sn, cn, dn at the argument theta_3^2 v, from the nome of k'; the sums are divided by their
    growth e^|v|."""
    t2, t3, t4 = _constants(q)
    sign = jnp.where(v < 0.0, -1.0, 1.0).astype(v.dtype)
    size = jnp.minimum(sign * v, most)
    falling = jnp.exp(-size)
    # The square of sqrt(q) e^|v|: q and e^(2|v|) alone have derivatives out of range.
    regular = q > math.exp(-2.0 * most)
    root = jnp.where(regular, jnp.sqrt(jnp.where(regular, q, 1.0)), 0.0)
    rising = (root * jnp.exp(size)) ** 2
    # The first term of the series divided by their growth. The root has no derivative on the
    # separatrix, where the product has.
    first = jnp.where(regular, rising * falling, q * jnp.exp(size))
    e = falling * falling
    f = q * e

    def sums(i: int) -> tuple[Scalar, Scalar]:
        return rising**i + f**i, rising**i + (f**i) * e

    _, b1 = sums(1)
    a2, b2 = sums(2)
    a3, b3 = sums(3)
    # `expm1`, because the sine vanishes with its argument and must be accurate there.
    sine = -jnp.expm1(-2.0 * size) - q * (
        (b1 - 2.0 * f * e) - q**3 * (b2 - 2.0 * f**2 * e) + q**8 * (b3 - 2.0 * f**3 * e)
    )
    below = 1.0 + e + q * (b1 + q**3 * (b2 + q**5 * b3))
    odd = f + q**6 * a3
    even = q**2 * a2
    factor = 2.0 * t2 / below
    return (
        sign * t3 / t4 * sine / below,
        factor / t4 * (falling * (1.0 - odd + even) - first),
        factor / t3 * (falling * (1.0 + odd + even) + first),
    )


def _series(t: Scalar, x: Scalar, y: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    """S, c, d for short times: the series of S in an eighth of the time, doubled three times. There
    sn(Nt)/N has the right value, but a derivative without digits."""
    t = t / 2**_DOUBLINGS
    a, b = (x + y) * t * t, x * y * t**4
    s9 = (a**4 + 1224.0 * a * a * b + 3024.0 * b * b) / 362880.0
    s11 = a * (a**4 + 11064.0 * a * a * b + 132624.0 * b * b) / 39916800.0
    s7 = (a**3 + 132.0 * a * b) / 5040.0
    s = t * (1.0 - a / 6.0 + (a * a + 12.0 * b) / 120.0 - s7 + s9 - s11)
    for _ in range(_DOUBLINGS):
        # From S alone, because a doubling of c and d would double their roundings.
        xs, ys = x * s * s, y * s * s
        s = 2.0 * s * jnp.sqrt((1.0 - xs) * (1.0 - ys)) / (1.0 - xs * ys)
    return s, jnp.sqrt(1.0 - x * s * s), jnp.sqrt(1.0 - y * s * s)
