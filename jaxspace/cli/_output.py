"""The files and the lines that a command writes."""

import contextlib
import os
import sys
from collections.abc import Iterator

from ..core import InputError
from ..core.text import printable


def harmless(text: str) -> str:
    """Lines of text with the codes of characters that a terminal would act on: it may come from
    files of others."""
    return "\n".join(map(printable, text.split("\n")))


def say(text: str) -> None:
    """Print text on the error output. Nothing where the terminal is gone."""
    with contextlib.suppress(OSError, ValueError):
        print(harmless(text), file=sys.stderr, flush=True)


def drop_output() -> None:
    """Discard output that could not be printed: Python would fail again when it flushes it at the
    end, and change the exit status."""
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def make_folder(name: str) -> None:
    """Make the folder for results. Raises `InputError` where nothing can be written."""
    try:
        os.makedirs(name, exist_ok=True)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise InputError(f"--out is {name}: the folder cannot be created: {reason}.") from error
    # Checked before the run, so that hours of computing do not end in a rejected write.
    if not os.access(name, os.W_OK | os.X_OK):
        raise InputError(f"--out is {name}: it must be a writable folder.")


@contextlib.contextmanager
def replacing(path: str) -> Iterator[str]:
    """A temporary path for a file that replaces `path` when it is complete: on a full disk an
    existing file is unchanged, and no partial file remains."""
    # A device, such as that of the output, cannot be replaced like a file.
    if os.path.exists(path) and not os.path.isfile(path):
        yield path
        return
    # Of a link, the file to which it leads is replaced.
    path = os.path.realpath(path)
    # With its extension, by which libraries choose the format.
    name = f".unfinished-{os.getpid()}{os.path.splitext(path)[1]}"
    unfinished = os.path.join(os.path.dirname(path), name)
    try:
        yield unfinished
        os.replace(unfinished, path)
    finally:
        with contextlib.suppress(OSError):
            os.unlink(unfinished)


def write_text(path: str, text: str) -> None:
    """Write a file of text, as a whole or not at all."""
    with replacing(path) as unfinished, open(unfinished, "w", encoding="utf-8") as out:
        out.write(text)
