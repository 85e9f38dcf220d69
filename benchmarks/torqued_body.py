"""An asymmetric body tumbling in a low orbit under the gravity-gradient torque, over some hundred
precessions: integration of orbit and rotation together, exact motions with kicks, steps on the
rotation group, and heyoka's Taylor method. The body rotates first at twenty times the orbital rate,
where the torque is one hundredth of the gyroscopic torque and every turn needs several kicks, then
at 2e5 times the orbital rate, where steps may span several turns. The last rows are the costs of
one evaluation of the equations, one kick, and one exact motion. An exact motion costs as much as
tens of evaluations: the splitting is faster only if its number of kicks is smaller than the number
of evaluations of DOP853 by more than this factor, whatever its coefficients are."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxspace import BodyState, Scene
from jaxspace.attitude import GravityGradient
from jaxspace.bodies import RigidBody
from jaxspace.orbits import PointGravity
from jaxspace.rotations import Quaternion
from jaxspace.simulation import Accuracy, simulate_batch
from jaxspace.solvers import DOP853, MuntheKaas, Splitting

from . import free_body, low_orbits
from ._measure import WIDE, heyoka_ends, in_turn, on_one_device, optional, with_errors_of_rotation

RUNS, MOMENTS, RATE, FAST = free_body.RUNS, free_body.MOMENTS, 20.0, 2e5
REPEATED = 200
SCENE = Scene((PointGravity(1.0), GravityGradient(1.0)), RigidBody(inertia=MOMENTS))


def starts(rate: float) -> np.ndarray:
    """Low orbits, and attitudes of every kind: position, velocity, omega, attitude, (13, runs). The
    axis of rotation lies within 27 degrees of that of the least or of the greatest moment: near the
    middle one the motion is chaotic."""
    y, body, runs = low_orbits.orbits(), free_body.starts(), np.arange(RUNS)
    omega, outer = body[:3], 2 * (runs % 2)
    omega[1] *= 0.5
    omega[outer, runs] += 2.0 * np.sign(omega[outer, runs])
    omega *= rate / np.linalg.norm(omega, axis=0)
    return np.concatenate([y.position[:, :RUNS], y.velocity[:, :RUNS], omega, body[3:]])


def equations(heyoka):
    """The same motion in heyoka's symbols."""
    x, y, z, vx, vy, vz = heyoka.make_vars("x", "y", "z", "vx", "vy", "vz")
    free = free_body.equations(heyoka)
    q0, q1, q2, q3 = (name for name, _ in free[3:])
    pull = (x**2 + y**2 + z**2) ** (-1.5)
    square = pull / (x**2 + y**2 + z**2)
    # r in body axes: r + 2 u x (u x r - q0 r)
    c = [q2 * z - q3 * y - q0 * x, q3 * x - q1 * z - q0 * y, q1 * y - q2 * x - q0 * z]
    b = [
        x + 2.0 * (q2 * c[2] - q3 * c[1]),
        y + 2.0 * (q3 * c[0] - q1 * c[2]),
        z + 2.0 * (q1 * c[1] - q2 * c[0]),
    ]
    i1, i2, i3 = MOMENTS
    torque = [
        (i3 - i2) / i1 * b[1] * b[2],
        (i1 - i3) / i2 * b[2] * b[0],
        (i2 - i1) / i3 * b[0] * b[1],
    ]
    euler = [
        (name, rate + 3.0 * square * m) for (name, rate), m in zip(free[:3], torque, strict=True)
    ]
    return [
        (x, vx),
        (y, vy),
        (z, vz),
        (vx, -x * pull),
        (vy, -y * pull),
        (vz, -z * pull),
        *euler,
        *free[3:],
    ]


def measure() -> dict:
    """Error of rate and attitude, and speed, of every method; then the costs."""
    rows = with_torque() | almost_free()
    start = _state(starts(RATE))
    split = SCENE.split()
    assert split is not None
    work = {
        "one evaluation": lambda y: jax.tree.map(
            lambda x, k: x + 1e-9 * k, y, SCENE.vector_field(jnp.zeros(()), y)
        ),
        "one kick": lambda y: split.kick(jnp.zeros(()), 1e-9, y),
        "one exact motion": lambda y: split.drift(1e-3, y),
    }
    calls = {name: _repeated(step, start) for name, step in work.items()}
    for name, row in in_turn(calls, REPEATED * RUNS).items():
        rows[name] = {"nanoseconds": 1e9 / row["runs_per_cpu_second"]}
    return rows


def with_torque() -> dict:
    """At the rate at which the torque is felt in every turn."""
    start, span = starts(RATE), free_body.SPAN / RATE
    calls = _ours(
        *(start, span, ""),
        {
            **{f"DOP853 {rtol:.0e}": (rtol, DOP853()) for rtol in (1e-7, 1e-8, 1e-9)},
            **{f"Munthe-Kaas {rtol:.0e}": (rtol, MuntheKaas()) for rtol in (1e-7, 1e-8)},
            "Splitting of order 4, 1200 steps": _split(4, 1200),
            "Splitting of order (8, 2), 640 steps": _split((8, 2), 640),
            "Splitting of order (8, 6, 4), 640 steps": _split((8, 6, 4), 640),
            "Splitting of order (8, 6, 4), 960 steps": _split((8, 6, 4), 960),
        },
    )
    if optional("heyoka") is not None:
        for tolerance in (1e-6, 1e-8, 1e-10, 1e-11):
            ends = heyoka_ends(equations, start, span, tolerance)
            calls[f"heyoka, vectors of 8, {tolerance:.0e}"] = lambda ends=ends: ends()[6:].copy()
        reference = heyoka_ends(equations, start, span, 1e-18)()[6:].copy()
    else:
        reference = _run(start, span, 1e-13, DOP853())
    return with_errors_of_rotation(in_turn(calls, RUNS), calls, np.asarray(reference))


def almost_free() -> dict:
    """At the rate at which the torque is one part in 1e10."""
    start, span = starts(FAST), free_body.SPAN / FAST
    calls = _ours(
        *(start, span, "fast: "),
        {
            **{f"DOP853 {rtol:.0e}": (rtol, DOP853()) for rtol in (1e-7, 1e-8)},
            "Splitting of order (8, 2), 6 steps": _split((8, 2), 6),
            "Splitting of order (8, 2), 160 steps": _split((8, 2), 160),
        },
    )
    reference = _run(start, span, *_split((8, 6, 4), 640))
    return with_errors_of_rotation(in_turn(calls, RUNS), calls, np.asarray(reference))


def _split(order: Any, steps: int) -> tuple[float, Any]:
    return 1e-3, Splitting(order, steps=steps, estimate=False)


def _state(start: np.ndarray) -> BodyState:
    r, v, omega, q = (
        jnp.asarray(start[k]) for k in (slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 13))
    )
    return on_one_device(BodyState(r, v, Quaternion(q), omega))


def _run(start: np.ndarray, span: float, rtol: float, method: Any):
    accuracy = Accuracy(rtol=rtol, method=method)
    final = simulate_batch(SCENE, _state(start), jnp.array([0.0, span]), accuracy=accuracy).final
    return jnp.concatenate([final.omega, final.attitude.wxyz])


def _ours(start: np.ndarray, span: float, before: str, methods: dict) -> dict:
    return {
        f"{before}ours, {name}": lambda how=how: _run(start, span, *how)
        for name, how in methods.items()
    }


def _repeated(step: Any, y: BodyState) -> Any:
    """A call that takes the step so many times, compiled as a batch is."""

    def again(n, y):
        del n
        return jax.lax.optimization_barrier(step(y))

    call = jax.jit(lambda y: jax.lax.fori_loop(0, REPEATED, again, y), compiler_options=WIDE)
    return lambda: call(y)
