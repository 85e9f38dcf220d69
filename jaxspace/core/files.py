"""Reading of text files that a user names, up to a limit of their size."""

import os
import stat
from pathlib import Path

from .checks import InputError

LARGEST = 64_000_000
"""Bytes of a file that are read: a campaign keeps the text of what it names in its store."""


def read_text(path: str | os.PathLike[str]) -> str:
    """The text of a file, without the mark of Unicode that spreadsheets write before it.

    Bytes that are not UTF-8 are replaced: a comment may be in any encoding. A path that a scene
    file gives has its `text`, which may be that of a store, and is not opened.

    **Raises** `OSError` for a file that cannot be opened, and `InputError` for one that is no
    regular file, as a device or a pipe, which may have no end, and for one of more than 64 MB."""
    known = getattr(path, "text", None)
    if known is not None:
        return known
    path = Path(path)
    result = path.stat()
    # Opening a folder raises a clear `OSError` itself.
    if not stat.S_ISREG(result.st_mode) and not stat.S_ISDIR(result.st_mode):
        raise InputError(f"{path} cannot be read: it is no regular file.")
    if result.st_size > LARGEST:
        raise InputError(
            f"{path} cannot be read: it has {result.st_size / 1e6:.0f} MB, and at most "
            f"{LARGEST / 1e6:.0f} MB are read."
        )
    return path.read_bytes().decode("utf-8-sig", errors="replace")
