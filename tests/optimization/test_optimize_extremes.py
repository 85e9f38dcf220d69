"""Extremes along a run as objective and constraints of [optimize], and a circular orbit by its
altitude: against dense searches, differences and closed forms."""

import functools
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxspace import Event, Mission, Phase, Scene
from jaxspace.bodies import BodyState, RigidBody
from jaxspace.io import SceneError, load
from jaxspace.io._search.task import search_of
from jaxspace.orbits import LowThrust, PointGravity, RotatingFrame, UniformGravity
from jaxspace.orbits.uniform_gravity import touchdown
from jaxspace.scene import scaled
from jaxspace.simulation import simulate_compact
from jaxspace.statistics.extremes import greatest, least

SCENES = Path(__file__).resolve().parents[2] / "examples" / "scenes"
AREA, DRAG, DENSITY, SCALE, G = 0.5, 0.6, 1.225, 8000.0, 9.81
THRUST, IMPULSE, START = 40e3, 250.0, 1000.0
# A vertical climb: the throttle that gives the greatest height within a dynamic pressure.
CLIMB = f"""
accuracy = 1e-9
[body]
mass = {START}
[effects.ground_gravity]
gravity = {G}
[effects.air_drag]
area = {AREA}
coefficient = {{ mach = [0.0, 9.0], values = [{DRAG}, {DRAG}] }}
air.atmosphere = {{ density = {DENSITY}, reference_height = 0.0, scale_height = {SCALE} }}
[effects.steered_thrust]
mean_thrust = {THRUST}
specific_impulse = {IMPULSE}
propellant_mass = 600.0
throttle = 0.8
steering.along = [0.0, 0.0, 1.0]
[initial]
position = [0.0, 0.0, 0.0]
velocity = [0.0, 0.0, 0.1]
[times]
end = 90.0
[optimize]
maximise = "final.position.2"
steps = 20
[optimize.free]
"effects.steered_thrust.throttle" = {{ low = 0.3, high = 1.0 }}
[[optimize.constraint]]
output = "air_drag.dynamic_pressure"
take = "greatest"
at_most = "15 kPa"
[[optimize.constraint]]
output = "proper_acceleration"
take = "greatest"
at_most = "90 m/s^2"
"""


@functools.cache
def climb():
    return load("climb.toml", text=CLIMB)


def by_hand(run):
    """The greatest dynamic pressure and acceleration felt among many states, by the formulas
    written out."""
    (burn,) = run.phases
    y = burn.states
    height, speed = np.asarray(y.position[2]), np.asarray(y.velocity[2])
    pressure = 0.5 * DENSITY * np.exp(-height / SCALE) * speed**2
    throttle = burn.system.effects[2].throttle
    # Within the flight, where the search has to find it between the ends of its steps.
    assert pressure[-1] < 0.95 * pressure.max()
    felt = np.abs(float(throttle) * THRUST - pressure * AREA * DRAG) / np.asarray(y.mass)
    return pressure.max(), felt.max()


def test_the_constraint_of_a_greatest_pressure_is_active():
    """The optimum meets the limit, and many states of a run of its file say the same."""
    file = climb()
    best = file.optimize()
    assert best.converged
    # The search lays cubics between the ends of twenty steps, with an error of some 1e-5.
    pressure, felt = best.constraints
    assert pressure == pytest.approx(15e3, rel=1e-6) and felt < 89.0
    at_best = load("best.toml", text=best.text())
    run = at_best.nominal_mission(samples=2001)
    assert_allclose(by_hand(run), (pressure, felt), rtol=1e-4)
    confirmed = best.confirmed(run, at_best)
    assert_allclose(confirmed[1:], (pressure, felt), rtol=1e-4)
    # A higher limit allows a greater height; the other one does not bind.
    assert best.target_derivatives[0] > 0.1 and abs(best.target_derivatives[1]) < 1e-6


def test_derivatives_of_extremes_in_both_modes():
    """One is the transpose of the other; the search has compared its own with differences."""
    file = climb()
    paths = ("effects.steered_thrust.throttle", "initial.velocity.2")

    def extremes(x):
        found = search_of(file, file.task, 20)(dict(zip(paths, x, strict=True)))
        return found.non_negative

    x, change, weights = jnp.array([0.7, 5.0]), jnp.array([1.0, 3.0]), jnp.array([1.0, 90.0])

    @jax.jit
    def both(x):
        value, tangent = jax.jvp(extremes, (x,), (change,))
        return value, tangent, jax.vjp(extremes, x)[1](weights)[0]

    value, tangent, gradient = both(x)
    assert jnp.isfinite(value).all() and jnp.all(jnp.abs(tangent) > 0.1)
    assert_allclose(weights @ tangent, gradient @ change, rtol=1e-11)


def test_what_is_greatest_where_an_event_ends_a_phase_moves_with_it():
    """Of a stone that falls to the ground: its time and its speed there, in both modes."""
    ground = Event(touchdown, -1, within=10.0)
    fall = Mission([Phase(Scene([UniformGravity([0.0, 0.0, -G])]), ground)])

    def landing(height):
        y0 = BodyState(height * jnp.array([0.0, 0.0, 1.0]), jnp.zeros(3))
        (phase,) = simulate_compact(fall, y0, steps=4).phases
        speed = -phase.states.velocity[2]
        return jnp.stack([greatest(phase.ts, speed, G + 0.0 * speed).value, phase.ts[-1]])

    @jax.jit
    def both(height):
        one = jnp.ones(())
        value, tangent = jax.jvp(landing, (height,), (one,))
        return value, tangent, jax.jacrev(landing)(height)

    height = 50.0
    value, tangent, slope = both(height)
    exact = np.sqrt(2.0 * G * height) * np.array([1.0, 1.0 / G])
    assert_allclose(value, exact, rtol=1e-13)
    assert_allclose(tangent, 0.5 * exact / height, rtol=1e-12)
    assert_allclose(slope, tangent, rtol=1e-13)


def test_extremes_by_given_slopes_need_no_even_times():
    """Of a cubic, which is exact however few and uneven the states are; two of them suffice."""

    def q(t):
        return t**3 - 6.0 * t**2 + 9.0 * t

    def slope(t):
        return 3.0 * t**2 - 12.0 * t + 9.0

    for times in ([0.0, 3.5], [0.0, 0.3, 2.9, 2.9, 3.5]):
        t = jnp.array(times)
        top = jax.jit(greatest)(t, q(t), slope(t))
        assert_allclose((top.value, top.time), (4.0, 1.0), rtol=1e-13)
        low = jax.jit(least)([t], [q(t)], [slope(t)])
        assert_allclose(low.value, 0.0, atol=1e-13)


def test_what_a_body_feels_is_without_gravity_and_forces_of_inertia():
    r, v = jnp.array([7e6, 0.0, 0.0]), jnp.array([0.0, 7e3, 0.0])
    turning = [PointGravity(3.986e14), RotatingFrame([0.0, 0.0, 7e-5])]
    y = BodyState(r, v)
    assert_allclose(Scene(turning).proper_acceleration(0.0, y), 0.0, atol=1e-15)
    pushed = Scene([*turning, LowThrust(0.01)], RigidBody(1.0))
    assert_allclose(pushed.proper_acceleration(0.0, y), [0.0, 0.01, 0.0], rtol=1e-12)
    # A scaled gravity is one still.
    half = Scene([scaled(effect, jnp.array(0.5)) for effect in turning])
    assert_allclose(half.proper_acceleration(0.0, y), 0.0, atol=1e-15)


def test_a_circular_orbit_is_three_constraints():
    demands = load(SCENES / "launch.toml").task.demands
    targets = {d.spec.name: (d.limit, d.target, d.spec.at) for d in demands}
    assert targets == {
        "altitude": ("equal", 300e3, -1),
        "radial_speed": ("equal", 0.0, -1),
        "semi_major_axis": ("equal", pytest.approx(6678137.0), -1),
    }
    bad = CLIMB.replace("steps = 20", 'steps = 20\ncircular_orbit = "300 km"')
    with pytest.raises(SceneError, match=r"planet.radius is missing: it must be a length, to"):
        load("climb.toml", text=bad)
    bad = CLIMB.replace("steps = 20", 'steps = 20\ncircular_orbit = "300 s"')
    with pytest.raises(SceneError, match=r'optimize.circular_orbit is "300 s": it must be a numb'):
        load("climb.toml", text=bad)
