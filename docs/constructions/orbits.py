"""One construction of each class of `jaxspace.orbits`, as the reference shows them."""

import jax.numpy as jnp

from jaxspace.bodies import ExponentialAtmosphere
from jaxspace.orbits import (
    AtAltitude,
    AtTargetOrbit,
    CentralPotential,
    CircularPath,
    ClassicalElements,
    ClohessyWiltshire,
    Drag,
    EquinoctialElements,
    Impulse,
    KeplerPath,
    LowThrust,
    ModifiedEquinoctialElements,
    Oblateness,
    PlanetRotation,
    PointGravity,
    PowerLawForce,
    QLaw,
    RotatingFrame,
    SolarPressure,
    SphereGravity,
    SphericalHarmonics,
    Station,
    TabulatedPath,
    ThirdBody,
    TwoBody,
    UniformGravity,
    VelocityToBeGained,
    Zonals,
)

# Orbits and elements.
TwoBody(mu=3.986004418e14)
ClohessyWiltshire(mean_motion=1.13e-3)
ClassicalElements(
    semi_latus_rectum=7.0e6,
    eccentricity=0.01,
    inclination=0.9,
    node=1.1,
    argument_of_periapsis=2.2,
    true_anomaly=0.0,
)
EquinoctialElements(
    semi_major_axis=7.0e6, h=0.01, k=0.0, p=0.1, q=0.2, mean_longitude=0.5
)
ModifiedEquinoctialElements(
    semi_latus_rectum=7.0e6, f=0.01, g=0.0, h=0.1, k=0.2, true_longitude=0.5
)

# Forces.
PointGravity(mu=3.986004418e14)
Oblateness(mu=3.986004418e14, j2=1.08263e-3, radius=6378137.0)
Zonals(
    mu=3.986004418e14,
    harmonics=[1.08263e-3, -2.53e-6, -1.62e-6],
    radius=6378137.0,
)
turning = PlanetRotation(rate=7.292115e-5, angle=1.75)
SphericalHarmonics(
    mu=3.986004418e14,
    coefficients=[
        [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [-4.84e-4, 0.0, 2.44e-6]],
        [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, -1.4e-6]],
    ],
    radius=6378137.0,
    rotation=turning,
)
SphereGravity(mu=3.986004418e14, radius=6378137.0)
UniformGravity(acceleration=[0.0, 0.0, -9.81])
PowerLawForce(coefficient=1.0, exponent=-2.5)
CentralPotential(lambda r: -jnp.exp(-r / 0.8) / r)
RotatingFrame(omega=[0.0, 0.0, 7.292e-5])
air = ExponentialAtmosphere(
    density=1e-11, reference_height=4e5, scale_height=6e4
)
Drag(
    ballistic_coefficient=50.0,
    atmosphere=air,
    radius=6378137.0,
    air_rate=7.292e-5,
)
moon = CircularPath(distance=3.844e8, rate=2.6617e-6)
ThirdBody(mu=4.9028e12, path=moon)
sun = CircularPath(distance=1.496e11, rate=1.991e-7)
SolarPressure(area_per_mass=0.02, sun=sun)
KeplerPath(
    position=[3.844e8, 0.0, 0.0],
    velocity=[0.0, 1018.0, 0.0],
    mu=3.986004418e14,
)
TabulatedPath.of_table(
    [0.0, 3600.0, 7200.0, 10800.0],
    [
        [1.0e8, 1.0e8, 1.0e8, 1.0e8],
        [0.0, 4.0e6, 8.0e6, 1.2e7],
        [0.0, 0.0, 0.0, 0.0],
    ],
)

# Manoeuvres.
Impulse(along=50.0)
LowThrust(acceleration=2e-4, exhaust_velocity=3e4)
QLaw(
    thrust=0.1, semi_major_axis=4.2e7, mu=3.986004418e14, exhaust_velocity=3e4
)
to_gain = VelocityToBeGained(semi_major_axis=8.0e6, mu=3.986004418e14)
AtTargetOrbit(increment_left=to_gain)
AtAltitude(altitude=0.0, radius=6378137.0)
Station(latitude=0.7, longitude=0.1, radius=6378137.0, rate=7.292e-5)
