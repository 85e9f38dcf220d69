"""An asymmetric body that tumbles in a low orbit at twenty times the orbit's rate, turned by the
gravity gradient, over some hundred precessions: stepping orbit and rotation together, and exact
motions with kicks, beside heyoka's Taylor method."""

from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxspace import BodyState, Scene
from jaxspace.attitude import GravityGradient
from jaxspace.bodies import RigidBody
from jaxspace.orbits import PointGravity
from jaxspace.rotations import Quaternion
from jaxspace.simulation import Accuracy, simulate_batch
from jaxspace.solvers import DOP853, Splitting

from . import free_body, low_orbits
from ._measure import heyoka_ends, in_turn, on_one_device, optional, with_errors_of_rotation

RUNS, RATE = free_body.RUNS, 20.0
SPAN, MOMENTS = free_body.SPAN / RATE, free_body.MOMENTS
SCENE = Scene((PointGravity(1.0), GravityGradient(1.0)), RigidBody(inertia=MOMENTS))


def starts() -> np.ndarray:
    """Low orbits, and attitudes of every kind: position, velocity, omega, attitude, (13, runs). The
    axis of rotation lies within 27 degrees of that of the least or of the greatest moment: near the
    middle one the motion is chaotic."""
    y, body, runs = low_orbits.orbits(), free_body.starts(), np.arange(RUNS)
    omega, outer = body[:3], 2 * (runs % 2)
    omega[1] *= 0.5
    omega[outer, runs] += 2.0 * np.sign(omega[outer, runs])
    omega *= RATE / np.linalg.norm(omega, axis=0)
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
    """Error of rate and attitude, and speed, of every method."""
    start = starts()
    r, v, omega, q = (
        jnp.asarray(start[k]) for k in (slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 13))
    )
    y0, ts = on_one_device(BodyState(r, v, Quaternion(q), omega)), jnp.array([0.0, SPAN])

    def ours(rtol: float, method: Any):
        accuracy = Accuracy(rtol=rtol, method=method)
        final = simulate_batch(SCENE, y0, ts, accuracy=accuracy).final
        return jnp.concatenate([final.omega, final.attitude.wxyz])

    calls = {
        f"ours, DOP853 {rtol:.0e}": lambda rtol=rtol: ours(rtol, DOP853())
        for rtol in (1e-7, 1e-8, 1e-9, 1e-10)
    }
    calls["ours, Splitting of order 4, 1200 steps"] = lambda: ours(
        1e-3, Splitting(4, steps=1200, estimate=False)
    )
    if optional("heyoka") is not None:
        for tolerance in (1e-6, 1e-8, 1e-10, 1e-11):
            ends = heyoka_ends(equations, start, SPAN, tolerance)
            calls[f"heyoka, vectors of 8, {tolerance:.0e}"] = lambda ends=ends: ends()[6:].copy()
        reference = heyoka_ends(equations, start, SPAN, 1e-18)()[6:].copy()
    else:
        reference = ours(1e-13, DOP853())
    return with_errors_of_rotation(in_turn(calls, RUNS), calls, np.asarray(reference))
