"""Runs that fail: nothing of them is a plausible number, and the error tells where it was."""

import re

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from systems import Integrated

from jaxspace import BodyState, Scene, simulate, simulate_batch, simulate_mission
from jaxspace.attitude import TorqueFreeBody
from jaxspace.bodies import BurningBody
from jaxspace.core import AbstractSystem
from jaxspace.orbits import Oblateness, PointGravity, TwoBody
from jaxspace.rockets import Thrust
from jaxspace.rotations import Quaternion
from jaxspace.simulation import Accuracy, Event, Mission, Phase, SimulationError, Status
from jaxspace.solvers import AdaptiveRegularised, Tsit5

KEPLER = Integrated(TwoBody(1.0))
# Too little to be seen, but no closed form.
NEARLY_ROUND = Scene((PointGravity(1.0), Oblateness(1.0, 1e-14, 1.0)))
Y = BodyState(jnp.array([1.0, 0.0, 0.0]), jnp.array([0.0, 1.1, 0.0]))
FEW = Accuracy(rtol=1e-9, max_steps=40, method=Tsit5())


def test_times_that_were_not_reached_are_nan():
    """At the save times, at the end, between the steps, and behind an event that is too far."""
    ts = jnp.linspace(0.0, 100.0, 101)
    run = simulate(KEPLER, Y, ts, accuracy=FEW, throw=False, dense=True)
    assert run.status == Status.MAX_STEPS
    taken = int(np.sum(np.isfinite(run.dense.ts)))
    last = float(run.dense.ts[taken - 1])
    assert 1.0 < last < 99.0 and taken <= 41
    exact = simulate(TwoBody(1.0), Y, ts).states.position
    reached = np.asarray(ts) <= last
    for block in jax.tree.leaves(run.states):
        np.testing.assert_array_equal(np.isfinite(block), np.broadcast_to(reached, block.shape))
    np.testing.assert_allclose(
        run.states.position[:, reached], exact[:, reached], rtol=0.0, atol=1e-6
    )
    for block in jax.tree.leaves((run.final, run.at(99.0), run.at(last + 0.01))):
        assert np.all(np.isnan(block))
    assert np.all(np.isnan(run.dense.states.position[:, taken:]))
    assert np.all(np.isfinite(run.at(0.9 * last).position))
    clock = Event(lambda t, y: t - 99.0)
    stopped = simulate(KEPLER, Y, ts[::50], accuracy=FEW, throw=False, events=(clock,))
    assert stopped.status == Status.MAX_STEPS and np.all(np.isnan(stopped.final.position))


def test_an_error_tells_time_and_state():
    with pytest.raises(SimulationError, match=r"It got to t = \d.*, with position = \[.*velocity"):
        simulate(KEPLER, Y, jnp.array([0.0, 100.0]), accuracy=FEW)
    late = Event(lambda t, y: t - 9.0, within=1.0)
    mission = Mission([Phase(TwoBody(1.0), 0.5, name="one"), Phase(TwoBody(1.0), late, name="two")])
    with pytest.raises(SimulationError, match="The phase 'two' starts at t = 0.5 s with position"):
        simulate_mission(mission, Y)


class Turning(AbstractSystem):
    """A vector that turns ever faster: by the angle t^2, as a body that a torque spins up, or by
    t / (1 - t)."""

    endless: bool = eqx.field(static=True)

    def vector_field(self, t, y):
        rate = 1.0 / (1.0 - t) ** 2 if self.endless else 2.0 * t
        return rate * jnp.stack([-y[1], y[0]])

    def invariants(self, t, y):
        return {}


def test_steps_that_run_out_say_how_many_would_do():
    def turned(system, end, max_steps):
        accuracy = Accuracy(1e-6, method=Tsit5(), max_steps=max_steps)
        return simulate(system, jnp.array([1.0, 0.0]), jnp.array([0.0, end]), accuracy=accuracy)

    sentence = (
        r"It got to t = .* Its end at t = 40 s requires about (\d+) steps .*max_steps=(\d+)\)"
    )
    with pytest.raises(SimulationError, match=sentence) as failed:
        turned(Turning(False), 40.0, 1000)
    estimate, enough = map(int, re.findall(sentence, str(failed.value))[0])
    assert enough == 2 * estimate
    taken = turned(Turning(False), 40.0, enough).stats
    # By the square of the time: in proportion to it they would be far too few.
    assert abs(int(taken["steps"] + taken["rejected_steps"]) - estimate) < 0.1 * estimate
    # Steps that become ever shorter lead to no number.
    with pytest.raises(SimulationError, match="maximum number of steps was reached") as failed:
        turned(Turning(True), 1.0, 1000)
    assert "requires about" not in str(failed.value)


@pytest.mark.parametrize(
    "system, method, max_steps, rtol, derivative",
    [
        pytest.param(KEPLER, Tsit5(), 60, 1e-7, True, id="shared"),
        pytest.param(NEARLY_ROUND, AdaptiveRegularised(), 12, 1e-9, False, id="own"),
        # Its reverse mode compiles for a minute.
        pytest.param(
            *(NEARLY_ROUND, AdaptiveRegularised(), 12, 1e-9, True),
            id="own, with derivatives",
            marks=pytest.mark.sweep,
        ),
    ],
)
def test_a_slow_run_harms_no_other_under_jit(system, method, max_steps, rtol, derivative):
    """Circular orbits, two of them so small that they turn 30 times as fast and need as many times
    the steps: value, gradient and status of the others are right."""
    accuracy = Accuracy(rtol=rtol, max_steps=max_steps, method=method)
    radius = jnp.array([1.0, 0.9, 0.1, 1.1, 1.2, 0.1])
    speed = 1.0 / jnp.sqrt(radius)

    def end(radius, speed):
        zero = jnp.zeros_like(radius)
        y = BodyState(jnp.stack([radius, zero, zero]), jnp.stack([zero, speed, zero]))
        run = simulate(system, y, jnp.array([0.0, 3.0]), accuracy=accuracy, throw=False)
        return run.final.position[0], run.status

    x, status = jax.jit(jax.vmap(end))(radius, speed)
    slow = np.asarray(radius) < 0.5
    np.testing.assert_array_equal(status, np.where(slow, Status.MAX_STEPS, Status.COMPLETED))
    np.testing.assert_array_equal(np.isnan(x), slow)
    exact = jax.vmap(
        jax.value_and_grad(
            lambda r, v: simulate(
                TwoBody(1.0),
                BodyState(jnp.array([r, 0.0, 0.0]), jnp.array([0.0, v, 0.0])),
                jnp.array([0.0, 3.0]),
            ).final.position[0]
        )
    )
    value, of_radius = exact(radius[~slow], speed[~slow])
    # A hundred times the tolerance of a step: the errors of some fifty steps, and their growth.
    np.testing.assert_allclose(x[~slow], value, rtol=0.0, atol=100.0 * rtol)
    if not derivative:
        return
    one = jax.value_and_grad(end, has_aux=True)
    (again, _), slope = jax.jit(jax.vmap(one))(radius, speed)
    np.testing.assert_array_equal(np.isnan(slope), slow)
    # Two programs, which round differently.
    np.testing.assert_allclose(x, again, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(slope[~slow], of_radius, rtol=0.0, atol=1000.0 * rtol)


def passage(energy):
    """A straight fall from a distance of one with an `energy`, mu = 1: the time of the passage of
    the centre, by Simpson's rule over sqrt(r)."""
    s = np.linspace(0.0, 1.0, 2001)
    rate = 2.0 * s**2 / np.sqrt(2.0 * (1.0 + energy * s**2))
    weights = np.full(2001, 2.0)
    weights[1::2], weights[[0, -1]] = 4.0, 1.0
    return float(np.sum(weights * rate) / 3.0 / 2000.0)


def test_a_flight_through_the_centre_has_a_status():
    """Straight falls on an ellipse, the parabola and a hyperbola, to just before and just after the
    centre, in both directions of time, and up and down again; a close flyby is none."""
    axis = np.array([2.0, -1.0, 2.0]) / 3.0
    starts, ends, expected = [], [], []
    for energy in (-0.7, 0.0, 0.8):
        speed = np.sqrt(2.0 * (1.0 + energy))
        time = passage(energy)
        for part, through in ((0.99, False), (1.01, True)):
            for sign in (1.0, -1.0):
                starts.append((axis, -sign * speed * axis))
                ends.append(sign * part * time)
                expected.append(through)
        starts.append((axis, speed * axis))
        # Out to the apoapsis and back on the ellipse, for ever on the others.
        ends.append(20.0)
        expected.append(energy < 0.0)
    starts.append((axis, np.array([1e-9, 2e-9, 0.0]) - 0.5 * axis))
    ends.append(5.0)
    expected.append(False)
    r, v = (jnp.asarray(np.stack(x, -1)) for x in zip(*starts, strict=True))
    ts = jnp.stack([jnp.zeros(len(ends)), jnp.asarray(ends)])
    run = simulate_batch(TwoBody(1.0), BodyState(r, v), ts)
    status = np.where(expected, Status.OUTSIDE_MODEL, Status.COMPLETED)
    np.testing.assert_array_equal(run.status, status)
    np.testing.assert_array_equal(np.isnan(run.final.position[0]), expected)


def test_fuel_below_the_dry_mass_has_a_status():
    """A motor that burns 100 kg, with 100 kg and with 99 kg on board."""
    body = BurningBody(50.0, [1.0, 1.0, 1.0], [0.1, 0.1, 0.1])
    scene = Scene((Thrust(1000.0, 100.0, 10.0),), body)

    def fly(mass):
        y = BodyState(
            jnp.zeros(3), jnp.zeros(3), Quaternion.identity(), jnp.zeros(3), jnp.asarray(mass)
        )
        return simulate(scene, y, jnp.array([0.0, 12.0]), throw=False)

    assert fly(150.0).status == Status.COMPLETED
    assert fly(149.0).status == Status.OUTSIDE_MODEL and np.isnan(fly(149.0).final.mass)


def test_a_traced_quaternion_of_zeros_is_no_start_of_a_free_body():
    """Its closed form would leave the zeros as they are."""
    moments = jnp.array([1.0, 2.0, 3.0])

    @jax.jit
    def turned(wxyz):
        y = BodyState(attitude=Quaternion(wxyz), omega=jnp.ones((3, 2)))
        ts = jnp.array([0.0, 1.0, 2.0])
        run = simulate_batch(TorqueFreeBody(moments), y, ts, throw=False)
        return run.status, run.final.attitude.wxyz

    status, final = turned(jnp.zeros((4, 2)).at[0, 1].set(1.0))
    np.testing.assert_array_equal(status, [Status.NOT_FINITE, Status.COMPLETED])
    assert np.all(np.isnan(final[:, 0])) and np.all(np.isfinite(final[:, 1]))
