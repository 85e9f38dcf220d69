"""The check of whole numbers: of runs, of the size of a chunk, of a seed."""

import numpy as np

from ..core import InputError

LARGEST_INTEGER = 2**31 - 1
"""The largest integer of a campaign, as in scene files: without double precision JAX has no
wider integers."""


def check_whole(name: str, value: object, least: int = 0) -> None:
    """Raise `InputError` unless `value` is a whole number from `least` to `LARGEST_INTEGER`.

    A float such as 1.0 is rejected too: a computed one may be off by rounding."""
    # In Python a bool is an integer, but here it can only be a mistake.
    whole = int(value) if isinstance(value, int | np.integer) else None
    if whole is None or isinstance(value, bool) or not least <= whole <= LARGEST_INTEGER:
        raise InputError(
            f"{name} is {value!r}: it must be a whole number from {least} to {LARGEST_INTEGER}."
        )
