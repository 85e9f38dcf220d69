"""The steady circles of a rolling disk, and the small oscillations about them. Equations, symbols
and units in `_rolling_disk.py`.

    J theta'' = G = A psi'^2 sin cos - K n psi' sin - m g R cos
    [A psi' cos(theta) - K n] psi' sin(theta) = m g R cos(theta)           steady circle
    theta~'' + kappa theta~ = 0,   kappa = -(dG/dtheta)/J along psi'(theta), n(theta)

Each function computes the method of `RollingDisk` that has its name, from the `disk`: A, C, m R^2
and m g R.

Source: Thomson 5.16-14 to -33, with -n for his omega_zeta.
"""

import jax
import jax.numpy as jnp

from ..core import Scalar
from ..core.safe import end_sqrt

Disk = tuple[Scalar, Scalar, Scalar, Scalar]


def tilt_acceleration(disk: Disk, theta: Scalar, precession: Scalar, spin: Scalar) -> Scalar:
    """theta'', rad/s^2 (Thomson 5.16-14)."""
    A, C, mRR, mgR = disk
    s, c = jnp.sin(theta), jnp.cos(theta)
    gyroscopic = (A * precession * c - (C + mRR) * spin) * precession
    return (gyroscopic * s - mgR * c) / (A + mRR)


def steady_spin(disk: Disk, theta: Scalar, precession: Scalar) -> Scalar:
    """The spin n, rad/s, for which the tilt is constant on a circle; infinite without
    precession."""
    A, C, mRR, mgR = disk
    balance = A * precession * jnp.cos(theta) - mgR / jnp.tan(theta) / precession
    return balance / (C + mRR)


def steady_precession_rates(disk: Disk, theta: Scalar, spin: Scalar) -> tuple[Scalar, Scalar]:
    """Both rates psi', rad/s, for which the tilt is constant at this spin, the slow one first; NaN
    without one."""
    A, C, mRR, mgR = disk
    p, q = (C + mRR) * spin, A * jnp.cos(theta)
    pull = mgR / jnp.tan(theta)
    # Of both roots of q psi'^2 - p psi' = pull the larger one first: nothing cancels.
    large = p + jnp.where(p > 0.0, 1.0, -1.0) * jnp.sqrt(p * p + 4.0 * q * pull)
    return -2.0 * pull / large, 0.5 * large / q


def tilt_stiffness(disk: Disk, theta: Scalar, precession: Scalar, spin: Scalar) -> Scalar:
    """kappa, 1/s^2: the square of the frequency of small oscillations, negative where they grow."""
    A, C, mRR, _ = disk

    def acceleration(tilt: Scalar) -> Scalar:
        """theta'' at a tilt near the circle, for the momenta that the motion conserves."""
        # The rates about the two axes in the plane of Z, to first order about this place.
        rate = (C * spin - 2.0 * A * precession * jnp.cos(theta)) / (A * jnp.sin(theta))
        slow = mRR * precession * jnp.sin(theta) / (C + mRR)
        step = tilt - theta
        return tilt_acceleration(disk, tilt, precession + rate * step, spin + slow * step)

    return -jax.jvp(acceleration, (theta,), (jnp.ones_like(theta),))[1]


def growth_rate(disk: Disk, theta: Scalar, precession: Scalar, spin: Scalar) -> Scalar:
    """The rate, 1/s, at which a perturbation of the circle grows; zero if the circle is stable."""
    # All are arguments, because a radicand has no derivative by what it closes over.
    return end_sqrt(_instability, *disk, theta, precession, spin)


def _instability(
    A: Scalar, C: Scalar, mRR: Scalar, mgR: Scalar, theta: Scalar, precession: Scalar, spin: Scalar
) -> Scalar:
    """-kappa, where that is positive."""
    return jnp.maximum(-tilt_stiffness((A, C, mRR, mgR), theta, precession, spin), 0.0)
