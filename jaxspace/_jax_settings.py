"""JAX settings of the whole process: changed explicitly by the caller, never by an import."""

import os
import sys
from pathlib import Path


def enable_x64() -> None:
    """Enable float64 in JAX for this process. Call it before the first array is created."""
    import jax

    jax.config.update("jax_enable_x64", True)


def keep_programs(folder: "str | os.PathLike[str] | None" = None) -> Path:
    """Cache every program that this process compiles from now on, for later processes.

    A later process that makes the same call loads programs instead of compiling them. The command
    line does this automatically, in the same folder. A program is reused only with the same
    versions, the same kind of processor and the same shapes.

    **Arguments**

    - `folder`: location of the cache; created when the first program is written. By default that of
      the environment's `JAX_COMPILATION_CACHE_DIR`, or else `jaxspace` among the caches of the
      user's system. It may be deleted at any time.

    **Returns** the folder.

    **Raises** `InputError` where `folder` is a file."""
    import jax
    from jax.experimental.compilation_cache import compilation_cache

    path = Path(folder or os.environ.get("JAX_COMPILATION_CACHE_DIR") or _user_folder())
    path = path.expanduser().absolute()
    if path.exists() and not path.is_dir():
        from .core import InputError

        raise InputError(f"keep_programs: folder is {str(path)!r}: it must be a folder, or new.")
    jax.config.update("jax_compilation_cache_dir", str(path))
    # All of them: a program starts from nothing, and many small ones add up.
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
    # JAX looks for a folder at the first compilation alone, which may be over.
    compilation_cache.reset_cache()
    return path


def _user_folder() -> Path:
    """The cache folder of the user's system."""
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA", Path.home() / "AppData" / "Local"))
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return base / "jaxspace"
