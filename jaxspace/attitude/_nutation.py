"""The large nutation of a heavy top in closed form.

    u'^2 = f(u) = (alpha - beta u)(1 - u^2) - (gamma - N u)^2 = (y3 - beta u)(u1 - u)(u - u2)
    psi' = (gamma - N u) / (1 - u^2)                                   u = cos(theta)

    r1 = y3 - beta u1,  r2 = y3 - beta u2,     period = 4 R_F(0, r1, r2),  and in one period
    psi = pi (sgn(gamma - N) + sgn(gamma + N))
          + 2 beta/3 [(gamma + N) R_J(0, r1, r2, y3 + beta) - (gamma - N) R_J(0, r1, r2, y3 - beta)]

    symbol         meaning                                                       unit
    N              C n / A                                                       1/s
    alpha, beta    [2 (T + V) - C n^2] / A and 2 W l / A                         1/s^2
    gamma          h_Z / A                                                       1/s
    u1, u2         cosines of the upper and lower turning circle                 1
    y3             beta u3, u3: the third root, which no top reaches             1/s^2
    R_F, R_J       complete elliptic integrals (core)                           s, s^3

Source: Thomson 5.13-10..13 (constants), 5.13-18..21 (cubic); DLMF 19.16.1, .2, 19.7.9 (integrals;
the half turns that they leave are the passages of the vertical).

The cubic is solved for d = y3 - |beta|, measured from the vertical at which the weight is highest,
whose constants are e = alpha - |beta| and g = gamma - N (for beta < 0 the signs of N, u and psi's
two poles change):

    d^3 + a2 d^2 + a1 d = (|beta| g)^2,     a2 = 2 |beta| - e - N^2,   a1 = 2 |beta| (N g - e)
    q = |beta| (2 - u1 - u2) = d + a2 = (|beta|^2 X - a1)/d
    X = (1 - u1)(1 - u2) = g^2/d = (a1 + q d)/|beta|^2

d, q and X are not negative, and of each pair of forms one is a sum of what is not negative: a1 < 0
or a1 >= 0 decides. So no digit is lost where d and 1 - u1 vanish together, the separatrix, where
the period is infinite; e and g, which decide there, are formed from the state, not from alpha and
gamma.
"""

from typing import NamedTuple, final

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import (
    Flag,
    Scalar,
    complete_first,
    complete_third,
    safe_atan2,
    safe_divide,
    safe_sqrt,
)

# Newton's steps: the two bounds from which they start are within a factor of 1.5 of the root, and
# five steps reach rounding from there.
STEPS = 7
# Where d < NEAR |beta| (1 - u2), the upper pole's integral has a form without a half turn, so that
# the small precession of a nearly plane pendulum is not a difference of half turns.
NEAR = 0.1


class _Roots(NamedTuple):
    """d, 1/s^2, and sums and products of sin^2 (`up`) and cos^2 (`down`) of half the two turning
    angles, which are measured from the vertical at which the weight is highest."""

    d: Scalar
    sum_up: Scalar
    product_up: Scalar
    sum_down: Scalar
    product_down: Scalar

    def half_angles(self) -> tuple[tuple[Scalar, Scalar], tuple[Scalar, Scalar]]:
        """sin^2 and cos^2 of half the turning angle, of the nearer and of the farther circle."""
        up, down = self.sum_up, self.sum_down
        # The square of the difference of both sin^2, or of both cos^2: of two equal numbers the one
        # that is formed from the smaller terms.
        squared = jnp.where(
            up < down, up * up - 4.0 * self.product_up, down * down - 4.0 * self.product_down
        )
        apart = safe_sqrt(jnp.maximum(squared, 0.0))
        sine, cosine = 0.5 * (up + apart), 0.5 * (down + apart)
        return (
            (safe_divide(self.product_up, sine), cosine),
            (sine, safe_divide(self.product_down, cosine)),
        )


@final
class Nutation(eqx.Module):
    """One nutation of a top between its two turning circles.

    - `N`, 1/s, and `beta`, 1/s^2: constants of the equations above.
    - `alpha_up` = alpha - beta and `alpha_down` = alpha + beta, 1/s^2: what alpha - beta u is where
      the axis points up and down.
    - `gamma_up` = gamma - N and `gamma_down` = gamma + N, 1/s, likewise.

    Near the separatrix these differences decide: `Top.nutation` forms them from the state without
    loss, `Nutation.of` from alpha and gamma."""

    N: Float[Array, "*#runs"]
    beta: Float[Array, "*#runs"]
    alpha_up: Float[Array, "*#runs"]
    alpha_down: Float[Array, "*#runs"]
    gamma_up: Float[Array, "*#runs"]
    gamma_down: Float[Array, "*#runs"]

    @classmethod
    def of(cls, N: Scalar, alpha: Scalar, beta: Scalar, gamma: Scalar) -> "Nutation":
        """The nutation with the constants of the equations above, units as there."""
        return cls(N, beta, alpha - beta, alpha + beta, gamma - N, gamma + N)

    @property
    def alpha(self) -> Scalar:
        """[2 (T + V) - C n^2] / A, 1/s^2."""
        return 0.5 * (self.alpha_up + self.alpha_down)

    @property
    def gamma(self) -> Scalar:
        """h_Z / A, 1/s."""
        return 0.5 * (self.gamma_up + self.gamma_down)

    def third_root(self) -> Scalar:
        """y3 = beta u3, 1/s^2: the largest root of the cubic in y = beta u."""
        return self._sign() * self.beta + self._roots().d

    def turning_points(self) -> tuple[Scalar, Scalar]:
        """theta_1 and theta_2, rad: the axis swings between them, theta_1 the nearer to the upward
        vertical.

        Each angle from its vertical is right to rounding. The difference of the two is so to the
        root of rounding (1e-8): it is what the start leaves of a steady precession."""
        near, far = self._roots().half_angles()
        stands = self.beta >= 0.0
        # A top that hangs is highest at theta = pi: sine and cosine change places.
        first = (jnp.where(stands, a, b) for a, b in zip(near, far[::-1], strict=True))
        second = (jnp.where(stands, a, b) for a, b in zip(far, near[::-1], strict=True))
        return _angle(*first), _angle(*second)

    def period(self) -> Scalar:
        """Time, s, of one nutation, down and up again (Thomson 5.13).

        Infinite, with derivatives of zero, on the separatrix: the path that creeps up to the
        vertical, and the upright top at and below its critical spin."""
        total, product, ever = self._means(self._roots())
        return jnp.where(ever, jnp.inf, 4.0 * complete_first(total, product))

    def precession(self) -> Scalar:
        """The angle psi, rad, that the axis turns about the vertical in one nutation.

        A path exactly through the vertical counts the half turn there, whose sense is undefined, as
        none. Infinite with the period, unless the spin is zero."""
        roots = self._roots()
        ever = self._means(roots)[2]
        endless = self._sign() * jnp.where(self.N == 0.0, 0.0, jnp.copysign(jnp.inf, self.N))
        return jnp.where(ever, endless, self._precession(roots))

    def mean_precession_rate(self) -> Scalar:
        """psi', rad/s, averaged over one nutation; where that lasts for ever, psi' at the
        vertical."""
        roots = self._roots()
        total, product, ever = self._means(roots)
        rate = 0.25 * self._precession(roots) / complete_first(total, product)
        return jnp.where(ever, 0.5 * self._sign() * self.N, rate)

    def _sign(self) -> Scalar:
        """1 where the top is highest upright, -1 where it hangs."""
        return jnp.where(self.beta < 0.0, -1.0, 1.0)

    def _highest(self) -> tuple[Scalar, ...]:
        """N, |beta|, e, g and, at the other vertical, alpha + |beta| and gamma + N, for an axis
        that is highest at u = 1."""
        stands = self.beta >= 0.0
        up, down = (self.alpha_up, self.gamma_up), (self.alpha_down, self.gamma_down)
        high, low = (
            [jnp.where(stands, a, b) for a, b in zip(*pair, strict=True)]
            for pair in ((up, down), (down, up))
        )
        sign = self._sign()
        return sign * self.N, sign * self.beta, *high, *low

    def _roots(self) -> _Roots:
        """The solution of the cubic."""
        N, b, e, g, e_down, g_down = self._highest()
        half_slope = N * g - e
        a2, a1 = 2.0 * b - e - N * N, 2.0 * b * half_slope
        d = _largest_root(a2, a1, (b * g) ** 2)
        # Of each pair of forms the one that adds numbers that are not negative. Those divided by d
        # have d > 0, because a1 < 0 or a2 < 0; those divided by |beta| have |beta| > 0, because
        # a2 > 0.
        wide, falls = a2 > 0.0, (a1 < 0.0) | (a2 <= 0.0)
        below = jnp.where(falls & (d > 0.0), d, 1.0)
        width = jnp.where(wide, b, 1.0)
        rest = (a2 + d) / width
        product = jnp.where(falls, g * g / below, (2.0 * half_slope + rest * d) / width)
        total = jnp.where(wide, rest, (b * product - 2.0 * half_slope) / below)
        # From the other vertical y3 + |beta| is far: no second form is needed there.
        far = jnp.where(d + b == 0.0, 1.0, d + 2.0 * b)
        product_down = g_down * g_down / far
        total_down = (2.0 * (e_down + N * g_down) - b * product_down) / far
        return _Roots(
            d,
            0.5 * jnp.maximum(total, 0.0),
            0.25 * jnp.maximum(product, 0.0),
            0.5 * jnp.maximum(total_down, 0.0),
            0.25 * product_down,
        )

    def _means(self, roots: _Roots) -> tuple[Scalar, Scalar, Flag]:
        """Sum of the square roots of y3 - beta u1 and y3 - beta u2, 1/s, square root of their
        product, 1/s^2, and whether it is zero: then the motion takes for ever, and the means are
        1."""
        b, d = self._sign() * self.beta, roots.d
        q, r = 2.0 * b * roots.sum_up, 4.0 * b * b * roots.product_up
        squared = d * d + q * d + r
        ever = squared <= 0.0
        product = jnp.sqrt(jnp.where(ever, 1.0, squared))
        return jnp.sqrt(jnp.where(ever, 2.0, 2.0 * d + q + 2.0 * product)), product, ever

    def _precession(self, roots: _Roots) -> Scalar:
        """psi in one nutation that ends, rad."""
        _, b, _, g, _, g_down = self._highest()
        total, product, ever = self._means(roots)
        (upper, _), (lower, _) = roots.half_angles()
        d = jnp.where(ever, 1.0, roots.d)
        share, most = safe_divide(upper, lower), d + 2.0 * b * lower
        whole = (share * most > d) & (d < NEAR * 2.0 * b * lower)
        pole = jnp.where(whole, share * most, d)
        pole = jnp.where(pole > 0.0, pole, 1.0)
        passing, standing = complete_third(
            total, product, jnp.stack([pole, jnp.where(d + b == 0.0, 1.0, d + 2.0 * b)])
        )
        # Half turns are added first: for a fast top they cancel, and what is left is small.
        turns = jnp.where(whole, 0.0, jnp.sign(g)) + jnp.sign(g_down)
        first = complete_first(total, product) + (1.0 - share) / 3.0 * most * passing
        near = jnp.where(whole, safe_divide(g, lower) * first, -2.0 / 3.0 * b * g * passing)
        return jnp.pi * turns + (near + 2.0 / 3.0 * b * g_down * standing)


def _largest_root(a2: Scalar, a1: Scalar, c: Scalar) -> Scalar:
    """The largest root of d^3 + a2 d^2 + a1 d = c, where one is not negative and two are not
    positive."""

    def excess(d: Scalar) -> Scalar:
        return ((d + a2) * d + a1) * d - c

    def newton(d: Scalar) -> Scalar:
        return d - safe_divide(excess(d), (3.0 * d + 2.0 * a2) * d + a1)

    # Two upper bounds: Samuelson's, exact where the other two roots are equal, and, for a2 > 0, the
    # root without the cubic term, exact for a small root.
    samuelson = (2.0 * safe_sqrt(jnp.maximum(a2 * a2 - 3.0 * a1, 0.0)) - a2) / 3.0
    width = jnp.where(a2 > 0.0, a2, 1.0)
    root = safe_sqrt(a1 * a1 + 4.0 * width * c)
    quadratic = jnp.where(a1 < 0.0, 0.5 * (root - a1) / width, safe_divide(2.0 * c, a1 + root))
    start = jnp.where(a2 > 0.0, jnp.minimum(samuelson, quadratic), samuelson)
    start = jax.lax.stop_gradient(jnp.maximum(start, 0.0))
    d = jax.lax.fori_loop(0, STEPS, lambda _, d: newton(d), start)
    # Two steps more carry the derivatives of first and second order.
    return newton(newton(jax.lax.stop_gradient(d)))


def _angle(sin_squared: Scalar, cos_squared: Scalar) -> Scalar:
    """The angle, rad, from the squares of the sine and the cosine of its half."""
    return 2.0 * safe_atan2(safe_sqrt(sin_squared), safe_sqrt(cos_squared))
