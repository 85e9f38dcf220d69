"""One day of low orbits under oblateness: this library's DOP853 on a batch side by side against diffrax's Dopri8 mapped over
the runs, at tolerances that give about the same error, interleaved in one process."""

import time

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxspace import BodyState, Scene
from jaxspace.orbits import ClassicalElements, Oblateness, PointGravity, state_from_elements
from jaxspace.simulation import Accuracy, simulate_batch

RUNS, DAY, REPEATS = 512, 86400.0 / 806.8110, 5
SCENE = Scene((PointGravity(1.0), Oblateness(1.0, 1.08262668e-3, 1.0)))


def orbits():
    """Low, nearly circular orbits of every inclination; earth radius and gravitational parameter 1."""
    g = np.random.default_rng(0)
    a, e = 1.0 + g.uniform(400.0, 1200.0, RUNS) / 6378.137, g.uniform(0.0, 0.02, RUNS)
    i, (node, periapsis, anomaly) = np.arccos(g.uniform(-1.0, 1.0, RUNS)), g.uniform(0.0, 2.0 * np.pi, (3, RUNS))
    elements = ClassicalElements(*(jnp.asarray(x) for x in (a * (1.0 - e**2), e, i, node, periapsis, anomaly)))
    r, v = state_from_elements(elements, 1.0)
    return BodyState(jnp.moveaxis(r, -1, 0), jnp.moveaxis(v, -1, 0))


def mapped(y0, rtol):
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

    return jax.tree.map(lambda x: x[:, 0], jax.vmap(one)(y0))


def measure():
    """Runs per second and worst relative error of both, and the ratio, medians of interleaved repeats."""
    y0 = orbits()
    ts = jnp.array([0.0, DAY])
    ours = lambda rtol: simulate_batch(SCENE, y0, ts, accuracy=Accuracy(rtol=rtol), in_axes=(None, 0)).final  # noqa: E731
    theirs = eqx.filter_jit(mapped)
    reference = ours(1e-13).position
    calls = {"ours": lambda: ours(1e-9), "diffrax mapped": lambda: theirs(y0, 1e-10)}
    seen = {name: {"error": worst(call().position, reference), "seconds": []} for name, call in calls.items()}
    for _ in range(REPEATS):
        for name, call in calls.items():
            start = time.perf_counter()
            jax.block_until_ready(call())
            seen[name]["seconds"].append(time.perf_counter() - start)
    rates = {name: RUNS / float(np.median(s["seconds"])) for name, s in seen.items()}
    found = {f"{name}, worst relative error": s["error"] for name, s in seen.items()}
    found |= {f"{name}, runs per second": rate for name, rate in rates.items()}
    return found | {"ratio": rates["ours"] / rates["diffrax mapped"]}


def worst(a, b):
    """The largest relative difference of the positions of all runs."""
    return float(np.max(np.linalg.norm(a - b, axis=1) / np.linalg.norm(b, axis=1)))
