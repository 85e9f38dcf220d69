"""The motion of a heavy top in closed form: attitude and angular velocity after any time.

With a = q_0 + i q_3, b = q_1 + i q_2, the Cayley-Klein parameters of the attitude, of which
|b| = sin(theta/2), and S, c, d of t (core) for

    x = beta (u3 - u2)/4,   y = beta (u1 - u2)/4,   x - y = beta (u3 - u1)/4

the motion after the start a, b, u, u' is, with D = d^2 + beta/4 (u1 - u) S^2,

    a(t) = e^(i alpha t) e^(i third) [a (c d + beta u' S^3/8) + a' S D] / (D sqrt(p))
    p    = 1 + M S^2,               M = beta (1 + u2)/4,   rho M = (gamma + N) beta/8
    b(t) = e^(-i alpha t) e^(i third) [b (c d - i rho M S^3) + b' S p] / (D sqrt(p))
    p    = c^2 + beta/4 (u3 - 1) S^2, M = -beta (1 - u2)/4, rho M = -(gamma - N) beta/8

    a' = (i N a - b conj(omega_12))/2,   b' = (a omega_12 - i N b)/2,   alpha = (n - N)/2
    omega_12(t) = 2 e^(-2 i alpha t) (conj(a) b' - b conj(a'))

and where |M| > sqrt(xy), b passes to the pole M* = xy/M, with q = b' - i rho b:

    b(t) = e^(-i alpha t) e^(i (rho t - third*)) [b p* + q S (c d - i rho S)] / (D sqrt(p*))
    p*   = c^2 + x (1 - u1)/(1 - u2) S^2,              rho = (gamma - N)/(2 (1 - u2))

    symbol         meaning                                                        unit
    a', b'         rates of a and b without the turns at the rate alpha           1/s
    omega_12       omega_1 + i omega_2                                            rad/s
    third          the integral of the third kind (core)                          rad
    u1, u2, u3     roots of the cubic (_turning_circles.py); other symbols as     1
                   in nutation.py

Source: Klein and Sommerfeld, Theorie des Kreisels, VI (a and b as quotients of theta functions);
Whittaker and Watson 20.6 (u(t) from any start); Thomson 5.13. A motion from any start needs no
phase, and so neither an inverse function nor a turning circle. D and p are sums of non-negative
terms, and no formula divides by sin(theta): nothing is singular at the vertical, on the separatrix
or at a steady precession. A top that hangs is seen upside down.
"""

__all__ = ["TopMotion"]

from typing import final

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..bodies import BodyState
from ..core import AbstractClosedForm, Flag, Scalar, Vector
from ..core.barrier import barrier
from ..core.jacobi import Jacobi, jacobi
from ..core.printing import printed
from ..core.square_roots import inverse_sqrt
from ..rotations import Quaternion, to_euler_angles
from ._cayley_klein import conjugate, lowered, product, raised, times_i, turned
from ._state import attitude_and_omega
from ._top_amplitudes import amplitudes, arguments, third_angles, third_rates
from ._top_start import TopStart, start_of


@final
@printed(transverse_inertia="kg m^2", axial_inertia="kg m^2", weight_moment="N m")
class TopMotion(AbstractClosedForm):
    """The motion of a heavy top in closed form.

    - `transverse_inertia`: A, kg m^2, across the axis, about the fixed point.
    - `axial_inertia`: C, kg m^2, about the axis.
    - `weight_moment`: W l, N m.

    It is valid for every initial state and any time: steady, cusped or looping, upright, hanging,
    through the vertical and on the separatrix. Compared with an 18-digit reference, the error of
    the state is about 1e-14 in units of its revolutions, and that of its first derivatives a
    relative 1e-14."""

    transverse_inertia: Float[Array, "*#runs"]
    axial_inertia: Float[Array, "*#runs"]
    weight_moment: Float[Array, "*#runs"]

    def flow(self, duration: Scalar, y: BodyState) -> BodyState:
        attitude, omega = attitude_and_omega(y)
        start, phase, hangs = self._start(duration, y)
        s, c, d = phase.s, phase.c, phase.d
        # S' = c d and its like carry the rates of a and b.
        (a, b), (a_rate, b_rate) = jax.jvp(
            lambda s, c, d: amplitudes(start, s, c, d),
            (s, c, d),
            (c * d, -start.x * s * d, -start.y * s * c),
        )
        down, up = barrier(third_angles(start, phase, duration))
        down_rate, up_rate = third_rates(start, phase)
        a, b, a_rate, b_rate = barrier((a, b, a_rate, b_rate))
        a, a_rate = turned(down, a), turned(down, a_rate + down_rate * times_i(a))
        b, b_rate = turned(up, b), turned(up, b_rate + up_rate * times_i(b))
        across = 2.0 * (product(conjugate(a), b_rate) - product(b, conjugate(a_rate)))
        half = start.alpha * duration
        a, b, across = barrier((a, b, across))
        across = turned(-2.0 * half, across)
        a = turned(half, a)
        b = turned(-half, b)
        q = jnp.stack([a[0], b[0], b[1], a[1]])
        q = jnp.where(hangs, lowered(q), q)
        # Of unit length to rounding, times the length at the start.
        q = q * jnp.sqrt(attitude.norm_squared / jnp.sum(q * q, axis=0))
        # For a duration of zero the start itself is returned, which the way through a and b gives
        # to rounding only; the derivatives by the time are those of the motion.
        still = jnp.asarray(duration) == 0.0
        q = _valued(jnp.where(still, attitude.wxyz, q), q)
        across = _valued(jnp.where(still, omega[:2], across), across)
        return BodyState(
            attitude=Quaternion(q),
            omega=jnp.stack([across[0], across[1], omega[2] + 0.0 * across[0]]),
        )

    def angles(self, duration: Scalar, y: BodyState) -> Vector:
        """Euler's angles after a time, psi and phi without jumps of whole turns.

        **Arguments**

        - `duration`: s, (*runs,).
        - `y`: the initial state; not on a vertical, where psi is undefined.

        **Returns** (psi, theta, phi), rad, (3, *runs); psi and phi count the turns since the start.
        """
        attitude, _ = attitude_and_omega(y)
        start, phase, hangs = self._start(duration, y)
        down, up = (
            angle + argument
            for angle, argument in zip(
                third_angles(start, phase, duration), arguments(start, phase), strict=True
            )
        )
        psi = down + up
        phi = down - up + 2.0 * start.alpha * duration
        first = to_euler_angles(attitude)
        later, _ = attitude_and_omega(self.flow(duration, y))
        theta = to_euler_angles(later)[1]
        return jnp.stack([first[0] + jnp.where(hangs, -psi, psi), theta, first[2] + phi])

    def _start(self, duration: Scalar, y: BodyState) -> tuple[TopStart, Jacobi, Flag]:
        """The start, seen from the vertical at which the weight is highest; S, c and d; whether
        that is turned upside down."""
        attitude, omega = attitude_and_omega(y)
        moments = self.transverse_inertia, self.axial_inertia, self.weight_moment
        runs = jnp.broadcast_shapes(
            *(jnp.shape(v) for v in (*moments, duration)), omega.shape[1:], attitude.wxyz.shape[1:]
        )
        A, C, Wl = (jnp.broadcast_to(v, runs) for v in moments)
        omega, q = (
            jnp.stack([jnp.broadcast_to(v, runs) for v in w]) for w in (omega, attitude.wxyz)
        )
        q = q * inverse_sqrt(jnp.sum(q * q, axis=0))
        hangs = Wl < 0.0
        # A hanging top is an upright one seen upside down: the same formula applies to both.
        q = jnp.where(hangs, raised(q), q)
        start = start_of(q, omega, C * omega[2] / A, 2.0 * jnp.abs(Wl) / A)
        phase = jacobi(duration, start.x, start.y, start.difference)
        # Between its stages, too: fused into one, the program compiles for much longer.
        return start, barrier(phase), hangs


def _valued(value: Array, x: Array) -> Array:
    """The `value`, to the bit, with the derivatives of `x`."""
    return jax.lax.stop_gradient(value) + (x - jax.lax.stop_gradient(x))
