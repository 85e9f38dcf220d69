"""Invalid input, reported in a message that names the field, the value and the allowed values.

Only values that are known are checked: a traced value passes, so that every check is free under
`jit`, `vmap` and `grad`."""

__all__ = ["check_finite", "check_non_negative", "check_positive", "is_concrete"]

from collections.abc import Iterable

import jax
import numpy as np
from jax.core import Tracer
from jax.typing import ArrayLike

from .suggestions import nearest

# Kinds of types of numbers: whole ones, with and without sign, real and complex.
NUMBERS = frozenset("iufc")


class InputError(ValueError):
    """A field has a value that is not allowed."""

    @staticmethod
    def hint(name: object, names: Iterable[str]) -> str:
        """The question for the nearest of the `names` that are allowed, or nothing when none is
        near."""
        return nearest(name, names)


def is_concrete(x: object) -> bool:
    """Whether `x` is a concrete number or array, and not a tracer, a placeholder or `None`."""
    # Asked first, because a tracer is an instance of `jax.Array` too.
    if isinstance(x, Tracer) or not isinstance(
        x, float | int | np.ndarray | np.generic | jax.Array
    ):
        return False
    # Booleans and text have no range that could be checked.
    known = isinstance(x, jax.Array | np.ndarray | np.generic)
    return (x if known else np.asarray(x)).dtype.kind in NUMBERS


def shown(x: object) -> str:
    """Numbers in the form of messages, on one line."""
    a = np.asarray(x)
    if a.ndim == 0:
        return f"{a.item():.6g}"
    # A sentence stays on one line, so that the command line can print one line for each error.
    return " ".join(np.array2string(a, precision=6, threshold=6).split("\n"))


def check(ok: ArrayLike, field: str, value: object, allowed: str) -> None:
    """Raise `InputError` unless `ok` is true everywhere; `allowed` completes the message "`field`
    is `value`: it must be ...".

    **Arguments**

    - `ok`: of each number, whether it is allowed.
    - `field`, `value`, `allowed`: named in the message."""
    if not np.all(ok):
        raise InputError(f"{field} is {shown(value)}: it must be {allowed}.")


def check_positive(field: str, value: object) -> None:
    """Raise `InputError` if the known `value` is not finite and above zero everywhere.

    **Arguments**

    - `field`: its name in the message.
    - `value`: a number or an array; a traced one passes."""
    if is_concrete(value):
        a = np.asarray(value)
        check(np.isfinite(a) & (a > 0.0), field, value, "positive and finite")


def check_non_negative(field: str, value: object) -> None:
    """Raise `InputError` if the known `value` is negative or not finite anywhere.

    **Arguments**

    - `field`: its name in the message.
    - `value`: a number or an array; a traced one passes."""
    if is_concrete(value):
        a = np.asarray(value)
        check(np.isfinite(a) & (a >= 0.0), field, value, "zero or positive, and finite")


def check_finite(field: str, value: object) -> None:
    """Raise `InputError` if the known `value` is NaN or infinite anywhere.

    **Arguments**

    - `field`: its name in the message.
    - `value`: a number or an array; a traced one passes."""
    if is_concrete(value):
        check(np.isfinite(np.asarray(value)), field, value, "finite")
