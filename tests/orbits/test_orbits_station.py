"""Ground track on the ellipsoid, look angles of a station, and its passes."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxspace import BodyState, Event, simulate
from jaxspace.orbits import Station, TwoBody
from jaxspace.orbits.ground_track import GroundPoint, geocentric_latitude, ground_point, position_of
from jaxspace.orbits.initial import orbit_from_radius
from jaxspace.orbits.kepler import kepler_flow

MU, RADIUS, RATE = 3.986004418e14, 6378137.0, 7.292115e-5
ground = jax.jit(ground_point)


def ellipsoid(latitude, longitude, altitude, flattening):
    """Axes of the planet, by the textbook's formula."""
    e2 = flattening * (2.0 - flattening)
    n = RADIUS / np.sqrt(1.0 - e2 * np.sin(latitude) ** 2)
    out = (n + altitude) * np.cos(latitude)
    z = ((1.0 - e2) * n + altitude) * np.sin(latitude)
    return np.stack([out * np.cos(longitude), out * np.sin(longitude), z])


def test_ground_point_undoes_the_ellipsoid():
    """Everywhere, below and above the ground, for a ball, the earth, Saturn and more."""
    random = np.random.default_rng(0)
    latitude = np.concatenate(
        [[-np.pi / 2, 0.0, np.pi / 2, 1e-9], random.uniform(-1.57, 1.57, 300)]
    )
    longitude = random.uniform(-3.1, 3.1, latitude.size)
    altitude = RADIUS * random.choice([-0.3, -1e-3, 0.0, 0.1, 6.0, 60.0], latitude.size)
    angle = 0.7
    for flattening in (0.0, 1.0 / 298.257223563, 0.0979, 0.25):
        fixed = ellipsoid(latitude, longitude, altitude, flattening)
        x, y, z = fixed
        c, s = np.cos(angle), np.sin(angle)
        inertial = jnp.array([c * x - s * y, s * x + c * y, z])
        place = GroundPoint(jnp.array(latitude), jnp.array(longitude), jnp.array(altitude))
        back = position_of(place, angle, RADIUS, flattening)
        size = np.linalg.norm(fixed, axis=0)
        np.testing.assert_allclose(back / size, inertial / size, atol=1e-15)
        found = ground(inertial, angle, RADIUS, flattening)
        # Rounding of the position, which a third of the radius from the centre counts threefold.
        np.testing.assert_allclose(found.latitude, latitude, atol=4e-15)
        np.testing.assert_allclose(found.altitude / size, altitude / size, atol=4e-15)
        inside = np.abs(latitude) < 1.57
        np.testing.assert_allclose(found.longitude[inside], longitude[inside], atol=4e-15)


def test_track_of_a_circle_over_a_sphere():
    """Thomson, problem 3-11: sin(lat) = sin(i) sin(u), tan(lon + W t) = cos(i) tan(u)."""
    i, n = 1.1, 1e-3
    t = np.linspace(0.0, 1400.0, 8)
    u = n * t
    position = np.array([np.cos(u), np.cos(i) * np.sin(u), np.sin(i) * np.sin(u)]) * 7e6
    track = ground(jnp.array(position), RATE * jnp.array(t), RADIUS, 0.0)
    np.testing.assert_allclose(np.sin(track.latitude), np.sin(i) * np.sin(u), atol=1e-15)
    longitude = np.arctan(np.cos(i) * np.tan(u)) - RATE * t
    np.testing.assert_allclose(track.longitude, longitude, atol=1e-15)
    np.testing.assert_allclose(track.altitude, 7e6 - RADIUS, rtol=1e-13)
    latitude = np.arctan((1.0 - 0.1) ** 2 * np.tan(0.6))
    np.testing.assert_allclose(geocentric_latitude(0.6, 0.1), latitude, rtol=1e-15)


def test_derivatives_on_the_axis_and_in_the_zenith_are_finite():
    places = jnp.array([[0.0, 0.0, 7e6], [7e6, 0.0, 0.0], [0.0, 0.0, -7e6]])
    slopes = jax.jit(jax.vmap(jax.jacrev(lambda r: ground_point(r, 0.0, RADIUS, 0.003))))(places)
    assert all(np.all(np.isfinite(x)) for x in slopes)
    station = Station(0.0, 0.0, RADIUS, 0.0)
    slopes = jax.jit(jax.jacfwd(lambda r: station.look_angles(0.0, r)))(jnp.array([7e6, 0.0, 0.0]))
    assert all(np.all(np.isfinite(x)) for x in slopes)


def test_passes_over_a_station():
    """Azimuth, elevation and range by vectors; every rise and set against a dense sampling."""
    mask, flattening, angle = np.radians(5.0), 1.0 / 298.257223563, 0.2
    latitude, longitude, altitude = 0.9, 0.3, 400.0
    station = Station(latitude, longitude, RADIUS, RATE, altitude, flattening, angle)
    y0 = BodyState(*orbit_from_radius(7.2e6, MU, 0.02, inclination=1.2))
    event = Event(station.above(mask), terminal=False, samples=600, capacity=40)
    run = simulate(TwoBody(MU), y0, jnp.array([0.0, 86400.0]), events=(event,))
    t = np.linspace(0.0, 86400.0, 20001)
    flow = jax.jit(jax.vmap(kepler_flow, in_axes=(None, None, 0, None), out_axes=-1))
    position = np.asarray(flow(y0.position, y0.velocity, jnp.array(t), MU)[0])
    # In numpy: the station and its axes east, north, up, turned by hand.
    turn = longitude + angle + RATE * t
    c, s = np.cos(turn), np.sin(turn)
    e2 = flattening * (2.0 - flattening)
    n = RADIUS / np.sqrt(1.0 - e2 * np.sin(latitude) ** 2)
    out, z = (n + altitude) * np.cos(latitude), ((1 - e2) * n + altitude) * np.sin(latitude)
    way = position - np.stack([out * c, out * s, z + 0.0 * t])
    sine, cosine = np.sin(latitude), np.cos(latitude)
    east = -s * way[0] + c * way[1]
    north = -sine * (c * way[0] + s * way[1]) + cosine * way[2]
    up = cosine * (c * way[0] + s * way[1]) + sine * way[2]
    distance = np.linalg.norm(way, axis=0)
    look = eqx.filter_jit(station.look_angles)(jnp.array(t), jnp.array(position))
    np.testing.assert_allclose(look.distance, distance, rtol=1e-13)
    np.testing.assert_allclose(look.elevation, np.arcsin(up / distance), atol=1e-12)
    np.testing.assert_allclose(look.azimuth, np.arctan2(east, north), atol=1e-11)
    rises = np.flatnonzero(np.diff(np.sign(up / distance - np.sin(mask))))
    found = run.crossings[0]
    assert found.count == rises.size > 8 and not found.overflow
    inside = np.asarray(found.ts[: rises.size])
    assert np.all((t[rises] <= inside) & (inside <= t[rises + 1]))
    seen = station.look_angles(found.ts, found.states.position)
    np.testing.assert_allclose(seen.elevation[: rises.size], mask, atol=1e-12)
