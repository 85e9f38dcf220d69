"""Environment steps compared with MuJoCo's JAX engine (MJX): 1024 free bodies with three different
moments of inertia that tumble at a few radians per second, for one second from the identity
attitude, in single precision. A run is one body for one second; each row states the step size.
Errors are with respect to an adaptive integration in double precision at 1e-12. An engine for
contacts and joints computes more than a free body needs, and MJX is designed for GPUs and TPUs: the
table shows the cost of a step for this task, which is not its intended use."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxspace import Accuracy, BodyState, Scene, simulate_batch
from jaxspace.bodies import RigidBody
from jaxspace.control import CommandedTorque, step
from jaxspace.rotations import Quaternion
from jaxspace.solvers import DOP853, FixedSteps, Tsit5

from ._measure import WIDE, in_turn, on_one_device, optional, with_errors_of_rotation

RUNS, SPAN, MOMENTS = 1024, 1.0, (1.0, 1.5, 2.0)
MODEL = """<mujoco><option gravity="0 0 0" integrator="{}"/><worldbody><body><freejoint/>
<inertial pos="0 0 0" mass="1" diaginertia="{} {} {}"/></body></worldbody></mujoco>"""


def scene(dtype: Any = float) -> Scene:
    """A free body, with its numbers in the precision."""
    whole = Scene([CommandedTorque()], RigidBody(inertia=MOMENTS))
    return jax.tree.map(lambda x: jnp.asarray(x, dtype), whole)


def starts(dtype: Any = float) -> BodyState:
    """The bodies, at rates of single precision."""
    rate = jax.random.normal(jax.random.key(0), (3, RUNS)).astype(jnp.float32)
    attitude = jnp.zeros((4, RUNS), dtype).at[0].set(1.0)
    return BodyState(attitude=Quaternion(attitude), omega=rate.astype(dtype))


def moved(y: BodyState, h: jax.Array, count: Any) -> jax.Array:
    """Rates and quaternions after as many steps of the length `h`, s."""
    body, method = scene(h.dtype), FixedSteps(Tsit5(), 1)
    y = jax.lax.fori_loop(0, count, lambda _, y: step(body, y, None, h, method=method), y)
    return jnp.concatenate([y.omega, y.attitude.wxyz])


def exact(y0: BodyState) -> jax.Array:
    """The same after the whole time, in adaptive steps."""
    accuracy = Accuracy(1e-12, method=DOP853())
    end = simulate_batch(scene(), y0, jnp.array([0.0, SPAN]), accuracy=accuracy).final
    return jnp.concatenate([end.omega, end.attitude.wxyz])


def _ours(y0: BodyState, length: float) -> Callable[[], Any]:
    assert y0.omega is not None
    h = jnp.asarray(length, y0.omega.dtype)
    compiled = jax.jit(moved, compiler_options=WIDE)
    return lambda: compiled(y0, h, round(SPAN / length))


def _mjx(rate: jax.Array, lengths: dict[str, tuple[float, ...]]) -> dict[str, Callable[[], Any]]:
    """One program for each integrator: the length of a step and their count are its arguments."""
    import mujoco
    from mujoco import mjx

    calls = {}
    for name, each in lengths.items():
        # Its arrays have the precision of the process, and not that of what they meet.
        with jax.enable_x64(False):
            model = mjx.put_model(mujoco.MjModel.from_xml_string(MODEL.format(name, *MOMENTS)))
            start = mjx.make_data(model)
        speeds = jnp.concatenate([jnp.zeros((3, RUNS), rate.dtype), rate]).T

        def fly(speeds, h, count, model=model, start=start):
            held = model.replace(opt=model.opt.replace(timestep=h))

            def one(speed):
                data = start.replace(qvel=speed)
                data = jax.lax.fori_loop(0, count, lambda _, d: mjx.step(held, d), data)
                return jnp.concatenate([data.qvel[3:], data.qpos[3:]])

            return jax.vmap(one)(speeds).T

        compiled = jax.jit(fly, compiler_options=WIDE)

        def call(h, compiled=compiled, speeds=speeds):
            with jax.enable_x64(False):
                return compiled(speeds, np.float32(h), round(SPAN / h))

        calls |= {f"MJX, {name}, {h:g} s": lambda h=h, call=call: call(h) for h in each}
    return calls


def measure() -> dict:
    """Bodies moved by one second in a second, and their errors."""
    single, reference = on_one_device(starts(jnp.float32)), np.asarray(exact(starts()))
    calls = {f"ours, Tsit5, {h:g} s": _ours(single, h) for h in (0.05, 0.1, 0.25)}
    if optional("mujoco") is not None:
        calls |= _mjx(single.omega, {"RK4": (0.01, 0.05, 0.1), "Euler": (0.002,)})
    return with_errors_of_rotation(in_turn(calls, RUNS), calls, reference)
