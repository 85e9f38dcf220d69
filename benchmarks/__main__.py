"""Runs the benchmarks, prints what was measured, and keeps it beside the versions: `python -m
benchmarks [NAME ...]`. With `--device gpu` it runs the work for accelerators on that device."""

import argparse
import importlib
import json
import os
import platform
import sys

import jax

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_num_cpu_devices", os.cpu_count() or 1)

from . import page, result_files  # noqa: E402

NAMES = (
    *("kepler", "lambert", "low_orbits", "eccentric_orbit", "free_body", "torqued_body", "top"),
    *("ascent", "choice", "eccentric_orbits", "dragged_orbits", "short_pulses", "gradients"),
    *("hybrid_training", "first_call", "first_answers", "second_starts", "kick_stage"),
    *("elements", "porkchop"),
    *("effects", "crossings", "model_rocket", "campaign", "closed_loops"),
    *("environment_steps", "instruments", "dispersion_methods", "rare_events"),
    *("rocket_campaign", "of_others"),
    *("optimisers", "chapter_8", "which_method", "design"),
)


def machine() -> dict:
    """Where it was measured, and with what."""
    import diffrax

    return {
        "python": platform.python_version(),
        "jax": jax.__version__,
        "diffrax": diffrax.__version__,
        "cores": os.cpu_count(),
        "device": jax.devices()[0].device_kind,
        "instructions": result_files.described(),
    }


def keep(name: str, what: str, rows: dict) -> None:
    """Store the rows of one benchmark, and print them."""
    seen = {"what": what.split("\n\n")[0], "machine": machine(), "rows": rows}
    kind = "gpu" if name == "accelerator_gpu" else result_files.instructions()
    result_files.write(name, kind, seen)
    print(json.dumps({name: seen}, indent=1), flush=True)


def arguments() -> argparse.Namespace:
    """What the command line asks for."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(NAMES)}")
    parser.add_argument("--device", choices=("cpu", "gpu", "tpu"), help="for wide batches")
    parser.add_argument("--widths", type=int, nargs="+", help="runs of a wide batch")
    asked = parser.parse_args()
    if unknown := set(asked.names) - set(NAMES):
        parser.error(
            f"There is no benchmark {', '.join(sorted(unknown))}: choose from {', '.join(NAMES)}."
        )
    if asked.widths and not asked.device:
        parser.error("--widths is of a --device.")
    return asked


def main() -> None:
    """One file of results for each benchmark named, or for all; or that of a device."""
    asked = arguments()
    if asked.device:
        accelerator = importlib.import_module(".accelerator", __package__)
        if without := set(asked.names) - set(accelerator.WORKS):
            sys.exit(
                f"{', '.join(sorted(without))} has no work for a device: choose from "
                f"{', '.join(accelerator.WORKS)}."
            )
        widths, names = asked.widths or accelerator.WIDTHS, asked.names or accelerator.WORKS
        rows = accelerator.measure(asked.device, widths, tuple(names))
        keep(f"accelerator_{asked.device}", accelerator.__doc__, rows)
    else:
        for name in asked.names or NAMES:
            benchmark = importlib.import_module(f".{name}", __package__)
            keep(name, benchmark.__doc__, benchmark.measure())
    page.write((*NAMES, "accelerator_gpu"))


if __name__ == "__main__":
    main()
