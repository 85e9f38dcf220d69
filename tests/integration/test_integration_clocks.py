"""Every run of a batch has its own time and steps: its neighbours do not change a bit of it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxspace import Accuracy, BodyState, Event, Scene, simulate_batch
from jaxspace.integration import _record
from jaxspace.orbits import Oblateness, PointGravity
from jaxspace.simulation import Status
from jaxspace.solvers import DOP853, RKN1210, Tsit5

SCENE = Scene((PointGravity(1.0), Oblateness(1.0, 1e-3, 1.0)))
RUNS, SLOW, FAILING, QUICK = 24, 5, 11, 17


EPS = float(np.finfo(float).eps)


def starts() -> BodyState:
    """Orbits of eccentricities up to 0.6 from their apses; one so low that its steps run out, one
    that is not finite, and one with many revolutions, which takes several times the steps of the
    others."""
    g = np.random.default_rng(3)
    e, tilt = g.uniform(0.0, 0.6, RUNS), g.uniform(0.1, 1.0, RUNS)
    speed = np.sqrt(1.0 + e)
    x = np.stack([2.0 + 0.0 * e, 0.0 * e, 0.0 * e])
    v = np.stack([0.0 * e, speed * np.cos(tilt), speed * np.sin(tilt)]) / np.sqrt(2.0)
    for run, part in ((SLOW, 0.05), (QUICK, 0.3)):
        x[:, run], v[:, run] = part * x[:, run], v[:, run] / np.sqrt(part)
    x[0, FAILING] = np.nan
    return BodyState(jnp.asarray(x), jnp.asarray(v))


def flown(y: BodyState, ts, method, events=()):
    """What the user sees of these runs."""
    accuracy = Accuracy(1e-8, method=method, max_steps=600)
    fly = jax.jit(lambda y: simulate_batch(SCENE, y, ts, accuracy=accuracy, events=events))
    run = fly(jax.device_put(y, jax.devices()[0]))
    numbers = (run.states, run.ts, run.status, run.stats["steps"], run.stats["rejected_steps"])
    return jax.tree.map(np.asarray, numbers)


# Of whole vectors, as the runs of a block are: a lane that is left over is rounded by itself. A
# block has 64 runs: the last one is filled up with copies of its last run.
ORDERS = {
    "turned round": np.arange(RUNS)[::-1],
    "beside one that fails": np.where(np.arange(RUNS) == 3, 3, FAILING),
    "beside slow ones": np.where(np.arange(RUNS) % 8 == 3, np.arange(RUNS), SLOW),
    "beside a quick one": np.where(np.arange(RUNS) == QUICK, QUICK, 3),
    "cut": np.arange(8, 16),
    "filled up with the one that fails": np.append(np.arange(7), FAILING),
    "filled up with the slow one": np.append(np.arange(7), SLOW),
    "mixed in two blocks": np.random.default_rng(0).integers(0, RUNS, 72),
}


@pytest.mark.parametrize("method", [DOP853(), Tsit5(), RKN1210()])
@pytest.mark.parametrize("saves", [2, 9])
def test_a_run_does_not_depend_on_its_neighbours(method, saves):
    """To the last bit, in any order, cut and filled up, in one block and in two, beside a run whose
    steps run out, one that fails and one that takes many steps."""
    y, ts = starts(), jnp.linspace(0.0, 30.0, saves)
    whole = flown(y, ts, method)
    assert whole[2][SLOW] == Status.MAX_STEPS and whole[2][FAILING] == Status.NOT_FINITE
    others = np.delete(np.arange(RUNS), [SLOW, FAILING])
    assert np.all(whole[2][others] == Status.COMPLETED)
    assert whole[3][QUICK] > 3 * np.median(whole[3][others])
    for name, order in ORDERS.items():
        some = flown(jax.tree.map(lambda x, k=order: x[..., k], y), ts, method)
        for a, b in zip(jax.tree.leaves(some), jax.tree.leaves(whole), strict=True):
            b = b[..., order] if b.shape[-1:] == (RUNS,) else b
            np.testing.assert_array_equal(a, b, err_msg=name)


@pytest.mark.parametrize(
    "runs", [16, *(pytest.param(n, marks=pytest.mark.sweep) for n in (8, 24, 40, 56, 65, 70, 100))]
)
def test_whole_vectors_of_runs_in_any_order(runs):
    """Multiples of eight runs, and more than a block, outside of `jit`, where the compiler uses the
    widest vectors of the processor. With other numbers its optimisations round the runs that are
    left over in another way."""
    g, places = np.random.default_rng(3), np.arange(runs)
    e, tilt = g.uniform(0.0, 0.6, runs), g.uniform(0.1, 1.0, runs)
    x = np.stack([2.0 + 0.0 * e, 0.0 * e, 0.0 * e])
    v = np.stack([0.0 * e, np.cos(tilt), np.sin(tilt)]) * np.sqrt(0.5 * (1.0 + e))
    accuracy = Accuracy(1e-8, method=DOP853(), max_steps=600)

    def ends(order):
        y = BodyState(jnp.asarray(x[:, order]), jnp.asarray(v[:, order]))
        run = simulate_batch(SCENE, y, jnp.linspace(0.0, 30.0, 3), accuracy=accuracy)
        return jax.tree.map(np.asarray, (run.states, run.stats["steps"]))

    whole = ends(places)
    for order in (places[::-1], np.roll(places, 1), g.permutation(runs)):
        for a, b in zip(jax.tree.leaves(ends(order)), jax.tree.leaves(whole), strict=True):
            np.testing.assert_array_equal(a, b[..., order])


def test_events_do_not_depend_on_the_neighbours():
    """Runs that meet their events in other passes, or never."""
    y, ts = starts(), jnp.linspace(0.0, 30.0, 2)
    edge = Event(lambda t, y: y.position[0] + 0.3, direction=-1)
    whole = flown(y, ts, DOP853(), (edge,))
    assert np.sum(whole[2] == Status.EVENT) > 10
    for name, order in ORDERS.items():
        some = flown(jax.tree.map(lambda x, k=order: x[..., k], y), ts, DOP853(), (edge,))
        for a, b in zip(jax.tree.leaves(some), jax.tree.leaves(whole), strict=True):
            b = b[..., order] if b.shape[-1:] == (RUNS,) else b
            # What follows the loop, the step to the zero, is a program for this number of runs:
            # compiled for another one it may round a sum in another order.
            np.testing.assert_allclose(a, b, rtol=4.0 * EPS, atol=4.0 * EPS, err_msg=name)


def slopes(y: BodyState, times, max_steps=300) -> BodyState:
    """The derivatives of a sum over all states of each run by where the run starts."""
    accuracy = Accuracy(1e-8, method=DOP853(), max_steps=max_steps)

    @jax.jit
    @jax.grad
    def slope(y):
        run = simulate_batch(SCENE, y, times, accuracy=accuracy)
        return jnp.sum(run.states.position)

    return jax.tree.map(np.asarray, slope(jax.device_put(y, jax.devices()[0])))


def whole_runs() -> BodyState:
    """The starts of the runs that end well."""
    return jax.tree.map(lambda x: jnp.delete(x, jnp.array([SLOW, FAILING]), axis=-1), starts())


def test_derivatives_do_not_depend_on_the_neighbours():
    """Of recorded steps, in reverse mode, to the last bit."""
    y, times = whole_runs(), jnp.linspace(0.0, 12.0, 2)
    whole = slopes(y, times)
    order = np.arange(whole.position.shape[-1])[::-1]
    some = slopes(jax.tree.map(lambda x: x[..., order], y), times)
    assert np.all(np.isfinite(whole.position))
    for a, b in zip(jax.tree.leaves(some), jax.tree.leaves(whole), strict=True):
        np.testing.assert_array_equal(a, b[..., order])


def test_a_slow_run_leaves_the_others_their_derivatives(monkeypatch, fresh_programs):
    """Where the record is full, and the steps that the runs share are used up by one of them."""
    times = jnp.linspace(0.0, 12.0, 2)
    alone = slopes(whole_runs(), times)
    monkeypatch.setattr(_record, "RECORDED_STEPS", 0)
    monkeypatch.setattr(_record, "FEWEST_ROWS", 8)
    some = slopes(starts(), times, 298)
    assert np.all(np.isnan(some.position[:, [SLOW, FAILING]]))
    for a, b in zip(jax.tree.leaves(some), jax.tree.leaves(alone), strict=True):
        found = np.delete(a, [SLOW, FAILING], axis=-1)
        np.testing.assert_allclose(found, b, rtol=0.0, atol=1e-5 * np.max(np.abs(b)))


def test_a_record_that_is_full_takes_steps_that_all_runs_share(monkeypatch, fresh_programs):
    """The same derivatives, within what the tolerance of the runs makes of them."""
    y, times = whole_runs(), jnp.linspace(0.0, 12.0, 3)
    whole = slopes(y, times)
    monkeypatch.setattr(_record, "RECORDED_STEPS", 0)
    monkeypatch.setattr(_record, "FEWEST_ROWS", 8)
    # Another limit, so that this is another program.
    shared = slopes(y, times, 299)
    assert np.any(shared.position != whole.position)
    for a, b in zip(jax.tree.leaves(shared), jax.tree.leaves(whole), strict=True):
        # The error of a derivative is about that of the run, 1e-8 a step, times some hundred steps.
        np.testing.assert_allclose(a, b, rtol=0.0, atol=1e-5 * np.max(np.abs(b)))
