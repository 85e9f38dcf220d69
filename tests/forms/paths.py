"""Closed forms of orbits beside those of `orbits.py`: outputs, paths, radial motion, stations."""

from types import SimpleNamespace

import jax.numpy as jnp

from jaxspace import orbits as o
from jaxspace.bodies import BodyState

from .conics import CIRCLE, on_conic
from .form import Form
from .mechanics import numbers


def yukawa(r):
    """The potential of a fading attraction."""
    return -jnp.exp(-0.1 * r) / r


def deviations(x):
    """Errors along, across and radial from two states, altitude and radial speed."""
    nominal = SimpleNamespace(position=x[3:6], velocity=x[6:9])
    errors = [
        f(x[:3], nominal)
        for f in (
            o.deviation_outputs.along_track_error,
            o.deviation_outputs.cross_track_error,
            o.deviation_outputs.radial_error,
        )
    ]
    # Of the size of the largest.
    return jnp.stack(errors), *numbers(
        o.outputs.altitude(x[3:6], x[9]), o.outputs.radial_speed(x[3:6], x[6:9])
    )


def outputs(x):
    """Eccentricity and both angles from position, velocity and mu."""
    r, v, mu = x[:3], x[3:6], x[6]
    angles = (
        o.deviation_outputs.argument_of_periapsis(r, v, mu),
        o.deviation_outputs.node_longitude(r, v, mu),
    )
    # Angles as directions, which have no jump at pi.
    parts = (jnp.stack([jnp.cos(a), jnp.sin(a)]) for a in angles)
    return *numbers(o.deviation_outputs.eccentricity(r, v, mu)), *parts


def orbit_sizes(x):
    """Period and back from a semi-major axis and mu; the height over a plane."""
    period = o.time_of_flight.period(x[0], x[1])
    touch = o.uniform_gravity.touchdown(0.0, BodyState(position=x[2:5]))
    return numbers(period, o.time_of_flight.semi_major_axis_of_period(x[0], x[1]), touch)


def radial(x):
    """Rates at a circle and the effective potential, from r and h; force of a conic at an angle,
    from e and h."""
    rates = (
        o.radial_motion.circular_rate(yukawa, x[0]),
        o.radial_motion.radial_frequency_squared(yukawa, x[0]),
    )
    force = o.orbit_force.force_of_orbit(lambda a: 1.0 / (1.0 + x[3] * jnp.cos(a)), x[2], x[1])
    return numbers(*rates, o.radial_motion.effective_potential(yukawa, x[0], x[1]), force)


def between_turns(x):
    """Apsidal angle, period, energy and momentum from both radii."""
    found = o.radial_motion.radial_motion(yukawa, x[0], x[1])
    return numbers(found.apsidal_angle, found.period, found.energy, found.angular_momentum)


def impulse(x):
    """Changes of elements by an impulse from position, velocity, impulse and mu."""
    found = o.small_impulse.impulse_change(x[:3], x[3:6], x[6:9], x[9])
    return numbers(*(found[name] for name in sorted(found)))


def shells(x):
    """Of a shell: position, mu and radius; sunlight and the shadow from the place of the sun, area
    and radius."""
    r = x[:3]
    dark = o.shadow.shadow_event(x[5:8], x[4], 0.1 * x[4])(0.0, BodyState(position=r))
    pull = (
        o.central_force.shell_gravity(r, x[3], x[4]),
        o.solar_pressure.solar_pressure(r, x[5:8], x[8], x[9]),
    )
    return *pull, *numbers(
        o.central_force.shell_potential(jnp.sqrt(jnp.sum(r * r)), x[3], x[4]), dark
    )


def third(x):
    """Acceleration and potential by a third body from two places and mu."""
    return o.third_body.third_body(x[:3], x[3:6], x[6]), *numbers(
        o.third_body.third_body_potential(x[:3], x[3:6], x[6])
    )


def turning_earth(x):
    """Frames, a projectile and a station: latitude, longitude, radius, rate; velocity, time,
    gravity; altitude, flattening."""
    frame = o.rotating_earth.local_frame(x[0], x[1], x[2], x[3])
    planet = o.rotating_earth.planet_frame(x[1], x[3])
    gone = o.projectile.projectile_position(x[4:7], x[7], x[8:11], planet.omega)
    station = o.Station(x[0], x[1], x[2], x[3], altitude=x[11], flattening=x[12])
    held = frame.attitude.matrix().reshape(-1), frame.omega, planet.attitude.wxyz
    return *held, gone, station.position(x[7])


def looking(x):
    """Azimuth and elevation as directions, and the distance, of a place from a station."""
    station = o.Station(x[0], x[1], x[2], x[3])
    seen = station.look_angles(x[4], x[5:8])
    above = station.above(0.1)(x[4], BodyState(position=x[5:8]))
    parts = [jnp.stack([jnp.cos(a), jnp.sin(a)]) for a in (seen.azimuth, seen.elevation)]
    return *parts, *numbers(seen.distance, above)


def on_paths(x):
    """Places on a circle, a conic and a table: 5 numbers, position, velocity, mu and time."""
    circle = o.CircularPath(*x[:5])
    conic = o.KeplerPath(x[5:8], x[8:11], x[11])
    table = o.TabulatedPath.of_table([0.0, 1.0, 2.0, 3.5], jnp.outer(x[5:8], x[:4]))
    return circle(x[12]), conic(x[12]), table(x[12])


def relative(x):
    """Place and velocity near a body on a circle, later: mean motion, state and time."""
    y = BodyState(x[1:4], x[4:7])
    later = o.ClohessyWiltshire(x[0]).closed_form().flow(x[7], y)
    return later.position, later.velocity


def meeting(x):
    """Impulses of an interception: two states, departure, arrival and mu."""
    chaser, target = (x[:3], x[3:6]), (x[6:9], x[9:12])
    found = o.interception.interception(chaser, target, x[12], x[13], x[14])
    table = o.interception.porkchop(chaser, target, x[12][None], x[13][None], x[14])
    return found.departure, found.arrival, *numbers(found.total, table.total)


def low_thrust(x):
    """The acceleration at a time, from the first, the exhaust velocity and the time."""
    return numbers(o.LowThrust(x[0], x[1]).acceleration_at(x[2]))


def q_law(x):
    """What is left to a target orbit and the direction to it: from the target's semi-major axis,
    eccentricity and inclination, the lowest periapsis, the softening, and a state; mu = 1."""
    law = o.QLaw(1.0, x[0], 1.0, x[1], x[2], None, x[3], x[4])
    y = BodyState(x[5:8], x[8:11])
    return *numbers(law.increment_left(y)), law.direction(y)


def names(*functions):
    return tuple(f"orbits.{name}" for name in functions)


LOW = (*on_conic(0.3, 1.0, 0.2),)

FORMS = (
    Form(
        deviations,
        names("along_track_error", "cross_track_error", "radial_error", "altitude", "radial_speed"),
        [(1.1, 0.2, 0.3, *LOW, 0.5), (*LOW[:3], *LOW, 0.5), (*CIRCLE[:3], *CIRCLE, 1.0)],
    ),
    Form(
        outputs,
        names("eccentricity", "argument_of_periapsis", "node_longitude"),
        [(*LOW, 1.0), (*on_conic(1e-6, 1.0, 0.2), 1.0), (*on_conic(0.3, 1.0, 1e-6), 1.0)],
    ),
    Form(
        orbit_sizes,
        names("period", "semi_major_axis_of_period", "touchdown"),
        [(7e6, 3.986e14, 1.0, 2.0, 3.0), (1.0, 1.0, 1.0, 2.0, 0.0)],
    ),
    Form(
        radial,
        names("circular_rate", "radial_frequency_squared", "effective_potential", "force_of_orbit"),
        [(1.2, 0.9, 0.7, 0.3), (1.2, 0.9, 0.0, 0.0), (1e-3, 0.9, 3.1415926, 0.999)],
    ),
    Form(
        between_turns,
        names("radial_motion"),
        [(0.8, 1.3), (1.0, 1.0), (1.0, 1.00000001), (0.01, 5.0)],
    ),
    Form(
        impulse,
        names("impulse_change"),
        [(*LOW, 1e-3, 2e-3, -1e-3, 1.0), (*LOW, 1e-9, 0.0, 0.0, 1.0), (*LOW, 0.0, 0.0, 0.0, 1.0)],
    ),
    Form(
        shells,
        names("shell_gravity", "shell_potential", "solar_pressure", "shadow_event"),
        [
            (1.1, 0.2, 0.3, 1.0, 1.0, 50.0, 10.0, 5.0, 1e-6, 0.02),
            (0.3, 0.0, 0.0, 1.0, 1.0, 50.0, 0.0, 0.0, 1e-6, 0.02),
            (-3.0, 1.0, 0.0, 1.0, 1.0, 50.0, 0.0, 0.0, 1e-6, 0.02),
        ],
    ),
    Form(
        third,
        names("third_body", "third_body_potential"),
        [(7e6, 1e5, 0.0, 3e8, 2e8, 1e8, 4.9e12), (7e-6, 0.0, 0.0, 3e8, 0.0, 0.0, 4.9e12)],
    ),
    Form(
        turning_earth,
        names("local_frame", "planet_frame", "projectile_position", "Station.position"),
        [
            (0.7, 0.3, 6.378e6, 7.3e-5, 100.0, 50.0, 300.0, 10.0, 0.1, 0.2, -9.8, 300.0, 3e-3),
            (0.0, 0.0, 6.378e6, 0.0, 100.0, 0.0, 0.0, 0.0, 0.0, 0.0, -9.8, 0.0, 0.0),
            (1.5707963, 0.0, 6.378e6, 7.3e-5, 100.0, 0.0, 0.0, 1.0, 0.0, 0.0, -9.8, 0.0, 0.0),
        ],
    ),
    Form(
        looking,
        names("Station.look_angles", "Station.above"),
        [
            (0.7, 0.3, 6.378e6, 7.3e-5, 10.0, 5e6, 2e6, 6e6),
            (0.0, 0.0, 6.378e6, 7.3e-5, 0.0, 7e6, 0.0, 1.0),
        ],
        vectors=(1, 1, 1, 1, 1, 3),
    ),
    Form(
        on_paths,
        names("CircularPath", "KeplerPath", "TabulatedPath.of_table"),
        [(1.5, 0.3, 0.2, 0.4, 1.1, *LOW, 1.0, 1.7), (1.5, 0.0, 0.0, 0.0, 0.0, *LOW, 1.0, 0.0)],
    ),
    Form(
        relative,
        names("ClohessyWiltshire.closed_form"),
        [
            (1.13e-3, 300.0, -2000.0, 150.0, 0.4, -0.2, 0.3, 900.0),
            (1e-9, 300.0, -2000.0, 150.0, 0.4, -0.2, 0.3, 900.0),
            (1.13e-3, 300.0, 0.0, 0.0, 0.4, 0.0, 0.0, 0.0),
        ],
    ),
    Form(
        meeting,
        names("interception", "porkchop", "Interception.total", "Porkchop.total"),
        [(*LOW, *on_conic(0.1, 2.0, 0.3), 0.3, 2.5, 1.0)],
    ),
    Form(low_thrust, names("LowThrust.acceleration_at"), [(2e-4, 3.0, 100.0), (2e-4, 3.0, 0.0)]),
    Form(
        q_law,
        names("QLaw.increment_left", "QLaw.direction"),
        [
            (6.0, 0.1, 0.2, 1.1, 1e-3, *on_conic(0.3, 2.0, 0.4)),
            (6.0, 0.1, 0.2, 0.5, 1e-3, *on_conic(1.4, 0.5, 0.4)),
        ],
    ),
)
