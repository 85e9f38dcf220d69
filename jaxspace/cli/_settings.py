"""Settings of jax for the command line, and for nobody else: double precision, all cores, a cache
of compiled programs."""

import contextlib
import os
import sys
from pathlib import Path

import jax


def settle() -> None:
    """Set jax up for one command; to be called before the first array is made."""
    jax.config.update("jax_enable_x64", True)
    # A caller of `main` that has computed before has fixed the devices; they are then used as they
    # are.
    with contextlib.suppress(RuntimeError):
        jax.config.update("jax_num_cpu_devices", cores())
    if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
        jax.config.update("jax_compilation_cache_dir", str(cache_folder()))
    # Every program is kept: each command starts from nothing, and many small ones add up.
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)


def cores() -> int:
    """How many cores this process may use."""
    # Containers and clusters often give a process fewer cores than the machine has.
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def cache_folder() -> Path:
    """The folder for compiled programs, where the user's system keeps such things."""
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA", Path.home() / "AppData" / "Local"))
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return base / "jaxspace"
