"""One day of low orbits under oblateness (15 revolutions). jaxspace and heyoka compute batches,
diffrax and astrojax are mapped over the runs, and SciPy computes the first few runs, one at a
time."""

import math
from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxspace import BodyState, Scene
from jaxspace.orbits import ClassicalElements, Oblateness, PointGravity
from jaxspace.orbits.elements import state_from_elements
from jaxspace.simulation import Accuracy, simulate_batch
from jaxspace.solvers import DOP853, RKN1210, Stormer

from ._measure import heyoka_ends, in_turn, oblate_orbit, on_one_device, optional, worst

RUNS, ALONE, DAY, J2 = 2048, 8, 86400.0 / 806.8110, 1.08262668e-3
SCENE = Scene((PointGravity(1.0), Oblateness(1.0, J2, 1.0)))


def orbits() -> BodyState:
    """Low, nearly circular orbits of every inclination; earth radius and gravitational parameter
    1."""
    g = np.random.default_rng(0)
    a, e = 1.0 + g.uniform(400.0, 1200.0, RUNS) / 6378.137, g.uniform(0.0, 0.02, RUNS)
    i, (node, periapsis, anomaly) = (
        np.arccos(g.uniform(-1.0, 1.0, RUNS)),
        g.uniform(0.0, 2.0 * np.pi, (3, RUNS)),
    )
    elements = ClassicalElements(
        *(jnp.asarray(x) for x in (a * (1.0 - e**2), e, i, node, periapsis, anomaly))
    )
    return BodyState(*state_from_elements(elements, 1.0))


def mapped(y0: BodyState, rtol: float) -> BodyState:
    """The same by diffrax alone, one solve for each run under `vmap`."""

    def one(y):
        return diffrax.diffeqsolve(
            diffrax.ODETerm(lambda t, y, args: SCENE.vector_field(t, y)),
            diffrax.Dopri8(),
            0.0,
            DAY,
            None,
            y,
            stepsize_controller=diffrax.PIDController(rtol=rtol, atol=rtol),
            max_steps=16384,
        ).ys

    return jax.tree.map(lambda x: x[0], jax.vmap(one, in_axes=-1, out_axes=-1)(y0))


def by_astrojax(astrojax, y0: BodyState, tolerance: float):
    """The same by astrojax's step of order 12 in a loop for each run under `vmap`: a call that
    gives the positions."""
    from astrojax.config import set_dtype
    from astrojax.integrators import rkn1210_step
    from astrojax.integrators.types import AdaptiveConfig

    set_dtype(jnp.float64)
    config = AdaptiveConfig(abs_tol=tolerance, rel_tol=tolerance)

    def rate(t, y):
        r, v = y[:3], y[3:]
        k = SCENE.vector_field(t, BodyState(r, v))
        return jnp.concatenate([k.position, k.velocity])

    def one(y):
        def step(carry):
            t, y, h = carry
            done = rkn1210_step(rate, t, y, jnp.minimum(h, DAY - t), config)
            return t + done.dt_used, done.state, done.dt_next

        return jax.lax.while_loop(lambda c: c[0] < DAY * (1.0 - 1e-14), step, (0.0, y, 0.05))[1]

    program = jax.jit(jax.vmap(one, in_axes=-1, out_axes=-1))
    start = jnp.concatenate([y0.position, y0.velocity])
    return lambda: program(start)[:3]


def by_scipy(states: np.ndarray, method: str, rtol: float):
    """The first few runs by scipy, its field written in plain numbers: a call that gives the
    positions."""
    from scipy.integrate import solve_ivp

    def rate(t, y):
        x, y, z, vx, vy, vz = y.tolist()
        r2 = x * x + y * y + z * z
        pull, c, s = 1.0 / (r2 * math.sqrt(r2)), 1.5 * J2 / r2, 5.0 * z * z / r2
        a = -pull * (1.0 + c * (1.0 - s))
        return (vx, vy, vz, x * a, y * a, -z * pull * (1.0 + c * (3.0 - s)))

    def end(y):
        return solve_ivp(rate, (0.0, DAY), y, method=method, rtol=rtol, atol=1e-3 * rtol).y[:3, -1]

    return lambda: np.stack([end(y) for y in states[:, :ALONE].T], axis=-1)


def equations(heyoka):
    """The same motion in heyoka's symbols."""
    return oblate_orbit(heyoka, J2)


def measure() -> dict:
    """Error and speed of every method."""
    y0, ts = orbits(), jnp.array([0.0, DAY])
    alone = on_one_device(y0)

    def ours(rtol, method: Any = DOP853(), y0=alone):  # noqa: B008
        accuracy = Accuracy(rtol=rtol, method=method)
        return simulate_batch(SCENE, y0, ts, accuracy=accuracy).final.position

    theirs = eqx.filter_jit(mapped)
    calls = {
        f"ours, DOP853 {rtol:.0e}": lambda rtol=rtol: ours(rtol) for rtol in (1e-6, 1e-9, 1e-11)
    }
    calls |= {
        f"ours, RKN 12(10) {rtol:.0e}": lambda rtol=rtol: ours(rtol, RKN1210())
        for rtol in (1e-7, 1e-9, 1e-11)
    }
    calls |= {
        f"ours, Stormer of order {m.k}, {m.steps} steps": lambda rtol=rtol, m=m: ours(rtol, m)
        for rtol, m in ((1e-5, Stormer(10, steps=850)), (1e-8, Stormer(12, steps=1310)))
    }
    calls |= {"diffrax Dopri8 under vmap 1e-10": lambda: theirs(y0, 1e-10).position}
    if (astrojax := optional("astrojax")) is not None:
        calls |= {"astrojax RKN 12(10) under vmap 1e-10": by_astrojax(astrojax, alone, 1e-10)}
    states = np.concatenate([y0.position, y0.velocity])
    if optional("scipy") is not None:
        for method, rtol in (("DOP853", 1e-9), ("LSODA", 1e-10)):
            calls[f"scipy {method}, one by one, {rtol:.0e}"] = by_scipy(states, method, rtol)
    if optional("heyoka") is not None:
        for tolerance in (1e-7, 4e-11):
            ends = heyoka_ends(equations, states, DAY, tolerance)
            calls[f"heyoka, vectors of 8, {tolerance:.0e}"] = lambda ends=ends: ends()[:3].copy()
        reference = heyoka_ends(equations, states, DAY, 1e-18)()[:3].copy()
    else:
        reference = ours(1e-12, RKN1210())
    rows = in_turn(calls, {name: ALONE if name.startswith("scipy") else RUNS for name in calls})
    for name, call in calls.items():
        found = call()
        rows[name]["worst_relative_error"] = worst(found, reference[:, : found.shape[1]])
    return rows | _scaling(ours, y0)


def _scaling(ours, y0: BodyState) -> dict:
    """Many runs on one device and on all."""
    if len(jax.devices()) == 1:
        return {}
    many = jax.tree.map(lambda x: jnp.tile(x, (1, 8)), y0)
    one = on_one_device(many)
    calls = {
        f"Stormer of order 12, {8 * RUNS} runs on {where}": lambda y=y: ours(
            1e-8, Stormer(12, steps=1310), y
        )
        for where, y in (("one device", one), ("all devices", many))
    }
    return in_turn(calls, 8 * RUNS)
