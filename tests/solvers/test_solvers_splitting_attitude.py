"""Splitting with attitude: free rotation and kicks by the gravity gradient and by the weight of a
top."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxspace import Scene
from jaxspace.attitude import GravityGradient, Top, TorqueFreeBody
from jaxspace.attitude.gravity_gradient import gravity_gradient_energy
from jaxspace.bodies import BodyState, RigidBody
from jaxspace.bodies.inertia import kinetic_energy
from jaxspace.orbits import PointGravity
from jaxspace.rotations import Quaternion
from jaxspace.simulation import Accuracy, simulate, simulate_batch
from jaxspace.solvers import DOP853, Splitting

GRADIENT = GravityGradient(1.0)
SCENE = Scene((PointGravity(1.0), GRADIENT), RigidBody(1.0, [1.0, 1.4, 1.8]))
ORBIT = 2.0 * np.pi


def start(omega):
    attitude = Quaternion(jnp.array([1.0, 0.1, 0.05, 0.08])).normalised()
    return BodyState(
        jnp.array([1.0, 0.0, 0.0]), jnp.array([0.0, 1.0, 0.0]), attitude, jnp.array(omega)
    )


def split(span, y, rtol=1e-3):
    """240 steps over the span."""
    accuracy = Accuracy(rtol=rtol, method=Splitting(4, steps=240))
    return simulate(SCENE, y, jnp.array([0.0, span]), accuracy=accuracy, throw=False)


def resolved(span, y, rtol):
    return simulate(SCENE, y, jnp.array([0.0, span]), accuracy=Accuracy(rtol=rtol, method=DOP853()))


def apart(a, b):
    """Of two runs, how far the attitudes are apart in the end."""
    return float(jnp.max(jnp.abs(a.final.attitude.wxyz - b.final.attitude.wxyz)))


def jacobi(y):
    """What a body in a circular orbit keeps beside it: its energy in the turning frame."""
    inertia = SCENE.body.inertia(None)
    h = y.attitude.rotate(inertia.times(y.omega))
    return (
        kinetic_energy(inertia, y.omega)
        + gravity_gradient_energy(y.position, y.attitude, inertia, 1.0)
        - h[2]
    )


@pytest.mark.sweep
def test_libration_under_the_gravity_gradient():
    y = start([0.05, 0.02, 1.1])
    run = split(6.0 * ORBIT, y)
    error = apart(run, resolved(6.0 * ORBIT, y, 1e-12))
    assert error < 3e-5
    assert 0.1 < 1e-3 * run.stats["largest_local_error"] / error < 10.0


def test_the_energy_of_a_libration_swings_and_does_not_wander():
    y, kept = start([0.05, 0.02, 1.1]), []
    for _ in range(40):
        kept.append(float(jax.jit(jacobi)(y)))
        y = split(6.0 * ORBIT, y).final
    swing = np.abs(np.array(kept) - kept[0]).reshape(4, 10).max(axis=1)
    assert swing.max() < 3.0 * swing[0]
    assert swing.max() < 1e-4


def test_a_fast_spin_is_free_rotation_but_for_a_little():
    """Three thousand radians of rotation within a third of one of the orbit: each step passes over
    a dozen of them."""
    y = start([3000.0, 200.0, 9500.0])
    # The splitting leaves 1.2e-5, DOP853 2.7e-5 at a tolerance of 3e-7 and a little less than the
    # splitting at 1e-7: it needs more than ten times as many steps for the same accuracy.
    exact, followed = resolved(0.3, y, 1e-12), resolved(0.3, y, 3e-7)
    assert apart(split(0.3, y), exact) < apart(followed, exact)
    assert 10 * 240 < followed.stats["steps"]


def test_without_a_torque_the_rotation_is_exact():
    y = start([2.0, 0.3, 1.0])
    spin = BodyState(attitude=y.attitude, omega=y.omega)
    split = Scene((), SCENE.body, carry=("attitude",)).split()
    free = eqx.filter_jit(split.drift)(30.0, spin)
    exact = eqx.filter_jit(TorqueFreeBody([1.0, 1.4, 1.8]).closed_form().flow)(30.0, spin)
    np.testing.assert_allclose(free.attitude.wxyz, exact.attitude.wxyz, atol=1e-14)
    line = eqx.filter_jit(Scene((GRADIENT,), SCENE.body).split().drift)(2.0, y)
    np.testing.assert_allclose(line.position, [1.0, 2.0, 0.0])


def test_a_top_precesses():
    """A fast top: its steps are those of the precession's kicks, and its energy swings."""
    top = Top(0.002, 0.0008, 0.3)
    y, ts = (
        Top.state(jnp.array([0.2, 0.7, 0.1]), jnp.array([1.0, 0.3, 149.0])),
        jnp.linspace(0.0, 1.0, 3),
    )
    exact = simulate(top, y, ts, accuracy=1e-12)
    run = simulate(top, y, ts, accuracy=Accuracy(rtol=1e-5, method=Splitting(4, steps=200)))
    assert apart(run, exact) < 1e-5
    assert all(np.max(drift) < 1e-6 for drift in run.drift().values())


@pytest.mark.sweep
def test_steps_that_pass_whole_turns_do_not_understate_their_error():
    """From a tenth of a turn to three turns a step, against steps 64 times as short: below a
    quarter of a turn the estimate is near the error; beyond, it is effectively random and lies
    above."""
    turns = np.concatenate([[0.03, 0.1, 0.2], np.linspace(0.3, 3.3, 28)])
    direction = np.array([0.3, 0.02, 0.95])
    speed = turns * 2.0 * np.pi * 40.0 / 0.3 / np.linalg.norm(direction)
    y = jax.tree.map(lambda *x: jnp.stack(x, axis=-1), *(start(direction * s) for s in speed))

    def run(method):
        ts = jnp.array([0.0, 0.3])
        return simulate_batch(SCENE, y, ts, accuracy=Accuracy(rtol=0.5, method=method))

    found, exact = run(Splitting(4, steps=40)), run(Splitting(4, steps=2560, estimate=False)).final

    def size(block):
        return np.linalg.norm(block, axis=0)

    error = [
        size(a - b) / size(b)
        for a, b in zip(jax.tree.leaves(found.final), jax.tree.leaves(exact), strict=True)
    ]
    quotient = found.stats["largest_local_error"] / np.max(error, axis=0)
    assert np.all((quotient[:3] > 0.8) & (quotient[:3] < 3.0))
    assert np.all(quotient > 0.8) and np.median(quotient) < 30.0
