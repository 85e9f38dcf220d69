"""Closed forms of transfers, conics, forces and flights over a planet."""

import jax.numpy as jnp
import twins

from jaxspace import orbits as o
from jaxspace.core.vectors import norm

from .conics import CIRCLE, on_conic
from .form import Form


def equinoctial(x):
    """The elements from position, velocity and mu: size, two vectors, longitude."""
    e = o.EquinoctialElements.of_state(x[:3], x[3:6], x[6])
    turn = jnp.stack([jnp.sin(e.mean_longitude), jnp.cos(e.mean_longitude)])
    return e.semi_major_axis[None], jnp.stack([e.h, e.k]), jnp.stack([e.p, e.q]), turn


def of_equinoctial(x):
    """The state from the elements and mu."""
    return o.EquinoctialElements(*x[:6]).state(x[6])


def sizes(elements):
    """Eccentricity, semi-major axis and apsides of elements."""
    names = ("semi_major_axis", "periapsis_radius", "apoapsis_radius")
    return tuple(getattr(elements, name)[None] for name in names)


def classical_sizes(x):
    """From the semi-latus rectum and the eccentricity."""
    return sizes(o.ClassicalElements(x[0], x[1], 0.0, 0.0, 0.0, 0.0))


def equinoctial_sizes(x):
    """From the semi-major axis and the eccentricity vector."""
    e = o.EquinoctialElements(x[0], x[1], x[2], 0.0, 0.0, 0.0)
    return e.eccentricity[None], *sizes(e)


def modified_sizes(x):
    """From the semi-latus rectum and the eccentricity vector."""
    e = o.ModifiedEquinoctialElements(x[0], x[1], x[2], 0.0, 0.0, 0.0)
    return e.eccentricity[None], *sizes(e)


def modified_equinoctial(x):
    """The elements from position, velocity and mu."""
    e = o.ModifiedEquinoctialElements.of_state(x[:3], x[3:6], x[6])
    turn = jnp.stack([jnp.sin(e.true_longitude), jnp.cos(e.true_longitude)])
    return e.semi_latus_rectum[None], jnp.stack([e.f, e.g]), jnp.stack([e.h, e.k]), turn


def of_modified_equinoctial(x):
    """The state from the elements and mu."""
    return o.ModifiedEquinoctialElements(*x[:6]).state(x[6])


def burnout(x):
    """The speeds of circle, escape, excess, and of an orbit: radius, mu, speed, size."""
    radius, mu, speed, a = x
    excess = o.burnout.excess_speed(radius, speed, mu)
    circle, escape = o.burnout.circular_speed(radius, mu), o.burnout.escape_speed(radius, mu)
    return tuple(f[None] for f in (circle, escape, excess, o.burnout.vis_viva_speed(radius, a, mu)))


def burnt_out(x):
    """Position and velocity from radius, speed, mu and four angles."""
    return o.burnout.orbit_from_burnout(*x)


def burnout_elements(x):
    """p, e and the true anomaly as a direction, from radius, speed, angle and mu."""
    e = o.burnout.elements_from_burnout(*x)
    turn = e.eccentricity * jnp.stack([jnp.cos(e.true_anomaly), jnp.sin(e.true_anomaly)])
    return e.semi_latus_rectum[None], e.eccentricity[None], turn


def apsides(x):
    """Impulse, coaxial, Hohmann and bi-elliptic transfer from four radii and mu."""
    r1, r2, r3, r4, mu = x
    coaxial = o.transfers.coaxial_transfer(r1, r2, r3, r4, mu)
    hohmann, bielliptic = (
        o.transfers.hohmann_transfer(r1, r3, mu),
        o.transfers.bielliptic_transfer(r1, r4, r3, mu),
    )
    one = o.transfers.apsidal_impulse(r1, r2, r3, mu)[None]
    times = coaxial.duration[None], bielliptic.duration[None]
    return one, coaxial.impulses, hohmann.impulses, bielliptic.impulses, *times


def tangential(x):
    """The orbit after an impulse along the path: p, e, true anomaly, gain."""
    x = (x[0], jnp.abs(x[1]), x[2], x[3])
    change, small = o.impulses.tangential_impulse(*x), o.impulses.small_tangential_impulse(*x)
    turn = jnp.stack([jnp.cos(change.true_anomaly), jnp.sin(change.true_anomaly)])
    e = change.eccentricity
    return e[None], e * turn, change.semi_major_axis[None], small.eccentricity[None]


def apse_kept(x):
    """The impulse that keeps the apse line."""
    return tuple(f[None] for f in o.impulses.apse_line_impulse(*x))


def plane_change(x):
    """The size of the impulse from two speeds and an angle."""
    return o.impulses.plane_change_impulse(*x)[None]


def through_a_place(x):
    """The two eccentricities from radius, true anomaly and size."""
    return tuple(f[None] for f in o.impulses.eccentricities_through(*x))


def break_even(x):
    """The least radius between of a bi-elliptic transfer."""
    return o.bielliptic.bielliptic_break_even(x[0])[None]


def ballistic(x):
    """Range, height and time from radius, speed, angle and mu."""
    return tuple(f[None] for f in o.ballistic.ballistic_flight(*x))


def ballistic_launch(x):
    """The two angles, and the slowest launch, from radius, speed, range and mu."""
    radius, speed, range_angle, mu = x
    slowest = o.ballistic.least_energy_launch(radius, range_angle, mu)
    return tuple(f[None] for f in (*o.ballistic.ballistic_angles(*x), *slowest))


def farthest(x):
    """Longest range and its angle, from radius, speed and mu."""
    return tuple(f[None] for f in o.ballistic.longest_range(*x))


def ballistic_ground(x):
    """Where a flight ends on a turning sphere; the longitude as a direction."""
    place = o.ballistic.ballistic_impact(*x)
    turn = jnp.stack([jnp.cos(place.longitude), jnp.sin(place.longitude)])
    return place.latitude[None], turn


def relative_flow(x):
    """Relative position and velocity after a duration: state, duration, mean motion."""
    return o.clohessy_wiltshire.clohessy_wiltshire_flow(x[:3], x[3:6], x[6], x[7])


def relative_transfer(x):
    """Relative velocities at both ends: two places, duration, mean motion."""
    return o.clohessy_wiltshire.clohessy_wiltshire_transfer(x[:3], x[3:6], x[6], x[7])


def flight_time(x):
    """Period and time of flight: two anomalies, p, e, mu."""
    return o.time_of_flight.time_of_flight(*x)[None]


def anomaly_later(x):
    """The true anomaly later, as it is (whole turns included): start, duration, p, e, mu."""
    return o.time_of_flight.true_anomaly_after(*x)[None]


def power_laws(x):
    """Acceleration and potential from position, k and n."""
    r = norm(x[:3])
    return o.central_force.power_law(x[:3], x[3], x[4]), o.central_force.power_law_potential(
        r, x[3], x[4]
    )[None]


def solid_sphere(x):
    """Acceleration and potential of a sphere from position, mu and radius."""
    r = norm(x[:3])
    return o.central_force.sphere_gravity(x[:3], x[3], x[4]), o.central_force.sphere_potential(
        r, x[3], x[4]
    )[None]


def anomalies(x):
    """Radius, eccentric anomaly and mean anomaly from p, e and the true anomaly; the true anomaly
    from another eccentric one, because there and back slopes by e of 1/(1 - e) cancel."""
    p, e, nu, other = x
    eccentric = o.conic.eccentric_anomaly(nu, e)
    mean = o.conic.mean_anomaly(eccentric, e)
    found = o.conic.conic_radius(p, e, nu), eccentric, mean, o.conic.true_anomaly(other, e)
    return tuple(f[None] for f in found)


def turned(x):
    """The turning angle of a flyby."""
    return o.conic.turning_angle(x[0])[None]


def plumb_line(x):
    """The deviation from latitude, mu, radius and rate."""
    return o.rotating_earth.plumb_line_deviation(*x)[None]


def rates_of_navigation(x):
    """Angular velocity and its rate from latitude, two rates, rate of the earth, accelerations."""
    return o.rotating_earth.navigation_rates(*x)


def detour(x):
    """Orbit, impulse and duration of a phasing: radius, size, lead, mu."""
    found = o.phasing.phasing(*x)
    return tuple(f[None] for f in (found.semi_major_axis, found.impulse, found.duration))


def secular(x):
    """Rates to second order from a, e, i, mu, J2, radius, J4."""
    return tuple(f[None] for f in o.secular_rates.secular_rates(*x, second_order=True))


def with_the_sun(x):
    """The sun-synchronous inclination from a, e, mu, J2, radius."""
    return o.secular_rates.sun_synchronous_inclination(*x)[None]


def zonal_field(x):
    """Acceleration and potential of J2 to J4 from position, mu, radius, three harmonics."""
    given = x[:3], x[3], x[5:], x[4]
    return o.zonals.zonals(*given), o.zonals.zonal_potential(*given)[None]


def lit(x):
    """How clear of the planet the sun is, and the part of its disk that is seen."""
    given = x[:3], x[3:6], x[6], x[7]
    return o.shadow.shadow(*given)[None], o.shadow.sunlight(*given)[None]


def encounters(x):
    """Synodic period and phase from two radii and mu."""
    return o.planets.synodic_period(*x)[None], o.planets.departure_phase(x[0], x[1])[None]


def two_bodies(x):
    """Reduced mass, barycentre, separation and back, sphere of influence."""
    m1, m2, first, second = x[0], x[1], x[2:5], x[5:8]
    centre, apart = o.two_masses.to_relative(m1, m2, first, second)
    both = o.two_masses.from_relative(m1, m2, centre, apart)
    influence = o.two_masses.sphere_of_influence(x[8], m1, m2)
    return o.two_masses.reduced_mass(m1, m2)[None], centre, apart, *both, influence[None]


def thrown(x):
    """Envelope and both angles from distance, height, speed and gravity."""
    distance, height, speed, gravity = x
    angles = o.projectile.projectile_angles(distance, height, speed, gravity)
    return tuple(
        f[None] for f in (o.projectile.projectile_envelope(distance, speed, gravity), *angles)
    )


def over_the_ground(x):
    """Latitude, longitude as a direction and altitude from position, angle, radius, flattening."""
    place = o.ground_track.ground_point(x[:3], x[3], x[4], x[5])
    turn = jnp.stack([jnp.cos(place.longitude), jnp.sin(place.longitude)])
    return place.latitude[None], turn, place.altitude[None]


def of_the_ground(x):
    """The position of a place: latitude, longitude, altitude, angle, radius, flattening."""
    return o.ground_track.position_of(o.ground_track.GroundPoint(*x[:3]), *x[3:])


def spiral(x):
    """The radius of a slow spiral: radius, increment, mu."""
    return o.low_thrust.spiral_radius(*x)[None]


def _names(*names):
    return tuple(f"orbits.{name}" for name in names)


POLAR = (1.0, 0.0, 1e-9, 0.0, 0.0, 1.0, 1.0)
RETROGRADE = (1.0, 0.1, 0.0, 0.2, -1.0, 1e-3, 1.0)

SIZES = ("semi_major_axis", "periapsis_radius", "apoapsis_radius")

FORMS = (
    Form(
        equinoctial,
        _names("EquinoctialElements.of_state"),
        [(*on_conic(0.3, 1.0, 0.2), 1.0), (*CIRCLE, 1.0), POLAR, (*on_conic(0.99, 2.0), 1.0)],
        vectors=(3, 3, 1),
    ),
    Form(
        of_equinoctial,
        _names("EquinoctialElements.state"),
        [
            (1.0, 0.1, 0.2, 0.3, -0.2, 1.0, 1.0),
            (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0),
            (1.0, 1e-9, 0.0, 1e-9, 0.0, 3.0, 1.0),
            (1.0, 0.6, 0.7, 0.0, 1.0, 2.0, 1.0),
        ],
    ),
    Form(
        classical_sizes,
        _names(*(f"ClassicalElements.{name}" for name in SIZES)),
        [(1.0, 0.3), (1.0, 0.0), (1.0, 0.999), (1.0, 1.001), (1.0, 4.0)],
    ),
    Form(
        equinoctial_sizes,
        _names(*(f"EquinoctialElements.{name}" for name in ("eccentricity", *SIZES[1:]))),
        [(1.0, 0.1, 0.2), (1.0, 1e-9, 0.0), (-1.0, 1.5, 0.5)],
    ),
    Form(
        modified_sizes,
        _names(*(f"ModifiedEquinoctialElements.{name}" for name in ("eccentricity", *SIZES))),
        [(1.0, 0.1, 0.2), (1.0, 1e-9, 0.0), (1.0, 0.0, 0.999), (1.0, 1.5, 0.5)],
    ),
    Form(
        modified_equinoctial,
        _names("ModifiedEquinoctialElements.of_state"),
        [(*on_conic(0.3, 1.0, 0.2), 1.0), (*CIRCLE, 1.0), POLAR, (*on_conic(1.5, 1.0), 1.0)],
        vectors=(3, 3, 1),
    ),
    Form(
        of_modified_equinoctial,
        _names("ModifiedEquinoctialElements.state"),
        [
            (1.0, 0.1, 0.2, 0.3, -0.2, 1.0, 1.0),
            (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0),
            (1.0, 1.5, 0.0, 0.0, 0.5, 0.3, 1.0),
        ],
    ),
    Form(
        burnout,
        _names("circular_speed", "escape_speed", "excess_speed", "vis_viva_speed"),
        [(7e6, 3.986e14, 1.2e4, 9e6), (1.0, 1.0, 1.41421357, 0.5000001), (1.0, 1.0, 3.0, -2.0)],
    ),
    Form(
        burnt_out,
        _names("orbit_from_burnout"),
        [(1.0, 1.0, 1.0, 0.1, 0.5, 0.3, 0.2), (1.0, 1.2, 1.0, 0.0, 0.0, 0.0, 0.0)],
    ),
    Form(
        burnout_elements,
        _names("elements_from_burnout"),
        [(1.0, 1.1, 0.1, 1.0), (1.0, 1.0, 0.0, 1.0), (1.0, 1.0, 1e-9, 1.0), (1.0, 1.41, 0.2, 1.0)],
    ),
    Form(
        apsides,
        _names(
            "apsidal_impulse",
            "coaxial_transfer",
            "hohmann_transfer",
            "bielliptic_transfer",
            "ImpulsiveTransfer.duration",
            "ImpulsiveTransfer.total",
        ),
        [
            (1.0, 1.2, 2.0, 2.5, 1.0),
            (1.0, 1.0, 1.0, 1.0, 1.0),
            (1.0, 1.0000001, 1.0000002, 1.0, 1.0),
            (1.0, 1.0, 12.0, 1e6, 1.0),
        ],
    ),
    Form(
        tangential,
        _names("tangential_impulse", "small_tangential_impulse", "OrbitChange"),
        [(1.0, 0.3, 0.5, 0.01), (1.0, 0.0, 0.0, 1e-8), (1.0, 0.3, 0.0, 0.0), (1.0, 0.9, 3.1, 1e-3)],
    ),
    Form(
        apse_kept,
        _names("apse_line_impulse"),
        [(1.0, 0.3, 0.5, 0.4, 1.0), (1.0, 0.3, 0.5, 0.3, 1.0), (1.0, 0.3, 1e-9, 0.35, 1.0)],
    ),
    Form(
        plane_change,
        _names("plane_change_impulse"),
        [(1.0, 1.1, 0.3), (1.0, 1.0, 1e-9), (1.0, 1.0, 0.0), (1.0, 1.0000001, 3.14159)],
    ),
    Form(
        through_a_place,
        _names("eccentricities_through"),
        [(1.0, 0.5, 1.5), (1.0, 1e-3, 1.2), (1.0, 3.1, 0.9), (1.0, 1.0, 1.0)],
    ),
    Form(
        break_even,
        _names("bielliptic_break_even"),
        [(12.0,), (15.0,), (11.94,), (15.58,)],
        exact=twins.bielliptic_break_even,
    ),
    Form(
        ballistic,
        _names("ballistic_flight", "BallisticFlight"),
        [
            (1.0, 0.9, 0.5, 1.0),
            (1.0, 1e-4, 0.8, 1.0),
            (1.0, 0.999, 1e-6, 1.0),
            (1.0, 0.9, 1.57, 1.0),
        ],
    ),
    Form(
        ballistic_launch,
        _names("ballistic_angles", "least_energy_launch"),
        [(1.0, 0.9, 0.5, 1.0), (1.0, 0.05, 1e-3, 1.0), (1.0, 0.9, 1.3, 1.0), (1.0, 1.2, 3.0, 1.0)],
    ),
    Form(
        farthest, _names("longest_range"), [(1.0, 0.9, 1.0), (1.0, 1e-5, 1.0), (1.0, 0.9999, 1.0)]
    ),
    Form(
        ballistic_ground,
        _names("ballistic_impact", "BallisticImpact"),
        [(1.0, 0.9, 0.5, 0.3, 0.4, 1.0, 0.05), (1.0, 0.01, 0.5, 0.0, 1.57, 1.0, 0.05)],
    ),
    Form(
        relative_flow,
        _names("clohessy_wiltshire_flow"),
        [
            (1.0, 2.0, 0.5, 0.1, -0.3, 0.2, 1.0, 1.1),
            (1.0, 2.0, 0.5, 0.1, -2.2, 0.2, 1e-9, 1.1),
            (1.0, 0.0, 0.0, 0.0, -2.0, 0.0, 1e3, 1.0),
        ],
    ),
    Form(
        relative_transfer,
        _names("clohessy_wiltshire_transfer"),
        [
            (1.0, 2.0, 0.5, 0.0, 0.0, 0.0, 1.0, 1.1),
            (1.0, 2.0, 0.5, 1.0, 2.0, 0.5, 1e-6, 1.0),
            (1.0, 2.0, 0.5, 0.3, 0.1, 0.2, 6.2, 1.0),
            (1.0, 2.0, 0.5, 0.3, 0.1, 0.2, 3.1415, 1.0),
        ],
    ),
    Form(
        flight_time,
        _names("time_of_flight"),
        [
            (0.3, 1.2, 1.0, 0.4, 1.0),
            (0.3, 0.3, 1.0, 1.0, 1.0),
            (-1.0, 2.0, 1.0, 1.0000001, 1.0),
            (0.0, 3.1, 1.0, 0.9999, 1.0),
            (0.1, 9.0, 1.0, 0.2, 1.0),
        ],
    ),
    Form(
        anomaly_later,
        _names("true_anomaly_after"),
        [
            (0.3, 1.2, 1.0, 0.4, 1.0),
            (0.3, 0.0, 1.0, 1.0, 1.0),
            (-1.0, 2.0, 1.0, 1.0000001, 1.0),
            (0.1, 9.0, 1.0, 0.2, 1.0),
        ],
    ),
    Form(
        power_laws,
        _names("power_law", "power_law_potential"),
        [
            (1.0, 2.0, 0.5, 1.0, 2.0),
            (1.0, 0.3, 0.2, 1.0, 1.0),
            (0.3, 0.4, 0.5, 1.0, 1.0000001),
            (1.0, 0.0, 0.0, 1.0, -1.0),
        ],
    ),
    Form(
        solid_sphere,
        _names("sphere_gravity", "sphere_potential"),
        [
            (1.0, 2.0, 0.5, 1.0, 1.0),
            (0.1, 0.2, 0.3, 1.0, 1.0),
            (1.0, 0.0, 0.0, 1.0, 1.0),
            (1e-9, 0.0, 0.0, 1.0, 1.0),
        ],
    ),
    Form(
        anomalies,
        _names("conic_radius", "eccentric_anomaly", "mean_anomaly", "true_anomaly"),
        [
            (1.0, 0.3, 0.5, 0.4),
            (1.0, 0.0, 3.0, 3.0),
            (1.0, 0.9999, 3.0, 0.1),
            (1.0, 1.5, 2.0, 1.2),
            (1.0, 0.5, 1e-9, 0.6e-9),
            (1.0, 2.0, 1e-9, 0.6e-9),
        ],
    ),
    Form(turned, _names("turning_angle"), [(1.5,), (1.0000001,), (1e6,)]),
    Form(
        plumb_line,
        _names("plumb_line_deviation"),
        [(0.7, 3.986e14, 6.378e6, 7.29e-5), (0.0, 1.0, 1.0, 0.1), (1.57079, 1.0, 1.0, 0.1)],
    ),
    Form(
        rates_of_navigation,
        _names("navigation_rates"),
        [(0.7, 1e-6, 2e-6, 7.29e-5, 1e-9, 2e-9), (1.57, 0.0, 0.1, 0.2, 0.3, 0.0)],
    ),
    Form(
        detour,
        _names("phasing", "Phasing"),
        [(1.0, 1.0, 0.3, 1.0), (1.0, 1.2, -1e-9, 1.0), (1.0, 1.0, 0.0, 1.0)],
    ),
    Form(
        secular,
        _names("secular_rates", "SecularRates"),
        [
            (7e6, 0.1, 0.9, 3.986e14, 1.08e-3, 6.378e6, -1.6e-6),
            (7e6, 0.0, 1.1071487177940904, 3.986e14, 1.08e-3, 6.378e6, 0.0),
        ],
    ),
    Form(
        with_the_sun,
        _names("sun_synchronous_inclination"),
        [(7e6, 0.1, 3.986e14, 1.08e-3, 6.378e6), (1.2e7, 0.0, 3.986e14, 1.08e-3, 6.378e6)],
    ),
    Form(
        zonal_field,
        _names("zonals", "zonal_potential"),
        [
            (1.0, 0.5, 0.3, 1.0, 1.0, 1e-3, -2e-6, 1e-6),
            (0.0, 0.0, 1.1, 1.0, 1.0, 1e-3, 1e-6, 0.0),
            (1.1, 0.0, 0.0, 1.0, 1.0, 1e-3, 1e-6, 1e-6),
        ],
    ),
    Form(
        lit,
        _names("shadow", "sunlight"),
        [
            (-7e6, 1e6, 6.2e6, 1.5e11, 1e9, 0.0, 6.378e6, 6.96e8),
            (-7e6, 1e6, 1e6, 1.5e11, 1e9, 0.0, 6.378e6, 6.96e8),
            (-4e7, 6.4e6, 0.0, 1.5e11, 0.0, 0.0, 6.378e6, 6.96e8),
        ],
    ),
    Form(
        encounters,
        _names("synodic_period", "departure_phase"),
        [(1.0, 1.5, 1.0), (1.0, 1.0000001, 1.0), (1.0, 30.0, 1.0)],
    ),
    Form(
        two_bodies,
        _names("reduced_mass", "to_relative", "from_relative", "sphere_of_influence"),
        [
            (1.0, 2.0, 1.0, 2.0, 3.0, 0.1, 0.2, 0.3, 5.0),
            (1.0, 1e-12, 1.0, 0, 0, 1.0, 1.0, 0.0, 1.0),
        ],
    ),
    Form(
        thrown,
        _names("projectile_envelope", "projectile_angles"),
        [(10.0, 1.0, 20.0, 9.81), (1e-6, 0.0, 20.0, 9.81), (20.0, 10.0, 17.82, 9.81)],
    ),
    Form(
        over_the_ground,
        _names("ground_point", "GroundPoint"),
        [
            (7e6, 1e6, 3e6, 0.3, 6.378e6, 3.35e-3),
            (0.0, 1.0, 7e6, 0.3, 6.378e6, 3.35e-3),
            (6.378e6, 0.0, 0.0, 0.3, 6.378e6, 0.0),
        ],
    ),
    Form(
        of_the_ground,
        _names("position_of", "geocentric_latitude"),
        [(0.7, 1.0, 4e5, 0.3, 6.378e6, 3.35e-3), (1.5707963, 0.0, 0.0, 0.3, 6.378e6, 3.35e-3)],
    ),
    Form(
        spiral,
        _names("spiral_radius"),
        [(7e6, 1e3, 3.986e14), (1.0, 1e-9, 1.0), (1.0, 0.99, 1.0)],
    ),
)
