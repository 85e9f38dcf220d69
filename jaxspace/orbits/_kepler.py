"""Two-body motion in closed form, for every conic alike: Kepler's equation in the universal anomaly.

    tau = G1 + sigma G2 + G3                        Kepler's equation; G_n = chi^n c_n(beta chi^2), c_n: Stumpff
    rho = G0 + sigma G1 + G2 = d(tau)/d(chi)        radius
    r = (1 - G2) r0 + (tau - G3) T v0
    v = -G1/(rho T) r0 + (1 - G2/rho) v0

    symbol  meaning                                                        unit
    r0, v0  position, velocity at the start                                m, m/s
    T       |r0| sqrt(|r0| / mu), unit of time; |r0| is the unit of length s
    tau     duration                                                       T
    chi     universal anomaly: d(chi) = d(tau) / rho                       1
    sigma   r0 . v0 / sqrt(mu |r0|)                                        1
    beta    2 - v0^2 |r0| / mu = |r0| / a; 0 for a parabola                1
    p, q, e semi-latus rectum, periapsis radius (in |r0|), eccentricity    1

Source: Danby, Fundamentals of Celestial Mechanics, 6.9; starting value: Mikkola (1987), Celestial Mechanics 40, 329, here written
so that it passes through the parabola; iteration: Laguerre-Conway (1986), Celestial Mechanics 39, 199. Thomson 4.13 has the
classical forms, which lose their digits at e = 1.
Not valid through a collision (h = 0 and past the centre): there the motion of two points has no continuation. A hyperbolic
flyby that starts far away loses about as many digits as |r0|/|a| and |r0|/q have.
"""

import math

import jax
import jax.numpy as jnp

from .._core import Flag, Scalar, Vector, cross, dot, stumpff

_ITERATIONS = 3


def kepler_flow(position: Vector, velocity: Vector, duration: Scalar, mu: Scalar) -> tuple[Vector, Vector]:
    """Position, m, and velocity, m/s, a `duration`, s (either sign), later on the conic about a centre of strength `mu`, m^3/s^2.

    Shapes (3, *runs) and (*runs,). Fixed number of iterations; derivatives of every order, forward and reverse, by the implicit
    function theorem. Whole revolutions are taken off first: the error then grows with their number, as the problem does.
    One state may meet many durations or centres: the runs broadcast."""
    rank = max(position.ndim - 1, velocity.ndim - 1, jnp.ndim(duration), jnp.ndim(mu))
    position, velocity = _with_rank(position, rank), _with_rank(velocity, rank)
    r0 = jnp.sqrt(dot(position, position))
    speed_unit = jnp.sqrt(mu / r0)
    time_unit = r0 / speed_unit
    sigma = dot(position, velocity) / (r0 * speed_unit)
    beta = 2.0 - dot(velocity, velocity) / (speed_unit * speed_unit)
    h = cross(position, velocity) / (r0 * speed_unit)
    tau = _without_revolutions(duration / time_unit, beta)
    chi = _universal_anomaly(sigma, beta, tau, jax.lax.stop_gradient(dot(h, h)))
    _, g1, g2, g3 = _g_functions(chi, beta)
    rho = _radius(chi, sigma, beta)
    by_position, by_velocity = 1.0 - g2, tau - g3
    return (
        by_position * position + (by_velocity * time_unit) * velocity,
        (-g1 / (rho * time_unit)) * position + (1.0 - g2 / rho) * velocity,
    )


def universal_anomaly(sigma: Scalar, beta: Scalar, tau: Scalar, p: Scalar) -> Scalar:
    """The anomaly chi a time `tau` later, whole revolutions included; symbols and units as above, all four (*runs,)."""
    rest = _without_revolutions(tau, beta)
    return _universal_anomaly(sigma, beta, rest, p) + beta * (tau - rest)


def _with_rank(vector: Vector, rank: int) -> Vector:
    """The vector with `rank` run axes, the new ones of length one, lest its components meet the runs of a scalar."""
    runs = vector.shape[1:]
    return vector.reshape(3, *(1,) * (rank - len(runs)), *runs)


def _without_revolutions(tau: Scalar, beta: Scalar) -> Scalar:
    """The duration less its whole revolutions, within half a period; as it is on an open orbit."""
    closed = jnp.where(beta > 0.0, beta, 0.0)
    turns = jax.lax.stop_gradient(jnp.round(tau * (closed * jnp.sqrt(closed) / (2.0 * math.pi))))
    some = turns != 0.0
    closed = jnp.where(some, closed, 1.0)
    return tau - jnp.where(some, turns * (2.0 * math.pi) / (closed * jnp.sqrt(closed)), 0.0)


def _g_functions(chi: Scalar, beta: Scalar) -> tuple[Scalar, Scalar, Scalar, Scalar]:
    c0, c1, c2, c3 = stumpff(beta * chi * chi)
    return c0, chi * c1, chi * chi * c2, chi * chi * chi * c3


def _residual(chi: Scalar, sigma: Scalar, beta: Scalar, tau: Scalar) -> Scalar:
    """How much later than tau the anomaly chi is reached."""
    _, g1, g2, g3 = _g_functions(chi, beta)
    return g1 + sigma * g2 + g3 - tau


def _radius(chi: Scalar, sigma: Scalar, beta: Scalar) -> Scalar:
    g0, g1, g2, _ = _g_functions(chi, beta)
    return g0 + sigma * g1 + g2


@jax.custom_jvp
def _universal_anomaly(sigma: Scalar, beta: Scalar, tau: Scalar, p: Scalar) -> Scalar:
    """The root chi of Kepler's equation. p is a function of sigma and beta, passed because it suffers when computed from them."""
    chi = _starter(sigma, beta, tau, p)
    for _ in range(_ITERATIONS):
        chi = chi + _laguerre_step(chi, sigma, beta, tau)
    return chi


@_universal_anomaly.defjvp
def _universal_anomaly_jvp(primals, tangents):
    *parameters, p = primals
    chi = _universal_anomaly(*parameters, p)
    _, change = jax.jvp(lambda *a: _residual(chi, *a), tuple(parameters), tuple(tangents[:-1]))
    return chi, -change / _radius(chi, *parameters[:2])


def _laguerre_step(chi: Scalar, sigma: Scalar, beta: Scalar, tau: Scalar) -> Scalar:
    """Correction of chi: Laguerre's method with n = 5, of third order, which has no way to leave the bracket of a good start."""
    g0, g1, g2, g3 = _g_functions(chi, beta)
    late, rho = g1 + sigma * g2 + g3 - tau, g0 + sigma * g1 + g2
    rho_slope = sigma * g0 + (1.0 - beta) * g1
    root = jnp.sqrt(jnp.abs(16.0 * rho * rho - 20.0 * late * rho_slope))
    return -5.0 * late / (rho + root)


def _starter(sigma: Scalar, beta: Scalar, tau: Scalar, p: Scalar) -> Scalar:
    """Mikkola's approximate anomaly, counted from periapsis, less that at the start: within a few per cent for every conic.

    A parabola is started as a conic with a/|r0| = 1e20, because both forms end in the same limit."""
    closed = beta > 0.0
    b = jnp.where(closed, jnp.maximum(beta, 1e-20), jnp.minimum(beta, -1e-20))
    s, zeta = jnp.sqrt(jnp.abs(b)), 1.0 - beta
    e = jnp.sqrt(jnp.where(closed, zeta * zeta + b * sigma * sigma, 1.0 - b * p))
    safe_e = jnp.maximum(e, 1e-30)
    from_periapsis = jnp.where(closed, jnp.arctan2(s * sigma, zeta), jnp.arcsinh(s * sigma / safe_e))
    chi0, q = from_periapsis / s, p / (1.0 + e)
    since_periapsis = q * chi0 + e * _g_functions(chi0, beta)[3] + tau
    s3 = s * s * s
    turns = jnp.where(closed, jnp.round(since_periapsis * (s3 / (2.0 * math.pi))), 0.0)
    t = since_periapsis - turns * (2.0 * math.pi) / s3
    return (_mikkola(t, closed, s, e, safe_e, q) + 2.0 * math.pi * turns - from_periapsis) / s


def _mikkola(t: Scalar, closed: Flag, s: Scalar, e: Scalar, safe_e: Scalar, q: Scalar) -> Scalar:
    """Eccentric (or hyperbolic) anomaly a time t after periapsis: the sine of its third by a cubic, then one correction."""
    k = 4.0 * e + 0.5
    a, b = q / k, 0.5 * t / k
    z = jnp.cbrt(jnp.abs(b) + jnp.sqrt(b * b + a * a * a))
    z2 = jnp.maximum(z * z, 1e-30)
    x = s * 2.0 * b / (z2 + a + a * a / z2)
    x2 = x * x
    x5 = x2 * x2 * x
    u = x - 0.078 * x5 / (1.0 + e)
    w = x + 0.071 * x5 / ((1.0 + 0.45 * x2) * (1.0 + 4.0 * x2) * safe_e)
    return jnp.where(closed, s * s * s * t + e * (3.0 - 4.0 * u * u) * u, 3.0 * jnp.arcsinh(w))
