"""Gimbal walk: the drift of the outer gimbal of a nutating gyro whose gimbals have mass.

    drift = -theta_0'^2 H I_1 cos(theta_0) / (2 w^2 I_0^2)     to second order in theta_0'
    X(theta) = H (cos(theta_0) - cos(theta)) / sqrt(J I_Z)     J theta'^2 + J X^2 = J theta_0'^2,
                                                               exactly

    psi' = ... + a^2 (H/I_0) [(s I'/I_0 - c/2)/2 - b s/2] cos(2 w t)      to second order in a
    theta = ... - (a^2 b/2) cos(2 w t),     b = c/(2 s) - I'/(2 I_0)

By the energy integral theta' = theta_0' cos(chi) and X = theta_0' sin(chi), hence dt =
d(chi) / X'(theta). The phase chi removes the singular ends of the quadrature, and the integrand is
periodic.

    symbol       meaning                                                              unit
    theta_0, '   angle and its rate at the moment when the outer gimbal is at rest    rad, rad/s
    H            spin momentum C n of the rotor                                       kg m^2/s
    J            inertia about the inner axis, A + A_i                                kg m^2
    I_Z, I_0     inertia about the outer axis, I_1 cos^2 + I_2 sin^2; at theta_0      kg m^2
    I_1, I_2     the same for theta = 0, C_i + C_0, and for 90 deg, A + B_i + C_0     kg m^2
    w            H sin(theta_0) / sqrt(I_0 J), frequency of the nutation              rad/s
    a            theta_0' / w, amplitude of the nutation                              rad
    I', s, c     slope of I_Z at theta_0; sine and cosine of theta_0                  kg m^2, 1

Source: Thomson 6.3-12 to -14 (energy integral), 6.3-22 (the line before it has a wrong sign),
problem 1 (second harmonic; 6.3-16 omits -(1/2) C n cos(theta_0) of the expansion), problem 5 (mean
of theta).
Valid as long as theta turns back before 0 and 180 deg, that is for |theta_0'| < H (1 -
|cos(theta_0)|) / sqrt(J I_1), which is X at the nearer of the two. A faster gimbal passes over the
pole, a motion of another kind: its walk is NaN.

The quadrature is exact to 1e-14 up to 0.8 of that rate, to 1e-10 at 0.9 and to 1e-3 at 0.99; at the
rate itself the period is infinite.
"""

__all__ = ["GimbalWalk"]

from typing import final

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import Scalar
from ..core.listed import no_method
from ..core.printing import printed
from ..core.special import stumpff
from ..core.square_roots import inverse_sqrt
from ..core.structure import HashedModule

# The error of a periodic quadrature falls exponentially with the nodes.
NODES = 48
# Newton's steps double the digits, from 1e-2 on. The last two, which carry the derivatives, are
# included.
STEPS = 6


@final
@printed(
    theta="rad",
    theta_rate="rad/s",
    spin_momentum="kg m^2/s",
    inner_inertia="kg m^2",
    outer_inertia_upright="kg m^2",
    outer_inertia_across="kg m^2",
)
class GimbalWalk(HashedModule):
    """One nutation of a gyro in two gimbals without moments, and the drift that it causes.

    - `theta`, rad: theta_0, at the start.
    - `theta_rate`, rad/s: the rate of theta at the start.
    - `spin_momentum`, kg m^2/s: H.
    - `inner_inertia`, kg m^2: the moment of inertia J.
    - `outer_inertia_upright`, kg m^2: the moment of inertia I_1.
    - `outer_inertia_across`, kg m^2: the moment of inertia I_2.

    The exact results are NaN from `greatest_rate` on."""

    theta: Float[Array, "*#runs"]
    theta_rate: Float[Array, "*#runs"]
    spin_momentum: Float[Array, "*#runs"]
    inner_inertia: Float[Array, "*#runs"]
    outer_inertia_upright: Float[Array, "*#runs"]
    outer_inertia_across: Float[Array, "*#runs"]

    @property
    def drift_to_second_order(self) -> Scalar:
        """Mean rate of the outer gimbal, rad/s, to second order in the rate of theta (Thomson
        6.3-22); zero at 90 deg and for gimbals without mass."""
        scale = self.theta_rate / (self.frequency * self.outer_inertia(self.theta))
        return (
            -0.5
            * scale
            * scale
            * self.spin_momentum
            * self.outer_inertia_upright
            * jnp.cos(self.theta)
        )

    @property
    def offset_to_second_order(self) -> Scalar:
        """Mean of theta - theta_0, rad (Thomson 6.3, problem 5, with all second-order terms)."""
        s = jnp.sin(self.theta)
        c = jnp.cos(self.theta)
        bend = c / s - 2.0 * self._difference() * s * c / self.outer_inertia(self.theta)
        return -0.75 * (self.theta_rate / self.frequency) ** 2 * bend

    @property
    @no_method
    def second_harmonic(self) -> tuple[Scalar, Scalar]:
        """Amplitudes of cos(2 w t) in psi', rad/s, and in theta, rad, to second order in the rate
        of theta (Thomson 6.3, problem 1).

        At t = 0 the outer gimbal is at rest, and the first harmonic of theta is that of
        sin(w t)."""
        s, c = jnp.sin(self.theta), jnp.cos(self.theta)
        inertia = self.outer_inertia(self.theta)
        slope = 2.0 * self._difference() * s * c / inertia
        theta = -0.25 * (self.theta_rate / self.frequency) ** 2 * (c / s - slope)
        # From the square of the first harmonic, sin^2 = (1 - cos(2 w t)) / 2.
        square = 0.5 * (self.theta_rate / self.frequency) ** 2 * (s * slope - 0.5 * c)
        return self.spin_momentum / inertia * (s * theta + square), theta

    @property
    def drift(self) -> Scalar:
        """Mean rate of the outer gimbal, rad/s, exactly."""
        chi, deviation, theta, slope = self._nodes()
        s0 = jnp.sin(self.theta)
        bend = self._bend(deviation)
        # psi' / X' = theta_0' sin(chi) J / (H v), v = sin(theta) - bend. Its part 1/v_0 has the
        # mean zero and is subtracted, because the drift of a small nutation is of second order.
        inverse = (bend - self._rise(deviation)) / ((jnp.sin(theta) - bend) * s0)
        turn = self.theta_rate * self.inner_inertia / self.spin_momentum
        # Means over time: equal steps in chi have the duration 1 / X'.
        return turn * jnp.mean(jnp.sin(chi) * inverse, axis=0) / jnp.mean(1.0 / slope, axis=0)

    @property
    def offset(self) -> Scalar:
        """Mean of theta - theta_0, rad, exactly."""
        _, d, theta, slope = self._nodes()
        s0 = jnp.sin(self.theta)
        inertia = self.outer_inertia(self.theta)
        # d / X' less X / X_0'^2 = share rest / X': the subtracted part has the mean zero, because X
        # = theta_0' sin(chi). The offset is of second order, and so is every term of the rest.
        growth = self._difference() * jnp.sin(2.0 * self.theta + d) * jnp.sin(d)
        odd = s0 * (d**3 * stumpff(d * d)[1] + d * growth / inertia)
        even = 2.0 * jnp.cos(self.theta) * jnp.sin(0.5 * d) ** 2
        rest = s0 * (odd - even) + self._fall(d) * (self._bend(d) - self._rise(d))
        share = inertia / (self.outer_inertia(theta) * s0 * s0)
        return jnp.mean(share * rest / slope, axis=0) / jnp.mean(1.0 / slope, axis=0)

    @property
    def period(self) -> Scalar:
        """Time, s, of one nutation, exactly."""
        return 2.0 * jnp.pi * jnp.mean(1.0 / self._nodes()[3], axis=0)

    @property
    def frequency(self) -> Scalar:
        """Frequency w, rad/s, of a small nutation."""
        return (
            self.spin_momentum
            * jnp.sin(self.theta)
            * inverse_sqrt(self.outer_inertia(self.theta) * self.inner_inertia)
        )

    def outer_inertia(self, theta: Scalar) -> Scalar:
        """I_Z, kg m^2, at `theta`, rad."""
        s = jnp.sin(theta)
        c = jnp.cos(theta)
        return self.outer_inertia_across * s * s + self.outer_inertia_upright * c * c

    @property
    def greatest_rate(self) -> Scalar:
        """The rate |theta_0'|, rad/s, with which the gimbal just reaches the nearer pole; infinite
        for gimbals without mass."""
        # (1 - |cos(theta)|) / 2, which would lose its digits close to a pole.
        rise = jnp.minimum(jnp.sin(0.5 * self.theta) ** 2, jnp.cos(0.5 * self.theta) ** 2)
        return (
            2.0
            * jnp.abs(self.spin_momentum)
            * rise
            * inverse_sqrt(self.inner_inertia * self.outer_inertia_upright)
        )

    def _fall(self, deviation: Scalar) -> Scalar:
        """cos(theta_0) - cos(theta_0 + deviation)."""
        # As a product: the difference would lose the digits of a small nutation.
        return 2.0 * jnp.sin(self.theta + 0.5 * deviation) * jnp.sin(0.5 * deviation)

    def _rise(self, deviation: Scalar) -> Scalar:
        """sin(theta_0 + deviation) - sin(theta_0), without cancellation."""
        return 2.0 * jnp.cos(self.theta + 0.5 * deviation) * jnp.sin(0.5 * deviation)

    def _bend(self, deviation: Scalar) -> Scalar:
        """sin(theta) - X' sqrt(J I_Z)/H: the part of the slope of X due to the change of I_Z."""
        theta = self.theta + deviation
        turned = jnp.sin(theta) * jnp.cos(theta) * self._fall(deviation)
        return self._difference() * turned / self.outer_inertia(theta)

    def _difference(self) -> Scalar:
        return self.outer_inertia_across - self.outer_inertia_upright

    def _map(self, deviation: Scalar) -> tuple[Scalar, Scalar]:
        """X, rad/s, and its slope, 1/s, at theta_0 + deviation."""
        theta = self.theta + deviation
        scale = self.spin_momentum * inverse_sqrt(self.inner_inertia * self.outer_inertia(theta))
        slope = scale * (jnp.sin(theta) - self._bend(deviation))
        return scale * self._fall(deviation), slope

    def _newton_step(self, deviation: Scalar, target: Scalar) -> Scalar:
        """A refined root of X(theta_0 + deviation) = target."""
        x, slope = self._map(deviation)
        return deviation - (x - target) / slope

    def _nodes(self) -> tuple[Scalar, Scalar, Scalar, Scalar]:
        """chi, theta - theta_0, theta and X'(theta) at the nodes of one period, on a new leading
        axis."""
        # A gimbal that passes over the pole has no turning points, and no period of this kind.
        theta_rate = jnp.where(
            jnp.abs(self.theta_rate) < self.greatest_rate, self.theta_rate, jnp.nan
        )
        rate = theta_rate / self.frequency
        shape = (NODES,) + (1,) * rate.ndim
        chi = 2.0 * jnp.pi / NODES * (jnp.arange(NODES, dtype=rate.dtype).reshape(shape) + 0.5)
        # The small nutation is the start of Newton's iteration for X(theta) = theta_0' sin(chi).
        deviation = _converged(self, rate * jnp.sin(chi), theta_rate * jnp.sin(chi))
        # From the root on, two steps bring its first three derivatives.
        for _ in range(2):
            deviation = self._newton_step(deviation, theta_rate * jnp.sin(chi))
        return chi, deviation, self.theta + deviation, self._map(deviation)[1]


def _converged(walk: GimbalWalk, deviation: Scalar, target: Scalar) -> Scalar:
    """The root of X(theta_0 + deviation) = target before the final two Newton steps, without
    derivatives."""
    walk, deviation, target = jax.lax.stop_gradient((walk, deviation, target))
    # A loop: written out, its steps and their derivatives take two minutes to compile.
    return jax.lax.fori_loop(0, STEPS - 2, lambda _, d: walk._newton_step(d, target), deviation)
