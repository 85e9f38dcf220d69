"""Transfers by tangential impulses at the apsides: Hohmann, bi-elliptic, between coaxial ellipses.

    v(r, s) = sqrt(2 mu s / (r (r + s)))                 speed at the apsis r, the other one at s
    dv = v(r, s') - v(r, s)                              impulse at r that moves the other apsis
    half a revolution: pi sqrt(a^3/mu),  a = (r + s)/2

    symbol  meaning                          unit
    r, s    radii of the two apsides         m
    dv      increment along the velocity     m/s

Source: Thomson 4.11-3..9 (in 4.11-9 the left side is the total of both impulses), 4.12-1..6.

Increments have a sign: positive along the velocity. They are computed as differences without
cancellation, so that small changes of the orbit are accurate.
"""

__all__ = [
    "ImpulsiveTransfer",
    "apsidal_impulse",
    "bielliptic_transfer",
    "coaxial_transfer",
    "hohmann_transfer",
]

import math
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import Scalar
from ..core.formula import ABOVE_ZERO, POSITIVE, formula
from ..core.printing import printed
from ..core.squares import quotient
from ..core.types import as_float


@printed(impulses="m/s", durations="s")
class ImpulsiveTransfer(NamedTuple):
    """Cost of a transfer.

    - `impulses`: increments of speed in their order, m/s, (impulses, *runs); negative against the
      velocity.
    - `durations`: of the arcs between them, s, (impulses - 1, *runs)."""

    impulses: Float[Array, "impulses *#runs"]
    durations: Float[Array, "arcs *#runs"]

    @property
    def total(self) -> Scalar:
        """Sum of the sizes of the impulses, m/s. Where one is zero, its size has a corner, with the
        derivative zero."""
        return jnp.sum(jnp.abs(self.impulses), axis=0)

    @property
    def duration(self) -> Scalar:
        """Time from the first to the last impulse, s."""
        return jnp.sum(self.durations, axis=0)


@formula(radius=ABOVE_ZERO, before=ABOVE_ZERO, after=ABOVE_ZERO, mu=POSITIVE)
def apsidal_impulse(radius: Scalar, before: Scalar, after: Scalar, mu: Scalar) -> Scalar:
    """The increment of speed at an apsis that moves the opposite apsis (Thomson 4.12).

    **Arguments**, each (*runs,)

    - `radius`: of the apsis at which the impulse acts, m.
    - `before`, `after`: radius of the opposite apsis, m; infinite on a parabola, for one of the
      two. All three are the same on a circle.
    - `mu`: gravitational parameter, m^3/s^2.

    **Returns** the increment along the velocity, m/s, (*runs,).

    **Raises** `InputError` for a number that is not above zero.
    """
    r = as_float(radius)
    s = as_float(before)
    s2 = as_float(after)
    speeds = _apsis_speed(r, s, mu) + _apsis_speed(r, s2, mu)
    # (s2 - s) / ((r + s2) (r + s)), of which one may be infinite.
    open_s, open_s2 = jnp.isinf(s), jnp.isinf(s2)
    t, t2 = jnp.where(open_s, r, s), jnp.where(open_s2, r, s2)
    share = quotient(t2 - t, (r + t2) * (r + t))
    share = jnp.where(open_s2, 1.0 / (r + t), jnp.where(open_s, -1.0 / (r + t2), share))
    return 2.0 * mu * share / speeds


def _apsis_speed(r: Scalar, s: Scalar, mu: Scalar) -> Scalar:
    """Speed at the apsis `r` of the orbit whose other apsis is at `s`."""
    # By r/s, which is zero for an infinite s, where s / (r + s) would be NaN.
    return jnp.sqrt(2.0 * mu / (r * (1.0 + r / s)))


def half_revolution(radius: Scalar, opposite: Scalar, mu: Scalar) -> Scalar:
    """Time from the apsis at the `radius`, m, to the `opposite` one, m, in s; `mu`, m^3/s^2."""
    a = 0.5 * (as_float(radius) + opposite)
    return math.pi * a * jnp.sqrt(quotient(a, mu))


@formula(
    departure=ABOVE_ZERO,
    departure_opposite=ABOVE_ZERO,
    arrival=ABOVE_ZERO,
    arrival_opposite=ABOVE_ZERO,
    mu=POSITIVE,
)
def coaxial_transfer(
    departure: Scalar,
    departure_opposite: Scalar,
    arrival: Scalar,
    arrival_opposite: Scalar,
    mu: Scalar,
) -> ImpulsiveTransfer:
    """Transfer from an apsis of one ellipse to an apsis of another on the same line of apsides,
    half a revolution on (Thomson 4.12).

    **Arguments**, each (*runs,)

    - `departure`, `departure_opposite`: radius of the apsis at which the first ellipse is left, and
      of its other apsis, m.
    - `arrival`, `arrival_opposite`: radius of the apsis at which the second one is reached, on the
      other side of the centre, and of its other apsis, m.
    - `mu`: gravitational parameter, m^3/s^2.

    **Returns** two impulses and the duration between them.

    **Raises** `InputError` for a number that is not above zero.
    """
    impulses = (
        apsidal_impulse(departure, departure_opposite, arrival, mu),
        apsidal_impulse(arrival, departure, arrival_opposite, mu),
    )
    return _transfer(impulses, (half_revolution(departure, arrival, mu),))


@formula(start=ABOVE_ZERO, end=ABOVE_ZERO, mu=POSITIVE)
def hohmann_transfer(start: Scalar, end: Scalar, mu: Scalar) -> ImpulsiveTransfer:
    """Transfer from a circle to another one in the same plane by two impulses (Thomson 4.11).

    **Arguments**, each (*runs,)

    - `start`, `end`: radii of the circles, m; the second may be the smaller one.
    - `mu`: gravitational parameter, m^3/s^2.

    **Returns** two impulses and the duration between them.

    **Raises** `InputError` for a number that is not above zero.
    """
    return coaxial_transfer(start, start, end, end, mu)


@formula(start=ABOVE_ZERO, between=ABOVE_ZERO, end=ABOVE_ZERO, mu=POSITIVE)
def bielliptic_transfer(
    start: Scalar, between: Scalar, end: Scalar, mu: Scalar
) -> ImpulsiveTransfer:
    """Transfer from a circle to another one by three impulses, over an apsis farther out.

    **Arguments**, each (*runs,)

    - `start`, `end`: radii of the circles, m.
    - `between`: radius of the second impulse, m. See `bielliptic_break_even` for where it pays.
    - `mu`: gravitational parameter, m^3/s^2.

    **Returns** three impulses and the durations of the two arcs.

    **Raises** `InputError` for a number that is not above zero.
    """
    impulses = (
        apsidal_impulse(start, start, between, mu),
        apsidal_impulse(between, start, end, mu),
        apsidal_impulse(end, between, end, mu),
    )
    return _transfer(
        impulses, (half_revolution(start, between, mu), half_revolution(between, end, mu))
    )


def _transfer(impulses: tuple[Scalar, ...], durations: tuple[Scalar, ...]) -> ImpulsiveTransfer:
    runs = jnp.broadcast_arrays(*impulses, *durations)
    return ImpulsiveTransfer(jnp.stack(runs[: len(impulses)]), jnp.stack(runs[len(impulses) :]))
