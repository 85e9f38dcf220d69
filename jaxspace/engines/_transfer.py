"""The transfer of a campaign to a worker in another process, which computes chunks of it."""

import contextlib
import functools
import io
import pickle
import sys
from collections.abc import Iterator

import jax

from ..core import InputError
from ..core.user_code import run_module
from ._interface import AbstractRunner, Done, Extent, timed

# Settings of jax that change a program or its results, or define where compiled programs are
# stored.
SETTINGS = (
    "jax_enable_x64",
    "jax_numpy_dtype_promotion",
    "jax_disable_most_optimizations",
    "jax_compilation_cache_dir",
    "jax_persistent_cache_min_compile_time_secs",
    "jax_persistent_cache_min_entry_size_bytes",
)


@contextlib.contextmanager
def without_main() -> Iterator[None]:
    """Context for starting processes: they do not import the user's script, which would require a
    main guard, because its definitions are sent with the campaign."""
    main = sys.modules["__main__"]
    hidden = {name: main.__dict__.pop(name) for name in ("__file__",) if name in main.__dict__}
    spec = getattr(main, "__spec__", None)
    main.__spec__ = None
    try:
        yield
    finally:
        main.__dict__.update(hidden)
        main.__spec__ = spec


def payload_of(runner: AbstractRunner) -> bytes:
    """The components of the runner, with the settings of JAX, for another process.

    Raises `InputError` if it contains objects that cannot be sent."""
    settings = {name: jax.config.values[name] for name in SETTINGS}
    # Copied from the device, which another process may not have.
    arrays = jax.device_get(runner.prepared)
    buffer = io.BytesIO()
    try:
        # cloudpickle sends the code of functions, so that those of the user's script arrive too.
        import cloudpickle as pickler
    except ImportError:
        pickler = pickle
    try:
        pickler.dump((type(runner), arrays), buffer)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise InputError(
            f"The campaign cannot be sent to another process ({error}): install cloudpickle, which "
            "is part of the extra cluster, or define its functions in a module."
        ) from error
    # The modules travel apart, because they must have run before the campaign is read.
    return pickle.dumps((settings, runner.modules, buffer.getvalue()))


# One is sufficient: a worker processes campaigns in sequence, each for a long time.
@functools.lru_cache(maxsize=1)
def _runner(payload: bytes) -> AbstractRunner:
    settings, modules, written = pickle.loads(payload)
    # Before the campaign is read: its arrays would lose their double precision.
    for name, value in settings.items():
        jax.config.update(name, value)
    for name, text in modules:
        run_module(name, text)
    kind, prepared = pickle.loads(written)
    return kind.in_worker(prepared, jax.local_devices())


def compute_chunk(payload: bytes, extent: Extent) -> Done:
    """A chunk, in a worker."""
    return timed(_runner(payload), extent)
