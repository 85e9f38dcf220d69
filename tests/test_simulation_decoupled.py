"""Scenes whose body turns freely beside forces that have no closed form: the rotation exactly, the
rest by steps."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from systems import AIR, J2, MU, RADIUS, motor, orbit, turned

from jaxspace import Accuracy, Event, Mission, Phase, Scene, Status, simulate, simulate_batch
from jaxspace.attitude import BodyTorque, GravityGradient, TorqueFreeBody
from jaxspace.bodies import BodyState, BurningBody, RigidBody
from jaxspace.orbits import Oblateness, PointGravity
from jaxspace.rotations import Quaternion
from jaxspace.solvers import DOP853

FORCES = (PointGravity(MU), Oblateness(MU, J2, RADIUS))
BODY = RigidBody(900.0, [520.0, 560.0, 340.0])
STAGE = Scene(FORCES, BODY, ("attitude", "mass"))
FREE = TorqueFreeBody([520.0, 560.0, 340.0]).closed_form()


def spinning(omega):
    return orbit(attitude=turned(), omega=jnp.asarray(omega), mass=jnp.array(900.0))


def rotation(y):
    return BodyState(attitude=y.attitude, omega=y.omega)


@jax.jit
def exact(t, y):
    return FREE.flow(t, rotation(y))


def test_a_long_spinning_coast_needs_no_steps_for_its_spin():
    """211 rpm for ten minutes: 13,000 radians, which are more steps than a run may take."""
    y0 = spinning([0.3, -0.1, 22.1])
    ts = jnp.array([0.0, 250.0, 600.0])
    run = simulate(STAGE, y0, ts, dense=True)
    alone = simulate(Scene(FORCES), orbit(), ts, accuracy=Accuracy(method=DOP853()))
    assert run.status == Status.COMPLETED and run.stats["steps"] < 10
    assert "DOP853 beside a closed form" in repr(run)
    for k, t in enumerate(ts):
        after = exact(t, y0)
        np.testing.assert_array_equal(run[k].attitude.wxyz, after.attitude.wxyz)
        np.testing.assert_array_equal(run[k].omega, after.omega)
        assert run[k].mass == 900.0
        # Both within the tolerance of a few steps.
        np.testing.assert_allclose(run[k].position, alone[k].position, rtol=1e-8)
    # Between the save times, too.
    within = run.at(jnp.array(123.4))
    np.testing.assert_allclose(within.omega, exact(123.4, y0).omega, rtol=1e-12, atol=1e-12)
    assert within.mass == 900.0 and np.all(np.isfinite(within.position))


@pytest.mark.parametrize("terminal", [True, False])
def test_events_read_the_exact_attitude(terminal):
    """The x axis of a body that spins about its z axis comes back to the plane y = 0."""
    y0 = orbit(
        attitude=Quaternion(jnp.array([1.0, 0.0, 0.0, 0.0])),
        omega=jnp.array([0.0, 0.0, 20.0]),
        mass=jnp.array(900.0),
    )

    def side(t, y):
        return y.attitude.rotate(jnp.array([1.0, 0.0, 0.0]))[1]

    event = Event(side, direction=-1, terminal=terminal, capacity=8)
    run = simulate(STAGE, y0, jnp.array([0.0, 1.0]), events=(event,))
    times = np.pi * np.array([1.0, 3.0, 5.0]) / 20.0
    if terminal:
        np.testing.assert_allclose(run.ts[-1], times[0], rtol=1e-13)
    else:
        np.testing.assert_allclose(run.crossings[0].ts[:3], times, rtol=1e-13)


def test_derivatives_are_those_of_steps():
    """Of an output of all parts, by the state, the inertia and the duration."""

    def measure(x, accuracy):
        rates, moments, duration = x
        scene = Scene(FORCES, RigidBody(900.0, moments), ("attitude", "mass"))
        y = simulate(
            scene, spinning(rates), jnp.stack([0.0 * duration, duration]), accuracy=accuracy
        )
        y = y.final
        return y.attitude.rotate(y.position / 7e6)[0] + y.omega[1]

    x = jnp.array([0.02, -0.1, 0.4]), jnp.array([520.0, 560.0, 340.0]), jnp.array(20.0)
    exactly, stepped = (
        jax.jit(jax.grad(measure), static_argnums=())(x, Accuracy(1e-12, method=method))
        for method in ("auto", DOP853())
    )
    for a, b in zip(exactly, stepped, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-7, atol=1e-10)


def test_runs_of_a_batch_and_phases_of_a_mission():
    y0s = jax.tree.map(lambda x: jnp.stack([x, x], axis=-1), spinning([0.3, -0.1, 22.1]))
    scale = jnp.array([1.0, 0.5])
    y0s = BodyState(y0s.position, y0s.velocity, y0s.attitude, scale * y0s.omega, y0s.mass)
    batch = simulate_batch(STAGE, y0s, jnp.array([0.0, 600.0]))
    np.testing.assert_array_equal(batch.status, Status.COMPLETED)
    mission = simulate(Mission([Phase(STAGE, 600.0)]), batch.of(1).initial)
    for run in (batch.of(1), mission.phases[0]):
        after = exact(600.0, run.initial)
        np.testing.assert_allclose(run.final.omega, after.omega, rtol=1e-10, atol=1e-10)
        np.testing.assert_allclose(run.final.attitude.wxyz, after.attitude.wxyz, atol=1e-10)


def test_a_quaternion_of_zeros_is_no_attitude():
    y0 = spinning([0.3, -0.1, 1.0])
    zero = Quaternion(jnp.zeros(4))
    y0 = BodyState(y0.position, y0.velocity, zero, y0.omega, y0.mass)
    batch = jax.tree.map(lambda x: x[..., None], y0)
    # A batch marks its own runs, where a single one is refused before.
    assert simulate_batch(STAGE, batch, jnp.array([0.0, 600.0])).status[0] == Status.NOT_FINITE


@pytest.mark.parametrize(
    "scene",
    [
        Scene((*FORCES, GravityGradient(MU)), BODY),
        Scene((*FORCES, BodyTorque([0.1, 0.0, 0.0])), BODY),
        Scene(
            (*FORCES, motor()), BurningBody(1100.0, [520.0, 560.0, 340.0], [0.42, 0.42, 0.4], -0.6)
        ),
        Scene((), BODY, ("attitude",)),
        Scene((*FORCES, AIR), BODY),
    ],
    ids=[
        "reads the attitude",
        "torque",
        "mass that changes",
        "rotation alone",
        "translation alone",
    ],
)
def test_other_scenes_stay_whole(scene):
    assert scene.decoupled() is None
