"""Shadow of a spherical planet: when an orbit enters it, and the remaining fraction of sunlight.

    a = asin(R_s / |s - r|),  b = asin(R / |r|)         apparent radii of sun and planet
    c = angle between s - r and -r                      between their centres
    penumbra where c < a + b,  umbra where c < b - a
    f = 1 - (alpha - sin alpha cos alpha + (b/a)^2 (beta - sin beta cos beta)) / pi
    tan(alpha/2) = sqrt((b + c - a) (a + b - c) / ((a + b + c) (a + c - b))),  beta: a, b exchanged

    symbol       meaning                                                      unit
    r, s         position, that of the sun, both from the planet's centre     m
    R, R_s       radius of the planet, of the sun                             m
    f            visible fraction of the sun's disk, by area                  1
    alpha, beta  half the angle of the common chord, from each centre         rad

Source: Montenbruck and Gill, Satellite Orbits, 3.4.2 (cone), 3.4.1 (light of parallel rays); f is
the area of two overlapping plane disks.

Parallel light is the case a = 0, where c is measured from s: the shadow is a cylinder, and f jumps
from one to zero. Refraction and absorption by air, and the planet's flattening, are neglected.
"""

__all__ = ["shadow", "shadow_event", "sunlight"]

from collections.abc import Callable
from typing import Literal

import jax
import jax.numpy as jnp

from ..core import Scalar, Vector
from ..core.barrier import barrier, computed_once
from ..core.formula import POSITIVE, formula
from ..core.safe import safe_atan2, safe_sqrt
from ..core.shapes import with_rank
from ..core.trigonometry import atan2, sincos
from ..core.vectors import cross, dot, norm, unit


def _apparent_radius(radius: Scalar, distance: Scalar) -> Scalar:
    """asin(radius / distance), rad; a right angle on the surface and below it."""
    tangent = jnp.maximum((distance - radius) * (distance + radius), 0.0)
    return atan2(radius, safe_sqrt(tangent))


def _angles(
    position: Vector, sun: Vector, radius: Scalar, sun_radius: Scalar | None
) -> tuple[Scalar, Scalar, Scalar]:
    """a, b and c, rad."""
    rank = max(sun.ndim, position.ndim) - 1
    # The same sun may shine on many runs.
    sun, position = with_rank(sun, rank), with_rank(position, rank)
    to_sun = sun if sun_radius is None else sun - position
    # Directions first: in metres the squares of the products leave the range of float32.
    light, up = barrier((unit(to_sun), unit(position)))
    c = safe_atan2(norm(cross(up, light)), -dot(up, light))
    b = _apparent_radius(radius, norm(position))
    return (0.0 if sun_radius is None else _apparent_radius(sun_radius, norm(to_sun))), b, c


@formula(radius=POSITIVE, sun_radius=POSITIVE)
def shadow(
    position: Vector,
    sun: Vector,
    radius: Scalar,
    sun_radius: Scalar | None = None,
    part: Literal["penumbra", "umbra"] = "penumbra",
) -> Scalar:
    """Angular separation of the sun and the shadow's edge: zero where the shadow begins and ends.

    The condition of an eclipse for events: it falls at the entry and rises at the exit.

    **Arguments**

    - `position`, `sun`: of the satellite and of the sun from the planet's centre, m, (3, *runs). In
      parallel light only the direction of `sun` counts.
    - `radius`: of the planet, m.
    - `sun_radius`: m; without it the light is parallel and the shadow a cylinder.
    - `part`: "penumbra", where the first bit of the sun is hidden, or "umbra", where the last is.

    **Returns** c - a - b or c + a - b, rad, (*runs,): positive in the light. Its derivatives are
    finite; on the axis of the shadow, where the direction of c is not defined, those of c are zero,
    and on the surface of the planet those of b."""
    a, b, c = _angles(position, sun, radius, sun_radius)
    return c - b - a if part == "penumbra" else c - b + a


@formula(radius=POSITIVE, sun_radius=POSITIVE)
def sunlight(
    position: Vector, sun: Vector, radius: Scalar, sun_radius: Scalar | None = None
) -> Scalar:
    """Visible fraction of the sun's disk, from 0 in the umbra to 1 in full light.

    **Arguments** as in `shadow`.

    **Returns** f, (*runs,). Its first derivatives are continuous, zero where the shadow begins and
    ends. In parallel light it is a step, whose derivative is zero."""
    a, b, c = _angles(position, sun, radius, sun_radius)
    if sun_radius is None:
        # In the precision of the angles, which two Python numbers do not define.
        return jnp.where(c > b, 1.0, 0.0).astype(jnp.result_type(c))
    return 1.0 - _hidden_part(*barrier(jnp.broadcast_arrays(a, b, c)))


@formula(radius=POSITIVE, sun_radius=POSITIVE)
def shadow_event(
    sun: Callable[[Scalar], Vector] | Vector,
    radius: Scalar,
    sun_radius: Scalar | None = None,
    part: Literal["penumbra", "umbra"] = "penumbra",
) -> Callable[..., Scalar]:
    """`shadow` as a condition (t, y) of events, for a state with a position.

    **Arguments**

    - `sun`: its position, m, (3, *runs), or a function of the time that returns it.
    - `radius`, `sun_radius`, `part`: as in `shadow`.

    **Returns** a function of the time, s, and the state."""

    def condition(t: Scalar, y) -> Scalar:
        place = sun(t) if callable(sun) else sun
        return shadow(y.position, place, radius, sun_radius, part)

    return condition


@jax.custom_jvp
def _hidden_part(a: Scalar, b: Scalar, c: Scalar) -> Scalar:
    """Part of a disk of the radius `a` behind one of the radius `b` at the distance `c`."""
    alpha, beta = _half_angles(a, b, c)
    # In the umbra all of it, to the last bit, so that the light is never negative.
    return jnp.minimum((_segment(alpha) + (b / a) ** 2 * _segment(beta)) / jnp.pi, 1.0)


@_hidden_part.defjvp
def _hidden_part_rule(primals, tangents):
    # Each rim that moves uncovers its arc: the derivatives of the chord cancel, and with them the
    # infinite slopes of the angles where the disks touch.
    a, b, c = primals
    da, db, dc = tangents
    alpha, beta = _half_angles(a, b, c)
    hidden = _hidden_part(a, b, c)
    turned = a * alpha * da + b * beta * db - a * sincos(alpha)[0] * dc
    slope = 2.0 * (turned / (jnp.pi * a) - hidden * da) / a
    # All of it stays hidden.
    return hidden, jnp.where(c <= b - a, 0.0, slope)


@computed_once
def _half_angles(a: Scalar, b: Scalar, c: Scalar) -> tuple[Scalar, Scalar]:
    """alpha and beta, rad: 0 for disks that do not overlap, pi for one that is covered."""
    # A negative side means that one disk is within the other.
    total, x, y, z = (jnp.maximum(s, 0.0) for s in (a + b + c, b + c - a, a + c - b, a + b - c))
    # The square root of a square at the ends has no slope: the rule above does without it.
    alpha = 2.0 * safe_atan2(safe_sqrt(x * z), safe_sqrt(total * y))
    beta = 2.0 * safe_atan2(safe_sqrt(y * z), safe_sqrt(total * x))
    return alpha, beta


def _segment(x: Scalar) -> Scalar:
    """x - sin x cos x for 0 <= x <= pi, without loss of digits near zero."""
    u = 2.0 * x
    near = u < 0.5
    s = jnp.where(near, u, 0.0)
    series = 1.0
    # 0.5^12 / (4 ... 15) is below rounding.
    for n in range(14, 3, -2):
        series = 1.0 - s * s / (n * (n + 1)) * series
    return 0.5 * jnp.where(near, s * s * s / 6.0 * series, u - sincos(u)[0])
