"""Derivatives of saved states by the times at which they are saved, and by breaks between them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxspace import BodyState, Scene, simulate, simulate_batch
from jaxspace.bodies import BurningBody
from jaxspace.orbits import Oblateness, PointGravity
from jaxspace.rockets import Thrust
from jaxspace.rotations import Quaternion
from jaxspace.simulation import Accuracy
from jaxspace.solvers import DOP853, RKN1210, AdaptiveRegularised, Stormer, Tsit5

ORBIT = Scene((PointGravity(1.0), Oblateness(1.0, 1e-3, 1.0)))
Y = BodyState(jnp.array([1.0, 0.0, 0.0]), jnp.array([0.0, 1.1, 0.2]))
TS = jnp.array([0.0, 0.7, 1.9, 3.0])


@pytest.mark.parametrize(
    "method",
    [
        DOP853(),
        pytest.param(Stormer(steps=200), marks=pytest.mark.sweep),
        pytest.param(RKN1210(), marks=pytest.mark.sweep),
        pytest.param(AdaptiveRegularised(), marks=pytest.mark.sweep),
    ],
    ids=str,
)
def test_by_save_times(method):
    """By its own time a position has the velocity as its derivative, by every other save time none;
    by the start that of a motion which does not depend on the time."""
    accuracy = Accuracy(rtol=1e-10, method=method)

    def saved(ts):
        run = simulate(ORBIT, Y, ts, accuracy=accuracy)
        return run.states.position, run.states.velocity

    forward, velocity = jax.jit(jax.jacfwd(saved, has_aux=True))(TS)
    reverse = jax.jit(jax.jacrev(lambda ts: saved(ts)[0]))(TS)
    expected = np.zeros((3, 4, 4))
    for k in range(1, 4):
        expected[:, k, k] = velocity[:, k]
        expected[:, k, 0] = -velocity[:, k]
    expected[:, 0, 0] = 0.0
    # The error of the velocity, and by the start that of the derivative by the initial state.
    np.testing.assert_allclose(forward[..., 1:], expected[..., 1:], rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(reverse, forward, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(forward[..., 0], expected[..., 0], rtol=0.0, atol=1e-7)


# Second derivatives of a run are in `test_simulation_results.py`.
@pytest.mark.sweep
def test_of_second_order_and_in_batches():
    """The second derivative by a save time is the acceleration."""
    # Of few stages: the compiler of JAX 0.10 takes memory by their second power.
    accuracy = Accuracy(rtol=1e-10, method=Tsit5())

    def between(t, velocity):
        ts = TS.at[1].set(t)
        y = BodyState(jnp.broadcast_to(Y.position[:, None], velocity.shape), velocity)
        return simulate_batch(ORBIT, y, ts, accuracy=accuracy).states

    velocity = Y.velocity[:, None] + 0.01 * jnp.arange(3.0)

    def at_that_time(t):
        states = between(t, velocity)
        return states.position[:, 1], BodyState(states.position[:, 1], states.velocity[:, 1])

    @jax.jit
    def both_orders(t):
        (rate, y), (curvature, _) = jax.jvp(
            jax.jacfwd(at_that_time, has_aux=True), (t,), (jnp.ones_like(t),)
        )
        return rate, curvature, y, ORBIT.vector_field(0.0, y).velocity

    rate, curvature, y, acceleration = both_orders(jnp.array(0.7))
    # The derivative of what an interpolation of this accuracy misses by.
    np.testing.assert_allclose(rate, y.velocity, rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(curvature, acceleration, rtol=0.0, atol=1e-7)


def test_by_a_break_between_save_times():
    """A motor whose burn time and thrust vary together: central differences, whose own error is
    1e-8 here."""
    body = BurningBody(1.0, [1.0, 1.0, 1.0], [0.1, 0.1, 0.1])
    still = jnp.zeros(3)
    y0 = BodyState(still, still, Quaternion.identity(), still, jnp.asarray(5.0))
    ts = jnp.array([0.0, 0.5, 1.5, 2.2, 3.0])

    @jax.jit
    def speeds(burn_time):
        scene = Scene((Thrust(3.0 * burn_time, 100.0, burn_time),), body)
        run = simulate(scene, y0, ts, accuracy=Accuracy(rtol=1e-10, method=DOP853()))
        return run.states.velocity[2]

    h = 1e-5
    differences = (speeds(2.0 + h) - speeds(2.0 - h)) / (2.0 * h)
    np.testing.assert_allclose(jax.jacfwd(speeds)(2.0), differences, rtol=0.0, atol=1e-7)
