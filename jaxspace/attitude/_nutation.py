"""The large nutation of a heavy top in closed form.

    u'^2 = f(u) = (alpha - beta u)(1 - u^2) - (gamma - N u)^2 = (y3 - beta u)(u1 - u)(u - u2)        u = cos(theta)
    psi' = (gamma - N u) / (1 - u^2)

    k'^2 = lo / hi,   period = 4 K / sqrt(hi)         hi, lo: the larger and smaller of y3 - beta u1, y3 - beta u2

    symbol         meaning                                                       unit
    N              C n / A                                                       1/s
    alpha, beta    [2 (T + V) - C n^2] / A and 2 W l / A                         1/s^2
    gamma          h_Z / A                                                       1/s
    u1, u2         cosines of the upper and lower turning circle                 1
    y3             beta u3, u3: the third root, which no top reaches             1/s^2

Source: Thomson 5.13-10..13 (constants), 5.13-18..21 (cubic). The third root comes from Newton's
method in y = beta u, which serves beta = 0 too; it starts at Samuelson's bound, beyond all roots,
and descends to the largest. The other two follow from (1 - u1)(1 - u2) = (gamma - N)^2 / (y3 -
beta) and (1 + u1)(1 + u2) = (gamma + N)^2 / (y3 + beta), so that an angle near the vertical keeps
its digits. Near a swing in a vertical plane (N = gamma = 0, the plane pendulum) the third root lies
on the vertical, and the product on that side is 1 - s + p (upper) or 1 + s + p, from p = u1 u2 =
(gamma^2 - alpha) / y3 and s = u1 + u2. In the integral of psi' the spikes at u = 1 and u = -1 are
integrated apart (each is half a turn); what is left is smooth. On the path that creeps up to the
vertical (a sleeping top below its critical spin) the period is infinite.
"""

from typing import Any, final

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import Scalar, safe_atan2, safe_divide, safe_sqrt
from ._elliptic import complete_elliptic

# Newton's steps from Samuelson's bound: it is exact for a double root u1 = u2, and six steps reach
# rounding at u3 = 1.1.
STEPS = 12
# Nodes of the periodic quadrature: the error falls as q^(2 NODES), q the nome of the modulus k.
NODES = 48
# Where y3 is as near to |beta|, their difference lacks digits, and 1 - s + p has all of them.
PLANAR = 1e-5


@final
class Nutation(eqx.Module):
    """One nutation of a top between its two turning circles, from its constants `N`, `alpha`,
    `beta` and `gamma`."""

    N: Float[Array, "*#runs"]
    alpha: Float[Array, "*#runs"]
    beta: Float[Array, "*#runs"]
    gamma: Float[Array, "*#runs"]

    def third_root(self) -> Scalar:
        """y3 = beta u3, 1/s^2: the largest root of the cubic in y = beta u."""
        s = self.alpha + self.N * self.N
        c1 = (2.0 * self.gamma * self.N - self.beta) * self.beta
        c0 = (self.alpha - self.gamma * self.gamma) * self.beta * self.beta
        y = s / 3.0 + 2.0 / 3.0 * safe_sqrt(jnp.maximum(s * s - 3.0 * c1, 0.0))

        def newton(_: Any, y: Scalar) -> Scalar:
            return y - safe_divide(((y - s) * y + c1) * y + c0, (3.0 * y - 2.0 * s) * y + c1)

        return jax.lax.fori_loop(0, STEPS, newton, y)

    def turning_points(self) -> tuple[Scalar, Scalar]:
        """theta_1 and theta_2, rad: the axis swings between them, theta_1 the nearer to the upward
        vertical."""
        x, y = self._products()
        half_sum_x, half_sum_y = 0.5 - (y - x) / 2.0, 0.5 + (y - x) / 2.0
        root = safe_sqrt(jnp.maximum(half_sum_x * half_sum_x - x, 0.0))
        low_x, high_y = half_sum_x + root, half_sum_y + root
        high_x, low_y = safe_divide(x, low_x), safe_divide(y, high_y)
        return _angle(high_x, high_y), _angle(low_x, low_y)

    def period(self) -> Scalar:
        """Time, s, of one nutation, down and up again (Thomson 5.13)."""
        _, at_upper, at_lower = self._rates_squared()
        high, low = jnp.maximum(at_upper, at_lower), jnp.minimum(at_upper, at_lower)
        return 4.0 * complete_elliptic(jnp.maximum(low, 0.0) / high) / jnp.sqrt(high)

    def precession(self) -> Scalar:
        """The angle psi, rad, that the axis turns about the vertical in one nutation.

        A path exactly through the vertical counts the half turn there, whose sense is undefined, as
        none."""
        y3, at_upper, at_lower = self._rates_squared()
        shape = (NODES,) + (1,) * y3.ndim
        chi = jnp.pi / NODES * (jnp.arange(NODES, dtype=y3.dtype).reshape(shape) + 0.5)
        r = jnp.sqrt(0.5 * (at_upper + at_lower) + 0.5 * (at_upper - at_lower) * jnp.cos(chi))
        up, down = (
            safe_sqrt(jnp.maximum(y3 - self.beta, 0.0)),
            safe_sqrt(jnp.maximum(y3 + self.beta, 0.0)),
        )
        x, y = (
            jnp.sign(side) * 2.0 * safe_sqrt(product)
            for side, product in zip(
                (self.gamma - self.N, self.gamma + self.N), self._products(), strict=True
            )
        )
        smooth = y / (r * (r + down)) - x / (r * (r + up))
        spikes = jnp.sign(self.gamma - self.N) + jnp.sign(self.gamma + self.N)
        return jnp.pi * (spikes + self.beta * jnp.mean(smooth, axis=0))

    def mean_precession_rate(self) -> Scalar:
        """psi', rad/s, averaged over one nutation."""
        return self.precession() / self.period()

    def _products(self) -> tuple[Scalar, Scalar]:
        """sin^2 sin^2 and cos^2 cos^2 of half the two turning angles."""
        y3 = self.third_root()
        x = safe_divide((self.gamma - self.N) ** 2, y3 - self.beta)
        y = safe_divide((self.gamma + self.N) ** 2, y3 + self.beta)
        size = jnp.abs(self.beta)
        planar = (y3 - size < PLANAR * size) & (size > 0.0)
        y3 = jnp.where(planar, y3, 1.0)
        p = (self.gamma * self.gamma - self.alpha) / y3
        s = (2.0 * self.gamma * self.N - self.beta * (1.0 + p)) / y3
        x = jnp.where(planar & (self.beta > 0.0), jnp.maximum(1.0 - s + p, 0.0), x)
        y = jnp.where(planar & (self.beta < 0.0), jnp.maximum(1.0 + s + p, 0.0), y)
        return x / 4.0, y / 4.0

    def _rates_squared(self) -> tuple[Scalar, Scalar, Scalar]:
        """y3, y3 - beta u1 and y3 - beta u2, 1/s^2."""
        y3 = self.third_root()
        theta_1, theta_2 = self.turning_points()
        return y3, y3 - self.beta * jnp.cos(theta_1), y3 - self.beta * jnp.cos(theta_2)


def _angle(sin_squared: Scalar, cos_squared: Scalar) -> Scalar:
    """The angle, rad, from the squares of the sine and the cosine of its half."""
    return 2.0 * safe_atan2(
        safe_sqrt(jnp.maximum(sin_squared, 0.0)), safe_sqrt(jnp.maximum(cos_squared, 0.0))
    )
