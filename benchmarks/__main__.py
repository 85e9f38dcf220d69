"""Runs every benchmark and prints what was measured, with the versions and the machine."""

import json
import os
import platform

import jax

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_num_cpu_devices", os.cpu_count() or 1)

from . import integrators, kick_stage  # noqa: E402


def main() -> None:
    """One block of JSON for each benchmark."""
    here = {
        "python": platform.python_version(),
        "jax": jax.__version__,
        "cores": os.cpu_count(),
        "backend": jax.default_backend(),
    }
    print(json.dumps({"machine": here}))
    for benchmark in (integrators, kick_stage):
        print(json.dumps({benchmark.__name__.split(".")[-1]: benchmark.measure()}, indent=1), flush=True)


if __name__ == "__main__":
    main()
