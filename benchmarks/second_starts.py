"""Seconds of the processor that a command takes in a new process: the first time, with the programs
that JAX has cached from a command before it, and with the stored programs of such a command, which
are loaded without tracing. The scene of the command before has another title and another mass or
speed, and the same structure; imports are included, and given in the first row.

The commands draw their figures and write their pages as usual."""

import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
SCENES = ROOT / "examples/scenes"
REPEATS = 3
# The command and the scene; one of its numbers, and another one.
COMMANDS = {
    "run kick_stage": (("run", "kick_stage"), 'dry_mass = "1191 kg"', 'dry_mass = "1192 kg"'),
    "disperse kick_stage, 100 runs": (
        ("disperse", "kick_stage", "--runs", "100", "--overwrite"),
        *('dry_mass = "1191 kg"', 'dry_mass = "1192 kg"'),
    ),
    "optimize launch": (("optimize", "launch"), "title = ", "# edited\ntitle = "),
    "cost kick_stage": (("cost", "kick_stage"), 'dry_mass = "1191 kg"', 'dry_mass = "1192 kg"'),
}
IMPORTS = [sys.executable, "-c", "import jaxspace.cli._carry_out"]


def _seconds(command: list[str], folder: str, limit: int) -> float:
    """The processor time of a command in a new process."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith("JAX")}
    environment |= {
        "JAX_COMPILATION_CACHE_DIR": f"{folder}/programs",
        "JAXSPACE_PROGRAMS_LIMIT": str(limit),
        "PYTHONPATH": str(ROOT),
    }
    # Compiled modules of Python are written at the first import, and read by all others.
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, cwd=folder, env=environment, check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def _started(words: tuple[str, ...], number: str, other: str) -> dict[str, float]:
    """The seconds of a command by its three starts."""
    action, scene, *options = words
    text = (SCENES / f"{scene}.toml").read_text()
    if number not in text:
        raise ValueError(f"{scene}.toml does not contain {number}")
    command = [sys.executable, "-m", "jaxspace.cli", action, f"{scene}.toml", *options]
    result = {}
    for column, limit in (("with_kept_cache", 0), ("with_stored_programs", 10**9)):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"{scene}.toml"
            path.write_text(text.replace(number, other))
            first = _seconds(command, folder, limit)
            result.setdefault("first_cpu_seconds", first)
            path.write_text(text)
            again = [_seconds(command, folder, limit) for _ in range(REPEATS)]
            result[f"{column}_cpu_seconds"] = float(np.median(again))
    return result


def measure() -> dict:
    """Medians of new processes."""
    with tempfile.TemporaryDirectory() as folder:
        imports = [_seconds(IMPORTS, folder, 0) for _ in range(1 + REPEATS)][1:]
    rows = {"imports alone": {"first_cpu_seconds": float(np.median(imports))}}
    return rows | {name: _started(*given) for name, given in COMMANDS.items()}
