"""A million states on ellipses and hyperbolas moved along by the closed form, with the error of a sample against forty digits,
and that of a sample of strong hyperbolas; beside pykep on one core, called from prepared lists with its results dropped.

In blocks: a thousand states at a time, arrays (blocks, 3, 1024). Ours give the whole state, as pykep does; pykep moves the first
2^16 states only, and has its own process."""

import subprocess
import sys
import tempfile
from pathlib import Path

import jax
import jax.numpy as jnp
import mpmath
import numpy as np

from jaxspace.orbits import ClassicalElements, kepler_flow, state_from_elements

from ._measure import in_turn

STATES, BLOCK, PEERS, CHECKED = 2**20, 1024, 2**16, 200
WIDE = {"xla_cpu_prefer_vector_width": "512"}


def states():
    """Three fifths ellipses up to e = 0.95, two fifths hyperbolas from 1.05 to 4, anywhere on the orbit; centre of strength 1."""
    g = np.random.default_rng(1)
    e = np.where(g.uniform(size=STATES) < 0.4, g.uniform(1.05, 4.0, STATES), g.uniform(0.0, 0.95, STATES))
    p = g.uniform(0.5, 2.0, STATES) * (1.0 + e)
    furthest = np.where(e > 1.0, 0.8 * np.arccos(-1.0 / np.maximum(e, 1.0)), np.pi)
    anomaly = g.uniform(-1.0, 1.0, STATES) * furthest
    i, (node, periapsis) = np.arccos(g.uniform(-1.0, 1.0, STATES)), g.uniform(0.0, 2.0 * np.pi, (2, STATES))
    r, v = state_from_elements(ClassicalElements(*map(jnp.asarray, (p, e, i, node, periapsis, anomaly))), 1.0)
    return r, v, jnp.asarray(g.uniform(-10.0, 10.0, STATES))


def exact(r, v, t):
    """The position after the time `t` in forty digits, by Kepler's equation in the universal anomaly."""
    with mpmath.workdps(40):
        r, v, t = [mpmath.mpf(float(x)) for x in r], [mpmath.mpf(float(x)) for x in v], mpmath.mpf(float(t))
        size, sigma = mpmath.sqrt(mpmath.fdot(r, r)), mpmath.fdot(r, v)
        beta = 2 / size - mpmath.fdot(v, v)
        root = mpmath.sqrt(beta)  # imaginary on a hyperbola: the functions below are real all the same

        def g(x):
            c, s = mpmath.re(mpmath.cos(root * x)), mpmath.re(mpmath.sin(root * x) / root)
            return s, (1 - c) / mpmath.re(root**2), (x - s) / mpmath.re(root**2)

        def late(x):
            g1, g2, g3 = g(x)
            return size * g1 + sigma * g2 + g3 - t

        low, high = mpmath.mpf(-1), mpmath.mpf(1)
        while late(low) > 0:
            low *= 2
        while late(high) < 0:
            high *= 2
        x = mpmath.findroot(late, (low, high), solver="anderson", tol=1e-60, maxsteps=500, verify=False)
        _, g2, g3 = g(x)
        return np.array([float((1 - g2 / size) * a + (t - g3) * b) for a, b in zip(r, v, strict=True)])


def strong_hyperbolas():
    """Eccentricities from 1.001 to 1000, from and to anywhere on the way."""
    g = np.random.default_rng(2)
    e, f = 1.0 + 10.0 ** g.uniform(-3.0, 3.0, CHECKED), g.uniform(-0.98, 0.98, CHECKED)
    p, f = 1.0 + e, f * np.arccos(-1.0 / e)
    level, size = np.zeros(CHECKED), p / (1.0 + e * np.cos(f))
    r, v = state_from_elements(ClassicalElements(*map(jnp.asarray, (p, e, level, level, level, f))), 1.0)
    return r, v, jnp.asarray(size * np.sqrt(size) * 10.0 ** g.uniform(-3.0, 2.0, CHECKED) * g.choice([-1.0, 1.0], CHECKED))


def error(found, expected) -> float:
    """The worst relative error of positions (3, CHECKED)."""
    found = np.asarray(found)[:, :CHECKED]
    return float(np.max(np.linalg.norm(found - expected, axis=0) / np.linalg.norm(expected, axis=0)))


def pykep_moves(start) -> dict | None:
    """Seconds of repeats, and positions, of pykep; `None`, with a sentence, where it does not run."""
    with tempfile.TemporaryDirectory() as folder:
        states, results = Path(folder) / "states.npz", Path(folder) / "results.npz"
        np.savez(states, **dict(zip("rvt", map(np.asarray, start), strict=True)))
        script = Path(__file__).parent / "_pykep.py"
        child = subprocess.run([sys.executable, str(script), str(states), str(results)], capture_output=True, text=True)
        if not results.exists():
            print(f"pykep does not run, so that it has no row: {child.stderr.strip().splitlines()[-1]}", file=sys.stderr)
            return None
        return dict(np.load(results))


def in_blocks(start):
    """The states in blocks, a call that moves them on one device, and one that shares them out among all."""
    blocks = tuple(jnp.moveaxis(x.reshape(*x.shape[:-1], -1, BLOCK), -2, 0).copy() for x in start)
    mesh = jax.make_mesh((len(jax.devices()),), ("runs",))
    spread = jax.sharding.PartitionSpec("runs")
    shared = jax.device_put(blocks, jax.sharding.NamedSharding(mesh, spread))

    def move(blocks):
        return jax.lax.map(lambda block: kepler_flow(*block, 1.0), blocks)

    alone = jax.jit(move, compiler_options=WIDE)
    together = jax.jit(
        jax.shard_map(move, mesh=mesh, in_specs=(spread,), out_specs=spread, check_vma=False), compiler_options=WIDE
    )
    return lambda: alone(blocks), lambda: together(shared)


def measure() -> dict:
    """States per second of the flow, of its reverse mode and of the peer, and the worst relative error of the samples."""
    r, v, t = states()
    flow = jax.jit(lambda r, v, t: kepler_flow(r, v, t, 1.0))
    slope = jax.jit(jax.grad(lambda r, v, t: jnp.sum(kepler_flow(r, v, t, 1.0)[0][0])))
    alone, together = in_blocks((r, v, t))
    calls = {
        "ours, one array": lambda: flow(r, v, t),
        "ours, one array, with reverse mode": lambda: slope(r, v, t),
        "ours, in blocks": alone,
        "ours, in blocks on every core": together,
    }
    seen, strong = in_turn(calls, STATES), strong_hyperbolas()
    found = {
        "ours, one array": (flow(r, v, t)[0], flow(*strong)[0]),
        "ours, in blocks on every core": (np.asarray(together()[0])[0],),
    }
    some = tuple(x[..., :PEERS] for x in (r, v, t))
    if peer := pykep_moves(tuple(jnp.concatenate(pair, axis=-1) for pair in zip(some, strong, strict=True))):
        wall, cpu = np.median(peer["seconds"], axis=0)
        runs, positions = PEERS + CHECKED, peer["positions"]
        seen["pykep"] = {"runs_per_second": runs / wall, "runs_per_cpu_second": runs / cpu, "cores": cpu / wall}
        found["pykep"] = (positions, positions[:, PEERS:])
    for which, (column, start) in enumerate((("worst_position_error", (r, v, t)), ("of_strong_hyperbolas", strong))):
        first = [np.asarray(x[..., :CHECKED]) for x in start]
        expected = np.stack([exact(*(x[..., k] for x in first)) for k in range(CHECKED)], axis=1)
        for name, positions in found.items():
            if which < len(positions):
                seen[name][column] = error(positions[which], expected)
    seen["ours, one array, with reverse mode"]["times_the_run"] = (
        seen["ours, one array"]["runs_per_cpu_second"] / seen["ours, one array, with reverse mode"]["runs_per_cpu_second"]
    )
    return seen
