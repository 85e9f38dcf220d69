"""The stored programs: which there are, and their removal."""

import time
from collections import Counter

from .._jax_settings import STORED, folder_of_programs
from ..core.program_folder import StoredFile, clear, stored_files

DAY = 86400.0


def programs(*, removes: bool) -> int:
    """List the stored programs by their functions, or remove them."""
    root = folder_of_programs() / STORED
    if removes:
        print(f"{clear(root)} stored programs removed from {root}")
        return 0
    files = stored_files(root)
    for machine in sorted({file.machine for file in files}):
        _print_machine(machine, [file for file in files if file.machine == machine])
    print(f"{len(files)} stored programs, {_size(files)}, in {root}")
    return 0


def _print_machine(machine: str, files: list[StoredFile]) -> None:
    """The programs for a type of processor, those with the largest files first."""
    print(machine)
    sizes: Counter[str] = Counter()
    for file in files:
        sizes[file.function] += file.size
    for function, _ in sizes.most_common():
        own = [file for file in files if file.function == function]
        days = (time.time() - max(file.used for file in own)) / DAY
        used = "today" if days < 1.0 else f"{days:.0f} days ago"
        print(f"  {function:<24} {len(own):>4}  {_size(own):>9}  last used {used}")
    print()


def _size(files: list[StoredFile]) -> str:
    return f"{sum(file.size for file in files) / 1e6:.1f} MB"
