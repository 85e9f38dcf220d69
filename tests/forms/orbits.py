"""Closed forms of orbits."""

from types import SimpleNamespace

from jaxspace.bodies import BodyState, ExponentialAtmosphere
from jaxspace.orbits import AtAltitude, Drag, VelocityToBeGained
from jaxspace.orbits.drag import circular_decay_rate, drag_acceleration
from jaxspace.orbits.elements import (
    angular_momentum,
    eccentricity_vector,
    semi_latus_rectum,
    specific_energy,
)
from jaxspace.orbits.initial import orbit_from_altitude, orbit_from_radius
from jaxspace.orbits.oblateness import apsidal_rate, node_regression_rate, oblateness_potential
from jaxspace.orbits.outputs import (
    apoapsis_altitude,
    periapsis_altitude,
    speed,
    speed_error,
    velocity_error,
)
from jaxspace.orbits.point_gravity import point_gravity, point_gravity_potential

from .conics import CIRCLE, on_conic
from .form import Form


def constants(x):
    """Energy, momentum, eccentricity vector and size from position, velocity and mu."""
    r, v, mu = x[:3], x[3:6], x[6]
    scalars = specific_energy(r, v, mu)[None], semi_latus_rectum(r, v, mu)[None]
    return angular_momentum(r, v), eccentricity_vector(r, v, mu), *scalars


def altitudes(x):
    """From position, velocity, mu and radius."""
    given = x[:3], x[3:6], x[6], x[7]
    return periapsis_altitude(*given)[None], apoapsis_altitude(*given)[None]


def speeds(x):
    """From two velocities."""
    v, nominal = x[:3], SimpleNamespace(velocity=x[3:])
    found = speed(v), speed_error(v, nominal), velocity_error(v, nominal)
    return tuple(f[None] for f in found)


def attraction(x):
    """Acceleration and potential of a point and of a bulge, from position, mu, J2 and radius."""
    r, mu, j2, radius = x[:3], x[3], x[4], x[5]
    potentials = point_gravity_potential(r, mu), oblateness_potential(r, mu, j2, radius)
    return point_gravity(r, mu), *(p[None] for p in potentials)


def precessions(x):
    """Of node and apsides, from a, e, i, mu, J2 and radius."""
    return node_regression_rate(*x)[None], apsidal_rate(*x)[None]


def air(x):
    """Acceleration, decay and density from velocity, density, ballistic coefficient, radius, mu,
    reference height, scale height and position."""
    v, density, ballistic, radius, mu, reference, scale = x[:3], *x[3:9]
    drag = Drag(ballistic, ExponentialAtmosphere(density, reference, scale), radius)
    decay = circular_decay_rate(radius, density, ballistic, mu)[None]
    return drag_acceleration(v, density, ballistic), decay, drag.density_at(x[9:])[None]


def placed(x):
    """Position and velocity from the periapsis: radius, mu, e and four angles."""
    return orbit_from_radius(*x)


def placed_above(x):
    """The same from the altitude of the periapsis, which is the first input, and the radius."""
    names = ("eccentricity", "inclination", "node", "argument_of_periapsis", "true_anomaly")
    angles = dict(zip(names, x[3:], strict=True))
    return orbit_from_altitude(x[0], x[1], x[2], **angles)


LOW = (6.6e6, 4.0e5, -3.0e5)
ANGLES = (0.4, 0.3, 0.2)


def conditions(x):
    """Velocity to be gained and height over an altitude: position, velocity, axis, mu, altitude,
    radius."""
    y = BodyState(x[:3], x[3:6])
    return VelocityToBeGained(*x[6:8])(0.0, y)[None], AtAltitude(*x[8:])(0.0, y)[None]


FORMS = (
    Form(
        constants,
        tuple(
            f"orbits.{name}"
            for name in (
                *("specific_energy", "semi_latus_rectum", "angular_momentum"),
                "eccentricity_vector",
            )
        ),
        [
            (*on_conic(0.3, 1.0, 0.2), 1.0),
            (*CIRCLE, 1.0),
            (2.0, 0.0, 0.0, 0.6, 0.8, 0.0, 1.0),
            (1.0, 0.0, 0.0, 1.0, 1e-9, 0.0, 1.0),
        ],
    ),
    Form(
        altitudes,
        ("orbits.periapsis_altitude", "orbits.apoapsis_altitude"),
        [(*on_conic(0.3, 1.0, 0.2), 1.0, 0.5), (*on_conic(1e-9, 1.0, 0.2), 1.0, 1.0),
         (*on_conic(0.999, -2.9), 1.0, 1.0)],
    ),
    Form(
        speeds,
        tuple(f"orbits.{name}" for name in ("speed", "speed_error", "velocity_error")),
        [(1.0, 2.0, 3.0, 1.0, 2.0, 3.1), (1.0, 2.0, 3.0, 1.0, 2.0, 3.0), (0.0,) * 3 + (1.0,) * 3],
    ),
    Form(
        attraction,
        tuple(
            f"orbits.{name}"
            for name in ("point_gravity", "point_gravity_potential", "oblateness_potential")
        ),
        [(*LOW, 3.986e14, 1.08e-3, 6.378e6), (0.0, 0.0, 1.1, 1.0, 1e-3, 1.0),
         (1.0, 1.0, 1.0, 1.0, 1e-3, 1.0)],
    ),
    Form(
        precessions,
        ("orbits.node_regression_rate", "orbits.apsidal_rate"),
        [(7e6, 0.1, 0.9, 3.986e14, 1.08e-3, 6.378e6), (7e6, 0.0, 0.0, 3.986e14, 1.08e-3, 6.378e6),
         (7e6, 0.999999, 1.5707963, 3.986e14, 1.08e-3, 6.378e6),
         (7e6, 0.1, 1.1071487177940904, 3.986e14, 1.08e-3, 6.378e6)],
    ),
    Form(
        air,
        ("orbits.drag_acceleration", "orbits.circular_decay_rate", "orbits.Drag.density_at"),
        [(7e3, 100.0, -3e2, 1e-11, 50.0, 6.378e6, 3.986e14, 4e5, 6e4, *LOW),
         (0.0, 0.0, 0.0, 1e-11, 50.0, 6.378e6, 3.986e14, 4e5, 6e4, 6.378e6, 0.0, 0.0)],
    ),
    Form(
        placed,
        ("orbits.orbit_from_radius", "orbits.ClassicalElements.from_periapsis"),
        [(1.0, 1.0, 0.3, *ANGLES, 1.2), (1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0),
         (1.0, 1.0, 1.5, *ANGLES, 2.3), (1.0, 1.0, 1.0, *ANGLES, 3.1)],
    ),
    Form(
        placed_above,
        ("orbits.orbit_from_altitude",),
        [(4e5, 6.378e6, 3.986e14, 0.3, *ANGLES, 1.2), (0.0, 1.0, 1.0, 1e-9, 1e-9, 0.0, 0.0, 3.14)],
    ),
    Form(
        conditions,
        ("orbits.VelocityToBeGained", "orbits.AtAltitude"),
        [(7e6, -2e6, 1e6, 3e3, 5e3, -1e3, 1e7, 3.986e14, 4e5, 6.378e6),
         (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 1.0),
         (3.0, 0.0, 0.0, 0.0, 0.5, 0.0, 1.0, 1.0, 0.0, 1.0)],
    ),
)  # fmt: skip
