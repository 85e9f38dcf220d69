"""The processor cores of this process."""

import os


def cores() -> int:
    """Number of cores that this process may use."""
    # Containers and clusters often give a process fewer cores than the machine has.
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
