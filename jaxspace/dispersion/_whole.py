"""Whole numbers that are given as such: of runs, of a chunk, of a seed."""

import numpy as np

from ..core import InputError


def check_whole(name: str, value: object, least: int | None = None) -> None:
    """Raise `InputError` unless `value` is a whole number, and at least `least` if that is given.

    Not 1.0 either: a number that was computed may just have missed another one."""
    # A truth value is an integer of Python, and never meant as one.
    whole = int(value) if isinstance(value, int | np.integer) else None
    if whole is None or isinstance(value, bool) or (least is not None and whole < least):
        more = "" if least is None else f", {least} or more"
        raise InputError(f"{name} is {value!r}: it must be a whole number{more}.")
