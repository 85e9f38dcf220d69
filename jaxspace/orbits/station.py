"""A station on a rotating planet: azimuth, elevation and range of a satellite, and passes over the
station.

    d = R - R_s
    tan(A) = d_east / d_north,  sin(El) = d_up / |d|

    symbol   meaning                                                           unit
    R, R_s   positions of the satellite and of the station                     m
    d        from the station to the satellite                                 m
    A, El    azimuth from the north to the east, elevation above the horizon   rad

Source: Thomson, problem 3-11, for a sphere; here on an ellipsoid, whose normal is up.

Singular in the zenith, where the azimuth is undefined, and at the station itself.
"""

__all__ = ["LookAngles"]

import math
from typing import NamedTuple, final

import jax.numpy as jnp

from ..bodies import BodyState
from ..core import AbstractParameters, NumberField, Scalar, Vector, quantity
from ..core.printing import printed
from ..core.safe import safe_atan2, safe_sqrt
from ..core.shapes import with_rank
from ..core.vectors import norm
from ..rotations import Quaternion
from .ground_track import GroundPoint, position_of


@printed(azimuth="rad", elevation="rad", distance="m")
class LookAngles(NamedTuple):
    """Direction and distance of an object seen from a station: `azimuth` from the north to the
    east, from -pi to pi, and `elevation`, rad; `distance`, m; each (*runs,)."""

    azimuth: Scalar
    elevation: Scalar
    distance: Scalar


@final
class Station(AbstractParameters):
    """A place on a planet that rotates about the z axis.

    `look_angles` gives azimuth, elevation and range. For passes, `above` is the condition of an
    event: `Event(station.above(jnp.radians(5.0)), terminal=False)` collects every rise and set."""

    latitude: NumberField = quantity(
        "rad", low=-0.5 * math.pi, high=0.5 * math.pi, doc="geodetic latitude"
    )
    longitude: NumberField = quantity("rad", doc="positive to the east")
    radius: NumberField = quantity("m", positive=True, doc="equatorial radius")
    rate: NumberField = quantity("rad/s", doc="of the planet about the z axis")
    altitude: NumberField = quantity("m", default=0.0, doc="above the ellipsoid")
    flattening: NumberField = quantity("", default=0.0, doc="of the ellipsoid")
    angle: NumberField = quantity(
        "rad", default=0.0, doc="of the prime meridian from the inertial x axis at t = 0"
    )

    def position(self, t: Scalar) -> Vector:
        """Position of the station at the time `t`, s, in inertial axes, m, (3, *runs)."""
        place = GroundPoint(self.latitude, self.longitude, self.altitude)
        return position_of(place, self._angle(t), self.radius, self.flattening)

    def look_angles(self, t: Scalar, position: Vector) -> LookAngles:
        """Azimuth, elevation and distance of an inertial `position`, m, (3, *runs), at the time
        `t`, s, (*runs,)."""
        east, north, up = self._seen(t, position)
        across = safe_sqrt(east * east + north * north)
        distance = jnp.sqrt(east * east + north * north + up * up)
        return LookAngles(safe_atan2(east, north), jnp.arctan2(up, across), distance)

    def above(self, elevation: Scalar = 0.0) -> "AboveElevation":
        """The condition that rises through zero where an object rises above this `elevation`,
        rad."""
        return AboveElevation(self, elevation)

    def _angle(self, t: Scalar) -> Scalar:
        return self.angle + self.rate * t

    def _seen(self, t: Scalar, position: Vector) -> Vector:
        """The vector from the station to the position in east, north, up axes, m, (3, *runs)."""
        meridian = jnp.asarray(self.longitude + self._angle(t))
        station = self.position(t)
        rank = max(position.ndim, station.ndim, meridian.ndim + 1) - 1
        way = with_rank(position, rank) - with_rank(station, rank)
        # About the axis to the meridian; then x points up at the equator and y to the east.
        x, east, z = Quaternion.about(2, meridian).rotate_back(way)
        s, c = jnp.sin(self.latitude), jnp.cos(self.latitude)
        north, up = c * z - s * x, c * x + s * z
        return jnp.stack(jnp.broadcast_arrays(east, north, up))


@final
class AboveElevation(AbstractParameters):
    """The condition (t, y) of an event: sin(El) less that of an elevation, seen from a station.

    Also smooth in the zenith, where its derivatives vanish up to the rounding error of the sine."""

    station: Station
    elevation: NumberField = quantity("rad", doc="of the mask above the horizon")

    def __call__(self, t: Scalar, y: BodyState) -> Scalar:
        way = self.station._seen(t, y.position)
        # The sine, because the slope of the angle itself jumps in the zenith.
        return way[2] / norm(way) - jnp.sin(self.elevation)
