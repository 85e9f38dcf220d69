"""Lambert's problem: the conic that connects two positions in a given time.

Short way or long way, with or without whole revolutions.

    v1 = (gamma / |r1|) ((lambda y (1 - rho) - x (1 + rho)) i1 + sigma zeta t1)
    v2 = (gamma / |r2|) ((x (1 - rho) - lambda y (1 + rho)) i2 + sigma zeta t2)
    gamma = sqrt(mu s / 2),  rho = (|r1| - |r2|) / c,  sigma = sqrt(1 - rho^2)
    zeta = y + lambda x = kappa / eta

    symbol     meaning                                                                 unit
    r1, r2     places at the start and at the end; i1, i2: their unit vectors          m
    t1, t2     unit vectors along the motion, normal to i1, i2 in the plane            1
    c, s       chord |r2 - r1|, half of |r1| + |r2| + c                                m
    x, y, eta, lambda, kappa    as in _transfer_time.py                                1

Source: Thomson 4.16 states the problem; Izzo (2015), Celestial Mechanics 121, 1.

Not unique where both positions coincide or are opposite each other: there a `normal` must select
the plane, and derivatives are restricted to it. Where the plane of the positions contains the
`normal`, the sense of the motion is undefined.
"""

__all__ = ["TransferStatus", "lambert", "least_duration", "transfer_status"]

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Int

from ..core import InputError, Scalar, Vector, check
from ..core.barrier import barrier
from ..core.formula import POSITIVE, formula
from ..core.shapes import with_rank
from ..core.square_roots import inverse_sqrt
from ..core.squares import quotient, unit_factor
from ..core.tracing import is_traced
from ..core.vectors import axis, components, cross, dot, norm, unit
from ._conic_of_time import conic_of_time, least_time
from ._transfer_status import (
    TransferStatus,
    geometry_status,
    rounding_of_directions,
    way_is_undecided,
)
from ._transfer_time import transfer_time


class _Chord(NamedTuple):
    """The triangle of the centre and the two places, in the symbols of the module.

    `rise` is |r2| - |r1|, `root` is sqrt(|r1| |r2|), and `sine` is 2 sin(theta/2) of the angle
    theta of the transfer."""

    r1: Scalar
    r2: Scalar
    c: Scalar
    s: Scalar
    rise: Scalar
    root: Scalar
    sine: Scalar
    i1: Vector
    i2: Vector
    t1: Vector
    t2: Vector
    lam: Scalar
    kappa: Scalar


@formula(mu=POSITIVE)
def lambert(
    start: Vector,
    end: Vector,
    duration: Scalar,
    mu: Scalar,
    *,
    normal: Vector | None = None,
    revolutions: int = 0,
    low: bool = True,
) -> tuple[Vector, Vector]:
    """The velocities at both ends of the transfer from `start` to `end` in a given duration.

    **Arguments**

    - `start`, `end`: positions, m, (3, *runs).
    - `duration`: s, (*runs,).
    - `mu`: gravitational parameter of the centre, m^3/s^2, (*runs,).
    - `normal`: the axis about which the motion turns counterclockwise, (3, *runs); the third axis
      by default. It selects the short or the long way, for which it must not be in the plane of the
      positions. For positions half a revolution apart it selects the plane and is required.
    - `revolutions`: whole revolutions before the arrival.
    - `low`: with one or more revolutions there are two transfers; whether to take the one that
      leaves lower above the horizon.

    **Returns** the velocities at `start` and at `end`, m/s, (3, *runs); the runs broadcast. In a
    batch and under a transformation, a run without a unique transfer is NaN and does not affect the
    others: `transfer_status` gives the reason. Derivatives of every order, forward and reverse,
    follow from the implicit function theorem.

    **Raises** `InputError` for `revolutions` below zero, for a `mu` that is not positive, and for
    concrete inputs of a single transfer that does not exist or is not unique (`TransferStatus`).
    """
    check(revolutions >= 0, "lambert: revolutions", revolutions, "zero or more")
    v1, v2, status = _transfer(start, end, duration, mu, normal, revolutions, low)
    if status.ndim == 0 and not is_traced(status) and status != TransferStatus.FOUND:
        raise InputError(f"lambert: {TransferStatus(int(status)).sentence}")
    result = status == TransferStatus.FOUND
    return jnp.where(result, v1, jnp.nan), jnp.where(result, v2, jnp.nan)


@formula(mu=POSITIVE)
def transfer_status(
    start: Vector,
    end: Vector,
    duration: Scalar,
    mu: Scalar,
    *,
    normal: Vector | None = None,
    revolutions: int = 0,
) -> Int[Array, "*runs"]:
    """The reason why `lambert` has no solution, for each run.

    **Arguments** as in `lambert`.

    **Returns** a `TransferStatus` for each run, (*runs,).

    **Raises** `InputError` for `revolutions` below zero.
    """
    check(revolutions >= 0, "transfer_status: revolutions", revolutions, "zero or more")
    return _transfer(start, end, duration, mu, normal, revolutions, True)[2]


def _transfer(
    start: Vector,
    end: Vector,
    duration: Scalar,
    mu: Scalar,
    normal: Vector | None,
    revolutions: int,
    low: bool,
) -> tuple[Vector, Vector, Int[Array, "*runs"]]:
    """The velocities at both ends, and the `TransferStatus`; arguments as in `lambert`."""
    normal = _direction(normal)
    chord = _chord(start, end, normal)
    unit_of_time = chord.s * jnp.sqrt(quotient(chord.s, 2.0 * mu))
    time, lam, kappa = barrier((duration / unit_of_time, chord.lam, chord.kappa))
    x = conic_of_time(time, lam, kappa, revolutions, low)
    status = geometry_status(
        (chord.r1, chord.r2, chord.c),
        (chord.i1, chord.i2),
        jnp.asarray(duration),
        jnp.asarray(mu),
        normal,
    )
    # In a valid triangle only the duration can leave no conic.
    short = jnp.isnan(x) & (status == TransferStatus.FOUND)
    return *_velocities(x, chord, mu), jnp.where(short, TransferStatus.TOO_SHORT, status)


@formula(mu=POSITIVE)
def least_duration(
    start: Vector, end: Vector, mu: Scalar, revolutions: int, *, normal: Vector | None = None
) -> Scalar:
    """The shortest duration of a transfer with one or more whole revolutions.

    **Arguments** as in `lambert`.

    **Returns** the duration, s, (*runs,); NaN in a batch and under a transformation where the
    `normal` does not determine the way.

    **Raises** `InputError` for `revolutions` below one, for a `mu` that is not positive, and for
    concrete positions and a `normal` that do not determine the way.
    """
    check(revolutions >= 1, "least_duration: revolutions", revolutions, "one or more")
    normal = _direction(normal)
    chord = _chord(start, end, normal)
    undecided = way_is_undecided((chord.i1, chord.i2), normal)
    if jnp.ndim(undecided) == 0 and not is_traced(undecided) and undecided:
        raise InputError(f"least_duration: {TransferStatus.NO_WAY.sentence}")
    least, _ = least_time(chord.lam, chord.kappa, revolutions)
    duration = least * chord.s * jnp.sqrt(quotient(chord.s, 2.0 * mu))
    return jnp.where(undecided, jnp.nan, duration)


def _direction(normal: Vector | None) -> Vector | None:
    """The normal in a size whose square float32 represents: the product of two places in metres is
    beyond."""
    return None if normal is None else unit_factor(*components(normal)) * normal


def _chord(start: Vector, end: Vector, normal: Vector | None) -> _Chord:
    rank = max(start.ndim, end.ndim, 1 if normal is None else normal.ndim)
    start = with_rank(start, rank - 1)
    end = with_rank(end, rank - 1)
    r1 = norm(start)
    r2 = norm(end)
    chord = end - start
    c = norm(chord)
    # The difference of close places is exact. What is small on a short arc, the rise |r2| - |r1|
    # and the angle, follows from it and not from differences of lengths and directions.
    rise = dot(chord, (start + end) * (1.0 / (r1 + r2)))
    per_r2 = 1.0 / r2
    i1, i2, r1, r2, c, rise = barrier((start * (1.0 / r1), end * per_r2, r1, r2, c, rise))
    # It differs from i2 along i1 only, which changes neither the cross product nor the component
    # along t1.
    toward = jnp.where(c < r2, chord * per_r2, i2)
    t1, t2, way = _directions_of_motion(i1, i2, toward, normal)
    s = 0.5 * (r1 + r2 + c)
    root = jnp.sqrt(r1 * r2)
    # The angle enters by its half, from the sum and the difference of the unit vectors: nothing
    # then cancels on short arcs or near half a turn. Of sine and cosine the larger one is computed,
    # and the smaller one follows from the component of i2 along the motion.
    beyond = dot(i1, i2) < 0.0
    larger = jnp.where(beyond, norm(i2 - i1), way * norm(i1 + i2))
    smaller = 2.0 * dot(toward, t1) / larger
    sine = jnp.where(beyond, larger, smaller)
    cosine = jnp.where(beyond, smaller, larger)
    lam = 0.5 * root * cosine / s
    return _Chord(r1, r2, c, s, rise, root, sine, i1, i2, t1, t2, lam, kappa=c / s)


def _directions_of_motion(
    i1: Vector, i2: Vector, toward: Vector, normal: Vector | None
) -> tuple[Vector, Vector, Scalar]:
    """Directions along the motion at both places, and 1 for the short way, -1 for the long one.

    `toward`: i2, or its remainder without the component along i1."""
    up = axis(2, i1[0]) if normal is None else with_rank(normal, i1.ndim - 1)
    n = barrier(cross(i1, toward))
    n2, turn = barrier((dot(n, n), dot(n, up)))
    # At half a turn, to rounding, the places define no plane.
    noise = rounding_of_directions(n2)
    aligned = (n2 == 0.0) | ((n2 <= noise * noise) & (dot(i1, i2) < 0.0))
    way = jnp.where(turn < 0.0, -1.0, 1.0).astype(i1.dtype)
    per_n = way * inverse_sqrt(jnp.where(aligned, 1.0, n2))
    h = barrier(jnp.where(aligned, unit(up - dot(up, i1) * i1), per_n * n))
    return *barrier((cross(h, i1), cross(h, i2))), way


def _velocities(x: Scalar, chord: _Chord, mu: Scalar) -> tuple[Vector, Vector]:
    """The velocities at both places on the conic `x`."""
    r1, r2, c, s, rise, root, sine, i1, i2, t1, t2, lam, kappa = chord
    _, _, y, eta = transfer_time(x, lam, kappa)
    # 1 - rho and 1 + rho: the smaller one from r1 r2 (2 sin(theta/2))^2 = c^2 - (r1 - r2)^2,
    # because the difference would lose digits.
    outer = rise <= 0.0
    large = c + jnp.where(outer, -rise, rise)
    small = (root * sine) ** 2 / large
    minus = jnp.where(outer, small, large) / c
    plus = jnp.where(outer, large, small) / c
    gamma = jnp.sqrt(0.5 * mu * s)
    across = gamma * root * sine * kappa / (c * eta)
    radial1 = gamma * (lam * y * minus - x * plus) / r1
    radial2 = gamma * (x * minus - lam * y * plus) / r2
    radial1, radial2, across1, across2 = barrier((radial1, radial2, across / r1, across / r2))
    return radial1 * i1 + across1 * t1, radial2 * i2 + across2 * t2
