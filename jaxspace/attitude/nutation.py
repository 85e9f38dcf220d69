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

The cubic is solved in `_turning_circles.py`; for beta < 0 the signs of N, u and psi's two poles
change, so that the weight is highest at u = 1.
"""

__all__ = ["Nutation"]

from typing import final

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import Flag, Scalar, Vector
from ..core.elliptic import complete_first, complete_third
from ..core.listed import no_method
from ..core.printing import printed
from ..core.safe import safe_atan2, safe_divide, safe_sqrt
from ..core.structure import HashedModule
from ..rotations import Quaternion
from ._turning_circles import Place, TurningCircles, turning_circles

# Where d < NEAR |beta| (1 - u2), the upper pole's integral has a form without a half turn, so that
# the small precession of a nearly plane pendulum is not a difference of half turns.
NEAR = 0.1


@final
@printed(
    N="1/s", beta="1/s^2", alpha_up="1/s^2", alpha_down="1/s^2", gamma_up="1/s", gamma_down="1/s"
)
class Nutation(HashedModule):
    """One nutation of a top between its two turning circles.

    - `N`, 1/s: the constant N of the equations above.
    - `beta`, 1/s^2: the constant beta of the equations above.
    - `alpha_up`, 1/s^2: alpha - beta, the value of alpha - beta u where the axis points up.
    - `alpha_down`, 1/s^2: alpha + beta, the value of alpha - beta u where the axis points down.
    - `gamma_up`, 1/s: gamma - N, the value of gamma - N u where the axis points up.
    - `gamma_down`, 1/s: gamma + N, the value of gamma - N u where the axis points down.
    - `start`: a position on the path.

    Near the separatrix these differences decide: `Top.nutation` forms them from the state without
    loss, `Nutation.of` from alpha and gamma. Near a steady precession the start matters; without
    it, the turning angles have errors of the square root of rounding (1e-8) there, unless psi'
    vanishes during the motion, as for a fast top that is released from rest."""

    N: Float[Array, "*#runs"]
    beta: Float[Array, "*#runs"]
    alpha_up: Float[Array, "*#runs"]
    alpha_down: Float[Array, "*#runs"]
    gamma_up: Float[Array, "*#runs"]
    gamma_down: Float[Array, "*#runs"]
    start: Place | None = None

    @classmethod
    def of(cls, N: Scalar, alpha: Scalar, beta: Scalar, gamma: Scalar) -> "Nutation":
        """The nutation with the constants of the equations above, units as there."""
        return cls(N, beta, alpha - beta, alpha + beta, gamma - N, gamma + N)

    @property
    def third_root(self) -> Scalar:
        """y3 = beta u3, 1/s^2: the largest root of the cubic in y = beta u."""
        return self._sign() * self.beta + self._roots().d

    @property
    @no_method
    def turning_points(self) -> tuple[Scalar, Scalar]:
        """theta_1 and theta_2, rad: the axis swings between them, theta_1 the nearer to the upward
        vertical.

        Each angle from its vertical is accurate to rounding, also for a nearly steady
        precession."""
        near, far = self._roots().half_angles
        stands = self.beta >= 0.0
        # A top that hangs is highest at theta = pi: sine and cosine change places.
        first = (jnp.where(stands, a, b) for a, b in zip(near, far[::-1], strict=True))
        second = (jnp.where(stands, a, b) for a, b in zip(far, near[::-1], strict=True))
        return _angle(*first), _angle(*second)

    @property
    def period(self) -> Scalar:
        """Time, s, of one nutation, down and up again (Thomson 5.13).

        Infinite, with derivatives of zero, on the separatrix: the path that creeps up to the
        vertical, and the upright top at and below its critical spin."""
        total, product, ever = self._means(self._roots())
        return jnp.where(ever, jnp.inf, 4.0 * complete_first(total, product))

    @property
    def precession(self) -> Scalar:
        """The angle psi, rad, through which the axis precesses about the vertical in one nutation.

        A path exactly through the vertical counts the half turn there, whose sense is undefined, as
        none. Infinite with the period, unless the spin is zero."""
        roots = self._roots()
        ever = self._means(roots)[2]
        # A body that approaches the vertical without spin stays in its plane: the angle is finite.
        endless = self._sign() * jnp.where(self.N == 0.0, 0.0, jnp.copysign(jnp.inf, self.N))
        return jnp.where(ever, endless, self._precession(roots))

    @property
    def mean_precession_rate(self) -> Scalar:
        """psi', rad/s, averaged over one nutation; where that lasts for ever, psi' at the
        vertical."""
        roots = self._roots()
        total, product, ever = self._means(roots)
        rate = 0.25 * self._precession(roots) / complete_first(total, product)
        # In a motion of infinite period the mean is the rate at its end, where nearly all of the
        # time is spent.
        return jnp.where(ever, 0.5 * self._sign() * self.N, rate)

    @property
    @no_method
    def circle_rates(self) -> tuple[Scalar, Scalar]:
        """psi', rad/s, at the upper and at the lower turning circle (Thomson 5.13-17).

        Of one sign the path is a wave, of two signs it has loops, and where the upper rate is zero,
        cusps; zero at a circle that is a vertical, where psi is undefined."""
        near, far = self._roots().half_angles
        stands = self.beta >= 0.0
        first, second = (
            [jnp.where(stands, a, b) for a, b in zip(*pair, strict=True)]
            for pair in ((near, far[::-1]), (far, near[::-1]))
        )
        return self._rate(*first), self._rate(*second)

    @property
    def loops(self) -> Scalar:
        """The sign of psi' at the upper circle over that at the lower one (Thomson 5.13-3 to -5):
        1 for waves, 0 for cusps, -1 for loops."""
        upper, lower = self.circle_rates
        return jnp.sign(upper) * jnp.sign(lower)

    def _rate(self, up: Scalar, down: Scalar) -> Scalar:
        """psi', rad/s, where sin^2 and cos^2 of half the nutation angle are `up` and `down`."""
        # gamma - N u and alpha - beta u from the side on which they are accurate.
        momentum, of_momentum = _difference(up, down, self.gamma_up, self.gamma_down, self.N)
        energy, of_energy = _difference(up, down, self.alpha_up, self.alpha_down, self.beta)
        # f(u) = 0: psi'^2 is the energy over sin^2 as well. For a fast top this is accurate where
        # the momentum is not; at a cusp both vanish, and the momentum as its root.
        sin_squared = 4.0 * up * down
        fast = (energy > 0.0) & (sin_squared > 0.0)
        fast = fast & (of_energy * sin_squared < 2.0 * jnp.abs(momentum) * of_momentum)
        squared = safe_divide(jnp.where(fast, energy, 1.0), jnp.where(fast, sin_squared, 1.0))
        by_energy = jnp.where(momentum < 0.0, -1.0, 1.0) * jnp.sqrt(squared)
        return jnp.where(fast, by_energy, safe_divide(momentum, sin_squared))

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

    def _roots(self) -> TurningCircles:
        """The solution of the cubic, measured from the vertical at which the weight is highest."""
        stands = self.beta >= 0.0
        start = self.start
        if start is not None:
            # Seen from the other vertical up and down change places, and u its sign.
            up, down = (jnp.where(stands, *pair) for pair in (start[:2], start[1::-1]))
            start = Place(up, down, start.rate_squared, self._sign() * start.slope)
        N, b, e, g, e_down, g_down = self._highest()
        return turning_circles(N, b, e, g, e_down, g_down, start)

    def _means(self, roots: TurningCircles) -> tuple[Scalar, Scalar, Flag]:
        """Sum of the square roots of y3 - beta u1 and y3 - beta u2, 1/s, square root of their
        product, 1/s^2, and whether it is zero: then the period is infinite, and the means are 1."""
        b = self._sign() * self.beta
        d = roots.d
        q, r = 2.0 * b * roots.sum_up, 4.0 * b * b * roots.product_up
        squared = d * d + q * d + r
        ever = squared <= 0.0
        # With safe values on the separatrix: the caller replaces what follows from them.
        product = jnp.sqrt(jnp.where(ever, 1.0, squared))
        return jnp.sqrt(jnp.where(ever, 2.0, 2.0 * d + q + 2.0 * product)), product, ever

    def _precession(self, roots: TurningCircles) -> Scalar:
        """psi in one nutation that ends, rad."""
        _, b, _, g, _, g_down = self._highest()
        total, product, ever = self._means(roots)
        (upper, _), (lower, _) = roots.half_angles
        d = jnp.where(ever, 1.0, roots.d)
        share = safe_divide(upper, lower)
        most = d + 2.0 * b * lower
        whole = (share * most > d) & (d < NEAR * 2.0 * b * lower)
        pole = jnp.where(whole, share * most, d)
        # A pole at zero has the factor g = 0 before it: with any other value the product remains
        # zero.
        pole = jnp.where(pole > 0.0, pole, 1.0)
        passing, standing = complete_third(
            total, product, jnp.stack([pole, jnp.where(d + b == 0.0, 1.0, d + 2.0 * b)])
        )
        # Half turns are added first: for a fast top they cancel, and what is left is small.
        turns = jnp.where(whole, 0.0, jnp.sign(g)) + jnp.sign(g_down)
        first = complete_first(total, product) + (1.0 - share) / 3.0 * most * passing
        near = jnp.where(whole, safe_divide(g, lower) * first, -2.0 / 3.0 * b * g * passing)
        return jnp.pi * turns + (near + 2.0 / 3.0 * b * g_down * standing)


def _difference(
    up: Scalar, down: Scalar, at_up: Scalar, at_down: Scalar, slope: Scalar
) -> tuple[Scalar, Scalar]:
    """A linear function of u from its value at the nearer vertical, and the size of its terms."""
    from_up, from_down = 2.0 * slope * up, 2.0 * slope * down
    near = up < down
    value = jnp.where(near, at_up + from_up, at_down - from_down)
    terms = jnp.where(
        near, jnp.abs(at_up) + jnp.abs(from_up), jnp.abs(at_down) + jnp.abs(from_down)
    )
    return value, terms


def nutation_through(
    attitude: Quaternion, omega: Vector, Z: Vector, N: Scalar, beta: Scalar
) -> Nutation:
    """The nutation of a motion.

    **Arguments**

    - `attitude`, `omega`, rad/s, (3, *runs): the motion at one moment, in the axes of the top.
    - `Z`: the upward vertical in the same axes, (3, *runs).
    - `N`, 1/s, and `beta`, 1/s^2: constants of the equations above.
    """
    transverse = omega[0] * omega[0] + omega[1] * omega[1]
    around = omega[0] * Z[0] + omega[1] * Z[1]
    # sin^2 and cos^2 of half the nutation angle: near a vertical, 1 - cos(theta) has no digits.
    w, x, y, z = attitude.wxyz
    whole = attitude.norm_squared
    up, down = (x * x + y * y) / whole, (w * w + z * z) / whole
    rate = omega[1] * Z[0] - omega[0] * Z[1]
    slope = 2.0 * (N * around - Z[2] * transverse) - beta * (Z[0] * Z[0] + Z[1] * Z[1])
    return Nutation(
        N=N,
        beta=beta,
        alpha_up=transverse - 2.0 * beta * up,
        alpha_down=transverse + 2.0 * beta * down,
        gamma_up=around - 2.0 * N * up,
        gamma_down=around + 2.0 * N * down,
        start=Place(up, down, rate * rate, slope),
    )


def _angle(sin_squared: Scalar, cos_squared: Scalar) -> Scalar:
    """The angle, rad, from the squares of the sine and the cosine of its half."""
    return 2.0 * safe_atan2(safe_sqrt(sin_squared), safe_sqrt(cos_squared))
