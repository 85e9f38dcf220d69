"""Splitting of perturbed orbits: its order, that it is exact without a perturbation, its energy, its derivatives."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxspace import Scene
from jaxspace._core import InputError
from jaxspace.bodies import BodyState, Load
from jaxspace.orbits import Oblateness, PointGravity, TwoBody
from jaxspace.scene import Custom
from jaxspace.simulation import Accuracy, Status, simulate, simulate_batch
from jaxspace.solvers import Splitting

OBLATE = Scene((PointGravity(1.0), Oblateness(1.0, 1.08262668e-3, 1.0)))
TURNS = jnp.array([0.0, 20.0])


def start(e=0.1):
    """Periapsis of an inclined ellipse with semi-major axis 1.2 and gravitational parameter 1."""
    v = np.sqrt((1.0 + e) / (1.0 - e) / 1.2)
    return BodyState(jnp.array([1.2 * (1.0 - e), 0.0, 0.0]), jnp.array([0.0, 0.8 * v, 0.6 * v]))


def by(steps, order=4, rtol=1e-6, **more):
    return Accuracy(rtol=rtol, method=Splitting(order, steps=steps), **more)


def far(a, b):
    """The largest distance of two positions."""
    return float(jnp.max(jnp.linalg.norm(a - b, axis=-1)))


@pytest.mark.slow
@pytest.mark.parametrize(("order", "steps"), [(4, 60), (2, 100), (6, 60)])
def test_errors_fall_with_the_order_and_are_estimated(order, steps):
    exact = simulate(OBLATE, start(), TURNS, accuracy=1e-13).final.position
    errors = []
    for n in (steps, 2 * steps):
        run = simulate(OBLATE, start(), TURNS, accuracy=by(n, order, 1e-3))
        errors.append(far(run.final.position, exact))
        # Of the length of the position, near 1.2; the estimate is good to the next order.
        assert 0.2 < 1.2e-3 * run.stats["largest_local_error"] / errors[-1] < 5.0
    assert np.log2(errors[0] / errors[1]) > order - 0.5


def test_without_a_perturbation_every_step_is_exact():
    run = simulate(Scene((PointGravity(1.0),)), start(0.9), TURNS, accuracy=by(2))
    assert far(run.final.position, simulate(TwoBody(1.0), start(0.9), TURNS).final.position) < 1e-11


def test_every_state_asked_for_is_landed_on_backwards_and_in_a_batch():
    ts = jnp.linspace(20.0, 0.0, 7)
    exact = simulate(OBLATE, start(), ts, accuracy=1e-12).states.position
    run = simulate(OBLATE, start(), ts, accuracy=by(30, 6)).states.position
    assert far(run, exact) < 1e-7
    both = simulate_batch(OBLATE, jax.tree.map(lambda x: jnp.stack([x, x]), start()), ts, accuracy=by(30, 6), in_axes=(None, 0))
    assert far(both.states.position[1], run) < 1e-12


def test_energy_swings_and_does_not_wander():
    """Over 300 revolutions with twenty steps in each, as over thirty: the swing is of one size."""
    span = 2.0 * np.pi * 1.2**1.5
    swings = []
    for turns in (30, 300):
        ts = jnp.linspace(0.0, turns * span, 11)
        run = simulate(OBLATE, start(), ts, accuracy=Accuracy(method=Splitting(2, steps=2 * turns, estimate=False)))
        swings.append(float(jnp.max(run.drift()["energy"])))
    # The few states asked for catch the swing at ever other places of the orbit; an error that wanders would grow tenfold.
    assert swings[1] < 4.0 * swings[0]
    assert swings[0] < 1e-4


def test_derivatives_forwards_and_reverse():
    """Against those of an integration by another method."""

    def end(j2, y, accuracy):
        scene = Scene((PointGravity(1.0), Oblateness(1.0, j2, 1.0)))
        return jnp.sum(simulate(scene, y, TURNS, accuracy=accuracy).final.position ** 3)

    given = (jnp.array(1.08262668e-3), start())
    exact = jax.grad(lambda *p: end(*p, 1e-12), argnums=(0, 1))(*given)
    reverse = jax.grad(lambda *p: end(*p, by(200)), argnums=(0, 1))(*given)
    forward = jax.jacfwd(lambda *p: end(*p, by(200, adjoint=diffrax.ForwardMode())), argnums=(0, 1))(*given)
    for found in (reverse, forward):
        for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(exact), strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-6, atol=1e-6)


def test_too_few_steps_are_told():
    assert simulate(OBLATE, start(), TURNS, accuracy=by(4, 2, 1e-9), throw=False).status == Status.TOLERANCE_MISSED


def test_it_refuses_what_cannot_be_split():
    with pytest.raises(InputError, match="order is 3"):
        Splitting(3, steps=10)
    with pytest.raises(InputError, match="steps is 5"):
        Splitting(4, steps=5)
    with pytest.raises(InputError, match="TwoBody offers no drift"):
        simulate(TwoBody(1.0), start(), TURNS, accuracy=by(10))
    with pytest.raises(InputError, match="one effect as PointGravity, and has 0"):
        simulate(Scene((Oblateness(1.0, 1e-3, 1.0),)), start(), TURNS, accuracy=by(10))
    drag = Custom(lambda t, y, body: Load(acceleration_N=-0.01 * y.velocity), needs={"velocity"}, adds={"acceleration"})
    with pytest.raises(InputError, match="Custom reads the velocity"):
        simulate(Scene((PointGravity(1.0), drag)), start(), TURNS, accuracy=by(10))
