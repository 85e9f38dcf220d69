"""Phases that end at once where their event is passed already: stones that are thrown up, and of
which something opens at 20 m on the way down. Times and places are those of parabolas."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxspace import Accuracy, BodyState, Event, Mission, Phase, Scene, simulate
from jaxspace import simulate_mission as fly_one
from jaxspace import simulate_mission_batch as fly
from jaxspace.core import InputError
from jaxspace.core.status import Status
from jaxspace.orbits import UniformGravity
from jaxspace.simulation import simulate_compact
from jaxspace.simulation.mission_runs import run_mission
from jaxspace.simulation.phases import resolve_phases
from jaxspace.solvers import Tsit5

G, HEIGHT = 10.0, 20.0
# m/s: up to 1.8 m, to the height itself, and to 45 m.
SPEEDS = jnp.array([6.0, 20.0, 30.0])
TOP = SPEEDS / G
APEX = SPEEDS**2 / (2.0 * G)
OPEN = TOP + np.sqrt(2.0 * np.maximum(APEX - HEIGHT, 0.0) / G)
STEPS = Accuracy(rtol=1e-9, method=Tsit5())


class Above(eqx.Module):
    """Height above a level."""

    level: jax.Array

    def __call__(self, t, y):
        return y.position[2] - self.level


def thrown(speed):
    zero = 0.0 * speed
    return BodyState(jnp.stack([zero, zero, zero]), jnp.stack([zero, zero, speed]))


def mission(height=HEIGHT, passed=True):
    down = Scene([UniformGravity([0.0, 0.0, -G])])

    def through(level, passed):
        flag = jnp.asarray(passed)
        return Event(Above(jnp.asarray(level)), -1, 20.0, at_start=True, passed=flag)

    return Mission(
        [
            Phase(down, Event(lambda t, y: y.velocity[2], -1, 20.0), name="up"),
            Phase(down, through(height, passed), name="fall"),
            Phase(down, through(0.0, False), name="open"),
        ]
    )


def assert_flown(result):
    """Phases by hand: the stone that is below the height falls no time."""
    assert result.status.tolist() == [Status.EVENT] * 3
    up, fall, opened = result.phases
    for phase in (fall, opened):
        assert phase.event.tolist() == [0, 0, 0] and np.all(phase.happened)
    assert_allclose(up.ts[-1], TOP, rtol=1e-8)
    # At the height itself the time is the root of a rounding.
    assert_allclose(fall.ts[-1], OPEN, rtol=1e-8, atol=1e-6)
    assert_allclose(fall.states.position[2, -1], np.minimum(APEX, HEIGHT), rtol=1e-8)
    assert_allclose(opened.ts[-1], 2.0 * TOP, rtol=1e-8)
    assert_allclose(result.final.position[2], 0.0, atol=1e-6)


@pytest.mark.parametrize("shared_program", [False, True])
def test_a_batch_ends_a_phase_at_once_where_its_height_is_passed(shared_program):
    """Where each phase has a program, and where those of one structure share it."""

    @eqx.filter_jit
    def run(given, y0):
        configs = resolve_phases(given, y0, STEPS, 1)
        return run_mission(given, y0, 0.0, 2, configs, 1, shared_program=shared_program)

    assert_flown(run(mission(), thrown(SPEEDS)))


def test_a_closed_form_and_states_on_the_way():
    assert_flown(fly(mission(), thrown(SPEEDS), num_saved=5))
    missed = fly(mission(passed=False), thrown(SPEEDS), throw=False)
    assert missed["fall"].status.tolist()[0] == Status.EVENT_MISSED


def test_one_run_with_states_on_the_way():
    run = fly_one(mission(), thrown(SPEEDS[0]), num_saved=4, accuracy=STEPS)
    assert run.status == Status.EVENT and run["fall"].event == 0
    assert_allclose(run["fall"].states.position[2], np.full(4, APEX[0]), rtol=1e-8)


def test_derivatives_of_what_is_passed_are_those_of_the_start():
    """t_open = v/g below the height and v/g + sqrt(2 (v^2/2g - h)/g) above it, by the speed and by
    the height, in both modes."""
    speeds = SPEEDS[::2]

    def opening(speed, height):
        result = fly(mission(height), thrown(speed), accuracy=STEPS)
        return jnp.stack([result["fall"].ts[-1], result["fall"].final.position[2]])

    falling = float(OPEN[2] - TOP[2])
    by_speed = [[1.0 / G, 1.0 / G + 3.0 / (G * falling)], [speeds[0] / G, 0.0]]
    by_height = [[0.0, -1.0 / (G * falling)], [0.0, 1.0]]
    one = jnp.ones(2)
    zero = 0.0 * one
    heights = HEIGHT * one
    run = jax.jit(lambda s, h, a, b: jax.jvp(opening, (s, h), (a, b))[1])
    assert_allclose(run(speeds, heights, one, zero), by_speed, rtol=1e-7, atol=1e-9)
    assert_allclose(run(speeds, heights, zero, one), by_height, rtol=1e-7, atol=1e-9)
    back = jax.jit(jax.grad(lambda s, h: jnp.sum(opening(s, h)), argnums=(0, 1)))
    for found, rows in zip(back(speeds, heights), (by_speed, by_height), strict=True):
        assert_allclose(found, np.sum(np.asarray(rows), axis=0), rtol=1e-7, atol=1e-9)


def test_a_compact_run_ends_at_once_too():
    run = simulate_compact(mission(), thrown(SPEEDS[0]), steps=4)
    _, fall, opened = run.phases
    assert fall.happened and opened.happened
    assert_allclose([fall.ts[-1], run.end], [TOP[0], 2.0 * TOP[0]], rtol=1e-9)


@pytest.mark.parametrize("speed", [6.0, 6.1, 7.0])
def test_a_compact_run_to_a_condition_that_is_linear_in_the_time(speed):
    """The top of a throw: the secant leads to the zero at once, and the state goes with it."""
    up = Mission(mission().phases[:1])
    run = simulate_compact(up, thrown(jnp.asarray(speed)), steps=4)
    assert_allclose(run.end, speed / G, rtol=1e-12)
    assert_allclose(run.final.position[2], speed**2 / (2.0 * G), rtol=1e-12)


def test_passed_needs_a_side_and_a_phase():
    with pytest.raises(InputError, match="Event.passed is given without a direction"):
        Event(Above(jnp.asarray(1.0)), passed=True)
    event = Event(Above(jnp.asarray(1.0)), -1, 5.0, passed=True)
    scene = Scene([UniformGravity([0.0, 0.0, -G])])
    with pytest.raises(InputError, match="passed=True: it is allowed as Phase.until only"):
        simulate(scene, thrown(SPEEDS[0]), jnp.array([0.0, 1.0]), events=(event,))
    assert Event(Above(jnp.asarray(1.0)), passed=False).passed is None
