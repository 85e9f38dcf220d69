"""Position and velocity from an orbit, for initial states."""

__all__ = ["orbit_from_altitude", "orbit_from_radius"]

import math
import warnings

import numpy as np

from ..core import Scalar, Vector, argument, check, initial
from ..core.checks import is_concrete
from ..core.formula import formula
from ._lengths import warn_of_kilometres
from .elements import ClassicalElements, state_from_elements

MU = argument(
    "m^3/s^2", positive=True, shared="planet.mu", doc="gravitational parameter of the planet"
)
_PLACE = {
    "eccentricity": argument("", non_negative=True, default=0.0, doc="of the conic"),
    "inclination": argument(
        "rad", low=-math.pi, high=math.pi, default=0.0, doc="angle from the z axis to r x v"
    ),
    "node": argument("rad", default=0.0, doc="longitude of the ascending node"),
    "argument_of_periapsis": argument(
        "rad", default=0.0, doc="angle from the ascending node to the periapsis"
    ),
    "true_anomaly": argument("rad", default=0.0, doc="angle from the periapsis"),
    "mu": MU,
}


@formula
@initial(
    "orbit",
    gives=("position", "velocity"),
    periapsis_radius=argument("m", positive=True, doc="distance of the periapsis from the centre"),
    **_PLACE,
)
def orbit_from_radius(
    periapsis_radius: Scalar,
    mu: Scalar,
    eccentricity: Scalar = 0.0,
    inclination: Scalar = 0.0,
    node: Scalar = 0.0,
    argument_of_periapsis: Scalar = 0.0,
    true_anomaly: Scalar = 0.0,
) -> tuple[Vector, Vector]:
    """Position and velocity on an orbit that is given by the radius of its periapsis.

    **Arguments**

    - `periapsis_radius`, m; `mu`, m^3/s^2; `eccentricity`.
    - `inclination`, `node`, `argument_of_periapsis`, `true_anomaly`: rad.

    **Returns** position, m, and velocity, m/s, each (3, *runs).

    **Raises** `InputError` for a radius or a parameter that is not positive, or a negative
    eccentricity."""
    warn_of_kilometres("periapsis_radius", periapsis_radius, mu, stacklevel=4)
    elements = ClassicalElements.from_periapsis(
        periapsis_radius, eccentricity, inclination, node, argument_of_periapsis, true_anomaly
    )
    return state_from_elements(elements, mu)


@formula
@initial(
    "orbit",
    gives=("position", "velocity"),
    periapsis_altitude=argument("m", doc="height of the periapsis above the equatorial radius"),
    radius=argument(
        "m", positive=True, shared="planet.radius", doc="equatorial radius of the planet"
    ),
    **_PLACE,
)
def orbit_from_altitude(
    periapsis_altitude: Scalar, radius: Scalar, mu: Scalar, **elements: Scalar
) -> tuple[Vector, Vector]:
    """Position and velocity on an orbit that is given by the altitude of its periapsis.

    **Arguments**

    - `periapsis_altitude`, `radius`, m: height above the sphere of the planet, and its radius.
    - `mu`, m^3/s^2, and `elements`: as in `orbit_from_radius`.

    **Returns** position, m, and velocity, m/s, each (3, *runs). Warns of a periapsis inside the
    planet.

    **Raises** `InputError` for a periapsis at or beyond the centre of the planet."""
    if is_concrete(periapsis_altitude) and is_concrete(radius):
        height, r = np.asarray(periapsis_altitude), np.asarray(radius)
        centre = f"above -{float(np.min(r)):.6g} m, the centre of the planet"
        check(height > -r, "periapsis_altitude", height, centre)
    if is_concrete(periapsis_altitude) and np.any(np.asarray(periapsis_altitude) < 0.0):
        # No error: a ballistic flight begins and ends on the ground.
        warnings.warn(
            f"periapsis_altitude is {float(np.min(np.asarray(periapsis_altitude))):.6g} m: the "
            "orbit passes through the planet; give a positive value to avoid this.",
            stacklevel=2,
        )
    return orbit_from_radius(radius + periapsis_altitude, mu, **elements)
