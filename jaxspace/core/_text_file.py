"""Files that users name, such as tables of measured values: read once, and below a size."""

import os
import stat
from pathlib import Path

from ._check import InputError

LARGEST = 64_000_000
"""Bytes of a named file that are read: a campaign keeps the text in its store."""


def read_text(path: str | os.PathLike[str]) -> str:
    """The text of a file that a user names; a path that knows its text gives it.

    **Arguments**

    - `path`: of a regular file of at most 64 MB; or what has a `read_text` of its own, such as the
      file of a scene whose text is in a store.

    **Raises** `InputError` with the path of a file that cannot be read.
    """
    known = None if isinstance(path, str | Path) else getattr(path, "read_text", None)
    if known is not None:
        return known()
    try:
        # A name with a zero byte is a `ValueError`.
        found = Path(path).stat()
        # What has no size of its own, such as a device or a pipe, may have no end.
        if not stat.S_ISREG(found.st_mode) and not stat.S_ISDIR(found.st_mode):
            raise ValueError("it is no regular file")
        if found.st_size > LARGEST:
            raise ValueError(
                f"it has {found.st_size / 1e6:.0f} MB, and at most {LARGEST / 1e6:.0f} MB are read"
            )
        data = Path(path).read_bytes()
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise InputError(f"{path} cannot be read: {reason}.") from None
    # With the mark of Unicode that spreadsheets write; a comment may be in any encoding.
    return data.decode("utf-8-sig", errors="replace")
