"""Transfers by impulses, impulses on any orbit, relative motion: against the state after the
impulse, published limits, and the motion itself."""

import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np
import pytest

import jaxspace
from jaxspace import Mission, Phase, simulate_mission
from jaxspace.bodies import BodyState
from jaxspace.core import InputError
from jaxspace.orbits import ClassicalElements, Impulse, TwoBody
from jaxspace.orbits.bielliptic import bielliptic_break_even
from jaxspace.orbits.clohessy_wiltshire import clohessy_wiltshire_flow, clohessy_wiltshire_transfer
from jaxspace.orbits.elements import elements_from_state, state_from_elements
from jaxspace.orbits.impulses import (
    apse_line_impulse,
    eccentricities_through,
    plane_change_impulse,
    small_tangential_impulse,
    tangential_impulse,
)
from jaxspace.orbits.kepler import kepler_flow
from jaxspace.orbits.transfers import (
    apsidal_impulse,
    bielliptic_transfer,
    coaxial_transfer,
    hohmann_transfer,
)

hohmann = jax.jit(hohmann_transfer)
bielliptic = jax.jit(bielliptic_transfer)
coaxial = jax.jit(coaxial_transfer)


def flown(state, impulses, durations):
    """The state after impulses along the path and the arcs between them, mu = 1."""
    r, v = state
    for k, dv in enumerate(impulses):
        v = v * (1.0 + dv / jnp.linalg.norm(v))
        if k < len(durations):
            r, v = flow(r, v, durations[k], 1.0)
    return r, v


flow = jax.jit(kepler_flow)
elements = jax.jit(elements_from_state)
X, Y = jnp.array([1.0, 0, 0]), jnp.array([0, 1.0, 0])


@pytest.mark.parametrize("radii", [(1.0, 3.0), (1.0, 0.4), (1.0, 40.0, 15.0), (2.0, 3.0, 0.5)])
def test_the_transfers_arrive(radii):
    plan = hohmann(*radii, 1.0) if len(radii) == 2 else bielliptic(*radii, 1.0)
    start = radii[0] * X, radii[0] ** -0.5 * Y
    r, v = flown(start, list(plan.impulses), list(plan.durations))
    assert float(jnp.linalg.norm(r)) == pytest.approx(radii[-1], rel=1e-12)
    assert float(jnp.linalg.norm(v)) == pytest.approx(radii[-1] ** -0.5, rel=1e-12)
    assert abs(float(r @ v)) < 1e-12
    assert float(plan.duration) == pytest.approx(float(sum(plan.durations)), rel=1e-15)


def test_coaxial_ellipses():
    """From the apoapsis of one to the periapsis of the other, inwards."""
    plan = coaxial(3.0, 1.5, 0.8, 1.1, 1.0)
    v = np.sqrt(2 * 1.5 / (3.0 * 4.5))
    r, v = flown((3.0 * X, v * Y), list(plan.impulses), list(plan.durations))
    found = elements(r, v, 1.0)
    assert float(found.eccentricity) == pytest.approx(0.3 / 1.9, rel=1e-12)
    assert float(jnp.linalg.norm(r)) == pytest.approx(0.8, rel=1e-12)


def test_a_small_transfer_keeps_its_digits():
    with mp.workdps(40):
        x = mp.mpf(float(1 + 1e-9))
        exact = [mp.sqrt(2 * x / (1 + x)) - 1, 1 / mp.sqrt(x) - mp.sqrt(2 / (x * (1 + x)))]
    found = hohmann(1.0, 1 + 1e-9, 1.0).impulses
    np.testing.assert_allclose(found, [float(e) for e in exact], rtol=1e-15)
    slope = jax.jit(jax.jacfwd(lambda x: hohmann_transfer(1.0, x, 1.0).impulses))(1.0)
    np.testing.assert_allclose(slope, [0.25, 0.25], rtol=1e-14)


def test_escape_and_capture():
    for sign, radii in ((1, (1.0, np.inf)), (-1, (np.inf, 1.0))):
        value, slope = jax.value_and_grad(apsidal_impulse)(1.0, *radii, 1.0)
        assert float(value) == pytest.approx(sign * (np.sqrt(2) - 1), rel=1e-15)
        assert np.isfinite(slope)


break_even = jax.jit(lambda x: (bielliptic_break_even(x), jax.jacfwd(bielliptic_break_even)(x)))


@pytest.mark.parametrize("ratio", [11.95, 12.0, 13.7, 15.0, 15.57, 1 / 12.5])
def test_break_even_of_the_bielliptic_transfer(ratio):
    """The root of the difference of both totals, in forty digits; its slope by differences."""

    def exact(x):
        v = lambda r, s: mp.sqrt(2 * s / (r * (r + s)))  # noqa: E731
        two = v(1, x) - 1 + 1 / mp.sqrt(x) - v(x, 1)

        def excess(u):
            b = x / u
            three = v(1, b) - 1 + v(b, x) - v(b, 1) + v(x, b) - 1 / mp.sqrt(x)
            return (three - two) / (1 - u)

        guess = x / mp.mpf(float(break_even(float(x))[0]))
        return x / mp.findroot(excess, (guess * mp.mpf("0.999"), guess * mp.mpf("1.0005")))

    with mp.workdps(40):
        x, step = mp.mpf(max(ratio, 1 / ratio)), mp.mpf(10) ** -12
        value = exact(x)
        slope = (exact(x + step) - exact(x - step)) / (2 * step)
    found, found_slope = break_even(ratio)
    # Beside 11.94, where the root is far out, the excess is flat: 1e-16 over its slope.
    assert float(found) == pytest.approx(float(value), rel=1e-11)
    if ratio > 1:
        assert float(found_slope) == pytest.approx(float(slope), rel=1e-8)


def test_the_ends_of_the_break_even():
    assert [float(v) for v in break_even(11.938)] == [np.inf, 0.0]
    assert [float(v) for v in break_even(16.0)] == [16.0, 1.0]
    assert break_even(11.93877)[0] < np.inf and break_even(15.5817)[0] > 15.5817
    # Cheaper beyond it, and dearer before.
    b = float(break_even(13.0)[0])
    two = hohmann(1.0, 13.0, 1.0).total
    assert bielliptic(1.0, 1.01 * b, 13.0, 1.0).total < two
    assert bielliptic(1.0, 0.99 * b, 13.0, 1.0).total > two


tangential = jax.jit(tangential_impulse)


def after_impulse(p, e, f, gain):
    """Elements after an impulse along the path, by the state."""
    r, v = state_from_elements(ClassicalElements(p, e, 0.0, 0.0, 0.0, f), 1.0)
    y = elements_from_state(r, v * (1.0 + gain), 1.0)
    # From the old line of apsides, which is the x axis.
    return y.semi_latus_rectum, y.eccentricity, y.true_anomaly


by_state = jax.jit(after_impulse)


@pytest.mark.parametrize("f", [-2.5, 0.0, 1.2, 3.0])
@pytest.mark.parametrize("gain", [0.2, -0.3])
def test_tangential_impulse(f, gain):
    p, e = 1.3, 0.4
    change = tangential(p, e, f, gain)
    p2, e2, f2 = by_state(p, e, f, gain)
    assert float(change.eccentricity) == pytest.approx(float(e2) - e, abs=1e-14)
    assert np.cos(f + change.true_anomaly - f2) == pytest.approx(1.0, abs=1e-14)
    a2 = p2 / (1.0 - e2 * e2)
    assert float(change.semi_major_axis) == pytest.approx(float(a2 - p / (1 - e * e)), rel=1e-12)


def test_small_impulses():
    """The exact change tends to that of first order, and is right for the smallest gain; the slopes
    of the exact one are those of first order."""
    place = (1.3, 0.4, 1.2)
    first = np.array(small_tangential_impulse(*place, 1.0))
    slopes = np.array(jax.jacfwd(lambda g: jnp.stack(tangential_impulse(*place, g)))(0.0))
    np.testing.assert_allclose(slopes, first, rtol=1e-14)
    exact = np.array(tangential(*place, 1e-13))
    np.testing.assert_allclose(exact, 1e-13 * first, rtol=1e-12)
    # On a circle the eccentricity is 2 |g| + g^2, and the place becomes an apsis.
    change = tangential(1.0, 0.0, 0.7, 1e-3)
    assert float(change.eccentricity) == pytest.approx(2e-3 + 1e-6, rel=1e-14)
    assert float(change.true_anomaly) == pytest.approx(-0.7, rel=1e-14)


def test_impulse_with_the_line_of_apsides_kept():  # T4.13-2
    e, a, f, a2 = 0.5081941891541355, 3.3333333333333335, np.radians(150.0), 3.6
    p = a * (1 - e * e)
    other, new = eccentricities_through(p / (1 + e * np.cos(f)), f, a2)
    small, large = sorted((float(other), float(new)))
    np.testing.assert_allclose([small, large], [0.29563601507206577, 0.7666815662418822], 1e-12)
    r, v = state_from_elements(ClassicalElements(p, e, 0.0, 0.0, 0.3, f), 1.0)
    outwards = r / jnp.linalg.norm(r)
    # In units of the circular speed there; the textbook counts along the path and normal to it.
    unit = float(jnp.linalg.norm(r)) ** 0.5
    up, across = apse_line_impulse(p, e, f, small, 1.0)
    assert unit * float(jnp.hypot(up, across)) == pytest.approx(0.20335687192680277, rel=1e-11)
    kick = up * outwards + across * jnp.cross(jnp.array([0, 0, 1.0]), outwards)
    along = unit * float(kick @ v / jnp.linalg.norm(v))
    assert along == pytest.approx(0.03454906396633755, rel=1e-10)
    up, across = apse_line_impulse(p, e, f, large, 1.0)
    assert unit * float(jnp.hypot(up, across)) == pytest.approx(0.36319800268918767, rel=1e-11)
    y = Impulse(radial=up, transverse=across)(0.0, BodyState(position=r, velocity=v))
    found = elements(y.position, y.velocity, 1.0)
    assert float(found.eccentricity) == pytest.approx(large, rel=1e-12)
    assert float(found.argument_of_periapsis) == pytest.approx(0.3, abs=1e-12)


def test_plane_change():
    for v, v2, angle in ((1.0, 1.2, 0.5), (1.0, 1.0, 1e-9), (2.0, 1.0, np.pi)):
        turned = v2 * np.array([np.cos(angle), np.sin(angle)])
        expected = np.hypot(turned[0] - v, turned[1])
        assert float(plane_change_impulse(v, v2, angle)) == pytest.approx(expected, rel=1e-7)
    assert float(plane_change_impulse(1.0, 1.0, 1e-9)) == pytest.approx(1e-9, rel=1e-15)
    assert jax.grad(plane_change_impulse, 2)(1.0, 1.0, 0.0) == 0.0


def test_impulses_in_a_mission():
    """The transfer of Hohmann as a mission, with a turn of the plane at the end."""
    plan = hohmann(1.0, 2.0, 1.0)
    body = TwoBody(1.0)
    turn = 0.2
    v2 = 2.0**-0.5
    v1 = v2 - plan.impulses[1]
    last = Impulse(transverse=v2 * np.cos(turn) - v1, normal=v2 * np.sin(turn))
    mission = Mission(
        [
            Phase(body, 0.0, then=Impulse(along=plan.impulses[0]), name="leave"),
            Phase(body, plan.duration, then=last, name="arc"),
        ]
    )
    end = simulate_mission(mission, BodyState(position=X, velocity=Y)).final
    found = elements(end.position, end.velocity, 1.0)
    assert float(found.semi_latus_rectum) == pytest.approx(2.0, rel=1e-12)
    assert float(found.eccentricity) < 1e-13
    assert float(found.inclination) == pytest.approx(turn, rel=1e-12)


def test_components_of_an_impulse():
    r, v = jnp.array([[1.0, 0.3], [0, 0.2], [0, 0.1]]), jnp.array([[0.1, 0], [0.9, 1], [0.3, 0]])
    y = BodyState(position=r, velocity=v, mass=jnp.ones(2))
    kick = np.array([0.1, -0.2, 0.3])
    new = Impulse(inertial=jnp.asarray(kick))(0.0, y)
    np.testing.assert_allclose(new.velocity - v, kick[:, None] + 0 * v, rtol=1e-12)
    h = np.cross(np.asarray(r).T, np.asarray(v).T)
    new = Impulse(radial=0.1, transverse=-0.2, normal=[0.3, 0.4])(0.0, y)
    dv = np.asarray(new.velocity - v)
    for k, normal in enumerate((0.3, 0.4)):
        axes = np.stack([r[:, k], np.cross(h[k], r[:, k]), h[k]], axis=1)
        axes = axes / np.linalg.norm(axes, axis=0)
        np.testing.assert_allclose(axes.T @ dv[:, k], [0.1, -0.2, normal], rtol=1e-12)
    with pytest.raises(InputError, match="must have position and velocity"):
        Impulse(along=1.0)(0.0, BodyState(mass=jnp.ones(())))


SCENE = """
[planet]
mu = "398600.4418 km^3/s^2"

[effects.point_gravity]

[initial.orbit]
burnout_radius = "6578.137 km"
burnout_speed = "7.9 km/s"
flight_path_angle = "1 deg"

[[phase]]
name = "coast"
effects = ["point_gravity"]
duration = "10 min"

[phase.jump.impulse]
along = "0.1 km/s"

[[phase]]
name = "after"
effects = ["point_gravity"]
duration = "10 min"
"""


def test_burnout_and_impulse_in_a_scene_file(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    file = jaxspace.load(path)
    r, v = file.y0.position, file.y0.velocity
    angle = np.arcsin(float(r @ v / jnp.linalg.norm(r) / jnp.linalg.norm(v)))
    assert angle == pytest.approx(np.radians(1.0), rel=1e-12)
    after = file.system.phases[0].then(0.0, file.y0)
    np.testing.assert_allclose(after.velocity, v * (8.0 / 7.9), rtol=1e-12)


def rotating(n, t, rho, rho_rate):
    """Inertial state of the chaser from its relative one, beside a circle of the radius 1."""
    c, s = jnp.cos(n * t), jnp.sin(n * t)
    axes = jnp.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    place = rho + X
    rate = rho_rate + n * jnp.array([-place[1], place[0], 0.0])
    return axes @ place, axes @ rate


motion = jax.jit(clohessy_wiltshire_flow)


@pytest.mark.parametrize("t", [0.01, 2.0, 2.999, 3.001, 20.0, -4.0])
def test_relative_motion(t):
    """The first-order motion about the circle of radius 1 (n = 1): the derivative of the motion of
    two bodies, on both sides of the series."""
    rho, rate = jnp.array([0.3, -0.2, 0.5]), jnp.array([0.1, 0.4, -0.3])

    def end(size):
        start = rotating(1.0, 0.0, size * rho, size * rate)
        r, v = kepler_flow(*start, t, 1.0)
        c, s = jnp.cos(t), jnp.sin(t)
        back = jnp.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        place = back @ r
        return place, back @ v - jnp.array([-place[1], place[0], 0.0])

    _, (place, speed) = jax.jvp(end, (0.0,), (1.0,))
    found = motion(rho, rate, t, 1.0)
    np.testing.assert_allclose(found[0], place, atol=1e-12 * (1 + abs(t)))
    np.testing.assert_allclose(found[1], speed, atol=1e-12 * (1 + abs(t)))
    back = motion(*found, -t, 1.0)
    np.testing.assert_allclose(jnp.stack(back), jnp.stack([rho, rate]), atol=1e-12)


def test_relative_motion_at_small_angles():
    """No gravity at n = 0, and every digit at n t = 1e-6; the slope by n at zero."""
    rho, rate = jnp.array([300.0, -200.0, 50.0]), jnp.array([0.1, 0.4, -0.3])
    free, slope = jax.jvp(lambda n: motion(rho, rate, 10.0, n), (0.0,), (1.0,))
    np.testing.assert_allclose(free[0], rho + 10.0 * rate, rtol=1e-15)
    # x'' = 2 n y', y'' = -2 n x'
    np.testing.assert_allclose(slope[0], [100.0 * 0.4, -100.0 * 0.1, 0.0], rtol=1e-14)
    with mp.workdps(40):
        n, t = mp.mpf(1e-7), mp.mpf(10)
        s, c = mp.sin(n * t), mp.cos(n * t)
        drift = 6 * (s - n * t) * 300 - 2 * (1 - c) / n * mp.mpf(0.1)
        y = float(-200 + drift + (4 * s - 3 * n * t) / n * mp.mpf(0.4))
    assert float(motion(rho, rate, 10.0, 1e-7)[0][1]) == pytest.approx(y, rel=1e-15)


@pytest.mark.parametrize("t", [1e-5, 1.0, 4.0])
def test_rendezvous(t):
    start, end = jnp.array([0.1, -0.5, 0.2]), jnp.array([0.0, 0.05, -0.1])
    leave, arrive = clohessy_wiltshire_transfer(start, end, t, 1.1)
    r, v = motion(start, leave, t, 1.1)
    np.testing.assert_allclose(r, end, atol=1e-13)
    np.testing.assert_allclose(v, arrive, rtol=1e-12, atol=1e-13 / t)
