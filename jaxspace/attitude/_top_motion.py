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
                   in _nutation.py

Source: Klein and Sommerfeld, Theorie des Kreisels, VI (a and b as quotients of theta functions);
Whittaker and Watson 20.6 (u(t) from any start); Thomson 5.13. A motion from any start needs no
phase: neither an inverse function nor a turning circle is asked for. D and p are sums of what is
not negative, and no formula divides by sin(theta): nothing is singular at the vertical, on the
separatrix or at a steady precession. A top that hangs is seen upside down.
"""

import math
from typing import NamedTuple, final

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..bodies import BodyState
from ..core import (
    AbstractClosedForm,
    Flag,
    Jacobi,
    Scalar,
    Vector,
    barrier,
    complete_third,
    jacobi,
    safe_atan2,
    safe_divide,
    safe_sqrt,
    third,
)
from ..rotations import Quaternion, to_euler_angles
from ._cayley_klein import conjugate, lowered, pairs_of, product, raised, times_i, turned
from ._nutation import nutation_through
from ._state import attitude_and_omega, vertical
from ._turning_circles import turning_circles


class _Pole(NamedTuple):
    """One of the two verticals as a pole of the third integral.

    `slope`, 1/s^2: (p - 1)/S^2 for a, (p - c^2)/S^2 for b; `quarter`: p at the quarter period;
    `weight`, 1/s^3: rho M, less for the pole that b passes to; `momentum`, 1/s: gamma + N for a,
    gamma - N for b."""

    slope: Scalar
    quarter: Scalar
    weight: Scalar
    momentum: Scalar


class _Start(NamedTuple):
    """A top that is highest upright, at its start: the pairs a, b and a', b'; x, y, x - y; beta
    (u1 - u)/4, 1/s^2; u', 1/s; beta u'/8, 1/s^3; both poles; whether b passes to the other one,
    with the rate rho then, else zero; N and n."""

    a: Array
    b: Array
    a_rate: Array
    b_rate: Array
    x: Scalar
    y: Scalar
    difference: Scalar
    above: Scalar
    rise: Scalar
    bend: Scalar
    down: _Pole
    up: _Pole
    passes: Flag
    rho: Scalar
    alpha: Scalar
    near: Scalar


@final
class TopMotion(AbstractClosedForm):
    """The motion of a heavy top with the `transverse_inertia` A and the `axial_inertia` C, kg m^2,
    and the `weight_moment` W l, N m.

    It holds for every start and any time: steady, cusped or looping, upright, hanging, through the
    vertical and on the separatrix. Against 18 digits the state is right to some 1e-14 in units of
    its turns, and its first derivatives to the same of their size."""

    transverse_inertia: Float[Array, "*#runs"]
    axial_inertia: Float[Array, "*#runs"]
    weight_moment: Float[Array, "*#runs"]

    def flow(self, duration: Scalar, y: BodyState) -> BodyState:
        attitude, omega = attitude_and_omega(y)
        start, phase, hangs = self._start(duration, y)
        s, c, d = phase.s, phase.c, phase.d
        # S' = c d and its like carry the rates of a and b.
        (a, b), (a_rate, b_rate) = jax.jvp(
            lambda s, c, d: _amplitudes(start, s, c, d),
            (s, c, d),
            (c * d, -start.x * s * d, -start.y * s * c),
        )
        down, up = barrier(_third_angles(start, phase, duration))
        down_rate, up_rate = _third_rates(start, phase)
        a, b, a_rate, b_rate = barrier((a, b, a_rate, b_rate))
        a, a_rate = turned(down, a), turned(down, a_rate + down_rate * times_i(a))
        b, b_rate = turned(up, b), turned(up, b_rate + up_rate * times_i(b))
        across = 2.0 * (product(conjugate(a), b_rate) - product(b, conjugate(a_rate)))
        half = start.alpha * duration
        a, b, across = barrier((a, b, across))
        across, a, b = turned(-2.0 * half, across), turned(half, a), turned(-half, b)
        q = jnp.stack([a[0], b[0], b[1], a[1]])
        q = jnp.where(hangs, lowered(q), q)
        # Unit length to rounding; what the start lacked of it stays.
        q = q * jnp.sqrt(attitude.norm_squared() / jnp.sum(q * q, axis=0))
        # There and back again through a and b is the same to rounding only.
        still = jnp.asarray(duration) == 0.0
        q = jnp.where(still, attitude.wxyz + 0.0 * q, q)
        across = jnp.where(still, omega[:2] + 0.0 * across, across)
        return BodyState(
            attitude=Quaternion(q),
            omega=jnp.stack([across[0], across[1], omega[2] + 0.0 * across[0]]),
        )

    def angles(self, duration: Scalar, y: BodyState) -> Vector:
        """Euler's angles after a time, psi and phi without jumps of whole turns.

        **Arguments**

        - `duration`: s, (*runs,).
        - `y`: the start; not on a vertical, which has no psi.

        **Returns** (psi, theta, phi), rad, (3, *runs); psi and phi count the turns since the start.
        """
        attitude, _ = attitude_and_omega(y)
        start, phase, hangs = self._start(duration, y)
        down, up = (
            angle + argument
            for angle, argument in zip(
                _third_angles(start, phase, duration), _arguments(start, phase), strict=True
            )
        )
        psi = down + up
        phi = down - up + 2.0 * start.alpha * duration
        first = to_euler_angles(attitude)
        later, _ = attitude_and_omega(self.flow(duration, y))
        theta = to_euler_angles(later)[1]
        return jnp.stack([first[0] + jnp.where(hangs, -psi, psi), theta, first[2] + phi])

    def _start(self, duration: Scalar, y: BodyState) -> tuple[_Start, Jacobi, Flag]:
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
        q = q / jnp.sqrt(jnp.sum(q * q, axis=0))
        hangs = Wl < 0.0
        q = jnp.where(hangs, raised(q), q)
        # Barriers between the stages: fused into one, the program compiles for much longer.
        start = barrier(_start_of(q, omega, C * omega[2] / A, 2.0 * jnp.abs(Wl) / A))
        phase = jacobi(duration, start.x, start.y, start.difference)
        return start, barrier(phase), hangs


def _start_of(q: Array, omega: Vector, N: Scalar, beta: Scalar) -> _Start:
    """The start from a unit quaternion, omega, rad/s, N, 1/s, and beta, 1/s^2, not negative."""
    Z = vertical(Quaternion(q))
    nutation = barrier(nutation_through(Quaternion(q), omega, Z, N, beta))
    circles = turning_circles(
        N,
        beta,
        nutation.alpha_up,
        nutation.gamma_up,
        nutation.alpha_down,
        nutation.gamma_down,
        nutation.start,
    )
    (upper, _), (lower, rest) = barrier(circles.half_angles())
    x = 0.25 * (circles.d + 2.0 * beta * lower)
    y = 0.5 * beta * safe_sqrt(circles.apart_squared)
    pole = -0.5 * beta * lower
    passes = pole * pole > x * y
    rho = jnp.where(passes, nutation.gamma_up / jnp.where(passes, 4.0 * lower, 1.0), 0.0)
    share, top = safe_divide(upper, lower), jnp.where(x == 0.0, 1.0, x)
    near = 0.25 * circles.d
    down = 0.5 * beta * rest
    a, b = pairs_of(q)
    rise = omega[1] * Z[0] - omega[0] * Z[1]
    return _Start(
        a,
        b,
        a_rate=0.5 * (N * times_i(a) - product(b, conjugate(omega[:2]))),
        b_rate=0.5 * (product(a, omega[:2]) - N * times_i(b)),
        x=x,
        y=y,
        difference=0.25 * (circles.d + 2.0 * beta * upper),
        above=0.5 * beta * (b[0] * b[0] + b[1] * b[1] - upper),
        rise=rise,
        bend=0.125 * beta * rise,
        down=_Pole(down, 1.0 + down / top, 0.125 * beta * nutation.gamma_down, nutation.gamma_down),
        up=_Pole(
            jnp.where(passes, x * share, near),
            jnp.where(passes, share, near / top),
            jnp.where(
                passes,
                -rho * x * y / jnp.where(passes, pole, 1.0),
                -0.125 * beta * nutation.gamma_up,
            ),
            nutation.gamma_up,
        ),
        passes=passes,
        rho=rho,
        alpha=0.5 * (omega[2] - N),
        near=near,
    )


def _amplitudes(start: _Start, s: Scalar, c: Scalar, d: Scalar) -> tuple[Array, Array]:
    """a and b within a quarter period, before they are turned.

    Over d^2, because near the separatrix c and d are as small as the tilt."""
    c, s_d = c / d, s / d
    cubic = s * s_d * s_d
    D = 1.0 + start.above * s_d * s_d
    p = 1.0 + start.down.slope * s * s
    a = (start.a * (c + start.bend * cubic) + start.a_rate * (s * D)) / (D * jnp.sqrt(p))
    p = c * c + start.up.slope * s_d * s_d
    q = start.b_rate - start.rho * times_i(start.b)
    there = start.b * p + s * (c * q - (start.rho * s_d / d) * times_i(q))
    # Where b passes this form is not taken.
    weight = jnp.where(start.passes, 0.0, start.up.weight)
    here = start.b * c - (weight * cubic) * times_i(start.b) + start.b_rate * (s * p)
    return a, jnp.where(start.passes, there, here) / (D * d * jnp.sqrt(p))


def _third_angles(start: _Start, phase: Jacobi, duration: Scalar) -> tuple[Scalar, Scalar]:
    """The angles by which a and b are turned, without alpha t, rad, and the half turns of both
    that lie behind."""
    s, c, d = phase.s, phase.c, phase.d
    down, up = start.down, start.up
    returns = phase.half_periods != 0.0
    x = jnp.where(returns, start.x, 1.0)
    least = jnp.sqrt(jnp.where(returns, start.difference, 1.0) / x)
    p = jnp.stack([1.0 + down.slope * s * s, c * c + up.slope * s * s])
    quarter = jnp.where(returns, jnp.stack([down.quarter, up.quarter]), 1.0)
    weight = jnp.stack([down.weight, up.weight])
    s, c, d, x, least = (jnp.broadcast_to(v, p.shape) for v in (s, c, d, x, least))
    within = third(s, c, d, p, weight)
    whole = weight / (3.0 * x * jnp.sqrt(x)) * complete_third(1.0 + least, least, quarter)
    # S and c change their signs in a half period, and with them a and, where it does not pass, b.
    sense = jnp.stack([_sign(down.momentum), jnp.where(start.passes, 0.0, _sign(up.momentum))])
    period = jnp.where(returns, 2.0 * whole + math.pi * sense, 0.0)
    angles = within + phase.half_periods * period
    return angles[0], angles[1] + start.rho * duration


def _third_rates(start: _Start, phase: Jacobi) -> tuple[Scalar, Scalar]:
    """The rates of the `_third_angles`, rad/s."""
    s, c, s_d = phase.s, phase.c / phase.d, phase.s / phase.d
    down = start.down.weight * s * s / (1.0 + start.down.slope * s * s)
    up = start.up.weight * s_d * s_d / (c * c + start.up.slope * s_d * s_d)
    return down, start.rho + up


def _arguments(start: _Start, phase: Jacobi) -> tuple[Scalar, Scalar]:
    """The angles by which a and b turn in `_amplitudes` since the start, rad, on the half of the
    circle that the momentum decides."""
    s, c, s_d = phase.s, phase.c / phase.d, phase.s / phase.d
    cubic, D = s * s_d * s_d, 1.0 + start.above * s_d * s_d
    a, b = jnp.sum(start.a * start.a, axis=0), jnp.sum(start.b * start.b, axis=0)
    sine = 0.25 * s * D
    down = safe_atan2(start.down.momentum * sine, a * (c + start.bend * cubic) + start.rise * sine)
    # The pole near which b turns, also where its third integral is taken at the other one.
    p = c * c + start.near * s_d * s_d
    up = safe_atan2(start.up.momentum * sine, b * c - 0.25 * start.rise * s * p)
    return down, up - safe_atan2(start.rho * s_d / phase.d, c)


def _sign(x: Scalar) -> Scalar:
    return jnp.where(x < 0.0, -1.0, 1.0)
