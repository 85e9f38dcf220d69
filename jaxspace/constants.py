"""Constants with units and sources. No formula of the library imports them: all parameters are
passed explicitly."""

import typing as _typing

STANDARD_GRAVITY = 9.80665  # m/s^2, defines the specific impulse in seconds (CGPM 1901)
MU_EARTH = 3.986004418e14  # m^3/s^2, geocentric gravitational constant (IERS Conventions 2010)
RADIUS_EARTH = 6378137.0  # m, equatorial radius (WGS 84)
J2_EARTH = 1.08262668e-3  # 1, second zonal harmonic (WGS 84, EGM96)
# 1, zonal harmonics J2 to J6 (EGM96)
ZONALS_EARTH = (1.08262668e-3, -2.53265649e-6, -1.61962159e-6, -2.27296083e-7, 5.40681239e-7)
ROTATION_RATE_EARTH = 7.292115e-5  # rad/s, sidereal rotation (WGS 84)
MU_SUN = 1.32712440018e20  # m^3/s^2, heliocentric gravitational constant (IERS Conventions 2010)
# m^3/s^2, selenocentric gravitational constant (IAU 2009 system, from the mass ratio)
MU_MOON = 4.902800e12
ASTRONOMICAL_UNIT = 1.495978707e11  # m (IAU 2012, resolution B2)
RADIUS_SUN = 6.957e8  # m, nominal (IAU 2015, resolution B3)
RADIUS_MOON = 1.7374e6  # m, mean (IAU 2015 report on cartographic coordinates)


class Planet(_typing.NamedTuple):
    """A planet on a circle in the plane of the ecliptic: `orbit_radius`, m, the semi-major axis of
    its orbit at J2000; `mu`, m^3/s^2, its gravitational parameter, with that of its moons from Mars
    on; `radius`, m, at the equator.

    `orbits.initial.orbit_from_radius(planet.orbit_radius, MU_SUN, true_anomaly=longitude)` is its
    state."""

    orbit_radius: float
    mu: float
    radius: float


# Orbits: Standish, Williams, Keplerian elements for approximate positions of the major planets
# (JPL), of 1800 to 2050; gravitational parameters: DE440 (2021); radii: IAU 2015 report.
PLANETS = {
    "mercury": Planet(0.38709927 * ASTRONOMICAL_UNIT, 2.2031868551e13, 2.44053e6),
    "venus": Planet(0.72333566 * ASTRONOMICAL_UNIT, 3.24858592e14, 6.0518e6),
    "earth": Planet(1.00000261 * ASTRONOMICAL_UNIT, MU_EARTH, RADIUS_EARTH),
    "mars": Planet(1.52371034 * ASTRONOMICAL_UNIT, 4.2828375816e13, 3.39619e6),
    "jupiter": Planet(5.202887 * ASTRONOMICAL_UNIT, 1.267127641e17, 7.1492e7),
    "saturn": Planet(9.53667594 * ASTRONOMICAL_UNIT, 3.79405848418e16, 6.0268e7),
    "uranus": Planet(19.18916464 * ASTRONOMICAL_UNIT, 5.7945564e15, 2.5559e7),
    "neptune": Planet(30.06992276 * ASTRONOMICAL_UNIT, 6.83652710058e15, 2.4764e7),
}


if not _typing.TYPE_CHECKING:

    def __getattr__(name):
        """Raise the error of an unknown name, with the nearest one."""
        from difflib import get_close_matches

        public = [each for each in globals() if not each.startswith("_")]
        near = get_close_matches(name.upper(), public, n=1) if not name.startswith("_") else ()
        hint = f". Did you mean {near[0]}?" if near else ""
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}{hint}")
