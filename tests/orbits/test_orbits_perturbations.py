"""Zonal harmonics and their mean rates, a third body, sunlight, turning axes: closed forms, numbers
of other programs, and the shapes and files that they share."""

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.special import eval_legendre

from jaxspace import Accuracy, Scene, load, simulate
from jaxspace.bodies import BodyState, RigidBody, StandardAtmosphere
from jaxspace.constants import ASTRONOMICAL_UNIT, J2_EARTH, RADIUS_SUN, ZONALS_EARTH
from jaxspace.core import InputError
from jaxspace.core.tables import breaks_of
from jaxspace.orbits import (
    CircularPath,
    Drag,
    KeplerPath,
    PointGravity,
    RotatingFrame,
    SolarPressure,
    TabulatedPath,
    ThirdBody,
    UniformGravity,
    Zonals,
)
from jaxspace.orbits.elements import elements_from_state
from jaxspace.orbits.kepler import kepler_flow
from jaxspace.orbits.oblateness import apsidal_rate, node_regression_rate, oblateness
from jaxspace.orbits.secular_rates import (
    CRITICAL_INCLINATION,
    secular_rates,
    sun_synchronous_inclination,
)
from jaxspace.orbits.shadow import sunlight
from jaxspace.orbits.solar_pressure import solar_pressure
from jaxspace.orbits.third_body import third_body, third_body_potential
from jaxspace.orbits.zonals import zonal_potential, zonals
from jaxspace.rotations import MovingFrame, Quaternion

MU, RADIUS = 3.986004418e14, 6378137.0
BODY = RigidBody()
HARMONICS = jnp.array([1e-3, -2e-4, 3e-4, 5e-5, -7e-5])
PLACES = jnp.array(np.random.default_rng(3).normal(size=(3, 12)) * 1.3)


def test_zonals_are_the_gradient_of_their_potential():
    """Both against Legendre polynomials of scipy; a batch is its runs; on the axis too."""
    places = PLACES.at[:, 0].set(jnp.array([0.0, 0.0, 1.4])).at[:, 1].set(jnp.array([1.2, 0, 0]))
    r = np.linalg.norm(places, axis=0)
    value, slope = jax.jit(
        jax.vmap(jax.value_and_grad(lambda r: zonal_potential(r, 1.3, HARMONICS, 0.9)), -1)
    )(places)
    terms = [
        j * (0.9 / r) ** n * eval_legendre(n, places[2] / r) for n, j in enumerate(HARMONICS, 2)
    ]
    np.testing.assert_allclose(value, 1.3 / r * sum(terms), rtol=1e-12, atol=1e-17)
    found = jax.jit(zonals)(places, 1.3, HARMONICS, 0.9)
    np.testing.assert_allclose(found, -slope.T, rtol=1e-11, atol=1e-15)


def test_the_first_zonal_is_the_oblateness():
    """And the numbers of another program for the earth's (tudat, EGM2008, normalised C20)."""
    j2 = jnp.array([0.1])
    np.testing.assert_allclose(
        zonals(PLACES, 1.3, j2, 0.9), oblateness(PLACES, 1.3, 0.1, 0.9), rtol=1e-12, atol=1e-16
    )
    a = zonals(
        jnp.array([7e6, 8e6, 9e6]),
        3.986004418e14,
        jnp.array([0.000484165143790815 * np.sqrt(5.0)]),
        6378137.0,
    )
    expected = [0.0003824456141317033, 0.0004370807018648038, -0.000412481965681654]
    np.testing.assert_allclose(a, expected, rtol=2e-14)


@pytest.mark.parametrize("precision", [jnp.float32, jnp.float64])
def test_zonals_in_metres(precision):
    """No product of powers of a radius leaves float32; a few units in the last place."""
    r = jnp.array([6.6e6, 4.0e5, -3.0e6])
    harmonics = jnp.array(ZONALS_EARTH)
    exact = zonals(r, MU, harmonics, RADIUS)
    found = jax.jit(jax.jacfwd(lambda r: zonals(r, MU, harmonics.astype(precision), RADIUS)))(
        r.astype(precision)
    )
    scale = float(jnp.linalg.norm(exact) / jnp.linalg.norm(r))
    assert found.dtype == precision and np.all(np.isfinite(found))
    # The gradient of a potential is symmetric.
    assert float(jnp.abs(found - found.T).max()) < 1e-5 * scale
    # Laplace's equation: the trace is zero.
    assert abs(float(jnp.trace(found))) < (1e-5 if precision == jnp.float32 else 1e-13) * scale


def test_the_rates_derive_from_one_function_of_the_momenta():
    """In L = sqrt(mu a), G = L sqrt(1 - e^2), H = G cos i the rates of M, w and O are minus the
    derivatives of one Hamiltonian, so that their Jacobian is symmetric; of all orders together."""

    def rates(momenta):
        L, G, H = momenta
        e = jnp.sqrt(1.0 - (G / L) ** 2)
        found = secular_rates(L * L, e, jnp.arccos(H / G), 1.0, 0.02, 0.9, -3e-3, True)
        return jnp.stack([found.mean_anomaly, found.argument_of_periapsis, found.node])

    jacobian = jax.jit(jax.jacfwd(rates))(jnp.array([1.2, 1.1, 0.7]))
    np.testing.assert_allclose(jacobian, jacobian.T, rtol=0, atol=1e-13)
    assert np.abs(jacobian[0, 1]) > 1e-3


def test_mean_rates_of_a_full_integration():
    """Forty revolutions about the periapsis at 45 degrees, where the terms of long period have no
    rate: first order is right to J2, second order to its square times the numbers of the formula.
    The mean anomaly by its first order alone: the mean axis is known to J2^2."""
    j2, j4, a, e, i = 1e-3, -2e-6, 1.6, 0.25, 0.9
    harmonics = jnp.array([j2, 0.0, j4])
    drift = float(secular_rates(a, e, i, 1.0, j2, 1.0).argument_of_periapsis)
    turns = 40
    end = turns * 2.0 * np.pi * a**1.5
    w0 = np.pi / 4.0 - 0.5 * drift * end
    p = a * (1.0 - e * e)
    node, across = np.array([1.0, 0.0, 0.0]), np.array([0.0, np.cos(i), np.sin(i)])
    ahead = np.cos(w0) * node + np.sin(w0) * across
    side = -np.sin(w0) * node + np.cos(w0) * across
    y0 = np.concatenate([p / (1.0 + e) * ahead, np.sqrt(1.0 / p) * (1.0 + e) * side])

    def rate(t, y):
        r2 = y[:3] @ y[:3]
        r, s = np.sqrt(r2), y[2] / np.sqrt(r2)
        term2, term4 = 1.5 * j2 / r2, 0.625 * j4 / r2**2
        along = 1.0 + term2 * (1 - 5 * s * s) + term4 * (-3 + 42 * s**2 - 63 * s**4)
        up = 2 * term2 * s + term4 * (28 * s**3 - 12 * s)
        return np.concatenate([y[3:], -along * y[:3] / r**3 - np.array([0, 0, up]) / r2])

    # The field written once more, as explicit polynomials of both degrees.
    np.testing.assert_allclose(
        rate(0.0, y0)[3:] + y0[:3] / np.linalg.norm(y0[:3]) ** 3,
        zonals(jnp.array(y0[:3]), 1.0, harmonics, 1.0),
        rtol=0,
        atol=1e-15,
    )
    ts = np.linspace(0.0, end, turns * 100 + 1)
    y = solve_ivp(rate, (0, end), y0, method="DOP853", rtol=1e-11, atol=1e-12, t_eval=ts).y
    found = jax.jit(elements_from_state)(jnp.array(y[:3]), jnp.array(y[3:]), 1.0)
    f, ecc = np.asarray(found.true_anomaly), np.asarray(found.eccentricity)
    E = 2.0 * np.arctan2(np.sqrt(1 - ecc) * np.sin(f / 2), np.sqrt(1 + ecc) * np.cos(f / 2))
    angles = [found.node, found.argument_of_periapsis, E - ecc * np.sin(E)]
    size = np.asarray(found.semi_latus_rectum) / (1.0 - ecc**2)
    # A window that fades at both ends leaves nothing of the terms of short period.
    window = np.sin(np.pi * ts / end) ** 2
    osculating = (size, ecc, np.asarray(found.inclination))
    mean = [float(np.average(x, weights=window)) for x in osculating]
    slope = [np.polyfit(ts, np.unwrap(np.asarray(x)), 1, w=window)[0] for x in angles]
    first = np.array(secular_rates(*mean, 1.0, j2, 1.0))
    second = np.array(secular_rates(*mean, 1.0, j2, 1.0, j4, True))
    error = np.abs(np.array([first, second]) / slope - 1.0)
    # J2^2 leaves 2e-6; of the first order 2e-4 of the node and 2e-3 of the periapsis are wrong.
    assert np.all(error[1, :2] < 5e-6) and np.all(error[0, :2] > 1e-4), error
    assert error[0, 2] < 1e-6 and abs(mean[0] ** -1.5 / slope[2] - 1.0) > 2e-5, error


def test_special_inclinations():
    """800 km: 98.6 degrees (Vallado 11.4); the critical one stops the apsides; Curtis 12.2."""
    a = RADIUS + 8e5
    i = sun_synchronous_inclination(a, 0.0, MU, J2_EARTH, RADIUS)
    assert float(jnp.degrees(i)) == pytest.approx(98.6, abs=0.05)
    year = 2.0 * np.pi / float(secular_rates(a, 0.0, i, MU, J2_EARTH, RADIUS).node)
    assert year == pytest.approx(365.24219 * 86400.0, rel=1e-9)
    assert abs(float(apsidal_rate(a, 0.1, CRITICAL_INCLINATION, MU, J2_EARTH, RADIUS))) < 1e-21
    assert np.isnan(float(sun_synchronous_inclination(2e7, 0.0, MU, J2_EARTH, RADIUS)))
    r, v = jnp.array([-2384460.0, 5729010.0, 3050460.0]), jnp.array([-7361.38, -2989.97, 1643.54])
    found = elements_from_state(r, v, MU)
    a = found.semi_latus_rectum / (1.0 - found.eccentricity**2)
    args = (a, found.eccentricity, found.inclination, MU, J2_EARTH, RADIUS)
    hour = 3600.0 * 180.0 / np.pi
    assert float(-node_regression_rate(*args)) * hour == pytest.approx(-0.172, rel=1e-2)
    assert float(apsidal_rate(*args)) * hour == pytest.approx(0.282, rel=1e-2)


def test_a_third_body_keeps_its_digits():
    """The sun on a low orbit: the two attractions cancel to 1e-8; 40 digits of the difference."""
    r = jnp.array([[6.6e6, 3e8, 1.0], [4.0e5, -2e8, -2.0], [-3.0e5, 1e7, 0.5]])
    s = jnp.array([-2.6e10, 1.32e11, 5.7e10])
    mu = 1.32712440018e20
    found = jax.jit(third_body)(r, s, mu)
    potential, slope = jax.jit(
        jax.vmap(jax.value_and_grad(lambda r: third_body_potential(r, s, mu)), -1)
    )(r)
    with mp.workdps(40):
        for k in range(3):
            x = mp.matrix([mp.mpf(float(v)) for v in r[:, k]])
            z = mp.matrix([mp.mpf(float(v)) for v in s])
            d, far = mp.norm(z - x), mp.norm(z)
            exact = [float(mu * ((z[j] - x[j]) / d**3 - z[j] / far**3)) for j in range(3)]
            energy = -mu * (1 / d - 1 / far - (x.T * z)[0] / far**3)
            scale = np.linalg.norm(exact)
            np.testing.assert_allclose(found[:, k], exact, rtol=0, atol=1e-15 * scale)
            # Two terms that cancel to |r|/|s|, which for a metre is nothing: as in any potential.
            rise = mu * abs(float((x.T * z)[0])) / float(far) ** 3
            assert abs(float(potential[k]) - float(energy)) < 4e-16 * rise
            np.testing.assert_allclose(slope[k], -np.array(exact), atol=1e-12 * rise + 1e-6 * scale)
    assert third_body(r.astype(jnp.float32), s.astype(jnp.float32), mu).dtype == jnp.float32


MOON = CircularPath(3.844e8, 2.6617e-6, phase=0.4, inclination=0.4, node=1.1)


def test_paths_agree():
    """A circle, the conic of its state, and a table of it: a cubic spline of hourly nodes is right
    to 5/384 h^4 times the fourth derivative, 2e-4 m, away from its ends."""
    times = jnp.arange(-48.0, 96.0) * 3600.0
    ts = jnp.linspace(0.0, 86400.0, 7)
    circle = MOON(ts)
    _, velocity = jax.jvp(MOON, (0.0,), (1.0,))
    conic = KeplerPath(MOON(0.0), velocity, 3.844e8**3 * 2.6617e-6**2)
    table = TabulatedPath(times, MOON(times))
    np.testing.assert_allclose(jnp.linalg.norm(circle, axis=0), 3.844e8, rtol=1e-14)
    np.testing.assert_allclose(jax.jit(lambda t: conic(t))(ts), circle, atol=1e-4)
    np.testing.assert_allclose(table(ts), circle, atol=2e-2)
    assert breaks_of(Scene((ThirdBody(4.9e12, table),))).shape == times.shape
    with pytest.raises(InputError, match=r"TabulatedPath.positions has the shape \(144,\)"):
        TabulatedPath(times, times)
    # Any function of the time is a path; the derivative of a load by the time follows from it.
    y = BodyState(position=jnp.array([7e6, 1e6, -2e6]))
    of_function = ThirdBody(4.9e12, lambda t: MOON(t)).load(10.0, y, BODY).acceleration_N
    np.testing.assert_allclose(of_function, third_body(y.position, MOON(10.0), 4.9e12), rtol=1e-14)


SUN = CircularPath(ASTRONOMICAL_UNIT, 1.991e-7, inclination=0.4091)


def test_sunlight_pushes_away_and_is_shaded():
    """4.54e-6 N/m^2 on 0.02 m^2/kg at one au; nothing in the umbra; the penumbra in proportion."""
    towards = SUN(0.0) / ASTRONOMICAL_UNIT
    sail = SolarPressure(0.02, SUN, RADIUS, RADIUS_SUN, 1.3)
    lit = sail.load(0.0, BodyState(position=7e6 * towards), BODY).acceleration_N
    expected = 4.5398e-6 * 1.3 * 0.02 / (1.0 - 7e6 / ASTRONOMICAL_UNIT) ** 2
    np.testing.assert_allclose(lit, -expected * towards, rtol=1e-12, atol=1e-22)
    dark = sail.load(0.0, BodyState(position=-7e6 * towards), BODY).acceleration_N
    np.testing.assert_allclose(dark, 0.0, atol=1e-20)
    edge = jnp.cross(towards, jnp.array([0.0, 0.0, 1.0]))
    place = -7e6 * towards + (RADIUS + 3e3) * edge / jnp.linalg.norm(edge)
    full = solar_pressure(place, SUN(0.0), 1.3 * 4.5398e-6, 0.02)
    share = sunlight(place, SUN(0.0), RADIUS, RADIUS_SUN)
    assert 0.1 < float(share) < 0.9
    found = sail.load(0.0, BodyState(position=place), BODY).acceleration_N
    np.testing.assert_allclose(found, share * full, rtol=1e-12)
    bare = SolarPressure(0.02, SUN, coefficient=1.3).load(0.0, BodyState(position=place), BODY)
    np.testing.assert_allclose(bare.acceleration_N, full, rtol=1e-12)
    half = sail.scaled(0.5).load(0.0, BodyState(position=place), BODY).acceleration_N
    np.testing.assert_allclose(half, 0.5 * found, rtol=1e-12)


def test_turning_axes_and_inertial_space_agree():
    """An orbit in the earth's axes against the closed form seen from them, to the tolerance of the
    run; Jacobi's integral stays. Then the forces themselves, about any axis, to rounding."""
    rate = 7.292115e-5
    r0, v0 = jnp.array([6.9e6, 4e5, -3e5]), jnp.array([-300.0, 6900.0, 3600.0])
    omega = jnp.array([0.0, 0.0, rate])
    still = MovingFrame(Quaternion.identity(), omega)
    zero = jnp.zeros(3)
    start = still.from_inertial(r0, v0, zero)
    scene = Scene((PointGravity(MU), RotatingFrame(omega)))
    run = simulate(
        scene, BodyState(*start[:2]), jnp.array([0.0, 3000.0]), accuracy=Accuracy(rtol=1e-13)
    )
    r, v = kepler_flow(r0, v0, 3000.0, MU)
    angle = 0.5 * rate * 3000.0
    turned = Quaternion(jnp.array([np.cos(angle), 0.0, 0.0, np.sin(angle)]))
    place, velocity, _ = MovingFrame(turned, omega).from_inertial(r, v, zero)
    # Some hundred steps within 1e-13 of 7e6 m, along the motion.
    np.testing.assert_allclose(run.final.position, place, atol=1e-4)
    np.testing.assert_allclose(run.final.velocity, velocity, atol=1e-7)
    assert list(run.drift()) == ["energy"]
    assert float(run.drift()["energy"].max()) < 1e-12
    w = jnp.array([3e-4, -2e-4, 7e-4])
    frame = MovingFrame(turned, w)
    push = RotatingFrame(w).load(0.0, BodyState(r0, v0), BODY).acceleration_N
    _, _, inertial = frame.to_inertial(r0, v0, push)
    np.testing.assert_allclose(inertial, 0.0, atol=1e-14 * float(jnp.linalg.norm(push)))


def test_coriolis_force_beside_the_gravity_of_a_plumb_line():
    """Without the centrifugal force v' = g - 2 w x v, which the exponential of a matrix solves; a
    dropped body goes east by W g cos(lat) t^3/3 to first order (Thomson 2.6-4)."""
    rate, latitude, t = 0.02, 0.6, 3.0
    w = rate * np.array([np.cos(latitude), 0.0, np.sin(latitude)])  # North, west, up.
    gravity = np.array([0.0, 0.0, -9.8])
    scene = Scene((UniformGravity(gravity), RotatingFrame(w, centrifugal=False)))
    at_rest = BodyState(jnp.zeros(3), jnp.zeros(3))
    run = simulate(scene, at_rest, jnp.array([0.0, t]), accuracy=1e-12)
    # State r, v, 1.
    matrix = np.zeros((7, 7))
    matrix[:3, 3:6] = np.eye(3)
    matrix[3:6, 3:6] = -2.0 * np.cross(w, np.eye(3), axisb=0, axisc=0)
    matrix[3:6, 6] = gravity
    exact = expm(t * matrix)[:6, 6]
    np.testing.assert_allclose(run.final.position, exact[:3], atol=1e-11)
    np.testing.assert_allclose(run.final.velocity, exact[3:], atol=1e-11)
    assert float(run.drift()["energy"].max()) < 1e-10
    east = rate * 9.8 * np.cos(latitude) * t**3 / 3.0
    # The next terms are (2 W t)^2/20 of it.
    np.testing.assert_allclose(-run.final.position[1], east, rtol=(2.0 * rate * t) ** 2 / 20.0)


@pytest.mark.slow
def test_all_of_them_together():
    """A batch is its runs; the slopes of the vector field by state and parameters agree, forward,
    reverse and as central differences of order four."""
    scene = Scene(
        (
            PointGravity(MU),
            Zonals(MU, jnp.array(ZONALS_EARTH), RADIUS),
            Drag(50.0, StandardAtmosphere(), RADIUS, 7.29e-5),
            ThirdBody(4.9e12, MOON),
            SolarPressure(0.02, SUN, RADIUS, RADIUS_SUN),
            RotatingFrame(jnp.array([1e-6, 0.0, 7.29e-5])),
        )
    )
    y = BodyState(jnp.array([6.6e6, 4.0e5, -3.0e5]), jnp.array([-300.0, 6900.0, 3600.0]))
    keys = iter(jax.random.split(jax.random.key(4), 40))

    def field(both):
        return both[0].vector_field(100.0, both[1]).velocity

    def direction(x):
        return 1e-3 * x * jax.random.normal(next(keys), x.shape)

    here = (scene, y)
    along = jax.tree.map(direction, here)

    @jax.jit
    def at(h):
        return field(jax.tree.map(lambda x, d: x + h * d, here, along))

    @jax.jit
    def slopes(here):
        _, forward = jax.jvp(field, (here,), (along,))
        (gradient,) = jax.vjp(field, here)[1](forward)
        terms = jax.tree.map(lambda g, d: jnp.sum(g * d), gradient, along)
        return forward, sum(jax.tree.leaves(terms))

    forward, reverse = slopes(here)
    h = 0.03
    difference = (8.0 * (at(h) - at(-h)) - (at(2 * h) - at(-2 * h))) / (12.0 * h)
    size = float(jnp.linalg.norm(forward))
    assert abs(float(reverse) - size**2) < 1e-12 * size**2
    # Rounding of 1e-16 of 9 m/s^2 over a step of 3 percent of the change of 1e-2.
    np.testing.assert_allclose(forward, difference, atol=1e-8 * size)
    runs = jax.tree.map(lambda x: jnp.stack([x, x], -1), y)
    batch = jax.jit(field)((scene, runs))
    np.testing.assert_allclose(batch, jnp.stack([at(0.0)] * 2, -1), rtol=1e-12)


FILE = """
[planet]
mu = "398600.4418 km^3/s^2"
radius = "6378.137 km"
[effects.point_gravity]
[effects.zonals]
harmonics = [1.08262668e-3, -2.53265649e-6, -1.61962159e-6]
[effects.third_body]
mu = "4902.8 km^3/s^2"
path = { distance = "384400 km", rate = "13.176 deg/day", phase = "40 deg" }
[effects.solar_pressure]
area_per_mass = "0.02 m^2/kg"
sun_radius = "695700 km"
[effects.solar_pressure.sun]
times = [0.0, 1.0, 2.0, 3.0]
positions = [[1.0, 2.0, 3.0, 4.0], [0.0, 0.0, 0.0, 0.0], ["1 km", "2 km", "3 km", "4 km"]]
[effects.rotating_frame]
omega = [0.0, 0.0, 7.292115e-5]
[initial.orbit]
periapsis_altitude = "400 km"
[times]
end = "90 min"
"""


def test_the_effects_in_a_file(tmp_path):
    """Every key follows from the declarations; paths are given in their several ways."""
    path = tmp_path / "perturbed.toml"
    path.write_text(FILE)
    effects = load(path).system.effects
    _, field, moon, light, axes = effects
    np.testing.assert_allclose(field.harmonics, ZONALS_EARTH[:3], rtol=1e-12)
    assert isinstance(moon.path, CircularPath) and isinstance(light.sun, TabulatedPath)
    assert float(moon.path.rate) == pytest.approx(np.radians(13.176) / 86400.0, rel=1e-12)
    np.testing.assert_allclose(light.sun(1.0), [2.0, 0.0, 2e3], rtol=1e-12)
    assert float(light.radius) == RADIUS and float(axes.omega[2]) == 7.292115e-5


def test_the_potential_of_a_third_body_keeps_its_digits_beside_the_centre():
    """mu/s^3 (r^2/2 - 3/2 (r . s)^2/s^2), to first order in the share 1e-12 of the distance."""
    r, s = jnp.array([1e-12, 2e-12, -1e-12]), jnp.array([3.0, 1.0, 2.0])
    along = jnp.sum(r * s) / jnp.linalg.norm(s)
    expected = 5.0 * (0.5 * jnp.sum(r * r) - 1.5 * along**2) / jnp.linalg.norm(s) ** 3
    np.testing.assert_allclose(jax.jit(third_body_potential)(r, s, 5.0), expected, rtol=1e-11)
