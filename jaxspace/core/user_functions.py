"""Errors of functions that a user passes to the library: what to write instead.

While a program is traced, a number is a placeholder without a value. NumPy, `float` and `if` ask it
for its value, and JAX's message does not name the function that did.
"""

import contextlib
import traceback
from collections.abc import Iterator
from pathlib import Path

import jax

from .checks import InputError

PACKAGE = str(Path(__file__).resolve().parents[1])
# Frames of other libraries, which a user did not write.
LIBRARIES = ("site-packages", "dist-packages", PACKAGE)


@contextlib.contextmanager
def user_function(name: str) -> Iterator[None]:
    """In this context, convert an error about a number without a value to an `InputError` that
    names the function and the remedy; other errors pass.

    - `name`: of the function, as the start of the message: "Custom.function"."""
    try:
        yield
    except jax.errors.JAXTypeError as error:
        remedy = remedy_of(error)
        if not remedy:
            raise
        raise InputError(f"{name} {remedy}") from error


def reason_of(error: Exception) -> str:
    """The reason why a user's function failed: the remedy, or the first line of its error."""
    remedy = remedy_of(error)
    if remedy:
        return f"it {remedy}"
    return f"{type(error).__name__}: {(str(error).splitlines() or [''])[0]}"


def remedy_of(error: Exception) -> str:
    """What a user's function does with a number that has no value yet, and what to write instead;
    empty for another error."""
    if isinstance(error, jax.errors.TracerArrayConversionError):
        what = (
            "passes a traced array to NumPy or another library{}: use jax.numpy, such as jnp.sin "
            "in place of np.sin."
        )
    elif isinstance(error, jax.errors.TracerBoolConversionError):
        what = (
            "branches in Python on the value of a traced number (if, while, and, or, not){}: use "
            "jnp.where(condition, a, b), and &, | and ~ in place of and, or and not."
        )
    elif isinstance(error, jax.errors.TracerIntegerConversionError):
        what = (
            "uses a traced number as an index or a count of Python{}: index an array of JAX "
            "instead, or use jax.lax.fori_loop."
        )
    elif isinstance(error, jax.errors.ConcretizationTypeError):
        what = (
            "converts a traced number to a number of Python, as float(), int() and the functions "
            "of math do{}: use jax.numpy, such as jnp.sin in place of math.sin."
        )
    else:
        return ""
    return what.format(_place_of(error))


def _place_of(error: Exception) -> str:
    """The line of the user's code that raised the error, in parentheses; empty if unknown."""
    frames = [
        frame
        for frame in traceback.extract_tb(error.__traceback__)
        if not any(part in frame.filename for part in LIBRARIES) and frame.line
    ]
    return f" (line {frames[-1].lineno}: {frames[-1].line})" if frames else ""
