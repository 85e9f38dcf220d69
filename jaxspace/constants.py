"""Numbers with their unit and their source. No formula of the library imports them: every parameter
is passed."""

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
