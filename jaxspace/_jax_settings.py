"""JAX settings of the whole process: changed explicitly by the caller, never by an import."""

import operator
import os
import sys
import types
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable

F = TypeVar("F")

STORED = "stored"
"""The part of the folder of programs with those that are loaded without tracing."""
LIMIT = "JAXSPACE_PROGRAMS_LIMIT"
LARGEST = 2_000_000_000


def enable_x64() -> None:
    """Enable float64 in JAX for this process. Call it before the first array is created."""
    import jax

    jax.config.update("jax_enable_x64", True)


def keep_programs(
    folder: "str | os.PathLike[str] | None" = None, *, limit: int | None = None
) -> Path:
    """Store every program that this process compiles from now on, for later processes.

    A later process that makes the same call with other numbers loads its programs: those of the
    functions of this package without tracing them, and all others from JAX's cache of compiled
    programs, which spares the compiler only. The command line does this automatically, in the same
    folder. A program is reused only with the same versions, the same kind of processor and the same
    shapes, and results do not depend on it.

    Programs that contain classes of the user, or functions without a name (`stored_as`), and those
    that call back into Python, are traced in every process. So are those of other devices than
    CPUs.

    **Arguments**

    - `folder`: location of the programs; created when the first program is written. By default that
      of the environment's `JAX_COMPILATION_CACHE_DIR`, or else `jaxspace` among the caches of the
      user's system. It may be deleted at any time. Loading a program runs its code: the folder must
      not be writable by others.
    - `limit`: the greatest size of the programs that are loaded without tracing, in bytes; those
      that were not used for the longest time are removed. With 0 there are none. By default that of
      the environment's `JAXSPACE_PROGRAMS_LIMIT`, or else 2 GB.

    **Returns** the folder.

    **Raises** `InputError` where `folder` is a file, or `limit` is not a whole number from 0 on."""
    import jax
    from jax.experimental.compilation_cache import compilation_cache

    from .core import program_folder, stored

    path = folder_of_programs(folder)
    size = _limit_of(limit)
    jax.config.update("jax_compilation_cache_dir", str(path))
    # All of them: a program starts from nothing, and many small ones add up.
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
    # JAX looks for a folder at the first compilation alone, which may be over.
    compilation_cache.reset_cache()
    stores = size > 0 and program_folder.can_store()
    stored.store_in(program_folder.ProgramFolder(path / STORED, size) if stores else None)
    return path


def stored_as(name: str) -> "Callable[[F], F]":
    """Give a function of yours a name, so that the programs that contain it are stored as well.

        @jaxspace.stored_as("height above the pad, version 1")
        def height(t, y): ...

    `keep_programs` identifies such a function by this name, its own code, its default arguments and
    the values that it captures. All other functions, classes and variables of yours to which it
    refers are not compared: give it another name when they change, or a later process runs a
    program with their earlier form.

    **Returns** a decorator of functions, including a `lambda`, which returns the same function.

    **Raises** `InputError` for an empty name, and for anything but a function written in Python."""
    from .core import InputError
    from .core.stored import NAME_OF_USER

    if not isinstance(name, str) or not name:
        raise InputError(f"stored_as: name is {name!r}: it must be a text that is not empty.")

    def named(function: F) -> F:
        if not isinstance(function, types.FunctionType):
            raise InputError(f"stored_as is applied to {function!r}: it must be a function.")
        setattr(function, NAME_OF_USER, name)
        return function

    return named


def folder_of_programs(folder: "str | os.PathLike[str] | None" = None) -> Path:
    """The folder of `keep_programs` with this argument.

    **Raises** `InputError` where it is a file."""
    path = Path(folder or os.environ.get("JAX_COMPILATION_CACHE_DIR") or _user_folder())
    path = path.expanduser().absolute()
    if path.exists() and not path.is_dir():
        from .core import InputError

        raise InputError(f"keep_programs: folder is {str(path)!r}: it must be a folder, or new.")
    return path


def _limit_of(limit: int | None) -> int:
    given = os.environ.get(LIMIT, str(LARGEST)) if limit is None else limit
    try:
        size = int(given) if isinstance(given, str) else operator.index(given)
    except (TypeError, ValueError):
        size = -1
    if size < 0:
        from .core import InputError

        name = f"the environment's {LIMIT}" if limit is None else "keep_programs: limit"
        raise InputError(f"{name} is {given!r}: it must be a number of bytes, 0 or more.")
    return size


def _user_folder() -> Path:
    """The cache folder of the user's system."""
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA", Path.home() / "AppData" / "Local"))
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return base / "jaxspace"
