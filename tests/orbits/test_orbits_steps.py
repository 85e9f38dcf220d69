"""The number of fixed steps, from the osculating orbit."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from systems import J2, MU, RADIUS, orbit

from jaxspace import BodyState, Scene, simulate
from jaxspace.core import InputError
from jaxspace.orbits import Oblateness, PointGravity, TwoBody
from jaxspace.orbits.steps import steps_for
from jaxspace.simulation import Accuracy
from jaxspace.solvers import Regularised, Stormer

UNIT = TwoBody(1.0)
TURN = 2.0 * np.pi


def at_periapsis(e, a=1.0):
    speed = np.sqrt((1.0 + e) / (1.0 - e) / a)
    return BodyState(
        jnp.array([a * (1.0 - e), 0.0, 0.0]),
        jnp.array([0.0, speed * np.cos(0.5), speed * np.sin(0.5)]),
    )


@pytest.mark.parametrize("e", [0.0, 0.5, 0.95])
def test_a_revolution_is_one_whatever_the_eccentricity(e):
    assert steps_for(UNIT, at_periapsis(e), TURN, 64) == 64
    assert steps_for(UNIT, at_periapsis(e, 4.0), -8.0 * TURN, 64) == 64
    # Of 2^(k/2) the first beyond 900.
    assert steps_for(UNIT, at_periapsis(e), 10.0 * TURN, 90) == 1024


def test_similar_orbits_take_the_same_number():
    counts = {
        steps_for(UNIT, at_periapsis(0.1, a), 100.0 * TURN, 33) for a in np.linspace(1.0, 1.25, 20)
    }
    assert len(counts) <= 2
    assert all(count % 2 == 0 for count in counts)


def test_an_orbit_that_does_not_come_back_is_one_revolution():
    y0 = BodyState(jnp.array([1.0, 0.0, 0.0]), jnp.array([0.0, 2.0, 0.0]))
    assert steps_for(UNIT, y0, 1e3, 32) == 32


def test_of_many_runs_the_fastest_counts():
    y0s = jax.tree.map(
        lambda *x: jnp.stack(x, axis=-1),
        at_periapsis(0.0, 4.0),
        at_periapsis(0.3),
        at_periapsis(0.0, jnp.nan),
    )
    assert steps_for(UNIT, y0s, 8.0 * TURN, 32) == 256
    # As many runs as components: the runs are on the last axis all the same.
    one = jax.tree.map(lambda x: x[:, :1], y0s)
    assert steps_for(UNIT, one, 8.0 * TURN, 32) == 32


def test_a_state_without_attraction_or_traced_is_refused():
    with pytest.raises(InputError, match="attraction"):
        steps_for(Scene(()), at_periapsis(0.0), TURN, 32)
    with pytest.raises(InputError, match="outside of jit"):
        jax.eval_shape(lambda y: steps_for(UNIT, y, TURN, 32), at_periapsis(0.0))


def test_the_steps_serve():
    """Nine digits by 90 steps a revolution of order 12 on a low orbit, and ten by 32 in regularised
    variables on an eccentric one."""
    scene = Scene((PointGravity(MU), Oblateness(MU, J2, RADIUS)))
    ts = np.array([0.0, 43200.0])
    method = Stormer(12, steps=steps_for(scene, orbit(), ts[-1], 90))
    run, tight = (
        simulate(scene, orbit(), ts, accuracy=a).final
        for a in (Accuracy(1e-8, method=method), 1e-12)
    )
    np.testing.assert_allclose(run.position, tight.position, atol=1e-9 * 6.6e6)
    point = Scene((PointGravity(1.0),))
    ts = np.array([0.0, 10.0 * TURN])
    method = Regularised(steps=steps_for(point, at_periapsis(0.95), ts[-1], 32))
    run = simulate(point, at_periapsis(0.95), ts, accuracy=Accuracy(method=method)).final
    np.testing.assert_allclose(run.position, at_periapsis(0.95).position, atol=1e-10)
