"""Single steps and environments: their error, spaces, episodes, in batches and mapped."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxspace import Accuracy, BodyState, simulate
from jaxspace.control import LandingTask, RendezvousTask, SlewTask, plan_step, step
from jaxspace.control.commands import with_command
from jaxspace.core import InputError
from jaxspace.orbits.clohessy_wiltshire import clohessy_wiltshire_flow
from jaxspace.solvers import DOP853, FixedSteps, Tsit5

TASKS = [SlewTask(), LandingTask(), RendezvousTask()]
RUNS = 6


def name_of(task):
    return type(task).__name__


# Compiled as one: operation by operation it takes longer than all else here.
reset = eqx.filter_jit(lambda task, key, runs: task.reset(key, runs))
advanced = eqx.filter_jit(lambda task, *args: task.advance(*args))


@pytest.fixture(scope="module", params=TASKS, ids=name_of)
def task(request):
    return request.param


def test_an_episode(task):
    """Shapes and spaces, every run its own, mapped runs as those of a batch, auto-reset."""
    key = jax.random.key(0)
    seen, state = reset(task, key, (RUNS,))
    actions = task.action_space.sample(key, (RUNS,))
    assert task.action_space.contains(actions).all()
    assert seen.shape == (*task.observation_space.shape, RUNS)
    assert task.observation_space.contains(seen).all()
    stepped = eqx.filter_jit(task.step)
    seen, after, reward, done, info = stepped(key, state, actions)
    assert reward.shape == done.shape == info["truncated"].shape == (RUNS,) and not done.any()
    mapped = jax.jit(jax.vmap(lambda *a: task.step(*a), (None, -1, -1), -1))(key, state, actions)
    for a, b in zip(
        jax.tree.leaves((seen, after, reward)), jax.tree.leaves(mapped[:3]), strict=True
    ):
        # The same sums in another order; the states are of some thousands at most.
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-12)
    # One run at the end of its time, one that is no number: both start again, and only they.
    late = jax.tree.map(lambda x: x, after)
    late = type(after)(after.y, after.time.at[1].set(task.horizon))
    spoilt = jax.tree.map(lambda x: x.at[..., 2].set(jnp.nan), late.y)
    seen, begun, reward, done, info = stepped(key, type(after)(spoilt, late.time), actions)
    assert done.tolist() == [k in (1, 2) for k in range(RUNS)]
    assert info["truncated"].tolist() == [k == 1 for k in range(RUNS)]
    assert begun.time[1] == begun.time[2] == 0.0 and begun.time[0] > task.period
    assert jnp.isfinite(seen).all() and jnp.isfinite(reward).all()
    assert not np.allclose(info["last"][:, 1], seen[:, 1])


# The attitude of the first task doubles what is compiled.
@pytest.mark.parametrize(
    "task", [pytest.param(TASKS[0], marks=pytest.mark.sweep), *TASKS[1:]], ids=name_of
)
def test_steps_are_differentiated_and_scanned(task):
    """The gradient of twenty steps with respect to the first action, beside a difference."""
    key = jax.random.key(1)
    _, state = reset(task, key, ())

    # Value and slope from one program.
    @jax.jit
    @jax.value_and_grad
    def total(action):
        def one(state, _):
            _, state, reward, _, _ = task.step(key, state, action)
            return state, reward

        last, rewards = jax.lax.scan(one, state, length=20)
        return jnp.sum(rewards) + 1e-3 * jnp.sum(last.time)

    action = 0.2 * jnp.ones(3)
    _, slope = total(action)
    h = 1e-5 * jnp.eye(3)[0]
    difference = (total(action + h)[0] - total(action - h)[0]) / 2e-5
    # Of second order in the step, and a rounding of 1e-16 over it.
    np.testing.assert_allclose(slope[0], difference, rtol=1e-6, atol=1e-9)


def test_the_error_of_a_step(task):
    """One step of each task beside an adaptive run at 1e-12."""
    key = jax.random.key(2)
    _, state = reset(task, key, ())
    action = jnp.array([0.3, -0.2, 0.5])
    y, _ = advanced(task, state.y, action, state.time)
    if isinstance(task, RendezvousTask):
        # Closed form: free motion, and that of a constant push from rest as its integral.
        n, dt = float(task.motion.mean_motion), float(task.period)
        x, v = clohessy_wiltshire_flow(state.y.position, state.y.velocity, dt, n)
        nodes, weights = np.polynomial.legendre.leggauss(12)
        push = task.thrust * action
        for s, w in zip(0.5 * dt * (nodes + 1.0), 0.5 * dt * weights, strict=True):
            dx, dv = clohessy_wiltshire_flow(jnp.zeros(3), w * push, dt - s, n)
            x, v = x + dx, v + dv
        np.testing.assert_allclose(y.position, x, rtol=1e-11)
        np.testing.assert_allclose(y.velocity, v, rtol=1e-10)
        return
    scale = task._wheels.torque_limit if isinstance(task, SlewTask) else task._engine.max_thrust
    held = with_command(task.scene, scale * action)
    ts = jnp.array([0.0, task.period])
    fine = simulate(held, state.y, ts, accuracy=Accuracy(1e-12, method=DOP853())).final
    for a, b in zip(jax.tree.leaves(y), jax.tree.leaves(fine), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-8, atol=1e-8)


@pytest.mark.sweep  # a study compiles every method
def test_a_plan_says_what_a_step_costs():
    task = SlewTask()
    y = reset(task, jax.random.key(0), ())[1].y
    y = BodyState(attitude=y.attitude, omega=jnp.array([0.3, -0.2, 0.4]), parts=y.parts)
    plan = plan_step(task.scene, y, 0.01 * jnp.ones(3), 0.5, error=1e-7, counts=(1, 2))
    assert plan.error <= 1e-7 and "Tsit5(1 steps)" in str(plan.table)
    fine = step(task.scene, y, 0.01 * jnp.ones(3), 0.5, method=FixedSteps(DOP853(), 4))
    found = step(task.scene, y, 0.01 * jnp.ones(3), 0.5, method=plan.method)
    assert np.abs(found.omega - fine.omega).max() <= 1e-7 * np.abs(fine.omega).max()
    with pytest.raises(InputError, match="at least"):
        plan_step(
            task.scene, y, 0.01 * jnp.ones(3), 5.0, error=1e-14, solvers=(Tsit5(),), counts=(1,)
        )
