"""Two-body motion in closed form, one formula for every conic.

    G_n = chi^n c_n(beta chi^2)                     c_n: Stumpff functions
    tau = G1 + sigma G2 + G3                        Kepler's equation in the universal anomaly
    rho = G0 + sigma G1 + G2 = d(tau)/d(chi)        radius
    r = (1 - G2) r0 + (tau - G3) T v0
    v = -G1/(rho T) r0 + (1 - G2/rho) v0
    d(G_n)/d(chi) = G_(n-1),  d(G_n)/d(beta) = (n G_(n+2) - chi G_(n+1))/2

    symbol  meaning                                                        unit
    r0, v0  position, velocity at the start                                m, m/s
    T       |r0| sqrt(|r0| / mu), unit of time; |r0| is the unit of length s
    tau     duration                                                       T
    chi     universal anomaly: d(chi) = d(tau) / rho                       1
    sigma   r0 . v0 / sqrt(mu |r0|)                                        1
    beta    2 - v0^2 |r0| / mu = |r0| / a; 0 for a parabola                1
    p       h^2 / (mu |r0|), semi-latus rectum                             1

Source: Danby, Fundamentals of Celestial Mechanics, 6.9. Thomson 4.13 has the classical forms, which
lose their digits at e = 1.

The error is that of the rounding of the inputs, of each vector by its length. This also applies to
a flyby from afar, where the terms of Kepler's equation above nearly cancel: the anomaly is computed
from the form about periapsis (`_anomaly.py`). Derivatives of such a flyby lose up to two digits
more.

Near the parabola the inputs determine the energy to few digits: at periapsis beta = 1 - e is the
small difference 2 - v0^2 |r0|/mu, and half a unit in the last place of v0 changes the energy by a
relative 1e-16/(1 - e). So at e = 1 - 1e-8 the energy of a propagated state has a relative error of
2e-8, as have the period, the semi-major axis and, after a revolution, the position along the orbit.
More digits in beta would follow one rounded state more closely, not the motion that was meant; for
an orbit of a given small 1 - e, start away from periapsis, where |r0| is of the order of a and v0
is small.

Not valid through a collision (h = 0 and past the centre): there the motion of two points has no
continuation.
"""

__all__ = ["kepler_flow"]

import jax
import jax.numpy as jnp
import numpy as np

from ..core import Scalar, Vector, check
from ..core.barrier import barrier
from ..core.blocks import in_blocks
from ..core.checks import is_concrete
from ..core.formula import FINITE, NOT_NEGATIVE, formula
from ..core.one_kernel import in_one_kernel
from ..core.shapes import with_rank
from ..core.special import stumpff
from ..core.squares import quotient, unit_factor
from ..core.vectors import components, cross, dot, norm
from ._anomaly import Anomaly, anomaly_after
from ._rectilinear import rectilinear_motion


@formula(duration=FINITE, mu=NOT_NEGATIVE)
def kepler_flow(
    position: Vector, velocity: Vector, duration: Scalar, mu: Scalar
) -> tuple[Vector, Vector]:
    """Position and velocity after a given duration.

    **Arguments**

    - `position`, m, and `velocity`, m/s: at the start, (3, *runs).
    - `duration`: s, (*runs,), of either sign.
    - `mu`: gravitational parameter of the centre, m^3/s^2, (*runs,).

    **Returns** the position, m, and the velocity, m/s, (3, *runs). The batch axes broadcast: one
    state can be combined with many durations or centres.

    Computed without a loop. Derivatives of every order, forward and reverse, follow from the
    implicit function theorem. Whole revolutions are subtracted first, so that the error grows in
    proportion to their number, as the sensitivity of the problem does. Where `mu` is zero, the
    motion is a straight line, with its first derivative by mu.

    **Raises** `InputError` for a position at the centre, a duration that is not finite and a
    negative `mu`; under `jit`, where they are not concrete, the result is NaN.
    """
    if is_concrete(position):
        place = np.asarray(position)
        check(np.any(place != 0.0, axis=0), "position", place, "away from the centre")
    if is_concrete(mu) and np.all(np.asarray(mu) > 0.0):
        return conic_flow(position, velocity, duration, mu)
    return in_blocks(_flow, (1, 1, 0, 0), position, velocity, duration, mu)


def conic_flow(
    position: Vector, velocity: Vector, duration: Scalar, mu: Scalar
) -> tuple[Vector, Vector]:
    """`kepler_flow` for a positive `mu`: a smaller program, and NaN where `mu` is not positive."""
    return in_blocks(_conic, (1, 1, 0, 0), position, velocity, duration, mu)


def _flow(
    position: Vector, velocity: Vector, duration: Scalar, mu: Scalar
) -> tuple[Vector, Vector]:
    straight = mu == 0.0
    rank = max(position.ndim - 1, velocity.ndim - 1, jnp.ndim(duration), jnp.ndim(mu))
    position, velocity = with_rank(position, rank), with_rank(velocity, rank)
    # Any conic in place of the line, so that the branch which is not taken is finite.
    other = jnp.sqrt(dot(position, position)) * dot(velocity, velocity)
    other = jax.lax.stop_gradient(jnp.where(other > 0.0, other, 1.0))
    r, v = _conic(position, velocity, duration, jnp.where(straight, other, mu))
    line_r, line_v = rectilinear_motion(position, velocity, duration, jnp.where(straight, mu, 0.0))
    return jnp.where(straight, line_r, r), jnp.where(straight, line_v, v)


def _conic(
    position: Vector, velocity: Vector, duration: Scalar, mu: Scalar
) -> tuple[Vector, Vector]:
    rank = max(position.ndim - 1, velocity.ndim - 1, jnp.ndim(duration), jnp.ndim(mu))
    position = with_rank(position, rank)
    velocity = with_rank(velocity, rank)
    length = unit_factor(*components(position))
    if isinstance(length, float):
        return _motion(position, velocity, duration, mu)
    # In metres, products within the derivatives leave the range of float32.
    speed = unit_factor(jnp.sqrt(mu * length), *components(velocity))
    r, v = _motion(
        length * position,
        speed * velocity,
        duration * (length / speed),
        mu * (length * speed * speed),
    )
    return r / length, v / speed


def _motion(
    position: Vector, velocity: Vector, duration: Scalar, mu: Scalar
) -> tuple[Vector, Vector]:
    r0, v2 = norm(position), dot(velocity, velocity)
    # A weaker centre bends the path by less than a rounding, and e^2 would leave the range of
    # float32. The derivative by mu is the same.
    least = float(jnp.finfo(r0.dtype).eps) ** 2 * (r0 * v2)
    weak = (mu > 0.0) & (mu < least)
    mu = mu + jax.lax.stop_gradient(jnp.where(weak, least - mu, 0.0))
    # In units of |r0| and of the circular speed, so that no product leaves the range of float32.
    r0, speed_unit = barrier((r0, jnp.sqrt(quotient(mu, r0))))
    scale = quotient(1.0, r0 * speed_unit)
    sigma = dot(position, velocity) * scale
    beta = 2.0 - quotient(v2, speed_unit * speed_unit)
    h = cross(position, velocity) * scale
    time_unit = quotient(r0, speed_unit)
    # p is a function of sigma and beta, whose derivatives include those of p.
    p = jax.lax.stop_gradient(dot(h, h))
    sigma, beta, tau, p = barrier((sigma, beta, quotient(duration, time_unit), p))
    end = _anomaly(sigma, beta, tau, p)
    g1 = end.chi - beta * end.g3
    f = 1.0 - end.g2
    g = (end.left - end.g3) * time_unit
    rate_f = quotient(-g1, end.rho * time_unit)
    rate_g = 1.0 - end.g2 / end.rho
    # Each factor is shared by three components.
    f, g, rate_f, rate_g = barrier((f, g, rate_f, rate_g))
    return f * position + g * velocity, rate_f * position + rate_g * velocity


def universal_anomaly(sigma: Scalar, beta: Scalar, tau: Scalar, p: Scalar) -> Scalar:
    """The anomaly chi after a duration `tau`, including whole revolutions.

    All arguments and the result are in the symbols and units of the module, (*runs,)."""
    end = _anomaly(sigma, beta, tau, jax.lax.stop_gradient(p))
    return end.chi + beta * (tau - end.left)


@jax.custom_jvp
def _anomaly(sigma: Scalar, beta: Scalar, tau: Scalar, p: Scalar) -> Anomaly:
    given = sigma, beta, tau, p
    alone = not any(jnp.ndim(x) for x in given)
    return in_one_kernel(anomaly_after, *given) if alone else anomaly_after(*given)


@_anomaly.defjvp
def _anomaly_jvp(
    primals: tuple[Scalar, ...], tangents: tuple[Scalar, ...]
) -> tuple[Anomaly, Anomaly]:
    # The implicit function theorem on Kepler's equation. The rule uses the functions of the result
    # itself, so that derivatives of every order follow from it.
    sigma, beta, tau, _ = primals
    dsigma, dbeta, dtau, _ = tangents
    end = _anomaly(*primals)
    chi, g2, g3, rho, slope, left = end
    x2 = chi * chi
    *_, c4, c5 = stumpff(beta * x2)
    g0 = 1.0 - beta * g2
    g1 = chi - beta * g3
    g4 = x2 * x2 * c4
    g5 = x2 * x2 * chi * c5
    # b_n = d(G_n)/d(beta) at a fixed chi.
    b0 = -0.5 * chi * g1
    b1 = 0.5 * (g3 - chi * g2)
    b2 = g4 - 0.5 * chi * g3
    b3 = 0.5 * (3.0 * g5 - chi * g4)
    # The time of the whole turns taken off depends on beta, as beta^(-3/2).
    turned = left != tau
    dleft = dtau + jnp.where(turned, 1.5 * (tau - left) / jnp.where(turned, beta, 1.0), 0.0) * dbeta
    dchi = (dleft - g2 * dsigma - (b1 + sigma * b2 + b3) * dbeta) / rho
    return end, Anomaly(
        dchi,
        g1 * dchi + b2 * dbeta,
        g2 * dchi + b3 * dbeta,
        slope * dchi + g1 * dsigma + (b0 + sigma * b1 + b2) * dbeta,
        (1.0 - beta * rho) * dchi + g0 * dsigma + (sigma * b0 - g1 + (1.0 - beta) * b1) * dbeta,
        dleft,
    )
