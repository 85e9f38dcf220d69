"""Latitude, longitude and altitude on the rotating ellipsoid of a planet: the ground track.

    x = (N + h) cos(phi) cos(lam)          N = a / sqrt(1 - e2 sin^2(phi)),  e2 = f (2 - f)
    y = (N + h) cos(phi) sin(lam)          lam: from the prime meridian, which turns with the planet
    z = ((1 - e2) N + h) sin(phi)
    tan(phi) = (z + e2' b sin^3(beta)) / (p - e2 a cos^3(beta)),  tan(beta) = (1 - f) tan(phi)

    symbol     meaning                                                       unit
    phi, lam   geodetic latitude, longitude                                  rad
    h          altitude above the ellipsoid, along its normal                m
    a, b, f    equatorial and polar radius, flattening (a - b)/a             m, 1
    p          distance from the axis                                        m
    e2, e2'    squares of the first and second eccentricity                  1
    beta       reduced latitude                                              rad

Source: Bowring (1976), Survey Review 23, 323; for a sphere Thomson, problem 3-11.

Without flattening latitude and altitude are geocentric, those on a sphere. Singular on the axis,
where the longitude is undefined, and at the centre. Bowring's step is repeated to rounding for
altitudes from -0.9 a on and a flattening to 0.3; nearer to the centre it may not converge.
"""

__all__ = ["GroundPoint", "geocentric_latitude", "ground_point", "position_of"]

from typing import NamedTuple

import jax.numpy as jnp

from ..core import Scalar, Vector
from ..core.formula import BELOW_ONE, POSITIVE, formula
from ..core.printing import printed
from ..core.safe import safe_atan2, safe_sqrt
from ..core.shapes import with_rank
from ..core.square_roots import inverse_sqrt
from ..core.types import as_float
from .rotating_earth import planet_frame

# The error of a step is less than the square of the last one: two steps are enough for the earth.
_STEPS = 5


@printed(latitude="rad", longitude="rad", altitude="m")
class GroundPoint(NamedTuple):
    """A point given by its `latitude` and `longitude`, rad, and its `altitude`, m, each (*runs,).

    The latitude is geodetic: the angle of the normal of the ellipsoid with the equator. The
    longitude is positive to the east, from -pi to pi."""

    latitude: Scalar
    longitude: Scalar
    altitude: Scalar


@formula(radius=POSITIVE, flattening=BELOW_ONE)
def ground_point(
    position: Vector, angle: Scalar, radius: Scalar, flattening: Scalar = 0.0
) -> GroundPoint:
    """Sub-satellite point on a planet that rotates about the z axis.

    Along a run it is the ground track: `ground_point(run.states.position, rate * run.ts, ...)`.

    **Arguments**

    - `position`: relative to the centre, in inertial axes, m, (3, *runs).
    - `angle`: of the planet's prime meridian from the inertial x axis, rad, (*runs,).
    - `radius`: equatorial, m; `flattening`: of the ellipsoid; 0 gives geocentric latitudes.

    **Returns** a `GroundPoint`, each (*runs,).
    """
    x, y, z = _in_planet_axes(position, angle)
    f = as_float(flattening)
    e2 = f * (2.0 - f)
    b = radius * (1.0 - f)
    p = safe_sqrt(x * x + y * y)
    # Reduced latitude of a point on the ellipsoid itself; the rest is its correction.
    beta = jnp.arctan2(z, (1.0 - f) * p)
    sine, cosine = jnp.sin(beta), jnp.cos(beta)
    latitude = beta
    # A fixed number of steps, because a loop that ends by a condition has no reverse mode.
    for _ in range(_STEPS):
        up = z + e2 / (1.0 - f) * radius * sine**3
        out = p - e2 * radius * cosine**3
        latitude = jnp.arctan2(up, out)
        beta = jnp.arctan2((1.0 - f) * up, out)
        sine, cosine = jnp.sin(beta), jnp.cos(beta)
    # Along the normal from the point of the ellipsoid: this takes no division.
    altitude = (p - radius * cosine) * jnp.cos(latitude) + (z - b * sine) * jnp.sin(latitude)
    return GroundPoint(latitude, safe_atan2(y, x), altitude)


@formula(radius=POSITIVE, flattening=BELOW_ONE)
def position_of(
    place: GroundPoint, angle: Scalar, radius: Scalar, flattening: Scalar = 0.0
) -> Vector:
    """The inertial position of a point on or above a rotating planet; the inverse of
    `ground_point`.

    **Arguments**

    - `place`: latitude and longitude, rad, and altitude, m, each (*runs,).
    - `angle`, `radius`, `flattening`: as in `ground_point`.

    **Returns** the position, m, (3, *runs).
    """
    latitude, longitude, altitude = (as_float(x) for x in place)
    f = as_float(flattening)
    s, c = jnp.sin(latitude), jnp.cos(latitude)
    shrink = (1.0 - f) * (1.0 - f)
    normal = radius * inverse_sqrt(c * c + shrink * s * s)
    out = (normal + altitude) * c
    turned = longitude + angle
    parts = (out * jnp.cos(turned), out * jnp.sin(turned), (shrink * normal + altitude) * s)
    return jnp.stack(jnp.broadcast_arrays(*parts))


@formula(flattening=BELOW_ONE)
def geocentric_latitude(latitude: Scalar, flattening: Scalar) -> Scalar:
    """The geocentric latitude, rad, of a point of the ellipsoid with this geodetic one, rad:
    tan(psi) = (1 - f)^2 tan(phi).

    **Arguments**

    - `latitude`: geodetic, rad, (*runs,).
    - `flattening`: f of the ellipsoid, (*runs,)."""
    shrink = (1.0 - flattening) * (1.0 - flattening)
    return jnp.arctan2(shrink * jnp.sin(latitude), jnp.cos(latitude))


def _in_planet_axes(position: Vector, angle: Scalar) -> Vector:
    """The components in axes that turn with the planet."""
    rank = max(position.ndim - 1, jnp.ndim(angle))
    attitude = planet_frame(jnp.asarray(angle), 0.0).attitude
    return attitude.rotate_back(with_rank(position, rank))
