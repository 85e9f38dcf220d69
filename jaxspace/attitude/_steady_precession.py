"""The steady precession of a heavy symmetric top, the least spin that has one, and the small
motions about it. Equations, symbols and units in `_top.py`.

    A cos(theta) psi'^2 - C n psi' + W l = 0         A psi'^2 - h_Z psi' + W l cos(theta) = 0
    (C n)^2 >= 4 A W l cos(theta)                    the condition that roots exist
    V'(theta) = (h_Z - C n cos(theta))^2 / (2 A sin^2(theta)) + W l cos(theta)

Each function implements the method of `Top` whose name equals, or ends with, the name of the
function. Near the least spin the radicand is formed from differences of spins: nothing cancels, and
it is zero exactly there.

With s and c, sine and cosine of theta / 2, the pseudo-potential is

    V' = [(h_Z - C n) c/s + (h_Z + C n) s/c]^2 / (8 A) + W l (1 - 2 s^2)

which is accurate near both verticals, and is convex in cos(theta): it has one minimum, the
steady precession of these momenta, or the vertical where a top sleeps.

Source: Thomson 5.14-3, -4 (steady precession), 6.1-5 (small nutation); Harrison and Nettleton 4.11
(sleeping top, pseudo-potential).
"""

import jax
import jax.numpy as jnp

from ..core import Scalar
from ..core.barrier import barrier, computed_once
from ..core.roots import increasing_root
from ..core.safe import end_sqrt
from ..core.squares import quotient


def steady_rates(
    A: Scalar, C: Scalar, Wl: Scalar, theta: Scalar, n: Scalar
) -> tuple[Scalar, Scalar]:
    """The slow and the fast rate psi', rad/s, for the spin `n`, rad/s."""
    least = _constant(least_spin(A, C, Wl, theta))
    # Both from the root of larger magnitude and the product of the roots: nothing cancels for a
    # fast top or near the horizontal.
    p = C * n
    p = p + jnp.where(p < 0.0, -1.0, 1.0) * end_sqrt(_gyroscopic, A, C, Wl, theta, n, least)
    return 2.0 * Wl / p, p / (2.0 * A * jnp.cos(theta))


def rates_from_momentum(A: Scalar, Wl: Scalar, theta: Scalar, h_Z: Scalar) -> tuple[Scalar, Scalar]:
    """The slow and the fast rate psi', rad/s, for the momentum `h_Z`, kg m^2/s."""

    def radicand(A, Wl, theta, h_Z, least):
        return _gyroscopic(A, jnp.ones_like(h_Z), Wl, theta, h_Z, least)

    least = _constant(2.0 * jnp.sqrt(jnp.maximum(A * Wl * jnp.cos(theta), 0.0)))
    # The root of larger magnitude first, so that nothing cancels.
    p = h_Z + jnp.where(h_Z < 0.0, -1.0, 1.0) * end_sqrt(radicand, A, Wl, theta, h_Z, least)
    return 2.0 * (Wl * jnp.cos(theta)) / p, p / (2.0 * A)


def least_spin(A: Scalar, C: Scalar, Wl: Scalar, theta: Scalar) -> Scalar:
    """The least n, rad/s, with a steady precession at `theta`, rad."""

    def radicand(A, Wl, theta):
        return jnp.maximum(A * Wl * jnp.cos(theta), 0.0)

    return 2.0 / C * end_sqrt(radicand, A, Wl, theta)


def sleeping_growth_rate(A: Scalar, C: Scalar, Wl: Scalar, n: Scalar) -> Scalar:
    """Growth rate, 1/s, of a small tilt of the upright top."""

    def radicand(A, C, Wl, n, critical):
        x = 4.0 * A * Wl - (C * n) ** 2
        # The same, without the rounding of a difference of squares.
        size = jnp.abs(n)
        exact = C * C * (critical - size) * (critical + size)
        return jnp.maximum(x + jax.lax.stop_gradient(exact - x), 0.0)

    critical = _constant(least_spin(A, C, Wl, jnp.zeros_like(n)))
    return end_sqrt(radicand, A, C, Wl, n, critical) / (2.0 * A)


def nutation_frequency(
    A: Scalar, C: Scalar, Wl: Scalar, theta: Scalar, precession: Scalar, n: Scalar
) -> Scalar:
    """Angular frequency, rad/s, of a small nutation about a steady precession."""

    def radicand(A, C, Wl, theta, precession, n, least):
        around = A * precession * jnp.sin(theta)
        return _gyroscopic(A, C, Wl, theta, n, least) + around * around

    least = _constant(least_spin(A, C, Wl, theta))
    return end_sqrt(radicand, A, C, Wl, theta, precession, n, least) / A


def pseudo_potential(
    A: Scalar, C: Scalar, Wl: Scalar, theta: Scalar, h_Z: Scalar, n: Scalar
) -> Scalar:
    """V', J, at `theta`, rad, for the momentum `h_Z`, kg m^2/s, and the spin `n`, rad/s."""
    s, c = jnp.sin(0.5 * theta), jnp.cos(0.5 * theta)
    p = barrier(C * n)  # rounded once: a product within the difference would not vanish
    up, down = h_Z - p, h_Z + p
    # The vertical is not a pole where the momenta let the axis pass.
    upright = s == 0.0
    around = jnp.where(upright, 0.0, quotient(up * c, jnp.where(upright, 1.0, s))) + down * s / c
    V = around * around / (8.0 * A) + Wl * (1.0 - 2.0 * s * s)
    return jnp.where(upright & (up != 0.0), jnp.inf, V)


def pseudo_potential_minimum(A: Scalar, C: Scalar, Wl: Scalar, h_Z: Scalar, n: Scalar) -> Scalar:
    """The theta, rad, of the least V'."""
    p = barrier(C * n)  # rounded once: a product within the difference would not vanish
    up, down = h_Z - p, h_Z + p
    # A top that sleeps: the axis stays at a vertical that it can reach.
    stands = (up == 0.0) & (down * down >= 16.0 * A * Wl)
    hangs = (down == 0.0) & (up * up + 16.0 * A * Wl >= 0.0)
    sleeps = stands | hangs
    # Other momenta in the branch that is not taken, so that its root is not at an end.
    up, down = (jnp.where(sleeps, C, momentum) for momentum in (up, down))

    def fall(theta: Scalar) -> Scalar:
        """-16 A s^4 c^4 times the slope of V' by cos(theta)."""
        s, c = jnp.sin(0.5 * theta), jnp.cos(0.5 * theta)
        lift = jnp.where(sleeps, 0.0, 16.0 * A * Wl) * (s * c) ** 4
        return (down * s * s) ** 2 - (up * c * c) ** 2 - lift

    inside = increasing_root(fall, jnp.zeros_like(up), jnp.full_like(up, jnp.pi))
    return jnp.where(sleeps, jnp.where(stands, 0.0, jnp.pi), inside)


@computed_once
def _constant(x: Scalar) -> Scalar:
    """A value without derivatives, rounded once for every use."""
    return jax.lax.stop_gradient(x)


def _gyroscopic(
    A: Scalar, C: Scalar, Wl: Scalar, theta: Scalar, n: Scalar, least: Scalar
) -> Scalar:
    """(C n)^2 - 4 A W l cos(theta), zero exactly at the `least` spin; its derivatives are those of
    this formula."""
    x = (C * n) ** 2 - 4.0 * A * Wl * jnp.cos(theta)
    # The same, without the rounding of a difference of squares.
    size = jnp.abs(n)
    below = 4.0 * A * jnp.maximum(-Wl * jnp.cos(theta), 0.0)
    exact = C * C * (size - least) * (size + least) + below
    return x + jax.lax.stop_gradient(exact - x)
