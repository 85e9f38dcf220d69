"""Derivatives at places where the motion itself leaves nothing to resolve: they are as accurate as
the run, by steps that resolve them too."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from both_modes import both_modes
from jaxtyping import Array

from jaxspace import (
    Accuracy,
    BodyState,
    Event,
    Mission,
    Phase,
    Scene,
    simulate,
    simulate_batch,
    simulate_mission,
)
from jaxspace.bodies import Load, RigidBody
from jaxspace.core import Table
from jaxspace.integration._tangents import Directions
from jaxspace.orbits import PointGravity, UniformGravity
from jaxspace.rotations import Quaternion
from jaxspace.scene import Custom
from jaxspace.solvers import DOP853, RKN1210, MuntheKaas, Tsit5

RATE, SPAN = 20.0, 10.0
TS = np.array([0.0, SPAN])
REST = BodyState(jnp.zeros(3), jnp.zeros(3))
# x'' = e sin(20 t) from rest, by e.
SHAKEN = SPAN / RATE - np.sin(RATE * SPAN) / RATE**2
ALONG_X = np.array([1.0, 0.0, 0.0])
# A step may leave its tolerance in the derivative, and these runs take up to a thousand.
STEPS = 1e3


class SquareDrag(eqx.Module):
    """The acceleration -k |v| v."""

    k: Array

    def __call__(self, t, y, body):
        speed = jnp.sqrt(jnp.sum(y.velocity**2))
        return Load(acceleration_N=-self.k * speed * y.velocity)


def shake(e):
    """An acceleration e sin(20 t) along x, of one run or of each."""
    return Custom(
        lambda t, y, body: Load(acceleration_N=jnp.stack([e * jnp.sin(RATE * t), 0.0 * e, 0.0 * e]))
    )


def shaken(e, accuracy):
    """Where a body at rest is after it."""
    return simulate(Scene([shake(e)]), REST, TS, accuracy=accuracy).final.position[0]


@pytest.mark.parametrize("method", [DOP853(), Tsit5(), RKN1210()], ids=lambda m: type(m).__name__)
def test_a_force_that_is_zero_on_a_body_at_rest(method):
    """And one that is nearly zero, by which the motion has steps of its own."""

    @jax.jit
    def slopes(e, rtol):
        value, push = jax.linearize(lambda e: shaken(e, Accuracy(rtol, method=method)), e)
        return push(jnp.ones_like(e)), jax.linear_transpose(push, e)(jnp.ones_like(e))[0]

    for rtol in (1e-6, 1e-9, 1e-12):
        for e in (0.0, 1e-3):
            forward, reverse = slopes(e, rtol)
            assert abs(forward - SHAKEN) < STEPS * rtol * SHAKEN
            # The same steps, in another order of summation.
            assert abs(reverse - forward) < 1e-12


@pytest.mark.parametrize(
    "method", ["auto", pytest.param(MuntheKaas(), marks=pytest.mark.sweep)], ids=["auto", "group"]
)
def test_a_torque_that_is_zero_on_a_body_at_rest(method):
    def rate(e):
        twist = Custom(
            lambda t, y, body: Load(torque_B=jnp.stack([0.0 * e, 0.0 * e, e * jnp.sin(RATE * t)]))
        )
        y0 = BodyState(attitude=Quaternion(jnp.array([1.0, 0, 0, 0])), omega=jnp.zeros(3))
        scene = Scene([twist], RigidBody(1.0, [1.0, 1.0, 1.0]))
        return simulate(scene, y0, TS, accuracy=Accuracy(1e-9, method=method)).final.omega[2]

    _, forward, reverse = both_modes(rate)(0.0)
    # omega' = e sin(20 t).
    right = (1.0 - np.cos(RATE * SPAN)) / RATE
    np.testing.assert_allclose([forward, reverse], right, rtol=STEPS * 1e-9)


def test_an_unstable_rest_and_a_force_that_sets_in():
    """Along x what is small at first grows by e^40, so that early steps count as much as late ones.
    Along y a force that is zero sets in at a time that no step knows of."""
    growth, late = 4.0, 3.0

    def end(x):
        start, force = x

        def push(t, y, body):
            along_y = jnp.where(t > late, force, 0.0)
            return Load(acceleration_N=jnp.stack([growth**2 * y.position[0], along_y, 0.0 * t]))

        y0 = BodyState(start * ALONG_X, jnp.zeros(3))
        return simulate(Scene([Custom(push)]), y0, TS, accuracy=1e-9).final.position[:2]

    _, forward, reverse = both_modes(end)([0.0, 0.0])
    right = np.diag([np.cosh(growth * SPAN), 0.5 * (SPAN - late) ** 2])
    for slopes in (forward, reverse):
        np.testing.assert_allclose(slopes, right, rtol=STEPS * 1e-9)


def test_the_time_of_an_impact_by_the_drag_of_a_body_without_drag():
    """A parabola needs few steps, and what a small drag changes along it many: the derivative is
    that of an independent quadrature."""
    g, v0, density, area, mass = 9.81, np.array([0.1, 0.0, 30.0]), 1.2, 0.1, 1.0

    def time(drag, accuracy):
        down = Event(lambda t, y: y.position[2], direction=-1)
        scene = Scene([UniformGravity([0.0, 0.0, -g]), Custom(SquareDrag(drag))])
        y0 = BodyState(jnp.zeros(3), jnp.asarray(v0))
        return simulate(scene, y0, np.array([0.0, 10.0]), events=[down], accuracy=accuracy).ts[-1]

    k = 0.5 * density * area / mass
    # z' changes by -int |v| v_z dt, z by its integral, and the impact by z / |v_z|.
    t = np.linspace(0.0, 2.0 * v0[2] / g, 2_000_001)
    vz = v0[2] - g * t
    lost = np.hypot(v0[0], vz) * vz
    height = -np.trapezoid((t[-1] - t) * lost, t)
    right = height / v0[2]
    for accuracy in (Accuracy(1e-9), Accuracy(1e-6, method=Tsit5())):
        _, forward, reverse = both_modes(lambda d, a=accuracy: time(k * d, a))(0.0)
        # Each of fewer than twenty steps may leave its tolerance in the derivative.
        bound = 20.0 * float(accuracy.rtol)
        np.testing.assert_allclose([forward, reverse], k * right, rtol=bound)


def test_of_many_runs_the_one_at_rest():
    """The others oscillate slowly, and leave it steps that are too long: in a batch, and mapped."""
    e = jnp.array([0.0, 0.3, 0.0, 1e-3])
    slow = jnp.array([0.0, 1.0, 0.0, 1.0])

    def end(e, slow, run=simulate_batch):
        spring = Custom(lambda t, y, body: Load(acceleration_N=-y.position))
        y0 = BodyState(jnp.stack([slow, 0.0 * slow, 0.0 * slow]), jnp.zeros((3, *slow.shape)))
        return run(Scene([spring, shake(e)]), y0, TS, accuracy=1e-9).final.position[0]

    by_batch = jax.jit(jax.grad(lambda e: jnp.sum(end(e, slow))))(e)
    one = jax.grad(lambda e, slow: end(e, slow, simulate))
    by_map = jax.jit(jax.vmap(one))(e, slow)
    # x'' = -x + e sin(20 t).
    right = (RATE * np.sin(SPAN) - np.sin(RATE * SPAN)) / (RATE**2 - 1.0)
    np.testing.assert_allclose(by_batch, right, rtol=STEPS * 1e-9)
    np.testing.assert_allclose(by_map, right, rtol=STEPS * 1e-9)


def test_phases_of_a_mission_that_rests():
    def end(e):
        still = Custom(lambda t, y, body: Load(acceleration_N=0.0 * y.velocity))
        phases = [
            Phase(Scene([shake(e)]), SPAN, name="shaken"),
            Phase(Scene([still]), 2.0, name="free"),
        ]
        run = simulate_mission(Mission(phases), REST, accuracy=1e-9)
        return run["free"].final.position[0]

    _, forward, reverse = both_modes(end)(0.0)
    velocity = (1.0 - np.cos(RATE * SPAN)) / RATE
    np.testing.assert_allclose([forward, reverse], SHAKEN + 2.0 * velocity, rtol=STEPS * 1e-9)


def test_small_and_large_inputs_are_told_apart():
    """A large derivative by one of the inputs hides no small one, in one gradient by all."""

    def end(y0, e):
        spring = Custom(lambda t, y, body: Load(acceleration_N=-y.position))
        run = simulate(Scene([spring, shake(e)]), y0, TS, accuracy=Accuracy(1e-9, method=DOP853()))
        return run.final.position[0]

    y0 = BodyState(jnp.asarray(1e7 * ALONG_X), jnp.zeros(3))
    by_state, by_force = jax.grad(end, argnums=(0, 1))(y0, jnp.asarray(0.0))
    right = (RATE * np.sin(SPAN) - np.sin(RATE * SPAN)) / (RATE**2 - 1.0)
    np.testing.assert_allclose(by_state.position[0], np.cos(SPAN), rtol=STEPS * 1e-9)
    np.testing.assert_allclose(by_force, right, rtol=STEPS * 1e-9)


def test_a_derivative_that_is_not_finite_stops_no_run():
    """The root at zero has none; the run and its other derivatives are as they were."""

    def end(e):
        pull = Custom(lambda t, y, body: Load(acceleration_N=ALONG_X * jnp.sqrt(e) - y.position))
        return simulate(Scene([pull]), REST, TS, accuracy=1e-9).final.position[0]

    value, slope = jax.value_and_grad(end)(jnp.asarray(0.0))
    assert value == 0.0
    assert not np.isfinite(slope)


def test_it_is_switched_off_by_name():
    # One whole step or two, as of a body without a force.
    off = jax.grad(shaken)(0.0, Accuracy(1e-9, derivative_control=False))
    assert abs(off - SHAKEN) > 1.0


@pytest.fixture
def monitored(monkeypatch):
    """Has a number for each time that a run monitored at its tangents."""
    monitored, after = [], Directions.after

    def counted(*args):
        jax.debug.callback(lambda: monitored.append(1))
        return after(*args)

    monkeypatch.setattr(Directions, "after", counted)
    return monitored


def test_steps_that_nodes_keep_short_are_monitored_once(monitored):
    """A table of 61 nodes ends all steps of a motion that would need one or two between them."""

    def end(values):
        table = Table(np.linspace(0.0, SPAN, 61), values)
        push = Custom(lambda t, y, body: Load(acceleration_N=table(t) * ALONG_X))
        accuracy = Accuracy(1e-9, method=DOP853())
        return simulate(Scene([push]), REST, TS, accuracy=accuracy).final.position[0]

    jax.block_until_ready(jax.grad(end)(jnp.ones(61)))
    jax.effects_barrier()
    # Of some sixty steps the third, the 27th and the 51st, and before them while they grow.
    assert 1 <= len(monitored) <= 6


def test_an_orbit_is_monitored_once_in_some_dozen_steps(monitored):
    """The motion limits its steps; the last ones are short because the run ends, and tell nothing
    of a derivative: each look takes as long as ten steps."""
    # Orbits of several sizes end at several places of a step.
    r = np.linspace(1.0, 1.2, 16)
    y0 = BodyState(
        jnp.asarray(np.stack([r, 0.0 * r, 0.0 * r])),
        jnp.asarray(np.stack([0.0 * r, 1.0 / np.sqrt(r), 0.0 * r])),
    )

    def end(y):
        accuracy = Accuracy(1e-9, method=RKN1210())
        run = simulate_batch(Scene([PointGravity(1.0)]), y, 2.0 * TS, accuracy=accuracy)
        return jnp.sum(run.final.position[0])

    jax.block_until_ready(jax.grad(end)(y0))
    jax.effects_barrier()
    # At the third step; they take fewer than 24.
    assert len(monitored) == 1


@pytest.mark.parametrize("control", [True, False])
def test_the_times_of_zeros_are_differentiated_with_or_without_it(monitored, control):
    """The integration from a sample to a zero has the setting of the run."""
    y0 = BodyState(jnp.zeros(3), jnp.asarray(0.1 * ALONG_X))
    passing = Event(lambda t, y: y.position[0] - 0.5, terminal=False, capacity=1)

    def time(e):
        accuracy = Accuracy(1e-9, derivative_control=control)
        run = simulate(Scene([shake(e)]), y0, TS, accuracy=accuracy, events=(passing,))
        return run.crossings[0].ts[0]

    slope = jax.block_until_ready(jax.grad(time)(0.0))
    jax.effects_barrier()
    assert bool(monitored) == control
    if control:
        # The body is ahead by the displacement that the force causes until t = 5 s.
        ahead = 5.0 / RATE - np.sin(5.0 * RATE) / RATE**2
        np.testing.assert_allclose(slope, -ahead / 0.1, rtol=STEPS * 1e-9)
