"""The check of whole numbers: of runs, of the size of a chunk, of a seed."""

import numpy as np

from ..core import InputError


def check_whole(name: str, value: object, least: int | None = None) -> None:
    """Raise `InputError` unless `value` is a whole number, and at least `least` if that is given.

    A float such as 1.0 is refused too: a computed one may be off by rounding."""
    # In Python a bool is an integer, but here it can only be a mistake.
    whole = int(value) if isinstance(value, int | np.integer) else None
    if whole is None or isinstance(value, bool) or (least is not None and whole < least):
        more = "" if least is None else f", {least} or more"
        raise InputError(f"{name} is {value!r}: it must be a whole number{more}.")
