"""How everything here is measured: calls in turn in one process, first call apart, medians, and the cores used."""

import time
from collections.abc import Callable
from typing import Any

import jax
import numpy as np

REPEATS = 5


def in_turn(
    calls: dict[str, Callable[[], Any]], runs: int | dict[str, int], repeats: int = REPEATS
) -> dict[str, dict[str, float]]:
    """For every call, which does `runs` runs of work (a number for all, or one for each): seconds of the first call, then, over
    repeats in turn, runs per second and per CPU-second (medians) and the mean number of cores used."""
    first = {name: _timed(call)[0] for name, call in calls.items()}
    seen = {name: [] for name in calls}
    for _ in range(repeats):
        for name, call in calls.items():
            seen[name].append(_timed(call))
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


def _timed(call: Callable[[], Any]) -> tuple[float, float]:
    wall, cpu = time.perf_counter(), time.process_time()
    jax.block_until_ready(call())
    return time.perf_counter() - wall, time.process_time() - cpu


def on_one_device(tree: Any) -> Any:
    """The arrays, put on the first device: a batch of them does not spread over the others, and peers use one core."""
    return jax.device_put(tree, jax.devices()[0])


def worst(found: Any, reference: Any) -> float:
    """The largest relative error of the vectors on the last axis."""
    found, reference = np.asarray(found), np.asarray(reference)
    return float(np.max(np.linalg.norm(found - reference, axis=-1) / np.linalg.norm(reference, axis=-1)))


def with_errors_of_rotation(rows: dict[str, dict], calls: dict[str, Callable[[], Any]], reference: np.ndarray) -> dict[str, dict]:
    """The rows with the worst errors of the rate and of the attitude: every call and the reference give both, (runs, 3 + 4)."""
    for name, call in calls.items():
        found = np.asarray(call())
        rows[name]["worst_error_of_the_rate"] = worst(found[:, :3], reference[:, :3])
        rows[name]["worst_error_of_the_attitude"] = worst(found[:, 3:], reference[:, 3:])
    return rows


def optional(name: str) -> Any:
    """The module of a peer, or `None` where it is not installed."""
    try:
        return __import__(name)
    except ImportError:
        return None


def heyoka_ends(equations: Callable[[Any], list], states: np.ndarray, span: float, tolerance: float) -> Callable[[], np.ndarray]:
    """A call of heyoka's Taylor integrator, eight runs in one vector, over all `states` (components, runs): their ends."""
    heyoka = optional("heyoka")
    lanes = 8
    rows, runs = states.shape
    integrator = heyoka.taylor_adaptive_batch(equations(heyoka), np.zeros((rows, lanes)), tol=tolerance, fast_math=True)
    out = np.empty((rows, runs))

    def call() -> np.ndarray:
        for i in range(0, runs, lanes):
            integrator.set_time(0.0)
            integrator.state[:] = states[:, i : i + lanes]
            integrator.propagate_until(span)
            out[:, i : i + lanes] = integrator.state
        return out

    return call
