"""The text of a scene file, and its values as TOML has them.

A file may come from anybody, so that nothing about its text is taken for granted."""

import errno
import os
import select
import stat
import tomllib

from ._kinds.errors import SceneError
from ._kinds.kind import Value, Values

LONGEST = 4_000_000
"""Maximum number of characters of a scene file, about a hundred thousand lines."""
DEEPEST = 64
"""Maximum nesting depth of tables and lists of a file; no entry needs ten levels."""
PATIENCE = 10.0
"""Seconds in which the first of a text must come through a pipe."""
LONGEST_NUMBER = 1023
"""Bits of an integer that any float can represent."""


def read_toml(path: str | os.PathLike[str], text: str | None) -> tuple[Values, str]:
    """The values of a file, and its text, if it is not given as `text`.

    **Raises** `SceneError` for a file that cannot be read, is too long, or is not TOML."""
    try:
        # No more than needed to see that it is too long, because it may be endless.
        if text is None:
            text = _text_of(path)
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not text in UTF-8"
        raise SceneError(path, f"cannot be read: {reason}.") from error
    if len(text) > LONGEST:
        raise SceneError(
            path,
            f"is longer than {LONGEST:,} characters: move long tables into separate files that "
            "the scene file names.",
        )
    # The byte order mark that some editors write.
    text = text.removeprefix("\ufeff")
    try:
        data = tomllib.loads(text)
        _check_nested(data)
    except tomllib.TOMLDecodeError as error:
        # Messages begin with the path of the file, and continue in lower case.
        raise SceneError(path, f"is not TOML: {str(error)[0].lower()}{str(error)[1:]}.") from error
    except RecursionError:
        raise SceneError(
            path, f"is nested too deeply: at most {DEEPEST} levels are read."
        ) from None
    # Python itself does not read longer ones.
    except ValueError:
        raise SceneError(
            path, "has a whole number of more than 307 digits: it must have fewer."
        ) from None
    return data, text


def _text_of(path: str | os.PathLike[str]) -> str:
    """The text of a file, read only up to the length limit. Raises `OSError` also for a pipe
    into which nobody writes, at which it would wait for ever."""
    # Windows has neither such pipes nor the flag.
    handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
    with open(handle, encoding="utf-8") as file:
        if stat.S_ISFIFO(os.fstat(handle).st_mode):
            if not select.select([handle], [], [], PATIENCE)[0]:
                raise OSError(errno.EPIPE, "it is a pipe without a writer")
            os.set_blocking(handle, True)
        return file.read(LONGEST + 1)


def _check_nested(data: Values) -> None:
    """Raises `RecursionError` for tables and lists that are nested too deeply, and `ValueError` for
    a whole number beyond the range of a float."""
    level: list[Value] = [data]
    # Level by level, so that no depth can exceed that of Python's own calls.
    for _ in range(DEEPEST):
        if any(isinstance(x, int) and x.bit_length() > LONGEST_NUMBER for x in level):
            raise ValueError
        level = [
            x
            for inner in level
            if isinstance(inner, dict | list)
            for x in (inner.values() if isinstance(inner, dict) else inner)
        ]
    if level:
        raise RecursionError
