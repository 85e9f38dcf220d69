"""The small formulas of the first chapters: centrodes, anomalies, planets on circles, the force of
an orbit, projectiles, impulses in any direction."""

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np

from jaxspace.constants import MU_SUN, PLANETS
from jaxspace.orbits import ClassicalElements
from jaxspace.orbits.burnout import escape_speed, excess_speed
from jaxspace.orbits.conic import (
    conic_radius,
    eccentric_anomaly,
    mean_anomaly,
    true_anomaly,
    turning_angle,
)
from jaxspace.orbits.elements import state_from_elements
from jaxspace.orbits.orbit_force import force_of_orbit
from jaxspace.orbits.planets import departure_phase, synodic_period
from jaxspace.orbits.projectile import projectile_angles, projectile_envelope, projectile_position
from jaxspace.orbits.rotating_earth import local_frame
from jaxspace.orbits.small_impulse import impulse_change
from jaxspace.orbits.time_of_flight import time_of_flight
from jaxspace.rotations.plane_motion import centrodes


def test_centrodes_of_the_ladder_and_of_the_wheel():  # T3-P3..P5
    length, ts = 2.0, jnp.linspace(0.1, 1.4, 9)

    def ladder(t):
        """The foot slides along x, the top along y; t is the angle with the wall."""
        angle = jnp.pi / 2.0 + t + 0.0 * t**2
        return jnp.stack([length * jnp.sin(t), 0.0 * t]), angle

    def wheel(t):
        return jnp.stack([3.0 * t, 0.0 * t]), -2.0 * t

    space, body = jax.jit(lambda t: centrodes(ladder, t))(ts)
    np.testing.assert_allclose(np.hypot(*space), length, rtol=1e-14)
    # A circle over the ladder as its diameter, whose middle is half its length from the foot.
    np.testing.assert_allclose(np.hypot(body[0] - 0.5 * length, body[1]), 0.5 * length, rtol=1e-13)
    space, body = jax.jit(lambda t: centrodes(wheel, t))(ts)
    # It rolls along a line v0/w0 below its hub, on a circle of this radius.
    np.testing.assert_allclose(space, [3.0 * ts, np.full(9, -1.5)], rtol=1e-14)
    np.testing.assert_allclose(np.hypot(*body), 1.5, rtol=1e-14)


@jax.jit
def anomalies(f, e):
    x = eccentric_anomaly(f, e)
    back = true_anomaly(x, e)
    return x, back, mean_anomaly(x, e), time_of_flight(0.0, f, jnp.abs((1 - e) * (1 + e)), e, 1.0)


def test_anomalies_of_every_conic():
    f = np.array([0.0, 1e-8, 0.4, -1.3, 2.2, 3.0, 7.0, -20.0])
    for e in (0.0, 1e-9, 0.3, 0.9, 1.0 - 1e-6, 1.0 + 1e-6, 1.5, 4.0):
        # Short of the asymptote, and of one shape for all.
        limit = np.inf if e < 1.0 else np.arccos(-1.0 / e) - 0.05
        inside = jnp.array(np.where(np.abs(f) < limit, f, 0.1))
        x, back, mean, time = anomalies(inside, e)
        np.testing.assert_allclose(back, inside, rtol=1e-13, atol=1e-15)
        # An independent function; a is 1, so that times are mean anomalies.
        np.testing.assert_allclose(mean, time, rtol=1e-12, atol=1e-14)
        np.testing.assert_allclose(
            conic_radius(abs(1.0 - e * e), e, inside),
            np.abs(1.0 - e * np.cos(x)) if e < 1.0 else e * np.cosh(x) - 1.0,
            rtol=1e-8 if abs(e - 1.0) < 1e-5 else 1e-13,
        )
    slopes = jax.vmap(jax.grad(lambda e: anomalies(0.7, e)[2]))(jnp.array([0.0, 0.5, 2.0]))
    assert np.all(np.isfinite(slopes))


def test_kepler_near_the_parabola_keeps_its_digits():  # T4.13-par
    with mp.workdps(40):
        x, e = mp.mpf("1e-3"), mp.mpf(0.999999)
        exact = float(x - e * mp.sin(x))
    np.testing.assert_allclose(mean_anomaly(1e-3, 0.999999), exact, rtol=1e-14)


def test_flyby_and_escape():
    """The hyperbola with e = 2 turns by 60 degrees; from a circle sqrt(3) times its speed leaves
    the speed of the circle."""
    np.testing.assert_allclose(turning_angle(2.0), np.pi / 3.0, rtol=1e-15)
    np.testing.assert_allclose(turning_angle(1.0), np.pi, rtol=1e-15)
    np.testing.assert_allclose(excess_speed(1.0, np.sqrt(3.0), 1.0), 1.0, rtol=1e-15)
    # 9 + 2 7/2 = 16: a centre that repels adds speed on the way out, from rest too.
    np.testing.assert_allclose(excess_speed(2.0, 3.0, -7.0), 4.0, rtol=1e-15)
    np.testing.assert_allclose(excess_speed(2.0, 0.0, -4.0), 2.0, rtol=1e-15)
    assert float(escape_speed(2.0, -7.0)) == 0.0
    # The slope by mu, -1/(r v_inf), on both sides of zero and there.
    slope = jax.vmap(jax.grad(excess_speed, 2), in_axes=(None, None, 0))
    mu = np.array([-7.0, 0.0, 4.0])
    np.testing.assert_allclose(slope(2.0, 3.0, mu), -0.5 / np.sqrt(9.0 - mu), rtol=1e-14)


def test_planets_on_circles():
    """The earth and Mars: 780 days, and 44 degrees of lead."""
    mu, year = 4.0 * np.pi**2, 365.25636
    days = synodic_period(1.0, 1.523679, mu) * year
    np.testing.assert_allclose(days, 779.94, rtol=1e-4)
    phase = departure_phase(1.0, 1.523679)
    # What the target turns during half the ellipse, against half a turn.
    a = 0.5 * (1.0 + 1.523679)
    np.testing.assert_allclose(phase, np.pi - np.pi * (a / 1.523679) ** 1.5, rtol=1e-14)
    assert departure_phase(1.0, 0.723) < 0.0


def test_the_table_of_planets():
    """Synodic periods of the almanac, days; gravity at the equators, m/s^2."""
    almanac = {"mercury": 115.88, "venus": 583.92, "mars": 779.94, "jupiter": 398.88}
    almanac |= {"saturn": 378.09, "uranus": 369.66, "neptune": 367.49}
    earth = PLANETS["earth"].orbit_radius
    for name, days in almanac.items():
        found = synodic_period(earth, PLANETS[name].orbit_radius, MU_SUN) / 86400.0
        # The masses of the planets shorten their own periods: Jupiter's by 5e-4.
        np.testing.assert_allclose(found, days, rtol=2e-4)
    pulls = (3.70, 8.87, 9.80, 3.71, 24.79, 10.44, 8.87, 11.15)
    found = [planet.mu / planet.radius**2 for planet in PLANETS.values()]
    np.testing.assert_allclose(found, pulls, rtol=2e-3)


def test_the_force_of_an_orbit():
    """A circle through the centre, F = -8 R^2 h^2 / r^5 (Thomson 4.5); a conic, -mu/r^2."""
    angle = jnp.linspace(-1.0, 1.0, 5)
    circle = force_of_orbit(lambda theta: 2.0 * 1.3 * jnp.cos(theta), angle, 0.7)
    r = 2.6 * np.cos(angle)
    np.testing.assert_allclose(circle, -8.0 * 1.3**2 * 0.7**2 / r**5, rtol=1e-13)
    conic = force_of_orbit(lambda theta: conic_radius(1.2, 0.4, theta), angle, 0.7)
    r = 1.2 / (1.0 + 0.4 * np.cos(angle))
    np.testing.assert_allclose(conic, -(0.7**2) / 1.2 / r**2, rtol=1e-13)


def test_projectiles():
    v, g = 300.0, 9.8
    low, high = projectile_angles(4000.0, 500.0, v, g)
    for angle in (low, high):
        t = 4000.0 / (v * np.cos(angle))
        np.testing.assert_allclose(v * np.sin(angle) * t - 0.5 * g * t * t, 500.0, rtol=1e-12)
    # On the envelope both angles are one, to half the digits, and above it there is none.
    top = projectile_envelope(4000.0, v, g)
    low, high = projectile_angles(4000.0, top * (1.0 - 1e-15), v, g)
    np.testing.assert_allclose(low, high, atol=1e-6)
    assert np.isnan(projectile_angles(4000.0, 1.01 * top, v, g)[0])
    # Dropped from rest: W g cos(lat) t^3/3 to the east; x south, y east, z up.
    rate, latitude, down = 7.29e-5, 0.6, jnp.array([0.0, 0.0, -g])
    omega = local_frame(latitude, 0.0, 6.4e6, rate).omega
    fall = projectile_position(jnp.zeros(3), 10.0, down, omega)
    east = rate * g * np.cos(latitude) * 1000.0 / 3.0
    np.testing.assert_allclose(fall, [0.0, east, -490.0], rtol=1e-13, atol=1e-15)
    # Upwards and back: west by 4/3 W cos(lat) v^3/g^2 (Thomson 2.6).
    up = projectile_position(jnp.array([0.0, 0.0, v]), 2.0 * v / g, down, omega)
    west = 4.0 / 3.0 * rate * np.cos(latitude) * v**3 / g**2
    np.testing.assert_allclose(up, [0.0, -west, 0.0], rtol=1e-12, atol=1e-9)


def test_a_small_impulse_keeps_its_digits():
    """Next to the first order, from which the change differs by its own share of the speed."""
    elements = ClassicalElements.from_periapsis(1.0, 0.3, 0.7, 0.4, 1.1, 2.0)
    r, v = state_from_elements(elements, 1.0)
    impulse = 1e-14 * jnp.array([0.3, -0.5, 0.8])
    whole, first = (impulse_change(r, v, impulse, 1.0, first_order=x) for x in (False, True))
    for name, value in first.items():
        np.testing.assert_allclose(whole[name], value, rtol=1e-12)


def test_an_impulse_in_any_direction():
    """The first order is that of the exact change, whose rest falls with the square."""
    elements = ClassicalElements.from_periapsis(1.0, 0.3, 0.7, 0.4, 1.1, 2.0)
    r, v = state_from_elements(elements, 1.0)
    impulse = jnp.array([0.3, -0.5, 0.8])
    exact = jax.jit(lambda dv: impulse_change(r, v, dv, 1.0))
    first = impulse_change(r, v, 1e-4 * impulse, 1.0, first_order=True)
    whole, half = exact(1e-4 * impulse), exact(0.5e-4 * impulse)
    for name, value in first.items():
        error = float(whole[name] - value)
        assert abs(error) < 1e-3 * abs(float(value)) + 1e-7
        # A quarter at half the impulse, to the third order.
        np.testing.assert_allclose(4.0 * (half[name] - 0.5 * value), error, rtol=1e-3, atol=1e-12)
