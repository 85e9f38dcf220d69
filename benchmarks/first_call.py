"""Time in seconds from the first call of `simulate` in a new process to its result, without and
with a stored compilation cache."""

import os
import subprocess
import sys
import tempfile

import numpy as np

REPEATS = 3
CODE = """
import time, jax, jax.numpy as jnp
jax.config.update("jax_enable_x64", True)
from jaxspace import BodyState, Scene, simulate
from jaxspace.orbits import Oblateness, PointGravity, TwoBody
y = BodyState(jnp.array([1.1, 0.0, 0.0]), jnp.array([0.0, 0.8, 0.4]))
system = {system}
jax.block_until_ready(y)
start = time.perf_counter()
jax.block_until_ready(simulate(system, y, jnp.array([0.0, 10.0])).final)
print(time.perf_counter() - start)
"""
SYSTEMS = {
    "closed form": "TwoBody(1.0)",
    "gravity and oblateness": "Scene((PointGravity(1.0), Oblateness(1.0, 1e-3, 1.0)))",
}


def _seconds(system: str, cache: str | None) -> float:
    kept = (
        {}
        if cache is None
        else {"JAX_COMPILATION_CACHE_DIR": cache, "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0"}
    )
    bare = {k: v for k, v in os.environ.items() if not k.startswith("JAX_")}
    command = [sys.executable, "-c", CODE.format(system=system)]
    return float(
        subprocess.run(command, env=bare | kept, capture_output=True, text=True, check=True).stdout
    )


def measure() -> dict:
    """Medians of new processes."""
    rows = {}
    for name, system in SYSTEMS.items():
        with tempfile.TemporaryDirectory() as cache:
            _seconds(system, cache)
            rows[name] = {
                "cold_seconds": float(np.median([_seconds(system, None) for _ in range(REPEATS)])),
                "with_kept_cache_seconds": float(
                    np.median([_seconds(system, cache) for _ in range(REPEATS)])
                ),
            }
    return rows
