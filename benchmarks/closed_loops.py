"""Cost of sampled control relative to the motion alone, and the step rate of environments: a rigid
body with quaternion feedback for 100 samples by Tsit5, one step per sample, single and in a batch
of 256; and a satellite with three wheels in batches of 4096 in single precision, in blocks of 128
on every core. Errors are those of one step of half a second compared with DOP853 with eight times
as many steps."""

import os
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import AxisType, PartitionSpec

from jaxspace import Accuracy, BodyState, Scene, simulate, simulate_batch
from jaxspace.bodies import RigidBody
from jaxspace.control import ClosedLoop, CommandedTorque, SlewTask, step
from jaxspace.control.attitude_laws import QuaternionFeedback, error_vector
from jaxspace.rotations import Quaternion
from jaxspace.solvers import DOP853, FixedSteps, Tsit5

from ._measure import WIDE, in_turn, worst

SCENE = Scene([CommandedTorque()], RigidBody(inertia=[1.0, 1.5, 2.0]))
PERIOD, SAMPLES = 0.1, 100
ENDS = np.array([0.0, PERIOD * SAMPLES])
ACCURACY = Accuracy(rtol=1e-5, method=FixedSteps(Tsit5(), 1), max_steps=128)
EPISODES, STEPS, BLOCK = 4096, 200, 128
WORK = "runs_per_cpu_second"  # what else runs on the machine takes no part in the ratios
TARGET = jnp.array([1.0, 0.0, 0.0, 0.0])

FIRST = """
import time, jax, jax.numpy as jnp
jax.config.update("jax_enable_x64", True)
from jaxspace import BodyState, Scene
from jaxspace.bodies import RigidBody
from jaxspace.control import ClosedLoop, CommandedTorque
from jaxspace.control.attitude_laws import QuaternionFeedback
from jaxspace.rotations import Quaternion
scene = Scene([CommandedTorque()], RigidBody(inertia=[1.0, 1.5, 2.0]))
y = BodyState(attitude=Quaternion.identity(), omega=jnp.array([0.1, -0.2, 0.3]))
jax.block_until_ready(y)
start = time.perf_counter()
loop = ClosedLoop(scene, QuaternionFeedback(2.0, 2.0), period=0.1)
jax.block_until_ready(loop.simulate(y, [0.0, 10.0]).final)
print(time.perf_counter() - start)
"""


def _bodies(runs: int | None) -> BodyState:
    rate = 0.3 * jax.random.normal(jax.random.key(0), (3, runs or 1))
    attitude = jnp.zeros((4, runs or 1)).at[0].set(1.0)
    state = BodyState(attitude=Quaternion(attitude), omega=rate)
    return state if runs else jax.tree.map(lambda x: x[:, 0], state)


def _loops(runs: int | None) -> dict[str, dict]:
    y0 = _bodies(runs)
    grid = jnp.linspace(*ENDS, SAMPLES + 1)

    def flown(gain, y):
        loop = ClosedLoop(SCENE, QuaternionFeedback(gain, 2.0), period=PERIOD)
        if runs:
            return loop.simulate_batch(y, ENDS, accuracy=ACCURACY).final.omega
        return loop.simulate(y, ENDS, accuracy=ACCURACY, throw=False).final.omega

    def free(y):
        if runs:
            return simulate_batch(SCENE, y, grid, accuracy=ACCURACY).final.omega
        return simulate(SCENE, y, grid, accuracy=ACCURACY, throw=False).final.omega

    programs = {
        "the motion alone, in as many fixed steps": (free, (y0,)),
        "loop": (flown, (2.0, y0)),
        "loop and gradient": (jax.value_and_grad(lambda k, y: jnp.sum(flown(k, y))), (2.0, y0)),
    }
    whose = f"{runs} runs" if runs else "one run"
    calls = {}
    for name, (function, arguments) in programs.items():
        compiled = jax.jit(function, compiler_options=WIDE)
        calls[f"{whose}, {name}"] = lambda f=compiled, a=arguments: f(*a)
    rows = in_turn(calls, runs or 1, repeats=31)
    alone, loop, gradient = rows.values()
    loop["times_the_motion_alone"] = alone[WORK] / loop[WORK]
    gradient["times_the_loop"] = loop[WORK] / gradient[WORK]
    return rows


def _episodes() -> dict[str, dict]:
    task, key = SlewTask(), jax.random.key(0)
    devices = jax.devices()
    mesh = jax.make_mesh((len(devices),), ("runs",), (AxisType.Auto,))
    _, start = task.reset(key, (EPISODES,))
    single = jax.tree.map(lambda x: x.astype(jnp.float32), (task, start))

    def fly(task, state, keys, whole):
        def one(carry, _):
            state, key = carry
            key, own = jax.random.split(key)
            error = error_vector(state.y.attitude, TARGET.astype(jnp.float32))
            action = -50.0 * error - 500.0 * state.y.omega
            if whole:
                _, state, *_ = task.step(own, state, action)
            else:
                y = step(task.scene, state.y, 0.02 * action, task.period)
                state = type(state)(y, state.time)
            return (state, key), None

        def piece(state):
            return jax.lax.scan(one, (state, keys[0]), length=STEPS)[0][0]

        def cut(x):
            return jnp.moveaxis(x.reshape(*x.shape[:-1], -1, BLOCK), -2, 0)

        ends = jax.lax.map(piece, jax.tree.map(cut, state))
        return jax.tree.map(lambda x: jnp.moveaxis(x, 0, -2).reshape(*x.shape[1:-1], -1), ends)

    specs = jax.tree.map(lambda x: PartitionSpec(*(None,) * (x.ndim - 1), "runs"), start)
    keys = jax.random.split(key, len(devices))
    calls = {}
    for name, whole in (("one step", False), ("one step, reward and new start", True)):
        program = jax.shard_map(
            lambda state, keys, whole=whole: fly(single[0], state, keys, whole),
            mesh=mesh,
            in_specs=(specs, PartitionSpec("runs")),
            out_specs=specs,
            check_vma=False,
        )
        compiled = jax.jit(program, compiler_options=WIDE)
        calls[f"slew by wheels, {name}"] = lambda f=compiled: f(single[1], keys)
    rows = in_turn(calls, EPISODES * STEPS, repeats=11)
    # At rates of the order at which an episode of this task begins, and ten times those.
    torque = 0.01 * jnp.ones((3, 1))
    fine = FixedSteps(DOP853(), 8)
    for row in rows.values():
        for scale, name in ((1.0, "worst_error_of_the_rate"), (10.0, "at_ten_times_the_rates")):
            y = BodyState(
                attitude=start.y.attitude, omega=scale * start.y.omega, parts=start.y.parts
            )
            low = jax.tree.map(lambda x: x.astype(jnp.float32), y)
            found = step(single[0].scene, low, torque.astype(jnp.float32), single[0].period)
            reference = step(task.scene, y, torque, task.period, method=fine)
            row[name] = worst(found.omega, reference.omega)
            if scale == 1.0:
                attitude = worst(found.attitude.wxyz, reference.attitude.wxyz)
                row["worst_error_of_the_attitude"] = attitude
    return rows


def measure() -> dict:
    """Loops beside the motion alone, their gradients, steps of an environment, the first call."""
    rows = {**_loops(None), **_loops(256), **_episodes()}
    bare = {k: v for k, v in os.environ.items() if not k.startswith("JAX_")}
    call = [sys.executable, "-c", FIRST]
    seconds = [
        float(subprocess.run(call, env=bare, capture_output=True, text=True, check=True).stdout)
        for _ in range(3)
    ]
    rows["first loop of a new process"] = {"first_call_seconds": float(np.median(seconds))}
    return rows
