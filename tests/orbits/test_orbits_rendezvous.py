"""Interception and rendezvous between any orbits, tables of them, the least of them, phasing, and
the slow spiral."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from unchecked import unchecked

from jaxspace import BodyState, Scene, load, simulate
from jaxspace.core import InputError
from jaxspace.optimization import least_rendezvous
from jaxspace.orbits import ClassicalElements, LowThrust, PointGravity
from jaxspace.orbits.burnout import vis_viva_speed
from jaxspace.orbits.elements import semi_major_axis, state_from_elements
from jaxspace.orbits.interception import interception, porkchop
from jaxspace.orbits.kepler import kepler_flow
from jaxspace.orbits.low_thrust import spiral_radius
from jaxspace.orbits.phasing import phasing
from jaxspace.orbits.transfers import hohmann_transfer
from jaxspace.plots import porkchop_figure

flow = jax.jit(kepler_flow)


def ring(radius, angle=0.0):
    """On a circle about a centre with mu = 1."""
    c, s, v = np.cos(angle), np.sin(angle), radius**-0.5
    return jnp.array([radius * c, radius * s, 0.0]), jnp.array([-v * s, v * c, 0.0])


def test_the_transfer_leads_from_one_orbit_to_the_other():
    """Twenty pairs of ellipses in any planes, by the motion of all three bodies."""
    random = np.random.default_rng(3)
    low, high = [1.0, 0.0, 0.1, 0.0, 0.0, 0.0], [2.0, 0.6, 2.9, 6.0, 6.0, 6.0]
    sets = [ClassicalElements(*jnp.array(random.uniform(low, high, (20, 6)).T)) for _ in range(2)]
    chaser, target = (jax.jit(state_from_elements)(x, 1.0) for x in sets)
    leave, meet = jnp.array(random.uniform([0.0, 6.0], [5.0, 20.0], (20, 2)).T)
    found = jax.jit(interception)(chaser, target, leave, meet, 1.0)
    start, before = flow(*chaser, leave, 1.0)
    end, after = flow(*target, meet, 1.0)
    # The conditioning of arcs that pass near the centre is worst.
    reached, speed = flow(start, before + found.departure, meet - leave, 1.0)
    np.testing.assert_allclose(reached, end, atol=1e-10)
    np.testing.assert_allclose(speed + found.arrival, after, atol=1e-10)
    np.testing.assert_allclose(
        found.total,
        np.linalg.norm(found.departure, axis=0) + np.linalg.norm(found.arrival, axis=0),
        rtol=1e-15,
    )


def test_from_the_pole_to_the_equator():  # T4.16-P7
    """A polar ellipse of e = 0.3, at its periapsis over the pole, to an equatorial circle."""
    chaser = jnp.array([0.0, 0.0, 1.4]), jnp.array([np.sqrt(1.3 / 1.4), 0.0, 0.0])
    meet = np.radians(330.0) * 2.0**1.5
    short = jnp.array([0.5, np.sqrt(0.75), 0.0])  # normal to both places
    expected = {
        1.0: [-0.4460400858845732, -0.29882727660936464, 0.7767899303992291],
        -1.0: [-1.8091947788443794, 0.48819045231808106, -0.048097975294306754],
    }
    solve = jax.jit(lambda n: interception(chaser, ring(2.0), 0.0, meet, 1.0, normal=n).departure)
    for way, dv in expected.items():
        np.testing.assert_allclose(solve(way * short), dv, rtol=1e-9)


def test_a_chaser_on_a_line_takes_the_short_way():
    """It has no sense of its own: the normal is that of the plane of both places, upwards or
    downwards."""
    chaser = jnp.array([1.0, 0.0, 0.0]), jnp.array([0.3, 0.0, 0.0])
    target = jnp.array([0.0, 0.0, 2.0]), jnp.array([0.0, 0.7, 0.0])
    find = jax.jit(lambda c, t, n: interception(c, t, 0.0, 2.0, 1.0, normal=n).velocity)
    found = jax.jit(lambda c, t: interception(c, t, 0.0, 2.0, 1.0).velocity)(chaser, target)
    end = kepler_flow(*target, 2.0, 1.0)[0]
    short = jnp.cross(chaser[0], end)
    np.testing.assert_allclose(found, find(chaser, target, short), atol=1e-14)


@pytest.mark.sweep
def test_a_table_holds_every_pair_and_its_figure_the_least():
    chaser, target = ring(1.0), ring(2.0, 0.6)
    leave, meet = jnp.linspace(0.0, 6.0, 7), jnp.linspace(3.0, 20.0, 9)
    table = porkchop(chaser, target, leave, meet, 1.0)
    assert table.total.shape == (7, 9)
    late = np.asarray(leave)[:, None] < np.asarray(meet)
    np.testing.assert_array_equal(np.isfinite(table.total), late)
    one = interception(chaser, target, leave[:, None], meet, 1.0)
    np.testing.assert_allclose(table.total, one.total, rtol=1e-12)
    figure = porkchop_figure(leave, meet, 1e3 * table.total, unit=1.0, unit_name="s")
    axes = figure.axes[0]
    assert axes.get_xlabel() == "departure [s]" and axes.get_ylabel() == "arrival [s]"
    assert axes.texts[0].get_text() == f"{float(jnp.nanmin(table.total)):.3f} km/s"


@pytest.mark.sweep
def test_the_least_rendezvous_of_two_circles_is_that_of_hohmann():
    chaser, target = ring(1.0), ring(2.0, 1.3)
    best = least_rendezvous(chaser, target, (1.5, 8.5), 1.0)
    plan = hohmann_transfer(1.0, 2.0, 1.0)
    assert best.converged
    # A minimum: the error of the times, 1e-7 and less, counts with its square.
    np.testing.assert_allclose(best.total, plan.total, rtol=1e-12)
    np.testing.assert_allclose(best.arrival - best.departure, plan.duration, rtol=1e-6)
    # Bounds are kept: later than the best departure, at a higher price.
    earliest = float(best.departure) + 0.4
    bound = least_rendezvous(chaser, target, (3.0, 9.5), 1.0, earliest=earliest)
    assert bound.converged and bound.total > best.total
    np.testing.assert_allclose(bound.departure, earliest, rtol=1e-6)


def test_phasing():  # T4.16-P3
    lead = np.radians(40.0)  # on a circle with n = 1
    back = phasing(1.0, 1.0, lead, 1.0)
    np.testing.assert_allclose(back.impulse, -0.041713601124672275, rtol=1e-12)
    np.testing.assert_allclose(back.semi_major_axis, 0.9244816991341797, rtol=1e-12)
    np.testing.assert_allclose(back.opposite, 0.8489633982683592, rtol=1e-12)
    out = phasing(1.0, 1.0, lead, 1.0, target_revolutions=2.0)
    np.testing.assert_allclose(out.impulse, 0.15998759354931014, rtol=1e-12)
    np.testing.assert_allclose(out.semi_major_axis, 1.5280501503977426, rtol=1e-12)
    # On an ellipse, anywhere on it, in three revolutions: both bodies are there again.
    elements = ClassicalElements.from_periapsis(1.0, 0.3, 0.4, 0.1, 0.7, 2.0)
    r, v = state_from_elements(elements, 1.0)
    a = float(semi_major_axis(r, v, 1.0))
    plan = phasing(float(jnp.linalg.norm(r)), a, 0.9, 1.0, revolutions=3.0)
    ahead = flow(r, v, 0.9, 1.0)
    chaser = flow(r, v * (1.0 + plan.impulse / jnp.linalg.norm(v)), plan.duration, 1.0)
    target = flow(*ahead, plan.duration, 1.0)
    np.testing.assert_allclose(chaser[0], target[0], atol=1e-12)
    # A small lead keeps its digits, to first order -2/3 pi L/T v_c at a circle.
    small = phasing(1.0, 1.0, 1e-12, 1.0).impulse
    np.testing.assert_allclose(small, -1e-12 / (6.0 * np.pi), rtol=1e-11)


def test_a_slow_spiral():
    """To first order in the thrust: its ratio to gravity, 5e-4, and the wave of the circle's
    eccentricity, of the same size."""
    thrust = LowThrust(2e-4)
    scene = Scene([PointGravity(1.0), thrust])
    run = simulate(scene, BodyState(*ring(1.0)), jnp.linspace(0.0, 1500.0, 6))
    radius = np.linalg.norm(run.states.position, axis=0)
    np.testing.assert_allclose(radius, spiral_radius(1.0, 2e-4 * run.ts, 1.0), rtol=3e-3)
    speed = np.linalg.norm(run.final.velocity)
    a = semi_major_axis(run.final.position, run.final.velocity, 1.0)
    np.testing.assert_allclose(vis_viva_speed(radius[-1], a, 1.0), speed, rtol=1e-9)
    # With an exhaust velocity: u ln(m0/m) is what was spent.
    burning = LowThrust(2e-4, 3.0)
    t = np.linspace(0.0, 1500.0, 4001)
    a_t = np.asarray(burning.acceleration_at(jnp.array(t)))
    spent = np.sum(0.5 * (a_t[1:] + a_t[:-1]) * np.diff(t))
    np.testing.assert_allclose(spent, -3.0 * np.log(1.0 - 2e-4 * 1500.0 / 3.0), rtol=1e-8)
    assert burning.scaled(2.0) is None and thrust.scaled(2.0).acceleration == pytest.approx(4e-4)


@pytest.mark.slow
def test_the_files_of_examples_fly():
    """The chaser of the file is with its target at the end of the transfer; the spiral is where the
    formula says, to a thousandth, as the thrust is to gravity."""
    scenes = Path(__file__).parents[2] / "examples" / "scenes"
    flight = load(scenes / "intercept.toml").simulate()
    target = [4909713.93998641, 3139880.40005651, 4052417.81591542]
    np.testing.assert_allclose(flight["transfer"].final.position, target, rtol=1e-7)
    velocity = [-5789.81209957, 3125.87364358, 4281.63542005]
    np.testing.assert_allclose(flight["together"].initial.velocity, velocity, rtol=1e-7)
    spiral = load(scenes / "low_thrust_spiral.toml").simulate()
    expected = spiral_radius(6778137.0, 2e-4 * 20.0 * 86400.0, 398600.4418e9)
    found = np.linalg.norm(spiral["spiral"].final.position)
    np.testing.assert_allclose(found, expected, rtol=1e-3)


def test_orbits_as_body_states():
    chaser = jnp.array([1.0, 0.0, 0.0]), jnp.array([0.0, 1.0, 0.1])
    target = jnp.array([0.0, 2.0, 0.0]), jnp.array([-0.7, 0.0, 0.0])
    expected = interception(chaser, target, 0.0, 3.0, 1.0)
    found = interception(BodyState(*chaser), BodyState(*target), 0.0, 3.0, 1.0)
    listed = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.1]]
    jax.tree.map(np.testing.assert_array_equal, found, expected)
    with unchecked():
        found = interception(listed, target, 0.0, 3.0, 1.0)
    jax.tree.map(np.testing.assert_array_equal, found, expected)
    times = jnp.array([0.0, 0.5]), jnp.array([3.0, 3.5])
    tables = [
        porkchop(one, two, *times, 1.0)
        for one, two in ((chaser, target), (BodyState(*chaser), BodyState(*target)))
    ]
    jax.tree.map(np.testing.assert_array_equal, *tables)


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        (BodyState(position=jnp.ones(3)), "chaser is of type BodyState: it must be a position"),
        ("earth", "chaser is 'earth': it must be a position and a velocity"),
        ((jnp.ones(3), "fast"), "The velocity of chaser is 'fast': it must be an array"),
        ((jnp.ones(3), jnp.ones(2)), "The velocity of chaser has the shape"),
    ],
)
@pytest.mark.parametrize("function", [interception, porkchop, least_rendezvous])
def test_an_orbit_of_another_kind_is_refused(function, wrong, sentence):
    target = jnp.array([0.0, 2.0, 0.0]), jnp.array([-0.7, 0.0, 0.0])
    times = ((0.0, 1.0),) if function is least_rendezvous else (jnp.zeros(1), jnp.ones(1))
    with unchecked(), pytest.raises(InputError, match=sentence):
        function(wrong, target, *times, 1.0)
