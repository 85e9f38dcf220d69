"""Runs the benchmarks, prints what was measured, and keeps it beside the versions: `python -m
benchmarks [NAME ...]`."""

import importlib
import json
import os
import platform
import sys
from pathlib import Path

import jax

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_num_cpu_devices", os.cpu_count() or 1)

from . import page  # noqa: E402

NAMES = (
    *("kepler", "lambert", "low_orbits", "eccentric_orbit", "free_body", "torqued_body", "top"),
    *("ascent", "choice", "eccentric_orbits", "dragged_orbits", "short_pulses", "gradients"),
    *("hybrid_training", "first_call", "first_answers", "kick_stage", "elements", "porkchop"),
    *("effects", "crossings", "model_rocket", "campaign", "closed_loops"),
    *("environment_steps", "instruments", "dispersion_methods", "rocket_campaign", "optimisers"),
)
RESULTS = Path(__file__).parent / "results"


def machine() -> dict:
    """Where it was measured, and with what."""
    import diffrax

    return {
        "python": platform.python_version(),
        "jax": jax.__version__,
        "diffrax": diffrax.__version__,
        "cores": os.cpu_count(),
        "device": jax.devices()[0].device_kind,
    }


def main() -> None:
    """One file of results for each benchmark named, or for all."""
    names = sys.argv[1:] or NAMES
    if unknown := set(names) - set(NAMES):
        sys.exit(
            f"There is no benchmark {', '.join(sorted(unknown))}: choose from {', '.join(NAMES)}."
        )
    RESULTS.mkdir(exist_ok=True)
    for name in names:
        benchmark = importlib.import_module(f".{name}", __package__)
        seen = {
            "what": benchmark.__doc__.split("\n\n")[0],
            "machine": machine(),
            "rows": benchmark.measure(),
        }
        (RESULTS / f"{name}.json").write_text(json.dumps(seen, indent=1) + "\n")
        print(json.dumps({name: seen}, indent=1), flush=True)
    page.write(RESULTS, NAMES)


if __name__ == "__main__":
    main()
