"""Whether the memory suffices for the records of a run, with room for all of its `max_steps`."""

import os

import jax

from ..core import InputError

SHARE = 0.5
"""Share of the memory for recorded steps: a derivative holds the record and its source at once."""
SMALL = 2**28
"""Bytes that any machine has: below this the memory is not checked."""


def check_memory(what: str, steps: int, per_step: int) -> None:
    """Raise `InputError` if the records of all steps take more than `SHARE` of the memory.

    **Arguments**

    - `what`: the name of the records.
    - `steps`: the largest number of steps.
    - `per_step`: bytes of one step."""
    size = steps * per_step
    if size <= SMALL:
        return
    available = SHARE * memory()
    if size > available:
        raise InputError(
            f"Accuracy.max_steps is {steps}: with room for all of them {what} would take "
            f"{size / 1e9:.0f} GB of memory; on this machine it must be at most "
            f"{int(available) // per_step}."
        )


def memory() -> float:
    """Memory of the device in use, or of this machine, bytes; infinite if both are unknown."""
    # None from a CPU.
    limit = (jax.devices()[0].memory_stats() or {}).get("bytes_limit")
    if limit is not None:
        return limit
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    # Not a POSIX system.
    except (AttributeError, ValueError):
        return float("inf")
