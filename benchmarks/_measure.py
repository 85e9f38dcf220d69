"""How everything here is measured: calls in turn in one process, first call apart, medians, and the
cores used."""

import math
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import mpmath
import numpy as np

REPEATS = 5
# A measurement, s.
SHORTEST = 0.1
BLOCK = 1024
WIDE = {"xla_cpu_prefer_vector_width": "512"}


def in_turn(
    calls: dict[str, Callable[[], Any]], runs: int | dict[str, int], repeats: int = REPEATS
) -> dict[str, dict[str, float]]:
    """For every call, which does `runs` runs of work (a number for all, or one for each): seconds
    of the first call, then, over repeats in turn, runs per second and per CPU-second (medians) and
    the mean number of cores used.

    Short calls are made several times in each turn, after one that is not timed: it finds what the
    call before it left in the caches of the processor."""
    first = {name: _timed(call)[0] for name, call in calls.items()}
    times = {name: math.ceil(SHORTEST / _timed(call)[0]) for name, call in calls.items()}
    seen = {name: [] for name in calls}
    for _ in range(repeats):
        for name, call in calls.items():
            if times[name] > 1:
                _timed(call)
            seen[name].append(_timed(call, times[name]))
    rows = {}
    for name, pairs in seen.items():
        wall, cpu = np.median(np.array(pairs), axis=0)
        done = runs[name] if isinstance(runs, dict) else runs
        rows[name] = {
            "runs_per_second": done / wall,
            "runs_per_cpu_second": done / cpu,
            "cores": cpu / wall,
            "first_call_seconds": first[name],
        }
    return rows


def _timed(call: Callable[[], Any], times: int = 1) -> tuple[float, float]:
    wall, cpu = time.perf_counter(), time.process_time()
    for _ in range(times):
        jax.block_until_ready(call())
    return (time.perf_counter() - wall) / times, (time.process_time() - cpu) / times


def on_one_device(tree: Any) -> Any:
    """The arrays, put on the first device: a batch of them does not spread over the others, and
    peers use one core."""
    return jax.device_put(tree, jax.devices()[0])


def worst(found: Any, reference: Any) -> float:
    """The largest relative error of vectors, components first and runs last.

    NaN where a run failed."""
    found = np.asarray(found)
    reference = np.asarray(reference)
    error = np.linalg.norm(found - reference, axis=0) / np.linalg.norm(reference, axis=0)
    return float(np.max(error))


def with_errors_of_rotation(
    rows: dict[str, dict], calls: dict[str, Callable[[], Any]], reference: np.ndarray
) -> dict[str, dict]:
    """The rows with the worst errors of the rate and of the attitude: every call and the reference
    give both, (3 + 4, runs)."""
    for name, call in calls.items():
        found = np.asarray(call())
        rows[name]["worst_error_of_the_rate"] = worst(found[:3], reference[:3])
        rows[name]["worst_error_of_the_attitude"] = worst(found[3:], reference[3:])
    return rows


def optional(name: str) -> Any:
    """The module of a peer, or `None` where it is not installed."""
    try:
        return __import__(name)
    except ImportError:
        return None


def oblate_orbit(heyoka, j2):
    """An orbit about an oblate body of unit gravitational parameter in heyoka's symbols, with `j2`
    times the square of the radius."""
    x, y, z, vx, vy, vz = heyoka.make_vars("x", "y", "z", "vx", "vy", "vz")
    r2 = x**2 + y**2 + z**2
    pull, c, s = r2 ** (-1.5), 1.5 * j2 / r2, 5.0 * z**2 / r2
    a = -pull * (1.0 + c * (1.0 - s))
    return [
        (x, vx),
        (y, vy),
        (z, vz),
        (vx, x * a),
        (vy, y * a),
        (vz, -z * pull * (1.0 + c * (3.0 - s))),
    ]


def heyoka_ends(
    equations: Callable[[Any], list], states: np.ndarray, span: float, tolerance: float
) -> Callable[[], np.ndarray]:
    """A call of heyoka's Taylor integrator, eight runs in one vector, over all `states`
    (components, runs): their ends."""
    heyoka = optional("heyoka")
    width = 8
    rows, runs = states.shape
    integrator = heyoka.taylor_adaptive_batch(
        equations(heyoka), np.zeros((rows, width)), tol=tolerance, fast_math=True
    )
    out = np.empty((rows, runs))

    def call() -> np.ndarray:
        for i in range(0, runs, width):
            integrator.set_time(0.0)
            integrator.state[:] = states[:, i : i + width]
            integrator.propagate_until(span)
            out[:, i : i + width] = integrator.state
        return out

    return call


def in_blocks(
    work: Callable[..., Any], given: tuple[Any, ...]
) -> tuple[Callable[[], Any], Callable[[], Any]]:
    """A call of `work` on arrays (components, runs), 1024 runs at a time, on one device, and one
    that shares them out among all; results (blocks, components, 1024)."""
    blocks = tuple(jnp.moveaxis(x.reshape(*x.shape[:-1], -1, BLOCK), -2, 0).copy() for x in given)
    mesh = jax.make_mesh((len(jax.devices()),), ("runs",))
    spread = jax.sharding.PartitionSpec("runs")
    shared = jax.device_put(blocks, jax.sharding.NamedSharding(mesh, spread))

    def all_blocks(blocks):
        return jax.lax.map(lambda block: work(*block), blocks)

    alone = jax.jit(all_blocks, compiler_options=WIDE)
    together = jax.jit(
        jax.shard_map(all_blocks, mesh=mesh, in_specs=(spread,), out_specs=spread, check_vma=False),
        compiler_options=WIDE,
    )
    return lambda: alone(blocks), lambda: together(shared)


def pykep(work: str, a: Any, b: Any, t: Any) -> tuple[dict[str, float], np.ndarray] | None:
    """The row of pykep's function `work` on vectors a, b, (3, runs), and times t, and the vectors
    it finds; `None`, with a sentence, where it does not run."""
    with tempfile.TemporaryDirectory() as folder:
        given, found = Path(folder) / "given.npz", Path(folder) / "found.npz"
        np.savez(given, a=np.asarray(a), b=np.asarray(b), t=np.asarray(t))
        script = Path(__file__).parent / "_pykep.py"
        child = subprocess.run(
            [sys.executable, str(script), work, str(given), str(found)],
            capture_output=True,
            text=True,
        )
        if not found.exists():
            reason = child.stderr.strip().splitlines()[-1]
            print(f"pykep does not run, so that it has no row: {reason}", file=sys.stderr)
            return None
        seen = np.load(found)
        wall, cpu = np.median(seen["seconds"], axis=0)
        runs = seen["vectors"].shape[-1]
        return {
            "runs_per_second": runs / wall,
            "runs_per_cpu_second": runs / cpu,
            "cores": cpu / wall,
        }, seen["vectors"]


def exact_position(r: Any, v: Any, t: Any) -> np.ndarray:
    """The position a time `t` after one state about a centre of gravitational parameter 1, in forty
    digits (Kepler, universal anomaly)."""
    with mpmath.workdps(40):
        r, v, t = (
            [mpmath.mpf(float(x)) for x in r],
            [mpmath.mpf(float(x)) for x in v],
            mpmath.mpf(float(t)),
        )
        size, sigma = mpmath.sqrt(mpmath.fdot(r, r)), mpmath.fdot(r, v)
        beta = 2 / size - mpmath.fdot(v, v)
        root = mpmath.sqrt(
            beta
        )  # imaginary on a hyperbola: the functions below are real all the same

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
        x = mpmath.findroot(
            late, (low, high), solver="anderson", tol=1e-60, maxsteps=500, verify=False
        )
        _, g2, g3 = g(x)
        return np.array(
            [float((1 - g2 / size) * a + (t - g3) * b) for a, b in zip(r, v, strict=True)]
        )
