"""Settings of JAX for the command line only: double precision, all cores, and a cache
of compiled programs."""

import contextlib
import gc

from .._jax_settings import enable_x64, keep_programs


def settle(*, once: bool = False) -> None:
    """Configure JAX for one command; to be called before the first array is created.

    `once`: whether the command runs each program once. The compiler's optimisations then cost more
    than they save: half of the wait for a rocket's flight. A command after one of the other kind
    recompiles its programs, so that its results are bit-identical to those of a separate
    process."""
    # Here, because the parser refers to the commands, and they to this file.
    import jax

    from ..core.processors import cores

    enable_x64()
    # A caller of `main` that has computed before has fixed the devices; they are then used as they
    # are.
    with contextlib.suppress(RuntimeError):
        jax.config.update("jax_num_cpu_devices", cores())
    keep_programs()
    # A trace leaves little garbage compared with its live objects: searching for it, at the default
    # frequency of Python, takes a thirtieth of the command.
    gc.set_threshold(100_000, 20, 100)
    if jax.config.read("jax_disable_most_optimizations") != once:
        jax.config.update("jax_disable_most_optimizations", once)
        jax.clear_caches()
