"""Landings of rockets: places on the Earth, and outputs of a campaign.

A point in the axes of the site is reached from the site along east, north and up of the ellipsoid;
its latitude is that of the normal through it.

Source: NIMA TR8350.2, World Geodetic System 1984, 4; `orbits.ground_track.ground_point`.
"""

__all__ = ["ground_place", "landing", "landing_latitude", "landing_longitude"]

from collections.abc import Mapping

import jax.numpy as jnp
from jaxtyping import Array

from ..core import Scalar, Vector, output
from ..core.formula import formula
from ..core.shapes import with_rank
from ..core.types import as_float
from ..core.vectors import norm
from ..orbits.ground_track import GroundPoint, ground_point, position_of
from ..simulation import MissionTrajectory
from ._launch_site import over_ground

EQUATORIAL = 6378137.0  # m, WGS 84
FLATTENING = 1.0 / 298.257223563


@formula
@output("rad", latitude="site.latitude", longitude="site.longitude", elevation="site.elevation")
def landing_latitude(
    position: Vector, latitude: Scalar, longitude: Scalar, elevation: Scalar = 0.0
) -> Scalar:
    """Geodetic latitude below a position in the axes of a site, rad.

    **Arguments**

    - `position`: to the east, to the north and up, m, (3, *runs).
    - `latitude`, `longitude`: of the site, rad; `elevation`: m."""
    return ground_place(position, latitude, longitude, elevation).latitude


@formula
@output("rad", latitude="site.latitude", longitude="site.longitude", elevation="site.elevation")
def landing_longitude(
    position: Vector, latitude: Scalar, longitude: Scalar, elevation: Scalar = 0.0
) -> Scalar:
    """Longitude below a position in the axes of a site, rad, from -pi to pi.

    **Arguments**

    - `position`, `latitude`, `longitude`, `elevation`: as in `landing_latitude`."""
    return ground_place(position, latitude, longitude, elevation).longitude


@formula
def ground_place(
    position: Vector, latitude: Scalar, longitude: Scalar, elevation: Scalar = 0.0
) -> GroundPoint:
    """Latitude, longitude and altitude of a position in the axes of a site (WGS 84).

    **Arguments**

    - `position`, `latitude`, `longitude`, `elevation`: as in `landing_latitude`."""
    site = GroundPoint(as_float(latitude), as_float(longitude), as_float(elevation))
    # By the ellipsoid, because latitudes are geodetic: on a sphere a degree of them would be longer
    # or shorter by up to half a percent.
    foot = position_of(site, as_float(0.0), EQUATORIAL, FLATTENING)
    s, c = jnp.sin(site.latitude), jnp.cos(site.latitude)
    across, along = jnp.sin(site.longitude), jnp.cos(site.longitude)
    zero = 0.0 * c
    axes = ((-across, along, zero), (-s * along, -s * across, c), (c * along, c * across, s))
    # Each component of the sum over the three axes.
    away = [sum(x * axis[k] for x, axis in zip(position, axes, strict=True)) for k in range(3)]
    point = with_rank(foot, position.ndim - 1) + jnp.stack(away)
    return ground_point(point, 0.0 * point[0], EQUATORIAL, FLATTENING)


def landing(result: MissionTrajectory, samples: Mapping[str, Array]) -> dict[str, Array]:
    """The outputs of a campaign of `sounding_flight`s: `Campaign(build, inputs, landing)`.

    **Arguments**

    - `result`: of the flights, from the rail to the ground.
    - `samples`: the inputs, which do not matter.

    **Returns** `east`, `north` and `distance` of the landing from the rail, `drift_of_ascent` and
    `drift_of_descent` over the ground, and the `apogee` above it, m; `impact_speed`, m/s, and
    `flight_time`, s; each (*runs,)."""
    del samples
    # Rail and ascent are the first two phases.
    top, end = result.phases[1].states.position[:, -1], result.final.position
    return {
        "east": end[0],
        "north": end[1],
        "distance": over_ground(end),
        "drift_of_ascent": over_ground(top),
        "drift_of_descent": over_ground(end - top),
        "apogee": top[2],
        "impact_speed": norm(result.final.velocity),
        "flight_time": result.end,
    }
