"""Kilometres in place of metres: a place deep within the planet whose gravitational parameter is
given."""

import warnings

import numpy as np

from ..bodies import BodyState
from ..constants import MU_MOON, MU_SUN, PLANETS, RADIUS_MOON, RADIUS_SUN
from ..core import Scalar
from ..core.checks import is_concrete

# Gravitational parameter, m^3/s^2, and radius, m. A check of units and no formula: those take all
# of their parameters.
KNOWN = {
    "Sun": (MU_SUN, RADIUS_SUN),
    "Moon": (MU_MOON, RADIUS_MOON),
    **{name.capitalize(): (planet.mu, planet.radius) for name, planet in PLANETS.items()},
}
# Up to which relative difference a parameter is that of a body.
SAME = 1e-2
# Part of the radius of a body below which a distance is most likely in another unit.
DEEP = 0.1


def warn_of_kilometres(name: str, distance: object, mu: Scalar, stacklevel: int) -> None:
    """Warn of a known `distance`, m, from the centre that is deep within the body with this `mu`,
    m^3/s^2.

    - `name`: of the distance, as the start of the message.
    - `stacklevel`: of the warning, from the caller."""
    single = is_concrete(distance) and np.ndim(distance) == 0
    if not single or not is_concrete(mu) or np.ndim(mu) > 0:
        return
    least = abs(float(np.asarray(distance)))
    for body, (known, radius) in KNOWN.items():
        # The centre itself is singular, and is reported as such.
        if abs(float(np.asarray(mu)) - known) < SAME * known and 0.0 < least < DEEP * radius:
            warnings.warn(
                f"{name} is {least:.6g} m, deep within the body with this gravitational parameter: "
                f"the radius of {body} is {radius:.6g} m. Lengths are in metres: multiply "
                "kilometres by 1000.",
                stacklevel=stacklevel + 1,
            )


def check_place(y: BodyState, mu: Scalar) -> None:
    """Warn of a first state deep within the body with this `mu`, m^3/s^2, in a single run."""
    # The states of a batch are not read, because that would wait for the device.
    if is_concrete(y.position) and y.position.ndim == 1:
        distance = np.linalg.norm(np.asarray(y.position, float), axis=0)
        warn_of_kilometres("The distance of y0.position", distance, mu, stacklevel=6)
