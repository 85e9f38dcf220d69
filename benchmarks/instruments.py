"""Instruments and mechanics: a gyrocompass released for one minute, 1e5 radians of its nutation, by
DOP853 and by the default method, at two tolerances; the gimbal walk over 1e5 nutations; a pendulum
of four links by its Lagrangian and by explicit equations; and runs in single precision."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxspace import simulate
from jaxspace.core import AbstractSystem
from jaxspace.gyros import Gyrocompass, TwoGimbalGyro
from jaxspace.mechanics import DoublePendulum, GeneralisedState, Lagrangian
from jaxspace.simulation import Accuracy, simulate_batch
from jaxspace.solvers import DOP853

from ._measure import in_turn, on_one_device, worst

LINKS, RUNS, STEPS = 4, 256, 2**22


def _compass() -> dict:
    compass = Gyrocompass(339.0, 0.2, 0.2, 8.5, 0.8, damping_moment=0.17)
    y0, ts = compass.state(0.0, 0.3), jnp.array([0.0, 60.0])

    def end(rtol: float, **how: Any) -> Array:
        y = simulate(compass, y0, ts, accuracy=Accuracy(rtol, max_steps=STEPS, **how)).final
        return jnp.stack([y.azimuth, y.tilt])

    calls = {}
    for rtol in (1e-8, 1e-9):
        calls[f"gyrocompass: DOP853 {rtol:.0e}"] = lambda r=rtol: end(r, method=DOP853())
        calls[f"gyrocompass: by default, {rtol:.0e}"] = lambda r=rtol: end(r)
    reference, rows = end(1e-13, method=DOP853()), in_turn(calls, 1)
    for name, call in calls.items():
        rows[name]["error_of_the_worst_run"] = worst(call(), reference)
    return rows


def _walk() -> dict:
    """The drift of the outer gimbal, of its own size, against the quadrature."""
    gyro = TwoGimbalGyro(0.002, 0.0008, 500.0, 0.0006, 0.0005, 0.0004, 0.0015)
    walk = gyro.walk(1.0471975511965976, 2.0)
    span, y0 = 1e5 * walk.period, gyro.state(1.0471975511965976, 0.0, 2.0, 0.0)

    def drift() -> Array:
        accuracy = Accuracy(1e-12, max_steps=STEPS, method=DOP853())
        return simulate(gyro, y0, jnp.stack([0.0, span]), accuracy=accuracy).final.psi / span

    rows = in_turn({"gimbal walk, 1e5 nutations: DOP853 1e-12": drift}, 1, repeats=1)
    for row in rows.values():
        row["error_of_the_worst_run"] = abs(float(drift() / walk.drift) - 1.0)
    return rows


class Chain(AbstractSystem):
    """A pendulum of four equal links in a plane, its equations written by hand."""

    def vector_field(self, t: Any, y: GeneralisedState) -> GeneralisedState:
        q, v = y.coordinates, y.rates
        below = LINKS - np.maximum.outer(np.arange(LINKS), np.arange(LINKS))
        below = below[..., None].astype(float)
        turned = q[:, None] - q[None]
        mass = below * jnp.cos(turned)
        force = -jnp.sum(below * jnp.sin(turned) * v[None] ** 2, axis=1)
        force = force - 9.8 * (LINKS - np.arange(LINKS))[:, None] * jnp.sin(q)
        # Gauss for all runs at once.
        rows = [jnp.concatenate([mass[i], force[i][None]]) for i in range(LINKS)]
        for i in range(LINKS):
            rows[i] = rows[i] / rows[i][i]
            for j in range(LINKS):
                if j != i:
                    rows[j] = rows[j] - rows[j][i] * rows[i]
        return GeneralisedState(v, jnp.stack([row[-1] for row in rows]))

    def invariants(self, t: Any, y: GeneralisedState) -> dict[str, Array]:
        return {}


def _lagrangian(t: Any, q: Array, v: Array, p: Any) -> Array:
    x, z = jnp.cumsum(jnp.cos(q) * v, axis=0), jnp.cumsum(jnp.sin(q) * v, axis=0)
    height = -jnp.cumsum(jnp.cos(q), axis=0)
    return jnp.sum(0.5 * (x * x + z * z) - 9.8 * height, axis=0)


def _chains() -> dict:
    q = jnp.asarray(np.random.default_rng(0).uniform(-0.5, 0.5, (LINKS, RUNS)))
    y0, ts = on_one_device(GeneralisedState(q, 0.0 * q)), jnp.array([0.0, 2.0])
    systems = {
        "four links: by hand": Chain(),
        "four links: Lagrangian": Lagrangian(_lagrangian, tuple("abcd")),
    }
    calls = {
        name: lambda s=s: (
            simulate_batch(s, y0, ts, accuracy=Accuracy(1e-9, method=DOP853())).final.coordinates
        )
        for name, s in systems.items()
    }
    reference, rows = next(iter(calls.values()))(), in_turn(calls, RUNS)
    for name, call in calls.items():
        rows[name]["error_of_the_worst_run"] = worst(call(), reference)
    return rows


def _single() -> dict:
    """Runs in single precision, against double."""
    compass = Gyrocompass(339.0, 0.2, 0.2, 8.5, 0.8, damping_moment=0.17)
    double = DoublePendulum(2.0, 1.0, 1.0, 0.8, 9.8)
    gyro = TwoGimbalGyro(0.002, 0.0008, 500.0, 0.0006, 0.0005, 0.0004, 0.0015)
    cases = {
        "gyrocompass, 60 s": (compass, compass.state(0.0, 0.3), 60.0, lambda y: y.azimuth),
        "double pendulum, 2 s": (double, double.state(0.6, 0.5), 2.0, lambda y: y.coordinates),
        "two-gimbal gyro, 1 s": (gyro, gyro.state(1.05, 0.0, 2.0, 0.0), 1.0, lambda y: y.theta),
    }

    def end(case: Any, kind: Any, rtol: float) -> Array:
        system, y0, span, read = jax.tree.map(
            lambda x: x.astype(kind) if isinstance(x, jax.Array) else x, case
        )
        ts = jnp.array([0.0, span], kind)
        return read(simulate(system, y0, ts, accuracy=Accuracy(rtol, max_steps=STEPS)).final)

    calls = {f"float32, {name}": lambda c=c: end(c, jnp.float32, 1e-5) for name, c in cases.items()}
    rows = in_turn(calls, 1)
    for (name, call), case in zip(calls.items(), cases.values(), strict=True):
        reference = jnp.atleast_1d(end(case, jnp.float64, 1e-12))
        rows[name]["error_of_the_worst_run"] = worst(
            jnp.atleast_1d(call()).astype(float), reference
        )
    return rows


def measure() -> dict:
    """Speed and error of every method on every case."""
    rows = {}
    for case in (_compass, _chains, _walk, _single):
        jax.clear_caches()
        rows |= case()
    return rows
